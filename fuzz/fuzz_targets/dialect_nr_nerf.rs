//! `precomputed.json`.
#![no_main]

fuzz::door!(dialect_nr_nerf);
