//! Tools for testing differentiable functions: ours, and yours.
//!
//! * [`golden`]: reader for the golden-vector files, [`golden::assert_close`], where the shared data lies.
//!
//! Nothing here depends on the crates it tests: everything is plain arrays, slices and closures, so a pair written
//! elsewhere is tested in the same way as one of ours.

pub mod golden;
