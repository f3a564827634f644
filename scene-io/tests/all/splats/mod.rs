//! Clouds of Gaussians to files and back. Files are built here by hand from the descriptions of the formats, so that
//! readers are not only held against our own writers.

mod foreign;
mod mutated;
mod ply;
mod splat;
mod spz;
mod trained;

use proptest::prelude::*;
use scene_io::{SceneError, SplatFile, SplatOptions, encode_splats, parse_splats, read_splats, write_splats};
use splat_core::{Gaussians, MAX_DEGREE, SH_0, Widening, rest_len};
use std::path::{Path, PathBuf};

fn parse(name: &str, bytes: &[u8]) -> Result<SplatFile, SceneError> {
    parse_splats(Path::new(name), bytes)
}

fn encode(name: &str, cloud: &Gaussians) -> (Vec<u8>, Vec<String>) {
    encode_splats(Path::new(name), cloud, &SplatOptions::default()).unwrap()
}

/// One line that holds all parts.
#[track_caller]
fn refused<T>(result: Result<T, SceneError>, parts: &[&str]) {
    let Err(error) = result else { panic!("is taken, although {parts:?}") };
    let line = error.to_string();
    assert!(!line.contains('\n'), "{line}");
    for part in parts {
        assert!(line.contains(part), "no `{part}` in: {line}");
    }
}

#[track_caller]
fn has_note(notes: &[String], part: &str) {
    assert!(notes.iter().any(|n| n.contains(part)), "no note holds `{part}`: {notes:#?}");
}

/// The numbers of each field, as bits.
fn bits(cloud: &Gaussians) -> Vec<Vec<u32>> {
    cloud.fields().iter().map(|(_, numbers)| numbers.iter().map(|x| x.to_bits()).collect()).collect()
}

/// Clouds of up to `most` Gaussians with numbers as training makes them: within reach of every format.
fn any_cloud(degree: impl Strategy<Value = usize>, most: usize) -> impl Strategy<Value = Gaussians> {
    (degree, 0..=most).prop_flat_map(|(degree, n)| {
        let row = |k: usize, low: f32, high: f32| prop::collection::vec(low..high, k * n);
        let fields = (
            row(3, -100.0, 100.0),
            row(3, -9.9, 5.9),
            row(4, -2.0, 2.0),
            row(1, -6.0, 6.0),
            row(3, -1.7, 1.7),
            row(3 * rest_len(degree), -0.99, 0.99),
        );
        fields.prop_map(move |(mean, log_scale, wxyz, logit, dc, rest)| {
            let mut cloud = Gaussians::new(n, degree).unwrap();
            (cloud.mean, cloud.log_scale, cloud.wxyz) = (mean, log_scale, wxyz);
            (cloud.logit, cloud.dc, cloud.rest) = (logit, dc, rest);
            cloud
        })
    })
}

/// Rotation `i`, with length 1; `None` where it is too short to have a direction.
fn rotation(cloud: &Gaussians, i: usize) -> Option<[f64; 4]> {
    let q = [0, 1, 2, 3].map(|k| f64::from(cloud.wxyz[k * cloud.len() + i]));
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    (norm > 1e-8).then(|| q.map(|x| x / norm))
}

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

/// Largest difference of two fields.
fn apart(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).fold(0.0, f64::max)
}

/// Largest difference of opacities.
fn opacities_apart(a: &Gaussians, b: &Gaussians) -> f64 {
    a.logit.iter().zip(&b.logit).map(|(a, b)| (opacity(*a) - opacity(*b)).abs()).fold(0.0, f64::max)
}

/// Largest angle between rotations of the same place, radians; those without direction left out.
fn turned(a: &Gaussians, b: &Gaussians) -> f64 {
    let angle = |i| {
        let dot: f64 = rotation(a, i)?.iter().zip(rotation(b, i)?).map(|(x, y)| x * y).sum();
        Some(2.0 * dot.abs().min(1.0).acos())
    };
    (0..a.len()).filter_map(angle).fold(0.0, f64::max)
}

