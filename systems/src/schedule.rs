//! Schedules, and where a training is in its own: at its own step, until it is found ahead of its time or behind it.
//!
//! Schedules are of the steps that a run was thought to have. One that stops after seconds makes others: the machine has more to do,
//! or the scene costs more than was thought. At each mark of the time the schedule goes on faster or slower, so that both end together:
//!
//! ```text
//! position(step) = at + pace (step - mark)
//! pace' = pace (planned time that is left / time that is left) (time since the last mark / planned time since the last mark)
//! ```

use engine::system::{SystemError, Tensor, TensorMap, take_u64, u64_tensor};
use serde::{Deserialize, Serialize};

/// Paces beyond these are errors of a clock, or of a machine that stood still.
const PACES: [f64; 2] = [0.2, 5.0];
/// No mark where less than this share of the time is left: what is measured of it is noise.
const LEFT: f64 = 0.02;
/// No run has more steps.
const MOST_STEPS: f64 = (1_u64 << 53) as f64;
/// Steps of a schedule where nobody knows when the training stops.
pub(crate) const HORIZON: u64 = 2500;

/// The schedule of a system whose parts go by shares of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ScheduleSettings {
    /// Steps of the schedule: rates, windows and doublings are shares of it, and end with it.
    pub(crate) horizon: u64,
}

impl ScheduleSettings {
    /// Of a training that is likely to stop after so many steps; of [`HORIZON`] where nobody knows.
    pub(crate) fn until(steps: Option<u64>) -> Self {
        Self { horizon: steps.unwrap_or(HORIZON).max(1) }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        if self.horizon == 0 {
            let problem = "must be at least 1".into();
            return Err(SystemError::Config { field: "horizon", value: "0".into(), problem });
        }
        Ok(())
    }
}

/// How much of its schedule a training has done.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Done {
    /// Steps of the schedule.
    pub(crate) steps: u64,
    /// Share of the schedule, from 0 to 1.
    pub(crate) share: f64,
}

impl Done {
    /// A share of a schedule, for tests of parts that go by shares alone.
    #[cfg(test)]
    pub(crate) fn of_share(share: f64) -> Self {
        Self { share, ..Self::default() }
    }
}

/// A schedule, and where the training is in it.
#[derive(Clone, Debug)]
pub(crate) struct Course {
    planned: PlannedTime,
    position: Position,
    keeps_up: bool,
}

impl Default for Course {
    /// Of [`HORIZON`] steps, never corrected: a position is a step of the training.
    fn default() -> Self {
        Self { keeps_up: false, ..Self::new(HORIZON) }
    }
}

impl Course {
    /// A schedule of `horizon` steps that take the same time each, corrected where the training is ahead of its time or behind it.
    pub(crate) fn new(horizon: u64) -> Self {
        Self { planned: PlannedTime { shares: vec![0.0, 1.0], horizon }, position: Position::default(), keeps_up: true }
    }

    /// What is done after `steps` steps of the training.
    pub(crate) fn done(&self, steps: u64) -> Done {
        Done { steps: self.position.of(steps), share: self.planned.until(self.position.exact(steps)).min(1.0) }
    }

    /// As [`Position::steps_done`].
    pub(crate) fn steps_done(&self, step: u64, every: u64) -> u64 {
        self.position.steps_done(step, every)
    }

    /// After `step` steps the share `time` of the training's time has passed.
    pub(crate) fn keep_up(&mut self, step: u64, time: f64) {
        if self.keeps_up {
            self.position.mark(&self.planned, step, time);
        }
    }

    /// The position, for a checkpoint; nothing where it was never corrected. The schedule itself is a setting.
    pub(crate) fn state(&self, name: &str) -> Option<Tensor<'static>> {
        self.position.state(name)
    }

    /// The same schedule where [`state`](Self::state) was written.
    ///
    /// # Errors
    /// [`SystemError::State`] for what is no place in a schedule.
    pub(crate) fn restored(&self, state: &TensorMap, name: &str) -> Result<Self, SystemError> {
        Ok(Self { position: Position::take(state, name)?, ..self.clone() })
    }
}

