//! Writing what must not be lost: where it fails, again and again for a while. A full disk is often not full for long.

use crate::error::RunError;
use crate::progress::{Event, Observer};
use std::time::{Duration, Instant};

/// Wall time between two tries.
const EVERY: Duration = Duration::from_secs(2);

/// Do `write` until it is done, for `wait` at most; what goes wrong is said once.
///
/// # Errors
/// What `write` failed with last; errors other than [`RunError::Write`] at once.
pub(super) fn insist<T>(
    wait: Duration,
    observer: &mut dyn Observer,
    mut write: impl FnMut(&mut dyn Observer) -> Result<T, RunError>,
) -> Result<T, RunError> {
    let since = Instant::now();
    let mut said = false;
    loop {
        let error = match write(observer) {
            Ok(done) => {
                if said {
                    observer.event(Event::Note("it could be written after all"));
                }
                return Ok(done);
            }
            Err(error @ RunError::Write { .. }) => error,
            Err(error) => return Err(error),
        };
        let left = wait.saturating_sub(since.elapsed());
        if left.is_zero() {
            return Err(error);
        }
        if !said {
            let room = if error.is_full() { "; please free some space" } else { "" };
            let line = format!("{}; trying again for {:.0} s{room}", error.with_reason(), left.as_secs_f64().ceil());
            observer.event(Event::Warning(&line));
            said = true;
        }
        std::thread::sleep(EVERY.min(left));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use std::io;

    fn full() -> RunError {
        RunError::Write { path: "a".into(), source: io::ErrorKind::StorageFull.into() }
    }

    #[test]
    fn what_fails_is_tried_again_until_it_is_done_or_time_is_up() {
        let mut left = 2;
        let tried = insist(Duration::from_secs(60), &mut Silent, |_| {
            left -= 1;
            if left == 0 { Ok("done") } else { Err(full()) }
        });
        assert_eq!(tried.unwrap(), "done");
        let mut tries = 0;
        let tried: Result<(), _> = insist(Duration::ZERO, &mut Silent, |_| {
            tries += 1;
            Err(full())
        });
        assert!(tried.is_err() && tries == 1);
        let denied = RunError::Write { path: "a".into(), source: io::ErrorKind::PermissionDenied.into() };
        assert!(full().is_full() && !denied.is_full());
        let tried: Result<(), _> = insist(Duration::from_secs(60), &mut Silent, |_| Err(RunError::Option("no".into())));
        assert_eq!(tried.unwrap_err().to_string(), "no");
    }
}
