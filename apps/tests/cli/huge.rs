//! Pictures that no machine has the memory for: one line, before anything is drawn.

use crate::tools::{error_line, nerf, text};
use scene_io::{SplatOptions, write_splats};
use serde_json::json;
use splat_core::Gaussians;
use std::fs;

#[test]
fn frames_that_are_too_large_are_refused_and_small_ones_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut cloud = Gaussians::new(30, 0).unwrap();
    for (i, x) in cloud.mean.iter_mut().enumerate() {
        *x = (i % 7) as f32 - 3.0;
    }
    write_splats(&at("a.ply"), &cloud, &SplatOptions::default()).unwrap();
    let path = |width: u64, height: u64| {
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9], [0, 0, 0, 1]];
        let frames = [json!({ "transform_matrix": pose })];
        let file = at(&format!("{width}.json"));
        fs::write(&file, json!({ "w": width, "h": height, "fl_x": 50, "frames": frames }).to_string()).unwrap();
        file
    };
    let out = at("out");
    let render = |file: &std::path::Path, more: &[&str]| {
        let (cloud, file) = (at("a.ply"), file.to_path_buf());
        let words = ["render", text(&cloud), "--path", text(&file), "--out", text(&out)];
        nerf(&[&words[..], more].concat())
    };
    // 65535 is the longest side of a path file: 387 GB.
    for (width, height, part) in [
        (65_535, 65_535, "frame 0 of the path has 65535x65535 pixels"),
        (4_000_000_000, 4_000_000_000, "at most 65535 pixels"),
        (1 << 62, 1, "at most 65535 pixels"),
    ] {
        let answer = render(&path(width, height), &[]);
        assert_eq!(answer.code, 1, "{}", answer.err);
        assert!(error_line(&answer).contains(part), "{}", answer.err);
        assert!(!out.exists(), "nothing is written");
    }
    let answer = render(&path(64, 48), &["--frames", "18446744073709551615"]);
    assert_eq!(answer.code, 2, "{}", answer.err);
    // The largest one asked for, made small.
    let answer = render(&path(65_535, 65_535), &["--longest-side", "40"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(image::image_dimensions(out.join("colour_0000.png")).unwrap(), (40, 40));
}
