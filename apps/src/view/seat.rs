//! Seats of pages: each has a thread that draws.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The place of a page among those that may be open; free again when dropped, whatever happened.
pub(crate) struct Seat(Arc<AtomicUsize>);

impl Seat {
    /// A place among `most`, where one of those that `taken` counts is free.
    pub(crate) fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Self> {
        // Counted down again by `drop` where it was one too many.
        let seat = Self(taken.clone());
        (taken.fetch_add(1, Ordering::Relaxed) < most).then_some(seat)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seats_are_free_again_when_they_are_left() {
        let taken = Arc::new(AtomicUsize::new(0));
        let mut seats: Vec<Seat> = (0..3).map_while(|_| Seat::take(&taken, 2)).collect();
        assert_eq!((seats.len(), Seat::take(&taken, 2).is_none(), taken.load(Ordering::Relaxed)), (2, true, 2));
        seats.pop();
        assert!(Seat::take(&taken, 2).is_some());
        drop(seats);
        assert_eq!(taken.load(Ordering::Relaxed), 0);
    }
}
