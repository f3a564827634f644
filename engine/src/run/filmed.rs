//! A run's frames along a path.

use super::Run;
use crate::camera_path::{Film, PathKind, Sight, film};
use crate::error::RunError;
use crate::folder::ANIMATION;
use crate::output::write_file;
use crate::picture::{colour, gif_bytes, limited};
use crate::render::render;
use crate::report;
use crate::system::Query;
use crate::time_path::TimePath;
use crate::train::Reason;
use render_core::camera::Camera;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Error of a pixel from skipped work in the small pictures that say what photos saw: one step of 8 bits.
const BUDGET: f32 = 1.0 / 255.0;

impl Run<'_> {
    /// `frames` cameras along a path (without one: the path that fits the scene), and the share of each frame that at least two
    /// photos saw; see [`film`]. `None` once `stop` is raised.
    ///
    /// # Errors
    /// As [`film`].
    ///
    /// # Panics
    /// As [`film`].
    pub fn film(
        &self,
        path: Option<&PathKind>,
        frames: Option<usize>,
        time: TimePath,
        stop: &AtomicBool,
    ) -> Result<Option<Film>, RunError> {
        let query = Query { error_budget: BUDGET, ..self.query() };
        let draw = |camera: &Camera, time: f64| match stop.load(Ordering::Relaxed) {
            true => Err(RunError::Option("stopped".into())),
            false => Ok(render(self.system.as_ref(), camera, &Query { time, ..query.clone() })),
        };
        let found =
            Sight::new(&self.train, &draw).and_then(|sight| film(path, &self.scene, &self.train, frames, time, &sight));
        if stop.load(Ordering::Relaxed) { Ok(None) } else { found.map(Some) }
    }
}

/// Frames of the report's animation, their longest side in pixels, and how many are shown a second.
const FRAMES: usize = 24;
const SIDE: u32 = 240;
const PER_SECOND: f64 = 8.0;
/// Longest side of the first picture that tells how fast the system draws, pixels.
const TRIAL_SIDE: u32 = 48;
/// Systems that would take longer have no animation: networks as published draw for hours.
const LONGEST_SECONDS: f64 = 20.0;

impl Run<'_> {
    /// The end of a training: the report with its animation, and the mark that says that all is done. Where `stop` is raised before,
    /// the rest is left to the next `--resume`.
    ///
    /// # Errors
    /// As [`Run::write_animation`], and [`RunError::Missing`] where a file that the run promises is not there.
    pub fn conclude(&self, stop: &AtomicBool) -> Result<Reason, RunError> {
        self.write_animation(stop)?;
        if stop.load(Ordering::Relaxed) {
            return Ok(Reason::Interrupted);
        }
        self.mark()?;
        Ok(Reason::Finished)
    }

    /// Write the report again, with a short animation along the path that fits the scene. Nothing where the system draws too slowly
    /// for that, where there are no photos, or once `stop` is raised.
    ///
    /// # Errors
    /// As [`film`], and [`RunError::Write`].
    pub fn write_animation(&self, stop: &AtomicBool) -> Result<(), RunError> {
        let photos: Vec<Camera> = self.train.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect();
        let Some(first) = photos.first() else { return Ok(()) };
        let query = Query { error_budget: BUDGET, ..self.query() };
        let seconds = |side: u32| {
            let start = Instant::now();
            render(self.system.as_ref(), &limited(first, Some(side)), &query);
            start.elapsed().as_secs_f64()
        };
        // What photos saw is found out on small pictures of all of them, and of each frame.
        let small = seconds(TRIAL_SIDE) * (photos.len() + FRAMES) as f64;
        if small > LONGEST_SECONDS || small + seconds(SIDE) * FRAMES as f64 > LONGEST_SECONDS {
            return Ok(());
        }
        let whole = if self.train.time_steps() > 1 { TimePath::WHOLE } else { TimePath::START };
        let Some(film) = self.film(None, Some(FRAMES), whole, stop)? else { return Ok(()) };
        let mut pictures = Vec::with_capacity(film.cameras.len());
        for (i, camera) in film.cameras.iter().enumerate() {
            if stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            let query = Query { time: whole.at(i, film.cameras.len()), ..query.clone() };
            let view = render(self.system.as_ref(), &limited(camera, Some(SIDE)), &query);
            if stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            pictures.push(colour(&view));
        }
        write_file(self.parts.storage, &self.folder.join(ANIMATION), &gif_bytes(&pictures, PER_SECOND)?)?;
        report::write(self.parts.storage, &self.folder)
    }
}
