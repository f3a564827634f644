//! PLY, all encodings: the header leads the way.
#![no_main]

fuzz::door!(splat_ply);
