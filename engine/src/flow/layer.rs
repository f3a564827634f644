//! Flow of a whole picture: a vector for each pixel, its colours, and which length has the fullest one.

use super::wheel::colour;
use super::{Shot, each_flow};
use crate::camera_path::FRAMES;
use crate::render::Rendered;
use crate::system::System;
use crate::time_path::TimePath;
use image::{Rgb, RgbImage};
use scene_io::{BitMask, Flow};

/// Flow that is shorter than this counts as no motion, pixels.
const STILL: f64 = 0.1;
/// Share of what moves that the length of the fullest colour is taken from: the rest may be seen from so near that all else would be
/// pale beside it. And room above that: not every pixel was looked at.
const SHARE: f64 = 0.98;
const ROOM: f64 = 1.05;
/// Pixels of a picture that tell how long its flow is, about.
const LOOKED_AT: usize = 1 << 14;
/// How far beyond the last time step a time may be by rounding.
const ROUNDED: f64 = 1e-9;

/// Optical flow of what `view` shows, which is the picture of `here`, to the picture of `next`: a pixel counts as seen where its flow is
/// known, and has the vector 0 elsewhere. `None` as soon as `go_on` says no.
///
/// # Panics
/// As [`each_flow`].
#[must_use]
pub fn whole_flow(
    system: &dyn System,
    view: &Rendered,
    here: Shot<'_>,
    next: Shot<'_>,
    go_on: &dyn Fn() -> bool,
) -> Option<Flow> {
    let (width, height) = (view.width, view.height);
    let mut vectors = vec![[0.0; 2]; width as usize * height as usize];
    let mut seen = BitMask::new(width, height);
    let is_whole = each_flow(system, view, here, next, go_on, |i, flow| {
        if let Some(flow) = flow {
            vectors[i] = flow.as_vec2().to_array();
            seen.set((i % width as usize) as u32, (i / width as usize) as u32);
        }
    });
    is_whole.then_some(Flow { width, height, vectors, seen })
}

/// The way through time from a frame of a path to the next one, where neither frames nor times are said: the whole sequence in
/// [`FRAMES`] frames.
#[must_use]
pub fn usual_step() -> f64 {
    TimePath::WHOLE.at(1, FRAMES)
}

/// As [`whole_flow`], where the camera stays and time goes on by [`usual_step`]: the motion of things alone. Where the sequence ends
/// before, it is the way from a step earlier, taken to be as long and as straight: that to there, turned round.
///
/// # Panics
/// As [`each_flow`].
#[must_use]
pub fn flow_in_place(system: &dyn System, view: &Rendered, here: Shot<'_>, go_on: &dyn Fn() -> bool) -> Option<Flow> {
    let later = here.time + usual_step();
    let is_last = later > 1.0 + ROUNDED;
    let time = if is_last { here.time - usual_step() } else { later.min(1.0) };
    let mut flow = whole_flow(system, view, here, Shot { time, ..here }, go_on)?;
    if is_last {
        flow.vectors.iter_mut().for_each(|vector| *vector = vector.map(|x| -x));
    }
    Some(flow)
}

/// Flow as colours of the wheel of Middlebury, `full` being the length of the fullest one, pixels, above 0; black where it is not known.
///
/// # Panics
/// If the flow does not hold what its size says.
#[must_use]
pub fn coloured(flow: &Flow, full: f64) -> RgbImage {
    let width = flow.width as usize;
    RgbImage::from_fn(flow.width, flow.height, |x, y| {
        let vector = flow.vectors[y as usize * width + x as usize];
        Rgb(if flow.seen.get(x, y) { colour(vector, full as f32) } else { [0; 3] })
    })
}

/// Length of the fullest colour for a picture `scale` times as large as that of this flow, its pixels: what most of what moves does not
/// exceed. `None` where nothing moves.
#[must_use]
pub fn full_length(flow: &Flow, scale: f64) -> Option<f64> {
    let every = flow.vectors.len().div_ceil(LOOKED_AT).max(1);
    let looked_at = flow.vectors.iter().zip(flow.seen.iter()).step_by(every);
    let known = looked_at.filter(|(_, seen)| *seen);
    length_of_most(known.map(|(vector, _)| scale * f64::from(vector[0]).hypot(f64::from(vector[1]))).collect())
}

/// Length of the fullest colour for vectors of these lengths, pixels; `None` where none is of what moves.
pub(super) fn length_of_most(mut lengths: Vec<f64>) -> Option<f64> {
    lengths.retain(|length| *length > STILL && length.is_finite());
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len().saturating_sub(1);
    lengths.get((SHARE * last as f64).round() as usize).map(|length| ROOM * length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow(width: u32, height: u32, vector: impl Fn(u32) -> Option<[f32; 2]>) -> Flow {
        let vectors = (0..width * height).map(|k| vector(k).unwrap_or_default()).collect();
        let seen = BitMask::from_fn(width, height, |x, y| vector(y * width + x).is_some());
        Flow { width, height, vectors, seen }
    }

    #[test]
    fn colours_are_those_of_the_vectors_and_black_where_nothing_is_known() {
        let flow = flow(3, 2, |k| (k != 4).then_some([k as f32, 0.5 - k as f32]));
        let picture = coloured(&flow, 2.0);
        assert_eq!(picture.dimensions(), (3, 2));
        for (k, pixel) in picture.pixels().enumerate() {
            let want = if k == 4 { [0; 3] } else { colour([k as f32, 0.5 - k as f32], 2.0) };
            assert_eq!(pixel.0, want, "pixel {k}");
        }
    }

    #[test]
    fn the_fullest_colour_is_for_what_most_of_what_moves_does_not_exceed() {
        // Half stands still, one is lost, a hundredth goes very far.
        let mixed = |k: u32| match k % 200 {
            0 => Some([900.0, 0.0]),
            1 => None,
            k if k < 100 => Some([3.0, -4.0]),
            _ => Some([0.01, 0.0]),
        };
        let full = full_length(&flow(20, 30, mixed), 2.0).unwrap();
        assert!((full - 1.05 * 10.0).abs() < 1e-9, "{full}");
        // Large pictures are looked at here and there.
        let large = flow(400, 300, |_| Some([0.0, 6.0]));
        assert!((full_length(&large, 1.0).unwrap() - 1.05 * 6.0).abs() < 1e-9);
        // What is still in a small picture may move in a large one.
        let slow = flow(4, 4, |_| Some([0.06, 0.0]));
        assert!(full_length(&slow, 1.0).is_none() && full_length(&slow, 2.0).is_some());
        let [lost, far] = [f32::NAN, f32::INFINITY].map(|x| flow(2, 2, |_| Some([x; 2])));
        for nothing in [flow(4, 4, |_| None), flow(0, 0, |_| None), lost, far] {
            assert_eq!(full_length(&nothing, 1.0), None);
        }
    }
}