#[test]
fn files_appear_under_their_names_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = Gaussians::new(3, 0).unwrap();
    for name in ["new/a.ply", "a.splat", "A.SPZ"] {
        let path = folder.path().join(name);
        write_splats(&path, &cloud, &SplatOptions::default()).unwrap();
        let file = read_splats(&path).unwrap();
        assert_eq!((file.cloud.len(), file.notes), (3, vec![]), "{name}");
    }
    refused(read_splats(&folder.path().join("none.ply")), &["none.ply", "check the path"]);
    refused(read_splats(folder.path()), &["is a folder"]);
}

#[test]
fn what_cannot_be_written_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut cloud = Gaussians::new(3, 0).unwrap();
    cloud.dc[4] = f32::NAN;
    for name in ["a.ply", "a.splat", "a.spz"] {
        let path = folder.path().join(name);
        refused(
            write_splats(&path, &cloud, &SplatOptions::default()),
            &[name, "`dc[1]` = NaN", "Gaussian 1 is not finite"],
        );
        assert!(!path.exists());
    }
    refused(write_splats(Path::new("a.obj"), &cloud, &SplatOptions::default()), &["a.obj", ".ply, .splat or .spz"]);
    cloud.dc.pop();
    refused(write_splats(Path::new("a.ply"), &cloud, &SplatOptions::default()), &["dc", "9", "8"]);
}

#[test]
fn empty_clouds_are_files() {
    for degree in 0..=MAX_DEGREE {
        let cloud = Gaussians::new(0, degree).unwrap();
        for name in ["a.ply", "a.splat", "a.spz"] {
            let (bytes, _) = encode(name, &cloud);
            let file = parse(name, &bytes).unwrap();
            let want = if name == "a.splat" { 0 } else { degree };
            assert_eq!((file.cloud.len(), file.cloud.degree(), file.notes), (0, want, vec![]), "{name}");
        }
    }
}

#[test]
fn how_a_cloud_wants_to_be_drawn_is_kept_where_the_format_can_say_it() {
    let cloud = Gaussians::new(1, 0).unwrap();
    for widening in [Widening::Keeps, Widening::Dims] {
        let options = SplatOptions::default().with_widening(widening);
        let (bytes, notes) = encode_splats(Path::new("a.spz"), &cloud, &options).unwrap();
        assert_eq!((parse("a.spz", &bytes).unwrap().widening, notes), (Some(widening), vec![]));
        let (bytes, notes) = encode_splats(Path::new("a.ply"), &cloud, &options).unwrap();
        let said = (widening == Widening::Dims).then_some(widening);
        assert_eq!((parse("a.ply", &bytes).unwrap().widening, notes), (said, vec![]));
        let (bytes, notes) = encode_splats(Path::new("a.splat"), &cloud, &options).unwrap();
        assert_eq!(parse("a.splat", &bytes).unwrap().widening, None);
        assert_eq!(notes.iter().any(|n| n.contains("antialiasing")), widening == Widening::Dims);
    }
    // As other programs say it.
    let (bytes, _) = encode("a.ply", &cloud);
    let text = String::from_utf8_lossy(&bytes);
    let at = text.find("element").unwrap();
    for (comment, want) in [
        ("SplatRenderMode: mip", Some(Widening::Dims)),
        ("SplatRenderMode: default", Some(Widening::Keeps)),
        ("antialiased 1", Some(Widening::Dims)),
        ("antialiased 0", Some(Widening::Keeps)),
        ("antialiased", None),
    ] {
        let said = [&bytes[..at], format!("comment {comment}\n").as_bytes(), &bytes[at..]].concat();
        assert_eq!(parse("a.ply", &said).unwrap().widening, want, "{comment}");
    }
}

#[test]
fn the_same_cloud_gives_the_same_bytes() {
    let cloud = trained::small();
    for name in ["a.ply", "a.splat", "a.spz"] {
        assert!(encode(name, &cloud).0 == encode(name, &cloud).0, "{name}");
    }
}
