//! The memory of a run: what it will need, and settings that make do with what there is.

use super::Run;
use crate::data::Dataset;
use crate::error::RunError;
use crate::memory::{ExpectedMemory, Needs, Reduced, available_bytes, human, limit, reduce, rehearse, resident_bytes};
use crate::options::{Request, RunOptions};
use crate::photo_points::provide;
use crate::progress::{Event, Observer};
use crate::system::{System, TensorData};

/// Share of what is available above which the machine may get slow.
const TIGHT: f64 = 0.9;

/// By how much a run needs too much.
fn beyond(excess: u64) -> String {
    let excess = human(excess);
    match limit() {
        Some(limit) => format!("{excess} more than `--memory` allows ({})", human(limit)),
        None => format!("{excess} more than the machine can give now"),
    }
}

impl Run<'_> {
    /// What the run will need, as far as it is known before its first step.
    pub fn expected_memory(&self) -> ExpectedMemory {
        self.expected
    }

    /// Find out what the run will need. Where there is a limit and it needs more, settings that the user did not choose
    /// are reduced, in a new run. One that has begun goes on whatever is found: it was planned with what it has, and its own
    /// arrays are counted beside those of the rehearsal.
    ///
    /// # Errors
    /// [`RunError::Untrainable`] where a new run needs more than there is, [`RunError::System`] where a smaller system cannot be
    /// made.
    pub fn fit_memory(&mut self, request: &Request, observer: &mut dyn Observer) -> Result<(), RunError> {
        let mut reduced = Vec::new();
        let mut expected = self.by_formula(request);
        while limit().is_some() && expected.excess().is_some() && self.make_smaller(request, &mut reduced)? {
            expected = self.by_formula(request);
        }
        if request.rehearsal && expected.excess().is_none() {
            let formula = expected.system.max(1) as f64;
            expected = self.by_rehearsal(request)?;
            // The process keeps what the rehearsal took; what a smaller system takes follows from how far the formula was off.
            let off = expected.system as f64 / formula;
            while limit().is_some() && expected.excess().is_some() && self.make_smaller(request, &mut reduced)? {
                let smaller = self.by_formula(request);
                expected = ExpectedMemory { system: (smaller.system as f64 * off) as u64, ..smaller };
            }
        }
        self.expected = expected;
        if !reduced.is_empty() {
            let list: Vec<String> = reduced.iter().map(|r| format!("{} {} -> {}", r.name, r.from, r.to)).collect();
            self.plan.push(format!("less memory than planned for (`--memory`): {}", list.join(", ")));
        }
        match expected.excess() {
            Some(excess) if self.resumed_at.is_some() => {
                let line = format!(
                    "the run may need {}, {}: it goes on as it was planned",
                    human(expected.total()),
                    beyond(excess)
                );
                observer.event(Event::Warning(&line));
                Ok(())
            }
            Some(excess) => Err(RunError::Untrainable(self.too_much(&expected, excess))),
            None => {
                self.warn_if_tight(&expected, observer);
                Ok(())
            }
        }
    }

    fn too_much(&self, expected: &ExpectedMemory, excess: u64) -> String {
        let [total, photos, system] = [expected.total(), expected.photos, expected.system].map(human);
        let needs =
            format!("the run needs {total} (photos {photos}, {} {system}), {}", self.config.system, beyond(excess));
        let way_out = "give `--longest-side PX`, `--image-memory MIB` or smaller settings with `--set`";
        match limit() {
            Some(_) => format!("{needs}: {way_out}, or allow more"),
            None => format!("{needs}: `--memory MIB` plans a smaller one; or {way_out}"),
        }
    }

    fn warn_if_tight(&self, expected: &ExpectedMemory, observer: &mut dyn Observer) {
        let Some(available) = available_bytes() else { return };
        let more = expected.total().saturating_sub(resident_bytes().map_or(0, |held| held.now));
        if limit().is_none() && more as f64 > TIGHT * available as f64 {
            let line = format!(
                "{} expected and {} available: the machine may start to swap; `--memory MIB` or `--longest-side PX` help",
                human(more),
                human(available)
            );
            observer.event(Event::Warning(&line));
        }
    }

    fn needs(&self, request: &Request, system: &dyn System) -> Needs {
        let photos = self.train.memory_bytes();
        let bytes = |data: &TensorData<'_>| match data {
            TensorData::F32(x) => 4 * x.len(),
            TensorData::U64(x) => 8 * x.len(),
        };
        Needs {
            photos,
            held_out: self.held_out.memory_bytes().min(self.config.data.image_bytes().saturating_sub(photos)),
            pixels: most_pixels(&self.held_out),
            prepass: 0,
            lpips: request.lpips,
            system: system.memory_bytes() as u64,
            growth: system.growth_bytes() as u64,
            state: system.state().iter().map(|t| bytes(&t.data) as u64).sum(),
        }
    }

    fn by_formula(&self, request: &Request) -> ExpectedMemory {
        let needs = self.needs(request, self.system.as_ref());
        let held = resident_bytes().map_or(needs.system, |held| held.now);
        ExpectedMemory::by_formula(&needs, held)
    }

    /// Build the system once more and train the copy for some steps: the run's own stays as it is.
    fn by_rehearsal(&self, request: &Request) -> Result<ExpectedMemory, RunError> {
        self.train.decode()?;
        let (mut copy, _) = self.build()?;
        let has_prepass = rehearse(copy.as_mut(), &self.train, request.stop, &self.halt);
        let mut needs = self.needs(request, copy.as_ref());
        needs.prepass = if has_prepass { most_pixels(&self.train) } else { 0 };
        let peak = resident_bytes().map_or(2 * needs.system + needs.photos, |held| held.peak);
        Ok(ExpectedMemory::by_rehearsal(&needs, peak))
    }

    /// The run's system as its configuration says, as `resume` makes it.
    fn build(&self) -> Result<(Box<dyn System>, crate::options::Plan), RunError> {
        let mut set = self.config.settings.clone();
        provide::take(&mut set)?;
        let options = RunOptions {
            seed: self.config.seed,
            background: Some(self.config.background),
            error_budget: Some(self.config.error_budget),
            stop: None,
            set,
        };
        Ok((self.parts.build)(&self.config.system, &self.scene, &self.train, &options)?)
    }

    /// Reduce one setting and make the system anew. Whether there was one left; the system of a run that has begun stays.
    fn make_smaller(&mut self, request: &Request, reduced: &mut Vec<Reduced>) -> Result<bool, RunError> {
        if self.resumed_at.is_some() {
            return Ok(false);
        }
        let Some(one) = reduce(&mut self.config.settings, &request.set, reduced) else { return Ok(false) };
        reduced.push(one);
        self.system = self.build()?.0;
        Ok(true)
    }
}

/// Pixels of the largest view.
fn most_pixels(data: &Dataset) -> u64 {
    data.views().iter().map(|v| u64::from(v.camera.width) * u64::from(v.camera.height)).max().unwrap_or(0)
}
