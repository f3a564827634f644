//! SPZ.

use super::*;
use flate2::Compression;
use flate2::bufread::GzDecoder;
use flate2::write::GzEncoder;
use std::io::{Read, Write};

pub(super) fn gzip(inside: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(inside).unwrap();
    gzip.finish().unwrap()
}

pub(super) fn inside(bytes: &[u8]) -> Vec<u8> {
    let mut inside = Vec::new();
    GzDecoder::new(bytes).read_to_end(&mut inside).unwrap();
    inside
}

fn header(version: u32, count: u32, degree: u8, bits: u8, flags: u8) -> Vec<u8> {
    let words = [0x5053_474e, version, count].map(u32::to_le_bytes).concat();
    [words, vec![degree, bits, flags, 0]].concat()
}

/// One Gaussian of version 2 or 3: at (1, -2, 3) of 8 fractional bits, degree 1.
fn one(version: u32) -> Vec<u8> {
    let mut bytes = header(version, 1, 1, 8, 0);
    for fixed in [256_i32, -512, 768] {
        bytes.extend(&fixed.to_le_bytes()[..3]);
    }
    bytes.push(51); // opacity 0.2
    bytes.extend([255, 0, 102]); // dc 10/3, -10/3, -2/3
    bytes.extend([0, 160, 255]); // sizes -10, 0, 5.9375
    if version == 3 {
        // y is largest; x positive 0, z negative full, w positive half.
        bytes.extend((1_u32 << 30 | (512 | 511) << 10 | 255).to_le_bytes());
    } else {
        bytes.extend([255, 128, 127]); // x 1, y and z next to 0, on either side
    }
    bytes.extend([128, 136, 120, 0, 255, 192, 64, 128, 128]);
    gzip(&bytes)
}

#[test]
fn files_built_by_hand_are_read() {
    for version in [2, 3] {
        let SplatFile { cloud, widening, notes } = parse("a.spz", &one(version)).unwrap();
        assert_eq!((cloud.len(), cloud.degree(), widening, notes), (1, 1, Some(Widening::Keeps), vec![]));
        // y and z turned.
        assert_eq!(cloud.mean, [1.0, 2.0, -3.0]);
        assert!((opacity(cloud.logit[0]) - 0.2).abs() < 1e-6);
        assert!(apart(&cloud.dc, &[10.0 / 3.0, -10.0 / 3.0, -2.0 / 3.0]) < 1e-6);
        assert_eq!(cloud.log_scale, [-10.0, 0.0, 5.9375]);
        // Coefficients of y and z turned, x not.
        let want = [0.0, -0.0625, 0.0625, 1.0, -0.992_187_5, -0.5, -0.5, 0.0, 0.0];
        assert_eq!(cloud.rest, want);
        let half = 0.5_f32.sqrt();
        let w = half * 255.0 / 511.0;
        let y = (1.0 - 0.5 - w * w).sqrt();
        let want = if version == 3 { [w, 0.0, -y, half] } else { [0.0, 1.0, -0.003_921_6, 0.003_921_6] };
        assert!(apart(&cloud.wxyz, &want) < 2e-5, "version {version}: {:?}", cloud.wxyz);
    }
}

#[test]
fn headers_are_written_as_described() {
    let mut cloud = Gaussians::new(2, 1).unwrap();
    cloud.mean[3] = 2000.0;
    let options = SplatOptions::default().with_widening(Widening::Dims).with_fractional_bits(12);
    let (bytes, _) = encode_splats(Path::new("a.spz"), &cloud, &options).unwrap();
    let inside = inside(&bytes);
    assert_eq!(inside[..16], header(3, 2, 1, 12, 1));
    assert_eq!(inside.len(), 16 + 2 * (9 + 1 + 3 + 3 + 4 + 9));
    // Row 1 is y, turned: -2000 * 4096.
    assert_eq!(inside[16 + 9 + 3..][..3], (-8_192_000_i32).to_le_bytes()[..3]);
    assert_eq!(inside[16 + 18..][..2], [128, 128]);
}

