//! A training step of `ngp` allocates nothing once its buffers have grown. Alone in its file: the counter sees the whole
//! process.

use engine::data::Dataset;
use engine::options::RunOptions;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Split, StoreOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Counts allocations while [`COUNTING`], and keeps where they come from.
struct Counter;

static COUNTING: AtomicBool = AtomicBool::new(false);
static CALLS: AtomicUsize = AtomicUsize::new(0);
/// Where allocations came from: functions of this workspace, and how often.
static SITES: Mutex<BTreeMap<String, usize>> = Mutex::new(BTreeMap::new());
/// Backtraces taken at most: each costs milliseconds.
const TRACED: usize = 400;

thread_local! {
    /// Set while the counter itself allocates.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

impl Counter {
    fn count() {
        if !COUNTING.load(Ordering::Relaxed) || INSIDE.replace(true) {
            return;
        }
        if CALLS.fetch_add(1, Ordering::Relaxed) < TRACED {
            let trace = Backtrace::force_capture().to_string();
            // The names of functions: there is no line where tests are built without debug information.
            let ours =
                |l: &&str| ["systems::", "engine::", "_core::", "losses::", "optim::"].iter().any(|c| l.contains(c));
            let frames = trace.lines().map(str::trim).filter(|l| !l.starts_with("at ") && !l.contains("no_allocation"));
            let site = frames.filter(|l| !l.contains("rayon_core::")).find(ours).unwrap_or("unknown").to_owned();
            if let Ok(mut sites) = SITES.lock() {
                *sites.entry(site).or_default() += 1;
            }
        }
        INSIDE.set(false);
    }
}

// SAFETY: forwards to the system's allocator; the counter has no part in it.
unsafe impl GlobalAlloc for Counter {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::count();
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Self::count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counter = Counter;

/// Steps after which all buffers have their size.
const WARM_UP: u64 = 192;
/// Steps counted: updates of the occupancy grid among them.
const COUNTED: u64 = 64;

/// Allocations while `work` runs, and where they were.
fn counted(work: impl FnOnce()) -> (usize, BTreeMap<String, usize>) {
    SITES.lock().unwrap().clear();
    CALLS.store(0, Ordering::Relaxed);
    COUNTING.store(true, Ordering::Relaxed);
    work();
    COUNTING.store(false, Ordering::Relaxed);
    (CALLS.load(Ordering::Relaxed), std::mem::take(&mut SITES.lock().unwrap()))
}

#[test]
fn a_step_of_ngp_allocates_nothing() {
    let scene =
        tabletop(&TabletopOptions { width: 32, height: 32, train: 12, test: 0, rays: 1, ..TabletopOptions::default() });
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    let set = ["log2_table=12", "batch_samples=4096", "batch_rays=256", "occupancy=32"];
    let set = set.iter().map(|s| engine::options::parse_set(s).unwrap()).collect();
    let options = RunOptions { seed: 3, background: None, error_budget: None, stop: None, set };
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut system = systems::registry::build("ngp", &scene, &data, &options).unwrap().0;
            let mut steps = |range: Range<u64>| {
                for step in range {
                    system.step(&data, step).unwrap();
                }
            };
            let (first, _) = counted(|| steps(0..1));
            assert!(first > 100, "the first step has to allocate its buffers; counted: {first}");
            steps(1..WARM_UP);
            let (calls, sites) = counted(|| steps(WARM_UP..WARM_UP + COUNTED));
            println!("{threads} threads: {calls} allocations in {COUNTED} steps, {first} in the first: {sites:#?}");
            assert_eq!(calls, 0, "{threads} threads, {COUNTED} steps: {sites:#?}");
        });
    }
}
