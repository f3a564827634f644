//! See the modules.
#![no_std]
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("enable `std` or `libm`: a float backend is needed");
