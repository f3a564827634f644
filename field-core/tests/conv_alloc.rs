//! Nothing is allocated after the first image of a size. The counter sees this thread only: the test's
//! harness allocates on its own while a test runs.

use field_core::conv::{Encoder, EncoderConfig, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    /// Allocations of this thread. Without a destructor, so that it can be used at any time.
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: forwards to the system's allocator; the counter has no part in it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn an_encoder_allocates_on_its_first_step_only() {
    let encoder = Encoder::new(EncoderConfig::small()).unwrap();
    let mut params = vec![0.0; encoder.param_count()];
    encoder.init(Rng::new(1, 1), &mut params);
    // Large, then small: the buffers of the first serve the second.
    let sizes = [Size::one(40, 56), Size::one(32, 32)];
    let mut work = Workspace::default();
    let mut steps = sizes.map(|size| {
        let images = vec![0.25; size.len(3)];
        let acts = vec![0.0; encoder.activations_len(size).unwrap()];
        (size, images.clone(), images, acts, [0.0; 48])
    });
    let mut params_bar = params.clone();
    for round in 0..3 {
        let before = CALLS.get();
        for (size, images, images_bar, acts, codes) in &mut steps {
            encoder.forward(Simd::best(), &params, images, *size, acts, codes, &mut work).unwrap();
            encoder
                .backward(
                    Simd::best(),
                    &params,
                    images,
                    *size,
                    acts,
                    codes,
                    &mut params_bar,
                    Some(images_bar),
                    &mut work,
                )
                .unwrap();
        }
        let calls = CALLS.get() - before;
        assert_eq!(calls > 0, round == 0, "round {round}: {calls} allocations");
    }
}
