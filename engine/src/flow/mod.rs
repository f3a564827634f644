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

mod layer;
mod wheel;

pub use layer::{coloured, flow_in_place, full_length, usual_step, whole_flow};

use crate::camera_path::Draw;
use crate::error::RunError;
use crate::picture::limited;
use crate::render::Rendered;
use crate::system::{FlowSource, System};
use crate::time_path::TimePath;
use glam::{DVec2, DVec3};
use image::RgbImage;
use layer::length_of_most;
use render_core::camera::Camera;
use render_core::induced_flow::{Coordinates, flow_of_point};
use scene_io::Flow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pixels of one call to [`System::scene_flow`]: enough work for many threads, little memory.
const STRIP: usize = 1 << 14;
/// Longest side of the small pictures that tell how long flow is, pixels, and how many of them there are at most.
const SIDE: u32 = 64;
const PICTURES: usize = 32;

/// A camera at a time.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// In the scene's frame.
    pub camera: &'a Camera,
    /// From 0 to 1.
    pub time: f64,
}

/// Optical flow of what `view` shows, which is the picture of `here`, to the picture of `next`: `each` is called once for each pixel that
/// shows something, row by row, with its number and its flow, pixels, x to the right, y down; `None` where that is not known. False where
/// it ended early, as soon as `go_on` said no, which is asked now and then.
///
/// # Panics
/// If `view` has another size than the camera, or lacks depths.
pub fn each_flow(
    system: &dyn System,
    view: &Rendered,
    here: Shot<'_>,
    next: Shot<'_>,
    go_on: &dyn Fn() -> bool,
    mut each: impl FnMut(usize, Option<DVec2>),
) -> bool {
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
        if !go_on() {
            return false;
        }
        let hits: Vec<(usize, DVec2, [f64; 3])> = (first..pixels.min(first + STRIP)).filter_map(shown).collect();
        let points: Vec<[f64; 3]> = hits.iter().map(|hit| hit.2).collect();
        let mut ways = vec![None; points.len()];
        system.scene_flow(&points, here.time, next.time, &mut ways);
        for ((i, pixel, point), way) in hits.into_iter().zip(ways) {
            let there = way.map(|way| DVec3::from(point) + DVec3::from(way));
            each(i, there.and_then(|there| flow_of_point(there, Coordinates::World, &to, 0.0, pixel)));
        }
    }
    true
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
        let go_on = || !stop.load(Ordering::Relaxed);
        let mut lengths = Vec::new();
        for frame in (0..pictures).map(|k| k * pairs / pictures) {
            if !go_on() {
                break;
            }
            let (Some(here), Some(next)) = (self.shot(frame), self.shot(frame + 1)) else { continue };
            let [small, small_next] = [here, next].map(|shot| limited(shot.camera, Some(SIDE)));
            let scale = f64::from(here.camera.width) / f64::from(small.width);
            let view = draw(&small, here.time)?;
            let (here, next) = (Shot { camera: &small, ..here }, Shot { camera: &small_next, ..next });
            each_flow(self.system, &view, here, next, &go_on, |_, flow| {
                lengths.extend(flow.map(|flow| scale * flow.length()));
            });
        }
        Ok(length_of_most(lengths).unwrap_or(1.0))
    }

    /// Flow of a frame, whose picture is `view`, to the next one. `None` for the last frame.
    ///
    /// # Panics
    /// As [`each_flow`].
    #[must_use]
    pub fn flow(&self, frame: usize, view: &Rendered) -> Option<Flow> {
        whole_flow(self.system, view, self.shot(frame)?, self.shot(frame + 1)?, &|| true)
    }

    /// Flow of a frame as colours, which have one scale for all of the path: see [`coloured`].
    ///
    /// # Panics
    /// If the flow does not hold what its size says.
    #[must_use]
    pub fn picture(&self, flow: &Flow) -> RgbImage {
        coloured(flow, self.full)
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