/// Share of its time that a schedule takes until equally spaced positions, from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlannedTime {
    /// `[parts + 1]`, never falling.
    pub(crate) shares: Vec<f64>,
    /// Its steps.
    pub(crate) horizon: u64,
}

impl PlannedTime {
    /// Share of the time until a position; 1 from the end on.
    fn until(&self, position: f64) -> f64 {
        let parts = self.shares.len().saturating_sub(1);
        let x = position / self.horizon.max(1) as f64 * parts as f64;
        let k = x as usize;
        match (self.shares.get(k), self.shares.get(k + 1)) {
            (Some(at), Some(next)) => at + (next - at) * (x - k as f64),
            _ => 1.0,
        }
    }
}

/// Where a training is in its schedule.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Position {
    mark: Option<Mark>,
}

/// What was known when a share of the time had passed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    /// Steps that the training had made, and the share of its time that had passed.
    step: u64,
    time: f64,
    /// Steps of the schedule that were done, and how many one step of the training does from then on.
    at: f64,
    pace: f64,
}

impl Position {
    fn exact(&self, step: u64) -> f64 {
        match self.mark {
            None => step as f64,
            Some(mark) => mark.at + mark.pace * step.saturating_sub(mark.step) as f64,
        }
    }

    /// The step of the schedule that step `step` of the training is, both counted from 0.
    pub(crate) fn of(&self, step: u64) -> u64 {
        self.exact(step) as u64
    }

    /// Steps of the schedule that are done with step `step`, for what happens after every `every` of them: a multiple of it after those
    /// steps alone that reach one.
    pub(crate) fn steps_done(&self, step: u64, every: u64) -> u64 {
        let [before, after] = [step, step + 1].map(|step| self.of(step));
        let reached = after / every.max(1) * every.max(1);
        match reached > before {
            true => reached,
            false => after.max(reached + 1),
        }
    }

    /// After `step` steps the share `time` of the training's time has passed.
    pub(crate) fn mark(&mut self, planned: &PlannedTime, step: u64, time: f64) {
        let at = self.exact(step);
        let pace = match self.mark {
            None => 1.0,
            // The training was given more time.
            Some(before) if time <= before.time => before.pace,
            Some(before) => {
                let went = (planned.until(at) - planned.until(before.at)) / (time - before.time);
                before.pace * (1.0 - planned.until(at)) / (1.0 - time) / went
            }
        };
        if time < 1.0 - LEFT && pace.is_finite() {
            self.mark = Some(Mark { step, time, at, pace: pace.clamp(PACES[0], PACES[1]) });
        }
    }

