//! Nerfies, HyperNeRF, DyCheck: nine files.
#![no_main]

fuzz::door!(dialect_nerfies);
