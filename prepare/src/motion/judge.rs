//! What moves, once it is known how far each pixel's flow is from what a point that stays could make.

use super::morphology;
use glam::DVec2;
use rayon::prelude::*;
use scene_io::{BitMask, Flow, Size};

/// Distance from what a point that stays could make below which nothing counts as moving, pixels: what a flow is wrong by here and there.
pub(super) const LEAST_DISTANCE: f64 = 0.75;
/// A pixel moves where its distance is more than this many standard deviations above the median. The standard deviation is taken to be
/// 1.4826 times the median of absolute deviations, which what moves does not change.
const OUTLIER: f64 = 5.0;
/// Share of a picture's pixels whose flow has to be known.
const LEAST_KNOWN: f64 = 0.01;
/// Radius of the specks that are taken out, and of the gaps that are filled, pixels.
const SPECK: u32 = 1;
const GAP: u32 = 2;

/// What moves in a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Pixels that show something that moves.
    pub moving: BitMask,
    /// Pixels that were judged, by the flow to some neighbour; the others are not in `moving`, and nothing is known of them.
    pub judged: BitMask,
}

impl Motion {
    /// Whether nothing could be judged: no neighbour, none that says something, or hardly any flow known.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        self.judged.count() == 0
    }

    /// The pixels that move by the flow to some neighbour. Specks are taken out and small gaps filled.
    pub(super) fn of(size: Size, neighbours: &[Distances]) -> Self {
        let Size { width, height } = size;
        let at = |column: u32, row: u32| row as usize * width as usize + column as usize;
        let judged = BitMask::from_fn(width, height, |column, row| {
            neighbours.iter().any(|of| of.pixels[at(column, row)].is_some())
        });
        let found = BitMask::from_fn(width, height, |column, row| {
            neighbours.iter().any(|of| of.pixels[at(column, row)].is_some_and(|d| d > of.threshold))
        });
        let clean = morphology::closed(&morphology::opened(&found, SPECK), GAP);
        let moving = BitMask::from_fn(width, height, |column, row| clean.get(column, row) && judged.get(column, row));
        Self { moving, judged }
    }
}

/// How far each pixel's flow to one neighbour is from what a point that stays could make.
pub(super) struct Distances {
    /// Pixels; `None`: not judged.
    pixels: Vec<Option<f32>>,
    /// Above this it moves.
    threshold: f32,
}

impl Distances {
    /// Of the distances of all pixels; `None` where hardly any is known.
    pub(super) fn of(pixels: &[Option<f64>]) -> Option<Self> {
        let known: Vec<f64> = pixels.iter().copied().flatten().collect();
        if (known.len() as f64) < LEAST_KNOWN * pixels.len() as f64 {
            return None;
        }
        let middle = median(known.clone())?;
        let spread = 1.4826 * median(known.iter().map(|d| (d - middle).abs()).collect())?;
        let threshold = LEAST_DISTANCE.max(middle + OUTLIER * spread) as f32;
        Some(Self { pixels: pixels.iter().map(|d| d.map(|d| d as f32)).collect(), threshold })
    }
}

/// What `of` says of each pixel (its centre) and its flow vector; `None` where the flow is not known.
pub(super) fn of_pixels<T: Send>(flow: &Flow, of: impl Fn(DVec2, DVec2) -> Option<T> + Sync) -> Vec<Option<T>> {
    let row = |row: u32| -> Vec<Option<T>> {
        let pixel = |column: u32| {
            if !flow.seen.get(column, row) {
                return None;
            }
            let [u, v] = flow.vectors[row as usize * flow.width as usize + column as usize].map(f64::from);
            let centre = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            of(centre, DVec2::new(u, v))
        };
        (0..flow.width).map(pixel).collect()
    };
    let rows: Vec<Vec<Option<T>>> = (0..flow.height).into_par_iter().map(row).collect();
    rows.into_iter().flatten().collect()
}

/// The middle value, the upper one of two; `None` of none.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_values_is_found() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0]), Some(4.0));
    }

    #[test]
    fn what_is_far_beyond_the_others_moves_and_what_a_noisy_flow_is_wrong_by_does_not() {
        // 20 x 10 pixels, of which a block of 6 x 6 has another distance.
        let size = Size::new(20, 10);
        let moving = |usual: f64, of_block: f64| {
            let pixel = |k: u32| {
                let (column, row) = (k % 20, k / 20);
                let is_inside = (8..14).contains(&column) && (2..8).contains(&row);
                Some(if is_inside { of_block } else { usual * (1.0 + 0.2 * f64::from(k % 3)) })
            };
            let distances = Distances::of(&(0..200).map(pixel).collect::<Vec<_>>()).unwrap();
            Motion::of(size, &[distances]).moving.count()
        };
        // All of the block or nothing.
        assert_eq!([moving(0.1, 0.7), moving(0.1, 0.8)], [0, 36]);
        assert_eq!([moving(2.0, 3.5), moving(2.0, 12.0)], [0, 36]);
    }

    #[test]
    fn hardly_any_flow_says_nothing() {
        let pixel = |known: usize| (0..1000).map(|k| (k < known).then_some(0.0)).collect::<Vec<_>>();
        assert!(Distances::of(&pixel(9)).is_none() && Distances::of(&pixel(10)).is_some());
        assert!(Distances::of(&[]).is_none());
        let nothing = Motion::of(Size::new(4, 3), &[]);
        assert!(nothing.is_blind() && nothing.moving.count() == 0);
    }
}
