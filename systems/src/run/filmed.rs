//! A run's frames along a path.

use super::Run;
use crate::camera_path::{Film, PathKind, Sight, film};
use crate::error::RunError;
use crate::render::render;
use crate::system::Query;
use crate::time_path::TimePath;
use render_core::camera::Camera;
use std::sync::atomic::{AtomicBool, Ordering};

/// Error of a pixel from skipped work in the small pictures that say what photos saw: one step of 8 bits.
const BUDGET: f32 = 1.0 / 255.0;

impl Run<'_> {
    /// `frames` cameras along a path (without one: the path that fits the scene), and the share of each frame that at least two
    /// photos saw; see [`film`]. `None` once `stop` is raised.
    ///
    /// # Errors
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
        let found = Sight::new(&self.train, &draw)
            .and_then(|sight| film(path, (&self.scene, &self.train), frames, time, &sight));
        if stop.load(Ordering::Relaxed) { Ok(None) } else { found.map(Some) }
    }
}
