//! The functions of `tests/doors`, which read what comes from outside, called by libFuzzer.

pub use doors;
pub use libfuzzer_sys;

use doors::Try;
use std::cell::RefCell;

/// A fuzz target: the door of a name.
#[macro_export]
macro_rules! door {
    ($name:ident) => {
        $crate::libfuzzer_sys::fuzz_target!(|bytes: &[u8]| $crate::try_door($crate::doors::open::$name, bytes));
        $crate::libfuzzer_sys::fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
            $crate::doors::mutate(&mut data[..max_size], size, seed, $crate::libfuzzer_sys::fuzzer_mutate)
        });
    };
}

thread_local! {
    static OPEN: RefCell<Option<Try>> = const { RefCell::new(None) };
}

/// Tries bytes at a door, which is opened by the first of them and stays open.
pub fn try_door(open: fn() -> Try, bytes: &[u8]) {
    OPEN.with_borrow_mut(|door| {
        let door = door.get_or_insert_with(|| {
            // One thread, this one: the same inputs take the same way, and nothing waits for another thread.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
            pool.build_global().expect("the only pool");
            open()
        });
        door(bytes);
    });
}
