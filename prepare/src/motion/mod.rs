//! What moves by itself: pixels whose flow no point that stays could make.
//!
//! With known cameras, a point that stays lies in a neighbouring picture on the epipolar line of its pixel. Its distance from there (Sampson)
//! is taken to each neighbour; above a threshold it moves. What moves along the line is not found, nor anything from cameras
//! that stand at one place.
//!
//! # Source
//! Liu et al., "Robust dynamic radiance fields", 2023, who find the lines from the flow itself; the thresholds are our own.

mod epipolar;
mod morphology;

use epipolar::{Deviation, Epipolar};
use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::Camera;
use scene_io::{BitMask, Flow};

/// Distance from the epipolar line below which nothing counts as moving, pixels: what a flow is wrong by here and there.
const LEAST_DISTANCE: f64 = 0.75;
/// Distances above the median by so many standard deviations (1.4826 times the median of the deviations from it) are none of the
/// flow's errors.
const OUTLIER: f64 = 5.0;
/// Median parallax, pixels, below which the line's direction is not known: two cameras at nearly one place.
const LEAST_PARALLAX: f64 = 0.5;
/// Share of a picture's pixels whose flow has to be known.
const LEAST_KNOWN: f64 = 0.01;
/// Radius of the specks that are taken out, and of the gaps that are filled, pixels.
const SPECK: u32 = 1;
const GAP: u32 = 2;

/// Another photo taken at another time.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// Its camera, at its photo's size.
    pub camera: &'a Camera,
    /// Flow from the photo in question to it.
    pub flow: &'a Flow,
}

/// What moves in a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Pixels that show something that moves.
    pub moving: BitMask,
    /// Pixels that were judged, by the flow to some neighbour; the others are not in `moving`, and nothing is known of them.
    pub judged: BitMask,
}

impl Motion {
    /// Whether nothing could be judged: no neighbour, none far enough away, or hardly any flow known.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        self.judged.count() == 0
    }
}

/// How far each pixel's flow to one neighbour is from its epipolar line; `None`: not judged.
struct Distances {
    pixels: Vec<Option<f32>>,
    /// Above this it moves.
    threshold: f32,
}

/// The pixels of a photo, taken by `camera`, that show something that moves by itself: to some neighbour their flow leads off the epipolar line,
/// by more than 0.75 pixels and by more than the errors of that flow. Specks are taken out and small gaps filled.
///
/// Neighbours whose camera stands at nearly the same place (median parallax below half a pixel) say nothing.
///
/// # Panics
/// If a flow has not the size of the camera's photo.
#[must_use]
pub fn motion(camera: &Camera, neighbours: &[Neighbour<'_>]) -> Motion {
    let (width, height) = (camera.width, camera.height);
    let known: Vec<Distances> = neighbours.iter().filter_map(|neighbour| distances(camera, neighbour)).collect();
    let at = |column: u32, row: u32| row as usize * width as usize + column as usize;
    let judged = BitMask::from_fn(width, height, |column, row| {
        known.iter().any(|distances| distances.pixels[at(column, row)].is_some())
    });
    let found = BitMask::from_fn(width, height, |column, row| {
        known.iter().any(|distances| distances.pixels[at(column, row)].is_some_and(|d| d > distances.threshold))
    });
    let clean = morphology::closed(&morphology::opened(&found, SPECK), GAP);
    let moving = BitMask::from_fn(width, height, |column, row| clean.get(column, row) && judged.get(column, row));
    Motion { moving, judged }
}

/// `None` where the neighbour says nothing.
fn distances(camera: &Camera, neighbour: &Neighbour<'_>) -> Option<Distances> {
    let flow = neighbour.flow;
    assert_eq!((flow.width, flow.height), (camera.width, camera.height), "flow and photo of two sizes");
    let epipolar = Epipolar::new(camera, neighbour.camera)?;
    let row = |row: u32| -> Vec<Option<Deviation>> {
        let pixel = |column: u32| {
            if !flow.seen.get(column, row) {
                return None;
            }
            let [u, v] = flow.vectors[row as usize * flow.width as usize + column as usize].map(f64::from);
            let centre = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            epipolar.deviation(centre, DVec2::new(u, v))
        };
        (0..flow.width).map(pixel).collect()
    };
    let rows: Vec<Vec<Option<Deviation>>> = (0..flow.height).into_par_iter().map(row).collect();
    let all: Vec<Option<Deviation>> = rows.into_iter().flatten().collect();
    let known: Vec<Deviation> = all.iter().copied().flatten().collect();
    if (known.len() as f64) < LEAST_KNOWN * all.len() as f64 {
        return None;
    }
    if median(known.iter().map(|d| d.parallax).collect())? < LEAST_PARALLAX {
        return None;
    }
    let middle = median(known.iter().map(|d| d.sampson).collect())?;
    let spread = 1.4826 * median(known.iter().map(|d| (d.sampson - middle).abs()).collect())?;
    let threshold = LEAST_DISTANCE.max(middle + OUTLIER * spread) as f32;
    Some(Distances { pixels: all.iter().map(|d| d.map(|d| d.sampson as f32)).collect(), threshold })
}

/// The middle value, the upper one of two; `None` of none.
fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests;
