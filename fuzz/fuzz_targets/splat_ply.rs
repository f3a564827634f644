//! PLY, all encodings: the header leads the way.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    fuzz::read("fuzz.ply", bytes);
});