#[test]
fn fractional_bits_hold_what_is_farthest() {
    let mut cloud = Gaussians::new(3, 0).unwrap();
    for (far, bits) in
        [(0.4, 24), (0.5, 23), (1.0, 22), (-2047.9, 12), (2048.0, 11), (-70_000.0, 6), (8_388_607.0, 0), (0.0, 24)]
    {
        cloud.mean[4] = far;
        let (bytes, notes) = encode("a.spz", &cloud);
        assert_eq!(inside(&bytes)[13], bits, "{far}");
        assert_eq!(notes.iter().any(|n| n.contains("Gaussian 1 lies as far out")), bits < 12, "{notes:?}");
        let back = parse("a.spz", &bytes).unwrap().cloud.mean[4];
        assert!((back - far).abs() <= 0.5_f32.powi(i32::from(bits) + 1), "{far} comes back as {back}");
    }
    let with = |fractional_bits: Option<u32>| SplatOptions::default().with_fractional_bits(fractional_bits);
    cloud.mean[4] = 8_388_608.0;
    refused(encode_splats(Path::new("a.spz"), &cloud, &with(None)), &["`mean[1]` = 8388608", "Gaussian 1 lies beyond"]);
    cloud.mean[4] = -2048.0;
    refused(encode_splats(Path::new("a.spz"), &cloud, &with(Some(12))), &["`mean[1]` = -2048", "with 12 fractional"]);
    cloud.mean[4] = 0.1;
    refused(encode_splats(Path::new("a.spz"), &cloud, &with(Some(25))), &["25 fractional bits"]);
}

#[test]
fn clamps_are_counted() {
    let mut cloud = Gaussians::new(2, 1).unwrap();
    cloud.log_scale[0] = -11.0;
    cloud.log_scale[5] = 7.0;
    cloud.dc[2] = 4.0;
    cloud.rest[3] = -1.5;
    (0..4).for_each(|k| cloud.wxyz[2 * k] = 0.0);
    let (bytes, notes) = encode("a.spz", &cloud);
    for note in ["2 sizes clamped", "1 colour clamped", "1 colour above degree 0 clamped", "1 rotation without"] {
        has_note(&notes, note);
    }
    let back = parse("a.spz", &bytes).unwrap().cloud;
    assert_eq!((back.log_scale[0], back.log_scale[5]), (-10.0, 5.9375));
    // A half turn lies between: the limit of the other side is 1.
    assert_eq!(back.rest[3].abs(), 127.0 / 128.0);
    assert_eq!(rotation(&back, 0), Some([1.0, 0.0, 0.0, 0.0]));
}

#[test]
fn ends_of_opacity_become_useful_logits() {
    let mut cloud = Gaussians::new(2, 0).unwrap();
    cloud.logit.copy_from_slice(&[-40.0, 40.0]);
    let file = parse("a.spz", &encode("a.spz", &cloud).0).unwrap();
    assert!(file.cloud.logit[0] < -13.8 && file.cloud.logit[1] > 13.8, "{:?}", file.cloud.logit);
    has_note(&file.notes, "2 opacities of exactly 0 or 1");
}

#[test]
fn every_cut_is_an_error() {
    let bytes = encode("a.spz", &trained::small()).0;
    let inside = inside(&bytes);
    for length in 0..bytes.len() {
        assert!(parse("a.spz", &bytes[..length]).is_err(), "cut to {length} of {}", bytes.len());
    }
    for length in 0..inside.len() {
        assert!(parse("a.spz", &gzip(&inside[..length])).is_err(), "cut inside to {length} of {}", inside.len());
    }
    refused(parse("a.spz", &gzip(&[&inside[..], &[0]].concat())), &["holds more than"]);
    let followed = parse("a.spz", &[&bytes[..], &[1, 2, 3]].concat()).unwrap();
    has_note(&followed.notes, "ignored 3 bytes");
}

#[test]
fn headers_that_are_not_read_are_named() {
    let one = inside(&one(3));
    let with = |at: usize, byte: u8| {
        let mut bytes = one.clone();
        bytes[at] = byte;
        parse("a.spz", &gzip(&bytes))
    };
    refused(with(0, b'M'), &["compressed, but something else"]);
    for version in [0, 1, 4, 255] {
        refused(with(4, version), &[&format!("SPZ version {version} is not read")]);
    }
    refused(with(12, 5), &["degree 5"]);
    refused(with(13, 25), &["25 fractional bits"]);
    refused(with(14, 2), &["extension records"]);
    has_note(&with(14, 0x84).unwrap().notes, "flags of unknown meaning: 0x84");
    assert_eq!(with(14, 1).unwrap().widening, Some(Widening::Dims));
    refused(with(4, 2), &["more than the"]);
    refused(with(10, 0xff), &["lists 16711681 Gaussians"]);
    refused(with(10, 0x7f), &["holds fewer than"]);
    refused(parse("a.spz", &one), &["is not compressed", "version 3"]);
    refused(parse("a.spz", b"NGSP\x04\0\0\0 and zstd"), &["version 4 is not read", "save it again"]);
    refused(parse("a.spz", &gzip(b"")), &["is cut off"]);
}

