//! The held-out views of a run, measured and written down.

use super::Run;
use super::kept;
use super::measure::measure_and_write;
use crate::error::RunError;
use crate::eval::scales::{ScaleTable, evaluate_scales};
use crate::eval::{Evaluation, Measures, Protocol, Terms, need_halves};
use crate::folder::{FolderLock, Place, SUMMARY};
use crate::options::EvalAppearance;
use crate::output::note_unwritten;
use crate::progress::{Observer, Reached};
use crate::render::plain_query;
use crate::report;
use crate::system::Query;
use losses::metrics::Lpips;

impl Run<'_> {
    /// Measure the held-out views of the run as it stands; writes `eval.json`, `eval.csv`, `renders/` and the report. Where
    /// the observer asks to stop, the views measured so far come back, and only their pictures are written; the next call goes
    /// on from there. What cannot be written is in [`Evaluation::unwritten`]: the scores come back nevertheless.
    ///
    /// # Errors
    /// [`RunError::Option`] without held-out views or for an appearance that the system does not have, [`RunError::Busy`], unreadable
    /// images, unwritable files.
    pub fn evaluate(&self, lpips: Option<&Lpips>, observer: &mut dyn Observer) -> Result<Evaluation, RunError> {
        self.need_held_out()?;
        let _lock = self.lock_if_writable(observer)?;
        let (protocol, query) = self.protocol()?;
        let mut evaluation = measure_and_write(
            self.place(),
            self.system.as_ref(),
            &self.held_out,
            &self.terms(&protocol, &query, Measures::All(lpips)),
            self.reached(),
            observer,
        )?;
        if evaluation.stopped {
            return Ok(evaluation);
        }
        if evaluation.unwritten.is_empty() {
            // A training that was stopped on its way to the end goes on with its own views, if they are these.
            if self.is_marked() {
                kept::forget(&self.folder);
            }
            let mut rest = || -> Result<(), RunError> {
                if !self.folder.join(SUMMARY).exists() {
                    self.write_summary()?;
                }
                self.write_showcase(observer)?;
                // Later, everything is there.
                evaluation.stopped = observer.stop_asked();
                report::write(self.parts.storage, &self.folder)
            };
            note_unwritten(rest(), &mut evaluation.unwritten)?;
        }
        Ok(evaluation)
    }

    /// Measure the held-out views at full, half, quarter … size; writes `eval_scales.json` and the pictures. What cannot be written
    /// is in [`ScaleTable::unwritten`].
    ///
    /// # Errors
    /// As [`Run::evaluate`], and [`RunError::Option`] for more scales than the images have.
    pub fn evaluate_scales(&self, scales: u32, observer: &mut dyn Observer) -> Result<ScaleTable, RunError> {
        self.need_held_out()?;
        let _lock = self.lock_if_writable(observer)?;
        let (protocol, query) = self.protocol()?;
        let terms = self.terms(&protocol, &query, Measures::All(None));
        evaluate_scales(self.place(), self.system.as_ref(), &self.held_out, &terms, scales, observer)
    }

    /// As [`Run::write_lock`]; none where nothing can be written, so that there is no other writer.
    fn lock_if_writable(&self, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
        match self.write_lock(observer) {
            Err(RunError::Write { .. }) => Ok(None),
            lock => lock,
        }
    }

    fn need_held_out(&self) -> Result<(), RunError> {
        if self.held_out.is_empty() {
            return Err(RunError::Option(
                "the run holds no views out, so there is nothing to measure: train with `--holdout every:8`".into(),
            ));
        }
        Ok(())
    }

    /// Render held-out views within another error budget than the run's; what is written down stays the run's.
    pub fn render_within(&mut self, error_budget: Option<f32>) {
        self.error_budget = error_budget.unwrap_or(self.config.error_budget);
    }

    /// Measure held-out views in another appearance than the run's; the configuration stays the run's.
    pub fn measure_in(&mut self, appearance: Option<EvalAppearance>) {
        self.eval_appearance = appearance.or_else(|| self.config.eval_appearance.clone());
    }

    fn place(&self) -> Place<'_> {
        Place { storage: self.parts.storage, folder: &self.folder, home: &self.home }
    }

    /// How far the training is.
    pub(super) fn reached(&self) -> Reached {
        Reached { step: self.step, seconds: self.seconds }
    }

    /// How views are rendered where nothing else is said: in the mean appearance, until a stop is asked for.
    pub fn query(&self) -> Query {
        Query { halt: self.halt.clone(), ..plain_query(self.config.background.colour(), self.error_budget) }
    }

    /// In which appearance held-out views are measured, and how they are rendered.
    ///
    /// # Errors
    /// [`RunError::Option`] for an appearance that the system does not have, and for views too narrow for it.
    pub(super) fn protocol(&self) -> Result<(Protocol, Query), RunError> {
        let system = self.system.as_ref();
        let protocol = Protocol::new(self.eval_appearance.as_ref(), system, &self.train)?;
        need_halves(&self.held_out, &protocol)?;
        let query = protocol.query(self.query(), system, &self.train)?;
        Ok((protocol, query))
    }

    pub(super) fn terms<'t>(&self, protocol: &'t Protocol, query: &'t Query, measures: Measures<'t>) -> Terms<'t> {
        Terms { protocol, query, measures, seed: self.config.seed }
    }
}
