//! Large pictures are drawn one at a time: each takes a hundred bytes a pixel while it is drawn, and eight pages may want one.
//!
//! Those by the cloud and those by the scene itself have a turn each: the latter may take a minute, the former hardly a second.

use super::header::Drawer;
use scene_io::Size;
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

/// Pixels of a picture that waits for nobody.
pub(crate) const SMALL: u64 = 1 << 19;

/// How soon it is seen that a turn has come.
const LOOK_EVERY: Duration = Duration::from_millis(10);

static BY_SCENE: Mutex<()> = Mutex::new(());
static BY_CLOUD: Mutex<()> = Mutex::new(());

/// The right to draw; given back when dropped.
pub(crate) struct Turn {
    _held: Option<MutexGuard<'static, ()>>,
}

/// Wait for the turn to draw a picture of this size; `None` when `go_on` says no before it has come. A small one has it at once.
pub(crate) fn turn(size: Size, drawer: Drawer, go_on: &dyn Fn() -> bool) -> Option<Turn> {
    if size.pixels() <= SMALL { Some(Turn { _held: None }) } else { large_turn(drawer, go_on) }
}

/// The same for a picture of any size.
pub(crate) fn large_turn(drawer: Drawer, go_on: &dyn Fn() -> bool) -> Option<Turn> {
    let place = if drawer == Drawer::Cloud { &BY_CLOUD } else { &BY_SCENE };
    while go_on() {
        match place.try_lock() {
            Ok(held) => return Some(Turn { _held: Some(held) }),
            // Whoever drew is gone; there is nothing in it that could be half done.
            Err(TryLockError::Poisoned(held)) => return Some(Turn { _held: Some(held.into_inner()) }),
            Err(TryLockError::WouldBlock) => std::thread::sleep(LOOK_EVERY),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn large_pictures_wait_for_each_other_and_small_ones_for_nobody() {
        let (large, small) = (Size::new(1000, 1000), Size::new(724, 724));
        let first = turn(large, Drawer::Scene, &|| true);
        assert!(first.is_some() && turn(large, Drawer::Cloud, &|| true).is_some());
        let asked = Cell::new(0);
        let three_times = || {
            asked.set(asked.get() + 1);
            asked.get() <= 3
        };
        assert!(turn(large, Drawer::Scene, &three_times).is_none() && asked.get() == 4);
        assert!(turn(small, Drawer::Scene, &|| false).is_some());
        drop(first);
        assert!(turn(large, Drawer::Scene, &|| true).is_some());
    }
}
