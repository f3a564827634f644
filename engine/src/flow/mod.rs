//! Optical flow along a path: where what a pixel shows is on the next frame.
//!
//! ```text
//! p = o + t d                                  what the pixel shows, t its median depth
//! p' = p + scene flow of p to the next time    System::scene_flow
//! flow = project(p') - pixel                   by the camera of the next frame
//! ```
//!
//! It is known where something is seen, where it is known where that goes, and where the next camera has it in front of it: also
//! beyond the borders of the next frame, and behind what hides it there.

mod wheel;

use crate::camera_path::Draw;
use crate::error::RunError;
use crate::picture::limited;
use crate::render::Rendered;
use crate::system::{FlowSource, System};
use crate::time_path::TimePath;
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use render_core::camera::Camera;
use render_core::induced_flow::{Coordinates, flow_of_point};
use std::sync::atomic::{AtomicBool, Ordering};
use wheel::colour;

/// Pixels of one call to [`System::scene_flow`]: enough work for many threads, little memory.
const STRIP: usize = 1 << 14;
/// Longest side of the small pictures that tell how long flow is, pixels, and how many of them there are at most.
const SIDE: u32 = 64;
const PICTURES: usize = 32;
/// What is shorter than so many pixels stands still.
const STILL: f64 = 0.1;
/// Share of what moves in the small pictures that the length of the fullest colour is taken from: the rest may be seen from so near that
/// all else would be pale beside it. And room above that: frames hold more pixels.
const SHARE: f64 = 0.98;
const ROOM: f64 = 1.05;

/// A camera at a time.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// In the scene's frame.
    pub camera: &'a Camera,
    /// From 0 to 1.
    pub time: f64,
}

/// Optical flow of what `view` shows, which is the picture of `here`, to the picture of `next`: `each` is called once for each pixel that
/// shows something, row by row, with its number and its flow, pixels, x to the right, y down; `None` where that is not known.
///
/// # Panics
/// If `view` has another size than the camera, or lacks depths.
pub fn each_flow(
    system: &dyn System,
    view: &Rendered,
    here: Shot<'_>,
    next: Shot<'_>,
    mut each: impl FnMut(usize, Option<DVec2>),
) {
    let (width, height) = (here.camera.width, here.camera.height);
    assert_eq!((view.width, view.height), (width, height), "a picture is as large as its camera's");
    let (from, to) = (here.camera.prepare(), next.camera.prepare());
    let (width, height) = (width as usize, height as usize);
    let shown = |i: usize| {
        let t = f64::from(view.layers.median_depth[i]);
        let pixel = DVec2::new((i % width) as f64, (i / width) as f64) + 0.5;
        let ray = from.ray(pixel).filter(|_| t.is_finite())?;
        Some((i, pixel, ray.at(t).to_array()))
    };
    let pixels = width * height;
    for first in (0..pixels).step_by(STRIP) {
        let hits: Vec<(usize, DVec2, [f64; 3])> = (first..pixels.min(first + STRIP)).filter_map(shown).collect();
        let points: Vec<[f64; 3]> = hits.iter().map(|hit| hit.2).collect();
        let mut ways = vec![None; points.len()];
        system.scene_flow(&points, here.time, next.time, &mut ways);
        for ((i, pixel, point), way) in hits.into_iter().zip(ways) {
            let there = way.map(|way| DVec3::from(point) + DVec3::from(way));
            each(i, there.and_then(|there| flow_of_point(there, Coordinates::World, &to, 0.0, pixel)));
        }
    }
}

/// The layer of flow of all frames of a path, but of the last one, which nothing follows.
pub struct FlowPath<'a> {
    system: &'a dyn System,
    cameras: Vec<Camera>,
    time: TimePath,
    /// Length of the fullest colour, pixels.
    full: f64,
}

impl<'a> FlowPath<'a> {
    /// For frames of these cameras, at their full size. `draw` draws small pictures of some of them, by which one scale is found for all;
    /// once `stop` is raised no more of them.
    ///
    /// # Errors
    /// [`RunError::Option`] for a path of one frame, and those of `draw`.
    ///
    /// # Panics
    /// As [`each_flow`], for pictures of `draw`.
    pub fn new(
        system: &'a dyn System,
        cameras: Vec<Camera>,
        time: TimePath,
        draw: &Draw<'_>,
        stop: &AtomicBool,
    ) -> Result<Self, RunError> {
        if cameras.len() < 2 {
            let problem = "`--layers flow`: flow goes from each frame to the next one, and the path has one frame only: give more \
                           `--frames`, a `--path` on which the camera moves, or, where the scene moves, `--time A..B`";
            return Err(RunError::Option(problem.into()));
        }
        let mut path = Self { system, cameras, time, full: 1.0 };
        path.full = path.length_of_most(draw, stop)?;
        Ok(path)
    }

    fn shot(&self, frame: usize) -> Option<Shot<'_>> {
        let camera = self.cameras.get(frame)?;
        Some(Shot { camera, time: self.time.at(frame, self.cameras.len()) })
    }

    /// Length that most of what moves does not exceed on the way, pixels of a frame; 1 where nothing moves.
    fn length_of_most(&self, draw: &Draw<'_>, stop: &AtomicBool) -> Result<f64, RunError> {
        let pairs = self.cameras.len() - 1;
        let pictures = pairs.min(PICTURES);
        let mut lengths = Vec::new();
        for frame in (0..pictures).map(|k| k * pairs / pictures) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let (Some(here), Some(next)) = (self.shot(frame), self.shot(frame + 1)) else { continue };
            let [small, small_next] = [here, next].map(|shot| limited(shot.camera, Some(SIDE)));
            let scale = f64::from(here.camera.width) / f64::from(small.width);
            let view = draw(&small, here.time)?;
            let (here, next) = (Shot { camera: &small, ..here }, Shot { camera: &small_next, ..next });
            each_flow(self.system, &view, here, next, |_, flow| {
                lengths.extend(flow.map(|flow| scale * flow.length()).filter(|length| *length > STILL));
            });
        }
        lengths.sort_by(f64::total_cmp);
        let last = lengths.len().saturating_sub(1);
        Ok(lengths.get((SHARE * last as f64).round() as usize).map_or(1.0, |length| ROOM * length))
    }

    /// Flow of a frame, whose picture is `view`, as colours of the wheel of Middlebury; black where it is not known. `None` for the last
    /// frame.
    ///
    /// # Panics
    /// As [`each_flow`].
    #[must_use]
    pub fn picture(&self, frame: usize, view: &Rendered) -> Option<RgbImage> {
        let (here, next) = (self.shot(frame)?, self.shot(frame + 1)?);
        let mut out = RgbImage::new(view.width, view.height);
        each_flow(self.system, view, here, next, |i, flow| {
            if let Some(flow) = flow {
                let (x, y) = (i as u32 % view.width, i as u32 / view.width);
                out.put_pixel(x, y, Rgb(colour(flow.as_vec2().to_array(), self.full as f32)));
            }
        });
        Some(out)
    }

    /// What its colours mean, for people; and what it lacks.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "flow is drawn from a frame to the next one: right red, down yellow, left cyan, up violet; white stands still, \
             fullest at {:.2} pixels, darker beyond; black is not known",
            self.full
        )];
        if !self.time.is_still() && self.system.flow_source() == FlowSource::Nothing {
            let name = self.system.name();
            lines.push(format!("flow is that of the camera alone: `{name}` does not say where things go in time"));
        }
        lines
    }
}

#[cfg(test)]
mod tests;
