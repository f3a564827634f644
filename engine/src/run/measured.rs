//! The held-out views of a run, measured and written down.

use super::Run;
use super::home::Home;
use super::kept::{self, KeptViews, PICTURES};
use super::lock::FolderLock;
use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::{
    EvalAppearance, Evaluation, Known, Measures, Protocol, Terms, ViewScore, evaluate_from, need_halves,
};
use crate::eval_scales::{ScaleTable, evaluate_scales};
use crate::names::stem;
use crate::output::{Storage, make_folder, note_unwritten, write_file};
use crate::picture::{depth, depth_range, error_map, write_png};
use crate::progress::{Meter, Observer};
use crate::render::plain_query;
use crate::report;
use crate::skips;
use crate::summary::Summary;
use crate::system::{Query, System};
use losses::metrics::Lpips;
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::Path;

/// The scores, in the run folder.
const EVAL: &str = "eval.json";

impl Run<'_> {
    /// Measure the held-out views of the run as it stands; writes `eval.json`, `eval.csv`, `renders/` and the report. Where
    /// the observer asks to stop, the views measured so far come back, and only their pictures are written; the next call goes
    /// on from there. What cannot be written is in [`Evaluation::unwritten`]: the scores come back nevertheless.
    ///
    /// # Errors
    /// [`RunError::Option`] without held-out views or for a light that the system has not, [`RunError::Busy`], unreadable
    /// images, unwritable files.
    pub fn evaluate(&self, lpips: Option<&Lpips>, observer: &mut dyn Observer) -> Result<Evaluation, RunError> {
        self.need_held_out()?;
        let _lock = self.lock_if_writable(observer)?;
        let (protocol, query) = self.protocol()?;
        let mut evaluation = measure_and_write(
            (self.parts.storage, &self.folder, &self.home),
            (self.system.as_ref(), &self.held_out),
            &self.terms((&protocol, &query), Measures::All(lpips)),
            (self.step, self.seconds),
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
                if !self.folder.join(Summary::FILE).exists() {
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
        let place = (self.parts.storage, self.folder.as_path(), &self.home);
        let (protocol, query) = self.protocol()?;
        let terms = self.terms((&protocol, &query), Measures::All(None));
        evaluate_scales(place, self.system.as_ref(), &self.held_out, &terms, scales, observer)
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

    /// Measure held-out views in another light than the run's; the configuration stays the run's.
    pub fn measure_in(&mut self, appearance: Option<EvalAppearance>) {
        self.eval_appearance = appearance.or_else(|| self.config.eval_appearance.clone());
    }

    /// How views are rendered where nothing else is said: in the mean of all lights, until a stop is asked for.
    pub fn query(&self) -> Query {
        Query { halt: self.halt.clone(), ..plain_query(self.config.background.colour(), self.error_budget) }
    }

    /// In which light held-out views are measured, and how they are rendered.
    ///
    /// # Errors
    /// [`RunError::Option`] for a light that the system has not, and for views too narrow for it.
    pub(super) fn protocol(&self) -> Result<(Protocol, Query), RunError> {
        let system = self.system.as_ref();
        let protocol = Protocol::new(self.eval_appearance.as_ref(), system, &self.train)?;
        need_halves(&self.held_out, &protocol)?;
        let query = protocol.query(self.query(), system, &self.train)?;
        Ok((protocol, query))
    }

    pub(super) fn terms<'t>(&self, light: (&'t Protocol, &'t Query), measures: Measures<'t>) -> Terms<'t> {
        Terms { protocol: light.0, query: light.1, measures, seed: self.config.seed }
    }
}

/// All metrics of all held-out views, with their pictures, on disk. Where the observer asks to stop, the pictures alone, and the
/// scores of these views for the next time. A file that cannot be written is no reason to have no scores.
pub(super) fn measure_and_write(
    (storage, folder, home): (&dyn Storage, &Path, &Home),
    (system, data): (&dyn System, &Dataset),
    terms: &Terms<'_>,
    at: (u64, f64),
    observer: &mut dyn Observer,
) -> Result<Evaluation, RunError> {
    let renders = folder.join("renders");
    let mut unwritten = Vec::new();
    note_unwritten(home.guard(|| make_folder(&renders)), &mut unwritten)?;
    let stems: Vec<String> =
        data.views().iter().enumerate().map(|(i, v)| format!("{i:03}_{}", stem(&v.name))).collect();
    let kept = RefCell::new(KeptViews::of(folder, at.0, terms));
    let known = |index: usize| kept.borrow().view(index, &renders, &stems[index]);
    let mut meter = Meter::new("held-out view", data.len());
    let mut evaluation = evaluate_from(system, data, terms, at, &known, |seen| {
        let stem = &stems[seen.index];
        let [depth_image, error] =
            [depth(seen.rendered, depth_range(&[seen.rendered])), error_map(seen.picture, seen.truth)];
        let pictures = PICTURES.into_iter().zip([seen.picture, seen.truth, &error, &depth_image]);
        let written = pictures.into_iter().try_for_each(|(ending, picture)| {
            let path = renders.join(format!("{stem}{ending}.png"));
            home.guard(|| {
                write_png(storage, &path, picture).or_else(|_| {
                    // The folder may have gone.
                    make_folder(&renders)?;
                    write_png(storage, &path, picture)
                })
            })
        });
        let known = || Known {
            score: ViewScore { files: Some(stem.clone()), ..seen.score.clone() },
            notes: seen.notes.to_vec(),
        };
        let written = written.and_then(|()| kept.borrow_mut().keep(storage, seen.index, known()));
        note_unwritten(written, &mut unwritten)?;
        meter.reach(seen.index + 1, observer);
        Ok(if observer.stop_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    })?;
    for (score, stem) in evaluation.views.iter_mut().zip(stems) {
        score.files = Some(stem);
    }
    if evaluation.left == 0 {
        evaluation.skips = skips::measure(system, data, terms.query);
        evaluation.stopped = terms.query.halt.raised();
    }
    if !evaluation.stopped {
        let scores = [(EVAL, evaluation.json()), ("eval.csv", evaluation.csv())];
        for (name, text) in scores {
            let before = unwritten.len();
            let written = home.guard(|| write_file(storage, &folder.join(name), text.as_bytes()));
            note_unwritten(written, &mut unwritten)?;
            evaluation.written |= name == EVAL && unwritten.len() == before;
        }
    }
    evaluation.unwritten = unwritten;
    Ok(evaluation)
}
