//! What the training loop asks of a run: measure, save, say how far it is.

use super::keeper::Keeper;
use super::measure::measure_and_write;
use crate::checkpoint;
use crate::error::RunError;
use crate::eval::{Evaluation, Measures, Terms, evaluate};
use crate::folder::Place;
use crate::progress::{Event, Meter, Observer, Progress, Reached};
use crate::system::System;
use crate::train::{Host, Occasion, Saved};
use std::ops::ControlFlow;

/// Connects the training loop to the folder and the observer.
pub(super) struct RunHost<'r> {
    pub(super) keeper: Keeper<'r>,
    pub(super) terms: Terms<'r>,
    pub(super) observer: &'r mut dyn Observer,
    pub(super) evaluation: Option<Evaluation>,
    /// Whether the checkpoint that was due last could not be written.
    pub(super) unsaved: bool,
}

impl Host for RunHost<'_> {
    fn evaluate(&mut self, system: &dyn System, at: Reached, occasion: Occasion) -> Result<Option<f64>, RunError> {
        let held_out = self.keeper.held_out;
        if held_out.is_empty() {
            return Ok(None);
        }
        let psnr = match occasion {
            Occasion::Midway => {
                let mut meter = Meter::new("held-out view", held_out.len());
                let observer = &mut *self.observer;
                let terms = Terms { measures: Measures::Psnr, ..self.terms };
                let evaluation = evaluate(system, held_out, &terms, at, |_| {
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
                self.keeper.keep_up(system, at, self.observer)?;
                let Keeper { storage, folder, home, .. } = self.keeper;
                let place = Place { storage, folder, home };
                let measured = measure_and_write(place, system, held_out, &self.terms, at, self.observer)?;
                let (psnr, stopped) = (measured.psnr, measured.stopped);
                self.evaluation = Some(measured);
                if stopped {
                    return Ok(None);
                }
                psnr
            }
        };
        self.observer.event(Event::Evaluated { step: at.step, seconds: at.seconds, psnr });
        Ok(psnr)
    }

    fn save(&mut self, system: &dyn System, at: Reached, occasion: Occasion) -> Result<Saved, RunError> {
        if occasion == Occasion::End {
            self.keeper.insist(system, at, self.observer)?;
            return Ok(Saved::Written);
        }
        match self.keeper.save(system, at, self.observer) {
            Ok(()) => {
                if std::mem::take(&mut self.unsaved) {
                    self.observer.event(Event::Note("the checkpoint could be written after all"));
                }
                Ok(Saved::Written)
            }
            Err(error @ RunError::Write { .. }) => {
                if !std::mem::replace(&mut self.unsaved, true) {
                    let last = match checkpoint::newest_step(self.keeper.folder) {
                        Some(step) => format!("Newest checkpoint on disk: step {step}"),
                        None => "No checkpoint is on disk yet".into(),
                    };
                    let line = format!(
                        "{}: training goes on; the checkpoint is tried again every few seconds. {last}",
                        error.with_reason()
                    );
                    self.observer.event(Event::Warning(&line));
                }
                Ok(Saved::Later)
            }
            Err(error) => Err(error),
        }
    }

    fn warn(&mut self, line: &str) {
        self.observer.event(Event::Warning(line));
    }

    fn tell(&mut self, line: &str) {
        self.observer.event(Event::Note(line));
    }

    fn progress(&mut self, progress: &Progress) {
        self.observer.event(Event::Step(progress));
    }
}
