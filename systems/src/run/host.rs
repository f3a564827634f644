//! What the training loop asks of a run: measure, save, say how far it is.

use super::measured::measure_and_write;
use crate::checkpoint;
use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::{Evaluation, Measures, Terms, evaluate};
use crate::options::RunConfig;
use crate::output::Storage;
use crate::progress::{Event, Meter, Observer};
use crate::system::System;
use crate::train::{Host, Occasion, Progress};
use std::ops::ControlFlow;
use std::path::Path;

/// Connects the training loop to the folder and the observer.
pub(super) struct RunHost<'r> {
    pub(super) folder: &'r Path,
    pub(super) storage: &'r dyn Storage,
    pub(super) config: &'r RunConfig,
    pub(super) dataset: &'r str,
    pub(super) held_out: &'r Dataset,
    pub(super) terms: Terms<'r>,
    pub(super) observer: &'r mut dyn Observer,
    pub(super) evaluation: Option<Evaluation>,
}

impl Host for RunHost<'_> {
    fn evaluate(&mut self, system: &dyn System, at: (u64, f64), occasion: Occasion) -> Result<Option<f64>, RunError> {
        if self.held_out.is_empty() {
            return Ok(None);
        }
        let psnr = match occasion {
            Occasion::Midway => {
                let mut meter = Meter::new("held-out view", self.held_out.len());
                let observer = &mut *self.observer;
                let terms = Terms { measures: Measures::Psnr, ..self.terms };
                let evaluation = evaluate(system, self.held_out, &terms, at, |_| {
                    meter.advance(observer);
                    Ok(if observer.stop_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
                })?;
                // The mean of some views is not comparable with that of all.
                if evaluation.left > 0 {
                    return Ok(None);
                }
                evaluation.psnr
            }
            Occasion::End => {
                let place = (self.storage, self.folder);
                let evaluation = measure_and_write(place, (system, self.held_out), &self.terms, at, self.observer)?;
                let (psnr, left) = (evaluation.psnr, evaluation.left);
                self.evaluation = Some(evaluation);
                if left > 0 {
                    return Ok(None);
                }
                psnr
            }
        };
        self.observer.event(Event::Evaluated { step: at.0, seconds: at.1, psnr });
        Ok(psnr)
    }

    fn save(&mut self, system: &dyn System, at: (u64, f64)) -> Result<(), RunError> {
        let path = checkpoint::save(self.storage, self.folder, system, at, self.config, self.dataset)?;
        self.observer.event(Event::Saved { step: at.0, path: &path });
        Ok(())
    }

    fn warn(&mut self, line: &str) {
        self.observer.event(Event::Warning(line));
    }

    fn progress(&mut self, progress: &Progress) {
        self.observer.event(Event::Step(progress));
    }
}
