//! Whether a system knows which points of two pictures are the same point of a thing, where the truth is known.
//!
//! A pixel of one held-out view that shows something that moves, and that the other view truly shows, is brought there: to the
//! pixel whose canonical point is nearest to its own. How far that lies from where the point exactly is counts, in pixels, and
//! whether it comes within 5 % of the picture's longer side (PCK-T of DyCheck: Gao et al., "Monocular Dynamic View Synthesis: A
//! Reality Check", 2022).
//!
//! Distances of canonical points are not the score: a warp that sends everything to one place would have them all 0. The
//! nearest of all pixels is asked for, and where everything is in one place none is nearer than the others: the first one is
//! taken, and that is wrong. Exact canonical points score about half a pixel, as the other picture is sampled in pixel centres.

use crate::data::Dataset;
use crate::error::RunError;
use rayon::prelude::*;

/// Points of a pair of views that are searched, at most: evenly spaced among all that could be.
pub const QUERIES: usize = 256;
/// A point counts as found within this share of the picture's longer side.
pub const FOUND: f64 = 0.05;

/// How well points of one view are found in another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transfer {
    /// Mean distance from where they are, pixels. One that is not searched, because the render shows no surface there, or
    /// that no surface of the other render can be, counts with the picture's longer side.
    pub error: f64,
    /// Share of them within [`FOUND`] of it, `0..=1`.
    pub found: f64,
}

/// A point that is searched in another picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sought {
    /// Its canonical point; infinite where the render shows nothing.
    pub canonical: [f64; 3],
    /// Where the other picture shows it, pixels.
    pub truth: [f64; 2],
}

/// Search points in a picture of `width` columns whose pixels show the canonical points `there`, `[height * width]`,
/// infinite where there are none. `None` where no point is searched.
///
/// Takes `sought * there` distances. The same bits with any number of threads; the first of equally near pixels is taken.
///
/// # Panics
/// When `width` is 0 or does not divide the number of pixels.
#[must_use]
pub fn transfer(sought: &[Sought], there: &[[f64; 3]], width: u32) -> Option<Transfer> {
    let columns = width as usize;
    assert!(columns > 0 && there.len().is_multiple_of(columns), "{} pixels in rows of {columns}", there.len());
    let longer = columns.max(there.len() / columns) as f64;
    let off = |sought: &Sought| -> Option<f64> {
        let k = nearest(sought.canonical, there)?;
        let [x, y] = [(k % columns) as f64 + 0.5, (k / columns) as f64 + 0.5];
        Some((x - sought.truth[0]).hypot(y - sought.truth[1]))
    };
    let offs: Vec<Option<f64>> = sought.par_iter().map(off).collect();
    let n = (!offs.is_empty()).then_some(offs.len() as f64)?;
    Some(Transfer {
        error: offs.iter().map(|off| off.unwrap_or(longer)).sum::<f64>() / n,
        found: offs.iter().flatten().filter(|off| **off <= FOUND * longer).count() as f64 / n,
    })
}

/// Which of `there` is nearest; `None` where all distances are infinite or NaN.
fn nearest(point: [f64; 3], there: &[[f64; 3]]) -> Option<usize> {
    let (mut best, mut least) = (None, f64::INFINITY);
    for (k, other) in there.iter().enumerate() {
        let distance: f64 = (0..3).map(|a| (other[a] - point[a]).powi(2)).sum();
        if distance < least {
            (best, least) = (Some(k), distance);
        }
    }
    best
}

/// A view, the one that its points are searched in, and which of its pixels these are.
#[derive(Debug)]
struct Pair {
    from: usize,
    to: usize,
    /// Pixel, where the other picture shows it.
    pixels: Vec<(usize, [f64; 2])>,
}

/// The pairs of views of an evaluation. Keeps 24 bytes for each pixel of the views that take part.
#[derive(Debug, Default)]
pub(super) struct Correspondence {
    pairs: Vec<Pair>,
    /// `[views]`, canonical points of those that take part.
    kept: Vec<Vec<[f64; 3]>>,
}

impl Correspondence {
    /// The held-out views whose flow to another one of `data`, of the same level, is known.
    ///
    /// # Errors
    /// [`RunError::Scene`] for truth that cannot be read.
    pub(super) fn of(data: &Dataset) -> Result<Self, RunError> {
        let mut pairs = Vec::new();
        for (from, view) in data.views().iter().enumerate().filter(|(_, v)| v.source.split.is_measured()) {
            let Some((flow, to)) = view.source.read_flow()? else { continue };
            let Some(to) = data.views().iter().position(|v| v.name == to && v.level == view.level) else { continue };
            let Some(moving) = view.source.read_moving()? else { continue };
            let (width, height) = (view.camera.width, view.camera.height);
            let other = &data.view(to).camera;
            if (other.width, other.height) != (width, height) {
                // The flow is in pixels of pictures of one size.
                continue;
            }
            let (flow, moving) = (flow.resized(width, height), moving.resized(width, height));
            let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            let counts = places.enumerate().filter(|&(_, (x, y))| moving.get(x, y) && flow.seen.get(x, y));
            let all: Vec<(usize, [f64; 2])> = counts
                .map(|(k, (x, y))| {
                    let [u, v] = flow.vectors[k].map(f64::from);
                    (k, [f64::from(x) + 0.5 + u, f64::from(y) + 0.5 + v])
                })
                .collect();
            let n = all.len().min(QUERIES);
            pairs.push(Pair { from, to, pixels: (0..n).map(|i| all[i * all.len() / n]).collect() });
        }
        Ok(Self { pairs, kept: vec![Vec::new(); data.len()] })
    }

    /// Whether a view takes part.
    pub(super) fn wants(&self, view: usize) -> bool {
        self.pairs.iter().any(|pair| pair.from == view || pair.to == view)
    }

    /// Canonical points of a view, `[height * width]`.
    pub(super) fn keep(&mut self, view: usize, canonical: Vec<[f64; 3]>) {
        if self.wants(view) {
            self.kept[view] = canonical;
        }
    }

    /// Scores of the views that have one, when all of them were kept.
    pub(super) fn scores(&self, data: &Dataset) -> Vec<(usize, Transfer)> {
        let score = |pair: &Pair| {
            let here = &self.kept[pair.from];
            let sought: Vec<Sought> =
                pair.pixels.iter().map(|&(k, truth)| Sought { canonical: here[k], truth }).collect();
            let found = transfer(&sought, &self.kept[pair.to], data.view(pair.to).camera.width);
            found.map(|found| (pair.from, found))
        };
        self.pairs.iter().filter_map(score).collect()
    }
}

#[cfg(test)]
mod tests;
