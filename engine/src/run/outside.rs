//! Held-out views of a dataset, measured with what no run has trained: Gaussians from a file of any program.

use super::Parts;
use super::create::{default_image_memory, read_scene};
use super::datasets::datasets;
use super::measure::measure_and_write;
use super::writer::take_lock;
use crate::checkpoint;
use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::{Evaluation, Measures, Protocol, Terms, evaluate};
use crate::folder::{Home, Place, refuse_foreign};
use crate::options::DataOptions;
use crate::output::make_folder;
use crate::progress::{Meter, Observer, Reached};
use crate::system::{Query, System};
use glam::DVec3;
use losses::metrics::Lpips;
use scene_io::Scene;
use std::ops::ControlFlow;
use std::path::Path;

/// The views that a dataset holds out, to measure any system with, as those of a run are measured.
pub struct HeldOutViews<'a> {
    parts: Parts<'a>,
    /// The scene.
    pub scene: Scene,
    /// Views that are not measured.
    train: Dataset,
    /// Views that are.
    pub views: Dataset,
}

impl<'a> HeldOutViews<'a> {
    /// Read the dataset that `spec` names.
    ///
    /// # Errors
    /// [`RunError::Option`] where no view is held out or a word means nothing, unreadable scenes, scenes without training views.
    pub fn open(
        spec: &str,
        data: &DataOptions,
        parts: Parts<'a>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        let mut data =
            DataOptions { image_memory: Some(data.image_memory.unwrap_or_else(default_image_memory)), ..data.clone() };
        let scene = read_scene(spec, &mut data, parts, observer)?;
        let (train, views) = datasets(&scene, &data)?;
        if views.is_empty() {
            return Err(RunError::Option(format!(
                "`--scene {spec}`: holds no views out, so there is nothing to measure: give `--holdout every:8`"
            )));
        }
        Ok(Self { parts, scene, train, views })
    }

    /// Where the cameras of the training views stand.
    #[must_use]
    pub fn training_cameras(&self) -> Vec<DVec3> {
        self.train.views().iter().filter(|view| view.level == 0).map(|view| view.camera.pose.c).collect()
    }

    /// Measure `system` on the views, rendered as `query` says; with `out` their pictures and scores are written there, under the
    /// names that they have in a run. Where the observer asks to stop, the views measured so far come back.
    ///
    /// # Errors
    /// [`RunError::Option`] for an `out` that holds a run, [`RunError::ForeignFiles`], [`RunError::Busy`], unreadable images. What
    /// cannot be written is in [`Evaluation::unwritten`].
    pub fn evaluate(
        &self,
        system: &dyn System,
        query: &Query,
        lpips: Option<&Lpips>,
        out: Option<&Path>,
        observer: &mut dyn Observer,
    ) -> Result<Evaluation, RunError> {
        let protocol = Protocol::default();
        let terms = Terms { query, protocol: &protocol, measures: Measures::All(lpips), seed: 0 };
        let at = Reached { step: 0, seconds: 0.0 };
        let Some(folder) = out else {
            let mut meter = Meter::new("held-out view", self.views.len());
            return evaluate(system, &self.views, &terms, at, |seen| {
                meter.reach(seen.index + 1, observer);
                Ok(if observer.stop_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
            });
        };
        refuse_run(folder)?;
        refuse_foreign(folder)?;
        make_folder(folder)?;
        let _lock = take_lock(folder, observer)?;
        let home = Home::of(folder);
        let place = Place { storage: self.parts.storage, folder, home: &home };
        measure_and_write(place, system, &self.views, &terms, at, observer)
    }
}

/// Refuses to write over the scores of a run.
fn refuse_run(folder: &Path) -> Result<(), RunError> {
    match checkpoint::newest_step(folder) {
        Some(_) => Err(RunError::Option(format!(
            "`--out {}`: holds a run, whose scores stay as they are; choose another folder",
            folder.display()
        ))),
        None => Ok(()),
    }
}
