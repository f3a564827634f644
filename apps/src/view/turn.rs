//! Large pictures are drawn one at a time: each takes a hundred bytes a pixel while it is drawn, and eight pages may want one.
//!
//! Those by the cloud and those by the scene itself have a turn each: the latter may take a minute, the former hardly a second.

use super::header::Drawer;
use scene_io::Size;
use std::panic::resume_unwind;
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::thread::Builder;
use std::time::Duration;

/// Pixels of a picture that waits for nobody.
pub(crate) const SMALL: u64 = 1 << 19;

/// How soon it is seen that a turn has come.
const LOOK_EVERY: Duration = Duration::from_millis(10);

static BY_SCENE: Mutex<()> = Mutex::new(());
static BY_CLOUD: Mutex<()> = Mutex::new(());

/// Whether to go on with a picture; asked on the thread that draws.
pub(crate) type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

/// The right to draw; given back when dropped.
pub(crate) struct Turn {
    /// Of a large picture.
    held: Option<MutexGuard<'static, ()>>,
}

impl Turn {
    /// Do the work of a picture, that of a large one on a thread that ends with it: what an allocator keeps for a thread, up to 64 MB in
    /// glibc, it would keep for that of every page.
    ///
    /// # Errors
    /// A sentence for the person: that of the work, or that there was no thread.
    pub(crate) fn work<T: Send>(&self, work: impl FnOnce() -> Result<T, String> + Send) -> Result<T, String> {
        if self.held.is_none() {
            return work();
        }
        let thread = Builder::new().name("picture".into());
        std::thread::scope(|scope| match thread.spawn_scoped(scope, work) {
            Ok(thread) => thread.join().unwrap_or_else(|panic| resume_unwind(panic)),
            Err(e) => Err(format!("no thread to draw with: {e}")),
        })
    }
}

/// Wait for the turn to draw a picture of this size; `None` when `go_on` says no before it has come. A small one has it at once.
pub(crate) fn turn(size: Size, drawer: Drawer, go_on: GoOn<'_>) -> Option<Turn> {
    if size.pixels() <= SMALL { Some(Turn { held: None }) } else { large_turn(drawer, go_on) }
}

/// The same for a picture of any size.
pub(crate) fn large_turn(drawer: Drawer, go_on: GoOn<'_>) -> Option<Turn> {
    let place = if drawer == Drawer::Cloud { &BY_CLOUD } else { &BY_SCENE };
    while go_on() {
        match place.try_lock() {
            Ok(held) => return Some(Turn { held: Some(held) }),
            // Whoever drew is gone; there is nothing in it that could be half done.
            Err(TryLockError::Poisoned(held)) => return Some(Turn { held: Some(held.into_inner()) }),
            Err(TryLockError::WouldBlock) => std::thread::sleep(LOOK_EVERY),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    use std::thread::current;

    #[test]
    fn large_pictures_wait_for_each_other_and_small_ones_for_nobody() {
        let (large, small) = (Size::new(1000, 1000), Size::new(724, 724));
        let first = turn(large, Drawer::Scene, &|| true);
        assert!(first.is_some() && turn(large, Drawer::Cloud, &|| true).is_some());
        let asked = AtomicU32::new(0);
        let three_times = || asked.fetch_add(1, Relaxed) < 3;
        assert!(turn(large, Drawer::Scene, &three_times).is_none() && asked.load(Relaxed) == 4);
        assert!(turn(small, Drawer::Scene, &|| false).is_some());
        drop(first);
        assert!(turn(large, Drawer::Scene, &|| true).is_some());
    }

    #[test]
    fn large_pictures_are_drawn_on_threads_that_end_with_them() {
        let here = current().id();
        let drawn_by = |side: u32| {
            let turn = turn(Size::new(side, side), Drawer::Cloud, &|| true).unwrap();
            turn.work(|| Ok(current().id())).unwrap()
        };
        assert!(drawn_by(700) == here && drawn_by(800) != here);
        let failed = turn(Size::new(800, 800), Drawer::Cloud, &|| true).unwrap().work::<()>(|| Err("why".into()));
        assert_eq!(failed, Err("why".into()));
    }
}
