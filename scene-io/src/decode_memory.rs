//! How much memory decoding files may take at one time.
//!
//! A small file can ask for much memory: 214 bytes of JPEG for a picture of 26000x26000 pixels, 3 MB of SPZ for ten million
//! Gaussians. Readers know from a header what a file will take. They reserve that here before they allocate, and give it back
//! when they are done; threads wait for each other, and a file that takes more than the whole limit is refused.

use crate::{ErrorKind, Problem, SceneError};
use std::cell::Cell;
use std::marker::PhantomData;
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard, OnceLock, PoisonError};

/// Decoding may always take this much: a photo of 50 megapixels fits in every format of 8 or 16 bits. As progressive JPEG
/// without subsampling it takes 510 MB (300 of coefficients, 150 of pixels, twice the file), as 16-bit PNG with alpha 600 MB.
const LEAST: u64 = 1 << 30;
/// Decoding takes no more than this where nobody says so: some files then still wait, but more threads would hardly be faster.
const MOST: u64 = 2 << 30;

/// A number of bytes that decoding may take at one time, over all threads.
///
/// Decoded photos that are kept are not part of it: [`crate::StoreOptions::budget_bytes`] is their limit.
///
/// All readers of this crate share [`DecodeMemory::of_process`]. Waiting threads are served in the order they came. A thread
/// that has reserved something does not wait here: what it reserves on top is granted at once. While it holds something it must
/// not wait elsewhere for threads that reserve (it would hold what they wait for); no reader does, and the closure of
/// [`crate::with_photo`] must not. What is refused depends on the file and the limit alone, not on what other threads do.
#[derive(Debug)]
pub struct DecodeMemory {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    limit: u64,
    used: u64,
    /// Most of `used` since the limit was set.
    most: u64,
    /// Number of the next thread that comes, and of the one whose turn it is.
    next: u64,
    turn: u64,
}

thread_local! {
    /// What this thread has reserved, bytes.
    static OWN: Cell<u64> = const { Cell::new(0) };
}

/// A part of a [`DecodeMemory`], given back when dropped. It stays on its thread.
#[derive(Debug)]
pub(crate) struct Reserved<'a> {
    memory: &'a DecodeMemory,
    bytes: u64,
    on_this_thread: PhantomData<*const ()>,
}

impl DecodeMemory {
    const fn new(limit: u64) -> Self {
        Self { state: Mutex::new(State { limit, used: 0, most: 0, next: 0, turn: 0 }), changed: Condvar::new() }
    }

    /// The one that all readers of this crate share. Until [`DecodeMemory::set_limit`] says something else, its limit is
    /// [`DecodeMemory::default_limit`] at the time of the first call.
    pub fn of_process() -> &'static Self {
        static SHARED: OnceLock<DecodeMemory> = OnceLock::new();
        SHARED.get_or_init(|| Self::new(Self::default_limit()))
    }

    /// A quarter of the memory that is available now, because a run needs the rest for photos, field and optimiser; at least
    /// 1 GiB, at most 2 GiB. 1 GiB where the system does not say what is available.
    #[must_use]
    pub fn default_limit() -> u64 {
        available_bytes().map_or(LEAST, |bytes| (bytes / 4).clamp(LEAST, MOST))
    }

    /// Bytes that decoding may take at one time.
    #[must_use]
    pub fn limit(&self) -> u64 {
        self.lock().limit
    }

    /// Changes the limit, in bytes. What is reserved already stays so; those who wait for more than the new limit are refused.
    pub fn set_limit(&self, limit: u64) {
        let mut state = self.lock();
        (state.limit, state.most) = (limit, state.used);
        drop(state);
        self.changed.notify_all();
    }

    /// Bytes reserved now.
    #[must_use]
    pub fn used(&self) -> u64 {
        self.lock().used
    }

    /// Most bytes reserved at one time since the limit was set.
    #[must_use]
    pub fn most_used(&self) -> u64 {
        self.lock().most
    }

    /// Refuses what can never be reserved. `what` completes "decoding …": `its 3000x2000 pixels`.
    pub(crate) fn check(&self, path: &Path, what: &str, bytes: u64) -> Result<(), SceneError> {
        let limit = self.limit();
        if bytes <= limit { Ok(()) } else { Err(refuse(path, what, bytes, limit)) }
    }

    /// Waits until `bytes` can be reserved; refuses at once what can never be. `what` completes "decoding …".
    ///
    /// # Errors
    /// [`ErrorKind::Memory`] where `bytes` alone is more than the limit.
    pub(crate) fn reserve(&self, path: &Path, what: &str, bytes: u64) -> Result<Reserved<'_>, SceneError> {
        let own = OWN.get();
        let mut state = self.lock();
        if own == 0 && bytes <= state.limit {
            let turn = state.next;
            state.next += 1;
            let fits = |state: &State| state.used == 0 || state.used.saturating_add(bytes) <= state.limit;
            while state.turn != turn || (bytes <= state.limit && !fits(&state)) {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            state.turn += 1;
            self.changed.notify_all();
        }
        if bytes > state.limit {
            return Err(refuse(path, what, bytes, state.limit));
        }
        state.used = state.used.saturating_add(bytes);
        state.most = state.most.max(state.used);
        OWN.set(own.saturating_add(bytes));
        Ok(Reserved { memory: self, bytes, on_this_thread: PhantomData })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // The state is consistent after every statement, so a panic elsewhere does not spoil it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Reserved<'_> {
    fn drop(&mut self) {
        OWN.set(OWN.get().saturating_sub(self.bytes));
        let mut state = self.memory.lock();
        state.used = state.used.saturating_sub(self.bytes);
        drop(state);
        self.memory.changed.notify_all();
    }
}

