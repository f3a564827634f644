//! `.splat`: any 32 bytes are a Gaussian.
#![no_main]

fuzz::door!(splat_splat);
