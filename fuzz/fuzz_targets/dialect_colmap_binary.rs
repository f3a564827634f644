//! COLMAP's binary files.
#![no_main]

fuzz::door!(dialect_colmap_binary);
