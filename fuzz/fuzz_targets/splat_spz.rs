//! SPZ: files as they are and, so that the checksum does not stop everything, what is inside the gzip.
#![no_main]

use flate2::{Compression, write::GzEncoder};
use std::io::Write;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    fuzz::read("fuzz.spz", bytes);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::none());
    gzip.write_all(bytes).expect("memory takes it");
    fuzz::read("fuzz.spz", &gzip.finish().expect("memory takes it"));
});
