//! What a run tells the people (or programs) that watch it.

use crate::halt::Halt;
use std::path::Path;
use std::time::Instant;

/// How far a training is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reached {
    /// Steps done.
    pub step: u64,
    /// Training seconds, evaluation not counted.
    pub seconds: f64,
}

/// How far a training is, and how it goes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Training seconds.
    pub seconds: f64,
    /// Share of the run that is done, in `[0, 1]`.
    pub done: f64,
    /// Training seconds still to go, from the speed of recent steps; `None` before there is one.
    pub eta_seconds: Option<f64>,
    /// Loss of recent steps.
    pub loss: Option<f64>,
    /// PSNR of recent training rays, dB.
    pub psnr_train: Option<f64>,
    /// PSNR of the held-out views when last measured, dB.
    pub psnr_test: Option<f64>,
    /// Rays per second.
    pub rays_per_s: Option<f64>,
    /// Field evaluations per second.
    pub samples_per_s: Option<f64>,
    /// Resident memory, MB.
    pub memory_mb: Option<f64>,
}

/// Something happened.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A line worth reading.
    Note(&'a str),
    /// A line worth acting on.
    Warning(&'a str),
    /// A step was done. Comes after every step.
    Step(&'a Progress),
    /// Part of a piece of work whose size is known was done: a view, a frame, a layer of a mesh. See [`Meter`].
    Part(Part<'a>),
    /// The held-out views were measured.
    Evaluated {
        /// Steps trained.
        step: u64,
        /// Training seconds.
        seconds: f64,
        /// Mean PSNR, dB.
        psnr: Option<f64>,
    },
    /// A checkpoint was written.
    Saved {
        /// Steps trained.
        step: u64,
        /// Its JSON file.
        path: &'a Path,
    },
}

/// How far a piece of work is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part<'a> {
    /// What the parts are, in the singular: `frame`, `held-out view`.
    pub what: &'a str,
    /// Parts done.
    pub done: usize,
    /// Parts in all.
    pub of: usize,
    /// Seconds since the work began.
    pub seconds: f64,
    /// Seconds still to go, at the mean speed so far; `None` before the first part.
    pub eta_seconds: Option<f64>,
}

/// Counts the parts of a piece of work and tells an observer how far it is and how long the rest will take.
///
/// ```
/// use engine::progress::{Meter, Silent};
/// let mut meter = Meter::new("frame", 60);
/// for _ in 0..60 {
///     meter.advance(&mut Silent);
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Meter<'a> {
    what: &'a str,
    done: usize,
    of: usize,
    since: Instant,
}

impl<'a> Meter<'a> {
    /// Work of `of` parts begins now.
    #[must_use]
    pub fn new(what: &'a str, of: usize) -> Self {
        Self { what, done: 0, of, since: Instant::now() }
    }

    /// One more part is done.
    pub fn advance(&mut self, observer: &mut dyn Observer) {
        self.reach(self.done + 1, observer);
    }

    /// `done` parts are done.
    pub fn reach(&mut self, done: usize, observer: &mut dyn Observer) {
        self.done = done.min(self.of);
        observer.event(Event::Part(self.part(self.since.elapsed().as_secs_f64())));
    }

    /// Parts done so far.
    #[must_use]
    pub fn done(&self) -> usize {
        self.done
    }

    fn part(&self, seconds: f64) -> Part<'a> {
        let eta = (self.done > 0).then(|| seconds / self.done as f64 * (self.of - self.done) as f64);
        Part { what: self.what, done: self.done, of: self.of, seconds, eta_seconds: eta }
    }
}

/// Watches a run.
pub trait Observer {
    /// Called as things happen; returns quickly.
    fn event(&mut self, event: Event<'_>);

    /// Raised when a stop is asked for: for work that cannot ask this observer.
    fn halt(&self) -> Halt {
        Halt::NEVER
    }

    /// Whether a stop was asked for (Ctrl-C). Long work checks it between its parts, and ends with what it has.
    fn stop_asked(&self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn event(&mut self, _: Event<'_>) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Seen(Vec<(usize, usize)>);

    impl Observer for Seen {
        fn event(&mut self, event: Event<'_>) {
            if let Event::Part(part) = event {
                self.0.push((part.done, part.of));
            }
        }
    }

    #[test]
    fn a_meter_counts_to_its_end_and_not_past_it() {
        let (mut meter, mut seen) = (Meter::new("frame", 3), Seen(Vec::new()));
        meter.advance(&mut seen);
        meter.reach(3, &mut seen);
        meter.advance(&mut seen);
        assert_eq!(seen.0, [(1, 3), (3, 3), (3, 3)]);
    }

    #[test]
    fn time_to_go_is_at_the_mean_speed_so_far() {
        let meter = |done| Meter { done, ..Meter::new("frame", 10) };
        assert_eq!(meter(0).part(5.0).eta_seconds, None);
        assert_eq!(meter(2).part(5.0).eta_seconds, Some(20.0));
        assert_eq!(meter(10).part(5.0).eta_seconds, Some(0.0));
    }
}
