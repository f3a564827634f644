//! Clouds of Gaussians: PLY, `.splat`, SPZ.

use flate2::{Compression, write::GzEncoder};
use scene_io::{SplatFile, SplatOptions, encode_splats, parse_splats};
use splat_core::Gaussians;
use std::io::Write;
use std::path::Path;

/// Reads bytes under a name. What is read is whole and finite, holds no more Gaussians than the bytes can, and comes
/// back from each format: from PLY bit for bit, from the others in the same number.
pub(crate) fn read(name: &str, bytes: &[u8]) -> Option<SplatFile> {
    let file = match parse_splats(Path::new(name), bytes) {
        Ok(file) => file,
        Err(error) => {
            let line = error.to_string();
            assert!(!line.contains('\n') && line.contains(name), "{line}");
            return None;
        }
    };
    let cloud = &file.cloud;
    cloud.check().expect("fields of one length");
    assert!(cloud.fields().iter().all(|(_, numbers)| numbers.iter().all(|x| x.is_finite())), "a number is not finite");
    let options = SplatOptions::default().with_widening(file.widening.unwrap_or_default()).with_fractional_bits(None);
    let again = written("a.ply", cloud, &options).expect("PLY holds any finite numbers");
    assert!(bits(&again.cloud) == bits(cloud), "PLY changes numbers");
    assert!(again.notes.is_empty(), "PLY loses something: {:?}", again.notes);
    for name in ["a.splat", "a.spz"] {
        // Numbers out of reach of a format are refused.
        if let Some(again) = written(name, cloud, &options) {
            assert_eq!(again.cloud.len(), cloud.len(), "{name}");
            assert_eq!(again.widening, (name == "a.spz").then_some(options.widening));
        }
    }
    Some(file)
}

fn written(name: &str, cloud: &Gaussians, options: &SplatOptions) -> Option<SplatFile> {
    let (bytes, _) = encode_splats(Path::new(name), cloud, options).ok()?;
    Some(parse_splats(Path::new(name), &bytes).expect("what is written is read"))
}

fn bits(cloud: &Gaussians) -> Vec<Vec<u32>> {
    cloud.fields().iter().map(|(_, numbers)| numbers.iter().map(|x| x.to_bits()).collect()).collect()
}

/// `.splat`: any 32 bytes are a Gaussian.
pub(crate) fn records(bytes: &[u8]) {
    if let Some(file) = read("fuzz.splat", bytes) {
        let records = bytes.len() / 32;
        assert!(file.cloud.len() <= records || !bytes.len().is_multiple_of(32), "more Gaussians than records");
    }
}

/// SPZ: files as they are and, so that the checksum does not stop everything, what is inside the gzip.
pub(crate) fn gzip(bytes: &[u8]) {
    read("fuzz.spz", bytes);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::none());
    gzip.write_all(bytes).expect("memory takes it");
    read("fuzz.spz", &gzip.finish().expect("memory takes it"));
}