#[test]
fn damage_inside_the_gzip_is_noticed() {
    let bytes = encode("a.spz", &trained::small()).0;
    let mut damaged = bytes.clone();
    let crc = bytes.len() - 8;
    damaged[crc] ^= 1;
    refused(parse("a.spz", &damaged), &["is damaged", "checksum"]);
    let mut damaged = bytes;
    damaged[10] = 0xff;
    refused(parse("a.spz", &damaged), &["a.spz"]);
}

#[test]
fn bombs_are_not_inflated() {
    // A header of one Gaussian before 64 MiB of zeros.
    let mut bomb = GzEncoder::new(Vec::new(), Compression::fast());
    bomb.write_all(&header(3, 1, 0, 12, 0)).unwrap();
    let zeros = vec![0; 1 << 20];
    (0..64).for_each(|_| bomb.write_all(&zeros).unwrap());
    refused(parse("a.spz", &bomb.finish().unwrap()), &["holds more than the 20 bytes of the 1 Gaussians"]);
}

#[test]
fn degree_four_is_cut_to_three_with_a_note() {
    let mut bytes = header(3, 1, 4, 12, 0);
    bytes.extend([0; 9 + 1 + 3 + 3]);
    bytes.extend((3_u32 << 30).to_le_bytes());
    bytes.extend(1..=72);
    let file = parse("a.spz", &gzip(&bytes)).unwrap();
    assert_eq!(file.cloud.degree(), 3);
    has_note(&file.notes, "above degree 3 left out");
    assert_eq!(file.cloud.rest[44].abs(), (128.0 - 45.0) / 128.0);
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn a_cloud_comes_back_within_half_a_step(cloud in any_cloud(0..=MAX_DEGREE, 6)) {
        let (bytes, notes) = encode("a.spz", &cloud);
        prop_assert!(notes.is_empty(), "{notes:?}");
        let back = parse("a.spz", &bytes).unwrap().cloud;
        prop_assert_eq!((back.len(), back.degree()), (cloud.len(), cloud.degree()));
        let step = 0.5_f64.powi(i32::from(inside(&bytes)[13]));
        let ulp = 4e-6; // of positions up to 100
        prop_assert!(apart(&back.mean, &cloud.mean) <= 0.5 * step + ulp);
        prop_assert!(apart(&back.log_scale, &cloud.log_scale) <= 0.5 / 16.0 + 1e-6);
        prop_assert!(apart(&back.dc, &cloud.dc) <= 0.5 / 255.0 / 0.15 + 1e-6);
        prop_assert!(opacities_apart(&back, &cloud) <= 0.5 / 255.0 + 1e-6);
        let (first, above) = cloud.rest.split_at(cloud.rest.len().min(9 * cloud.len()));
        let (back_first, back_above) = back.rest.split_at(first.len());
        prop_assert!(apart(back_first, first) <= 0.5 * 8.0 / 128.0 + 1e-6);
        prop_assert!(apart(back_above, above) <= 0.5 * 16.0 / 128.0 + 1e-6);
        for i in 0..cloud.len() {
            let (Some(want), Some(got)) = (rotation(&cloud, i), rotation(&back, i)) else { continue };
            let largest = (0..4).max_by(|a, b| want[*a].abs().total_cmp(&want[*b].abs())).unwrap();
            for k in (0..4).filter(|k| *k != largest) {
                let (got, want) = (got[k] * got[largest].signum(), want[k] * want[largest].signum());
                prop_assert!((got - want).abs() <= 0.5 / 511.0 * 0.5_f64.sqrt() + 1e-6);
            }
        }
        // What is on the grid stays there.
        let again = parse("a.spz", &encode("a.spz", &back).0).unwrap().cloud;
        prop_assert!(again.log_scale == back.log_scale && again.rest == back.rest);
        prop_assert!(opacities_apart(&again, &back) < 1e-6 && apart(&again.dc, &back.dc) < 1e-6);
    }
}
