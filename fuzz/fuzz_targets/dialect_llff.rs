//! `poses_bounds.npy` and points beside it.
#![no_main]

fuzz::door!(dialect_llff);
