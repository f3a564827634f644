//! COLMAP's text files.
#![no_main]

fuzz::door!(dialect_colmap_text);
