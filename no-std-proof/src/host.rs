//! What `std` would bring: output, memory, an end after a panic, from the C library.

use core::alloc::{GlobalAlloc, Layout};
use core::fmt::{Arguments, Write};

#[link(name = "c")]
unsafe extern "C" {
    fn write(file: i32, bytes: *const u8, len: usize) -> isize;
    fn posix_memalign(out: *mut *mut u8, align: usize, size: usize) -> i32;
    fn free(memory: *mut u8);
    fn _exit(code: i32) -> !;
}

/// Exit code after a panic, as Rust programs have it.
const PANICKED: i32 = 101;

/// A line on standard output.
pub(crate) fn say(text: Arguments<'_>) {
    // Nobody is left to tell when standard output is closed.
    let _ = writeln!(Out, "{text}");
}

struct Out;

impl Write for Out {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        // SAFETY: the pointer and the length are those of a living string.
        let written = unsafe { write(1, text.as_ptr(), text.len()) };
        if usize::try_from(written) == Ok(text.len()) { Ok(()) } else { Err(core::fmt::Error) }
    }
}

struct CMemory;

#[global_allocator]
static MEMORY: CMemory = CMemory;

// SAFETY: `posix_memalign` gives memory of the size and alignment asked for, or none; `free` takes it back.
unsafe impl GlobalAlloc for CMemory {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let mut memory = core::ptr::null_mut();
        // The C function wants at least the alignment of a pointer.
        let align = layout.align().max(size_of::<*mut u8>());
        // SAFETY: `memory` outlives the call; the alignment is a power of two and a multiple of a pointer's.
        match unsafe { posix_memalign(&raw mut memory, align, layout.size()) } {
            0 => memory,
            _ => core::ptr::null_mut(),
        }
    }

    unsafe fn dealloc(&self, memory: *mut u8, _layout: Layout) {
        // SAFETY: the caller hands back what `alloc` gave.
        unsafe { free(memory) }
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    say(format_args!("{info}"));
    // SAFETY: takes any number and does not return.
    unsafe { _exit(PANICKED) }
}

/// The precompiled `core` and `alloc` can unwind and name this function. Nothing unwinds here, so nothing calls it.
#[unsafe(no_mangle)]
extern "C" fn rust_eh_personality() {}
