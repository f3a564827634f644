//! `.splat`: any 32 bytes are a Gaussian.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some(file) = fuzz::read("fuzz.splat", bytes) {
        let records = bytes.len() / 32;
        assert!(file.cloud.len() <= records || !bytes.len().is_multiple_of(32), "more Gaussians than records");
    }
});
