//! Training, and what is written at its end.

use super::host::RunHost;
use super::keeper::Keeper;
use super::patience::insist;
use super::writer::take_lock;
use super::{Run, planned};
use crate::error::RunError;
use crate::eval::{Evaluation, Measures};
use crate::folder::{EVAL, METRICS};
use crate::log::MetricsLog;
use crate::options::{Schedule, Stop};
use crate::output::{read_json, write_file};
use crate::progress::{Observer, Reached};
use crate::report;
use crate::summary::{SceneSummary, Summary};
use crate::train::{Ended, Reason, train};
use losses::metrics::Lpips;
use std::sync::atomic::AtomicBool;

impl Run<'_> {
    /// Whether there is nothing left to do before `stop`: it is reached, the held-out views are measured as of now, and every
    /// file that a run promises is there.
    pub fn is_finished(&self, stop: Stop) -> bool {
        let measured = || read_json::<Evaluation>(&self.folder.join(EVAL)).ok().flatten();
        stop.reached(self.step, self.seconds)
            && (self.held_out.is_empty() || measured().is_some_and(|evaluation| evaluation.steps == self.step))
            && self.is_marked()
            && self.missing().is_empty()
    }

    /// Train until the schedule or `interrupt` stops it; at the end measure the held-out views and write the report. Where
    /// the observer asks to stop while that is done, the run ends as [`Reason::Interrupted`] with the views measured so far.
    /// What a full disk refuses is tried again for [`Schedule::disk_wait`]; results that stay unwritten are named in the
    /// evaluation.
    ///
    /// # Errors
    /// [`RunError::Busy`], and see [`train`]; the newest checkpoint stays usable.
    pub fn train(
        &mut self,
        schedule: &Schedule,
        lpips: Option<&Lpips>,
        observer: &mut dyn Observer,
        interrupt: &AtomicBool,
    ) -> Result<(Ended, Option<Evaluation>), RunError> {
        if self.lock.is_none() {
            self.lock = take_lock(&self.folder, observer)?;
        }
        self.halt = observer.halt();
        self.write_lost()?;
        let path = self.folder.join(METRICS);
        let mut log = MetricsLog::resume(&path, self.step)?.within(self.home.clone());
        planned::write(self.parts.storage, &self.folder, schedule, observer);
        self.train.decode()?;
        let (protocol, query) = self.protocol()?;
        let start = self.reached();
        let terms = self.terms(&protocol, &query, Measures::All(lpips));
        let keeper = Keeper {
            folder: &self.folder,
            home: &self.home,
            lock: &mut self.lock,
            storage: self.parts.storage,
            schedule,
            config: &self.config,
            dataset: &self.dataset,
            scene: &self.scene,
            held_out: &self.held_out,
        };
        let mut host = RunHost { keeper, terms, observer: &mut *observer, evaluation: None, unsaved: false };
        let mut ended = train(self.system.as_mut(), &self.train, schedule, start, &mut log, &mut host, interrupt)?;
        let mut evaluation = host.evaluation.take();
        let kept = host.keeper.keep_up(
            self.system.as_ref(),
            Reached { step: ended.step, seconds: ended.seconds },
            host.observer,
        );
        if evaluation.as_ref().is_some_and(|evaluation| evaluation.stopped) {
            ended.reason = Reason::Interrupted;
        }
        (self.step, self.seconds) = (ended.step, ended.seconds);
        let written = kept
            .and_then(|()| insist(schedule.disk_wait, observer, |_| log.flush()))
            .and_then(|()| self.write_rest(schedule, &mut ended, observer));
        match (written, &mut evaluation) {
            // The scores are to be seen whatever else is wrong.
            (Err(error @ RunError::Write { .. }), Some(evaluation)) => {
                evaluation.unwritten.push(error.with_reason());
            }
            (written, _) => written?,
        }
        Ok((ended, evaluation))
    }

    /// What comes after scores: summary, showcase, report.
    fn write_rest(&self, schedule: &Schedule, ended: &mut Ended, observer: &mut dyn Observer) -> Result<(), RunError> {
        // A run that had only its end to do over keeps what is known of its training.
        let known =
            Summary::read(&self.folder).is_ok_and(|s| s.steps == self.step && self.resumed_at == Some(self.step));
        if !known {
            insist(schedule.disk_wait, observer, |_| self.write_summary())?;
        }
        if ended.reason != Reason::Interrupted {
            self.write_showcase(observer)?;
            if observer.stop_asked() {
                ended.reason = Reason::Interrupted;
            }
        }
        insist(schedule.disk_wait, observer, |_| report::write(self.parts.storage, &self.folder))
    }

    pub(super) fn write_summary(&self) -> Result<(), RunError> {
        let summary = Summary::new(
            self.system.as_ref(),
            SceneSummary::new(&self.scene, &self.train, &self.held_out),
            &self.plan,
            self.reached(),
            self.resumed_at,
            self.expected,
        );
        write_file(self.parts.storage, &self.folder.join(Summary::FILE), summary.json().as_bytes())
    }
}
