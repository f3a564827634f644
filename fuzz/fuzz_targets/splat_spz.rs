//! SPZ: files as they are, and what is inside the gzip.
#![no_main]

fuzz::door!(splat_spz);
