//! What a preparation tells the people (or programs) that watch it, and how they stop it.

use std::time::Instant;

/// Something happened.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A line worth reading.
    Note(&'a str),
    /// A line worth acting on.
    Warning(&'a str),
    /// Part of a stage is done.
    Part {
        /// The stage, in words: `match photos`.
        stage: &'a str,
        /// Parts done.
        done: usize,
        /// Parts in all.
        of: usize,
        /// Seconds still to go at the mean speed so far; `None` where that cannot be said.
        eta_seconds: Option<f64>,
    },
}

/// Watches a preparation.
pub trait Watch {
    /// Called as things happen; returns quickly.
    fn event(&mut self, event: Event<'_>);

    /// Whether a stop was asked for. Running programs are ended then.
    fn stop_asked(&self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Watch for Silent {
    fn event(&mut self, _: Event<'_>) {}
}

/// Counts the parts of a stage and says how long the rest will take.
pub(crate) struct Meter<'a> {
    stage: &'a str,
    of: usize,
    done: usize,
    since: Instant,
}

impl<'a> Meter<'a> {
    pub(crate) fn new(stage: &'a str, of: usize) -> Self {
        Self { stage, of, done: 0, since: Instant::now() }
    }

    /// `done` parts are done; never goes back.
    pub(crate) fn reach(&mut self, done: usize, watch: &mut dyn Watch) {
        if done <= self.done && self.done > 0 {
            return;
        }
        self.done = done.min(self.of);
        let seconds = self.since.elapsed().as_secs_f64();
        let eta = (self.done > 0).then(|| seconds / self.done as f64 * (self.of - self.done) as f64);
        watch.event(Event::Part { stage: self.stage, done: self.done, of: self.of, eta_seconds: eta });
    }

    /// `done` parts of another total are done: tools count in units of their own.
    pub(crate) fn reach_of(&mut self, done: usize, of: usize, watch: &mut dyn Watch) {
        if of > 0 {
            self.of = of;
            self.reach(done, watch);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Seen(Vec<(usize, usize)>);

    impl Watch for Seen {
        fn event(&mut self, event: Event<'_>) {
            if let Event::Part { done, of, .. } = event {
                self.0.push((done, of));
            }
        }
    }

    #[test]
    fn a_meter_never_goes_back_nor_past_its_end() {
        let (mut meter, mut seen) = (Meter::new("count", 4), Seen::default());
        for done in [1, 3, 2, 9] {
            meter.reach(done, &mut seen);
        }
        assert_eq!(seen.0, [(1, 4), (3, 4), (4, 4)]);
    }
}
