//! Nothing is allocated after the first tile of a shape. The counter sees this thread only: the test's
//! harness allocates on its own while a test runs.

use field_core::tape::{Arena, BackwardArgs, Bar, CustomOp, Node, Shape, Tape, TapeError, View};
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

/// Twice its input; scratch and saved numbers are only there to be counted.
struct Double;

impl CustomOp for Double {
    fn name(&self) -> &'static str {
        "double"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        Ok(inputs[0])
    }

    fn saved_len(&self, inputs: &[Shape]) -> usize {
        inputs[0].len()
    }

    fn scratch_len(&self, inputs: &[Shape]) -> usize {
        4 * inputs[0].len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        for ((out, saved), x) in out.iter_mut().zip(saved).zip(inputs[0].data) {
            (*out, *saved) = (2.0 * x, *x);
        }
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, _scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { out_bar, .. } = args;
        bars[0].data.iter_mut().zip(out_bar).for_each(|(bar, g)| *bar += 2.0 * g);
        Ok(())
    }

    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        _inputs: &[Node],
        input_tangents: &[Option<Node>],
        output: Node,
    ) -> Result<Node, TapeError> {
        match input_tangents[0] {
            Some(x_dot) => tape.custom(self, &[x_dot]),
            None => tape.detach(output),
        }
    }
}

fn tile(arena: &mut Arena, params: &[f32], x: &[f32], grad: &mut [f32]) -> Result<(), TapeError> {
    let op = Double;
    let samples = x.len() / 3;
    let mut tape = Tape::new(arena, params);
    let x = tape.input(3, samples, x)?;
    let (w1, b1, w2) = (tape.param(0, 16, 9)?, tape.param(144, 16, 1)?, tape.param(160, 1, 16)?);
    let (s, c) = (tape.sin(x)?, tape.cos(x)?);
    let encoded = tape.concat(&[x, s, c])?;
    let h = tape.linear(w1, Some(b1), encoded)?;
    let h = tape.softplus(h, 0.0)?;
    let h = tape.custom(&op, &[h])?;
    let sigma = tape.linear(w2, None, h)?;
    let slope = tape.jacobian(sigma, x)?;
    let normal = tape.normalise(slope)?;
    let loss = tape.sum(normal)?;
    tape.backward_from(loss, grad)
}

#[test]
fn nothing_is_allocated_after_the_first_tile() {
    let params: Vec<f32> = (0..200).map(|i| ((i * 37 % 100) as f32 - 50.0) / 100.0).collect();
    let x: Vec<f32> = (0..3 * 100).map(|i| (i % 17) as f32 / 17.0).collect();
    let mut grad = vec![0.0; 200];
    let mut arena = Arena::new();
    let start = CALLS.get();
    tile(&mut arena, &params, &x, &mut grad).unwrap();
    let first = CALLS.get();
    assert!(first > start, "the counter counts nothing");
    let bytes = arena.memory_bytes();
    for _ in 0..5 {
        tile(&mut arena, &params, &x, &mut grad).unwrap();
        // A smaller tile fits as well.
        tile(&mut arena, &params, &x[..150], &mut grad).unwrap();
    }
    assert_eq!(CALLS.get(), first);
    assert_eq!(arena.memory_bytes(), bytes);
}