fn refuse(path: &Path, what: &str, bytes: u64, limit: u64) -> SceneError {
    let what = format!("decoding {what} takes {} of memory, and decoding may take {}", size(bytes), size(limit));
    let enough = bytes.saturating_mul(2).div_ceil(1 << 20);
    let remedy = format!("make it smaller, or give `--memory {enough}` or more (MiB), of which half is for decoding");
    SceneError::new(ErrorKind::Memory, Problem::new(path, what, remedy))
}

/// Bytes for people, powers of 1000.
fn size(bytes: u64) -> String {
    let b = bytes as f64;
    if b < 1e9 { format!("{:.1} MB", b / 1e6) } else { format!("{:.2} GB", b / 1e9) }
}

/// Memory of the machine that can still be had without swapping, bytes; `None` where the system does not say (only Linux is
/// asked).
#[must_use]
pub fn available_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.saturating_mul(1024))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    const PATH: &str = "a.jpg";

    #[test]
    fn what_can_never_fit_is_refused_with_one_line() {
        let memory = DecodeMemory::new(100_000_000);
        let held = memory.reserve(Path::new(PATH), "its 1x1 pixels", 60_000_000).unwrap();
        let error = memory.reserve(Path::new(PATH), "its 5x5 pixels", 160_000_000).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Memory);
        assert_eq!(
            error.to_string(),
            "a.jpg: decoding its 5x5 pixels takes 160.0 MB of memory, and decoding may take 100.0 MB; make it smaller, or \
             give `--memory 306` or more (MiB), of which half is for decoding"
        );
        assert_eq!(memory.used(), 60_000_000, "a refusal keeps nothing");
        drop(held);
        assert_eq!((memory.used(), OWN.get()), (0, 0));
        assert!(memory.reserve(Path::new(PATH), "all", u64::MAX).is_err());
        assert!(memory.reserve(Path::new(PATH), "all", 100_000_000).is_ok());
    }

    #[test]
    fn threads_take_turns_and_whoever_holds_something_never_waits() {
        let memory = DecodeMemory::new(10);
        let (now, most) = (AtomicU64::new(0), AtomicU64::new(0));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let decode = |bytes: u64| {
            let held = memory.reserve(Path::new(PATH), "it", bytes).unwrap();
            most.fetch_max(now.fetch_add(bytes, Ordering::SeqCst) + bytes, Ordering::SeqCst);
            std::thread::sleep(std::time::Duration::from_micros(200));
            now.fetch_sub(bytes, Ordering::SeqCst);
            drop(held);
            bytes
        };
        let sum: u64 = pool.install(|| (0..400_u64).into_par_iter().map(|i| decode(1 + i % 10)).sum());
        assert_eq!((sum, memory.used()), (400 * 11 / 2, 0));
        assert!((6..=10).contains(&most.into_inner()));
        // A thread that holds something is given more at once: it may have to run another decoder while it waits for its own work.
        let held = memory.reserve(Path::new(PATH), "it", 8).unwrap();
        let more = memory.reserve(Path::new(PATH), "it", 7).unwrap();
        assert_eq!((memory.used(), OWN.get()), (15, 15));
        drop((held, more));
        assert_eq!((memory.used(), OWN.get()), (0, 0));
    }

    #[test]
    fn a_lower_limit_refuses_those_who_wait() {
        let memory = DecodeMemory::new(10);
        let held = memory.reserve(Path::new(PATH), "it", 8).unwrap();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| memory.reserve(Path::new(PATH), "it", 9).is_err());
            while memory.lock().next < 2 {
                std::thread::yield_now();
            }
            memory.set_limit(8);
            assert!(waiting.join().unwrap());
        });
        drop(held);
        assert_eq!((memory.used(), memory.limit()), (0, 8));
    }

    #[test]
    fn the_default_lies_between_its_bounds() {
        assert!((LEAST..=MOST).contains(&DecodeMemory::default_limit()));
    }
}
