//! How much this process has worked: what else runs on the machine makes it wait, but not work more.

use std::time::{Duration, Instant};

/// Ticks of a second in `/proc/self/stat`: what Linux tells programs everywhere.
const TICKS: f64 = 100.0;

/// A point in time that work is counted from.
pub(super) struct Work {
    start: Instant,
    ticks: Option<u64>,
}

impl Work {
    pub(super) fn begin() -> Self {
        Self { start: Instant::now(), ticks: ticks() }
    }

    /// The time that the work since then takes a machine that does nothing else, all threads being busy; the time that has
    /// passed where the system does not count work.
    pub(super) fn done(&self) -> Duration {
        match self.ticks.zip(ticks()) {
            Some((before, now)) => {
                let seconds = now.saturating_sub(before) as f64 / TICKS;
                Duration::from_secs_f64(seconds / rayon::current_num_threads() as f64)
            }
            None => self.start.elapsed(),
        }
    }
}

/// Ticks that all threads of this process have run, in the program and in the kernel for it.
fn ticks() -> Option<u64> {
    of_stat(&std::fs::read_to_string("/proc/self/stat").ok()?)
}

fn of_stat(text: &str) -> Option<u64> {
    // The name of the program is in brackets, and may hold anything.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    Some(fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_those_of_program_and_kernel() {
        let text = "42 (a) b (c)) S 1 42 42 0 -1 4194304 100 0 0 0 700 33 5 6 20 0 3 0 100 1000 10";
        assert_eq!(of_stat(text), Some(733));
        assert_eq!(of_stat("42 (a"), None);
        assert_eq!(of_stat("42 (a) S 1"), None);
    }

    #[test]
    fn work_is_counted() {
        let work = Work::begin();
        let mut x = 1_u64;
        // Where the system does not count work within this time, it does not count it at all.
        while work.done() == Duration::ZERO && work.start.elapsed() < Duration::from_secs(20) {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(work.done() > Duration::ZERO);
    }
}