    /// Written only where there is a mark.
    pub(crate) fn state(&self, name: &str) -> Option<Tensor<'static>> {
        self.mark.map(|m| u64_tensor(name, vec![m.step, m.time.to_bits(), m.at.to_bits(), m.pace.to_bits()]))
    }

    /// What [`state`](Self::state) wrote.
    pub(crate) fn take(state: &TensorMap, name: &str) -> Result<Self, SystemError> {
        if !state.contains_key(name) {
            return Ok(Self::default());
        }
        let numbers = take_u64(state, name, 4)?;
        let [time, at, pace] = [1, 2, 3].map(|k| f64::from_bits(numbers[k]));
        let counted = |steps: f64| (0.0..=MOST_STEPS).contains(&steps);
        let are_places = counted(numbers[0] as f64) && counted(at) && (0.0..=1.0).contains(&time);
        if !(are_places && (PACES[0]..=PACES[1]).contains(&pace)) {
            return Err(SystemError::State { name: name.into(), problem: "no place in a schedule".into() });
        }
        Ok(Self { mark: Some(Mark { step: numbers[0], time, at, pace }) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: &str = "position";

    /// The second half of the schedule takes three quarters of its time.
    fn planned() -> PlannedTime {
        PlannedTime { shares: vec![0.0, 0.125, 0.25, 0.625, 1.0], horizon: 1000 }
    }

    /// Seconds of each step until the end, `slower` times as many as planned of 1 in all; the position at the end.
    fn run(slower: impl Fn(f64) -> f64) -> f64 {
        let (planned, mut position) = (planned(), Position::default());
        let (mut time, mut step, mut marks) = (0.0, 0, 1.0);
        while time < 1.0 {
            let at = position.exact(step);
            let cost = if at < 500.0 { 0.5e-3 } else { 1.5e-3 };
            time += slower(time) * cost;
            step += 1;
            if time * 32.0 > marks {
                position.mark(&planned, step, time);
                marks += 1.0;
            }
        }
        position.exact(step)
    }

    #[test]
    fn a_schedule_ends_with_the_time_on_faster_and_slower_machines() {
        for slower in [0.5, 0.8, 1.0, 1.3, 2.5] {
            let end = run(|_| slower);
            assert!((985.0..1060.0).contains(&end), "{slower}: {end}");
        }
        let busy = run(|time| if (0.3..0.6).contains(&time) { 2.0 } else { 0.9 });
        assert!((985.0..1060.0).contains(&busy), "{busy}");
    }

    #[test]
    fn more_time_is_not_time_that_ran_backwards() {
        let (planned, mut position) = (planned(), Position::default());
        position.mark(&planned, 100, 0.5);
        position.mark(&planned, 200, 0.8);
        let before = position.mark.unwrap().pace;
        position.mark(&planned, 300, 0.45);
        assert_eq!(position.mark.unwrap().pace, before);
        position.mark(&planned, 400, 0.55);
        assert!(position.mark.unwrap().pace > 0.0 && position.of(401) >= position.of(400));
    }

    #[test]
    fn without_a_mark_positions_are_steps() {
        let position = Position::default();
        for step in 0..400 {
            assert_eq!((position.of(step), position.steps_done(step, 7)), (step, step + 1));
        }
    }

    #[test]
    fn every_multiple_is_reached_once_at_any_pace() {
        for pace in [0.2, 0.37, 1.0, 1.8, 5.0] {
            let position = Position { mark: Some(Mark { step: 10, time: 0.1, at: 10.0, pace }) };
            let reached: Vec<u64> =
                (10..2010).map(|step| position.steps_done(step, 20)).filter(|steps| steps % 20 == 0).collect();
            let all = (position.of(2010) / 20) as usize;
            assert_eq!(reached, (1..=all as u64).map(|k| 20 * k).collect::<Vec<_>>(), "{pace}");
        }
    }

    #[test]
    fn shares_of_a_course_end_with_the_training() {
        let course = Course::new(400);
        let shares = [0, 100, 400, 900].map(|steps| course.done(steps).share);
        assert_eq!(shares, [0.0, 0.25, 1.0, 1.0]);
        assert_eq!(course.done(100).steps, 100);
        // A machine that makes half of the steps, and one that makes twice as many: told now and then, both end at the end.
        for made in [200, 800_u64] {
            let mut course = Course::new(400);
            (1..=32).for_each(|k| course.keep_up(k * made / 32, k as f64 / 32.0));
            let share = course.done(made).share;
            assert!((0.95..=1.0).contains(&share), "{made} steps: {share}");
            // What a checkpoint holds is where it goes on, to the bit.
            let tensor = course.state(NAME).unwrap();
            let state: TensorMap = [(tensor.name.clone(), tensor)].into();
            let again = Course::new(400).restored(&state, NAME).unwrap();
            assert!((0..made).all(|step| again.done(step) == course.done(step)));
        }
        let mut unbound = Course::default();
        unbound.keep_up(10, 0.5);
        assert!(unbound.state(NAME).is_none() && unbound.done(77).steps == 77);
    }

    #[test]
    fn a_checkpoint_goes_on_at_the_same_place() {
        let mut position = Position::default();
        position.mark(&planned(), 100, 0.1);
        position.mark(&planned(), 200, 0.2);
        let tensor = position.state(NAME).unwrap();
        let state: TensorMap = [(tensor.name.clone(), tensor)].into();
        assert_eq!(Position::take(&state, NAME).unwrap(), position);
        assert_eq!(Position::take(&TensorMap::default(), NAME).unwrap(), Position::default());
        let forged = u64_tensor(NAME, vec![1, 0, f64::NAN.to_bits(), 1.0_f64.to_bits()]);
        assert!(Position::take(&[(forged.name.clone(), forged)].into(), NAME).is_err());
    }
}
