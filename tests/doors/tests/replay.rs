//! Every input of the fuzzers' corpus once more: valid ones, and all that ever broke something.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Decoding has one count of memory for the whole process, and doors ask that nothing of it stays: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn corpus() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/corpus"))
}

#[test]
fn what_was_found_stays_mended() {
    let _alone = alone();
    for door in doors::DOORS {
        let folder = corpus().join(door.name);
        let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{} is empty", folder.display());
        let mut open = (door.open)();
        for file in files {
            println!("{}", file.display());
            open(&std::fs::read(&file).unwrap());
        }
    }
}

#[test]
fn valid_inputs_and_many_changes_of_them_hold() {
    const CHANGES: u32 = 60;
    let _alone = alone();
    for door in doors::DOORS {
        let mut open = (door.open)();
        for (name, seed) in (door.seeds)() {
            println!("{}: {name}", door.name);
            open(&seed);
            let mut data = vec![0; 4096.max(2 * seed.len())];
            for change in 0..CHANGES {
                data[..seed.len()].copy_from_slice(&seed);
                let mut size = seed.len();
                // Several changes, one upon the other; bytes are changed where there is no JSON.
                for round in 0..1 + change % 4 {
                    size = doors::mutate(&mut data, size, 31 * change + round, |bytes, size, _| {
                        let at = change as usize * 7919 % size.max(1);
                        bytes[at] = [0, 0xff, b'9', bytes[at] ^ 0x10][change as usize % 4];
                        size
                    });
                }
                let input = data[..size].to_vec();
                let tried = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| open(&input)));
                assert!(tried.is_ok(), "{} {name}: {:?}", door.name, String::from_utf8_lossy(&input));
            }
        }
    }
}
