//! Every word of the command line, on a small scene.

use crate::tools::{SMALL, dataset, error_line, nerf, text};
use scene_io::export::Ply;
use serde_json::Value;
use std::fs;

#[test]
fn wrong_usage_has_exit_code_2() {
    for words in [
        &["train"][..],
        &["train", "x", "--out", "y", "--steps", "many"],
        &["train", "x", "--out", "y", "--seconds", "-3"],
        &["train", "x", "--out", "y", "--set", "novalue"],
        &["render", "x"],
        &["export", "x"],
        &["paint", "x"],
    ] {
        assert_eq!(nerf(words).code, 2, "{words:?}");
    }
    assert_eq!(nerf(&["--help"]).code, 0);
}

#[test]
fn words_that_mean_nothing_are_named() {
    let (folder, scene) = dataset();
    let (scene, out) = (text(&scene), folder.path().join("run"));
    for (extra, part) in [
        (["--system", "telepathy"], "telepathy"),
        (["--set", "no_such_setting=1"], "no_such_setting"),
        (["--set", "levels=\"many\""], "levels"),
        (["--holdout", "sometimes"], "sometimes"),
        (["--format", "polaroid"], "polaroid"),
        (["--lpips-weights", "/nowhere"], "/nowhere"),
    ] {
        let answer = nerf(&[&["train", scene, "--out", text(&out), "--steps", "1"], &extra[..]].concat());
        assert_eq!(answer.code, 1, "{extra:?}: {}", answer.err);
        assert!(error_line(&answer).contains(part), "{}", answer.err);
    }
    for words in [["eval", "/nowhere"], ["check", "synthetic:nothing"]] {
        let answer = nerf(&words);
        assert_eq!(answer.code, 1);
        error_line(&answer);
    }
}

#[test]
fn check_lists_the_embedded_scene() {
    let answer = nerf(&["check", "synthetic:tabletop", "--quick"]);
    assert_eq!(answer.code, 0);
    assert!(answer.out.contains("60 train") && answer.out.contains("10 test"), "{}", answer.out);
}

#[test]
fn a_run_is_trained_measured_rendered_and_exported() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let path = |name: &str| folder.path().join(name);
    let train =
        ["train", text(&scene), "--out", text(&run), "--steps", "30", "--eval-every", "20", "--progress", "json"];
    let answer = nerf(&[&train[..], &SMALL].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("held out (2") && answer.out.contains("memory:"), "{}", answer.out);
    let events: Vec<Value> = answer.err.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let of = |kind: &str| events.iter().filter(|e| e["event"] == kind).count();
    assert!(of("progress") >= 1 && of("evaluated") == 2 && of("saved") == 1, "{}", answer.err);
    for file in ["config.toml", "heldout.txt", "metrics.csv", "eval.json", "report.html", "renders"] {
        assert!(run.join(file).exists(), "{file}");
    }

    let before: Value = serde_json::from_slice(&fs::read(run.join("eval.json")).unwrap()).unwrap();
    let answer = nerf(&["eval", text(&run)]);
    assert!(answer.code == 0 && answer.out.contains("mean"), "{}{}", answer.out, answer.err);
    let after: Value = serde_json::from_slice(&fs::read(run.join("eval.json")).unwrap()).unwrap();
    assert_eq!(before["psnr"], after["psnr"]);

    let (mesh, points, cameras) = (path("mesh.ply"), path("points.ply"), path("cameras.json"));
    let answer = nerf(&[
        "export",
        text(&run),
        "--mesh",
        text(&mesh),
        "--points",
        text(&points),
        "--cameras",
        text(&cameras),
        "--resolution",
        "24",
        "--level",
        "0.5",
        "--count",
        "500",
    ]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    for file in [&mesh, &points] {
        Ply::read(file).unwrap();
    }

    // The exported cameras are a path to render along.
    let frames = path("frames");
    let answer = nerf(&[
        "render",
        text(&run),
        "--path",
        text(&cameras),
        "--frames",
        "3",
        "--out",
        text(&frames),
        "--layers",
        "colour,depth,opacity,normals,canonical,flow",
        "--longest-side",
        "12",
    ]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    for layer in ["colour", "depth", "opacity", "normals", "canonical"] {
        let picture = image::open(frames.join(format!("{layer}_0002.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (12, 12));
    }
    assert_eq!(&fs::read(frames.join("preview.gif")).unwrap()[..6], b"GIF89a");
    assert!(answer.out.contains("canonical points are drawn from "), "{}", answer.out);
    // Nothing moves but the camera: that is all of the flow, which goes from each frame to the next one.
    assert!(answer.out.contains("flow is drawn ") && !answer.out.contains("the camera alone"), "{}", answer.out);
    let flow = |i: usize| frames.join(format!("flow_{i:04}.png"));
    assert_eq!([0, 1, 2].map(|i| flow(i).exists()), [true, true, false]);
    let picture = image::open(flow(0)).unwrap();
    assert_eq!((picture.width(), picture.height()), (12, 12));
    let still = ["--path", "hold:test/r_000", "--out", text(&frames), "--layers", "flow"];
    let answer = nerf(&[&["render", text(&run)], &still[..]].concat());
    let error = error_line(&answer);
    assert!(answer.code == 1 && error.contains("`--layers flow`") && error.contains("one frame only"), "{error}");
    let answer = nerf(&["render", text(&run), "--path", "orbit", "--out", text(&frames), "--layers", "canonicle"]);
    assert!(
        answer.code == 2 && answer.err.contains("[possible values: ") && answer.err.contains(", flow, background]")
    );
    let answer = nerf(&["render", text(&run), "--path", "orbit", "--out", text(&frames), "--layers", "background"]);
    assert!(answer.code == 1 && error_line(&answer).contains("`degauss`"), "{}", answer.err);
    let answer = nerf(&["render", text(&run), "--path", "orbit", "--frames", "2", "--out", text(&path("orbit"))]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    // Without a path: one that stays where photos were, and how much of each frame they saw.
    let default = path("default");
    let answer = nerf(&["render", text(&run), "--frames", "4", "--video", "off", "--out", text(&default)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("path ") && answer.out.contains("seen by two photos: "), "{}", answer.out);
    let table = fs::read_to_string(default.join("coverage.csv")).unwrap();
    assert!(table.starts_with("frame,seen_by_two\n0,") && table.lines().count() == 5, "{table}");
    assert!(!default.join("preview.mp4").exists() && !default.join("preview.webm").exists());
    let answer = nerf(&["render", text(&run), "--path", "orbits", "--out", text(&frames)]);
    assert!(answer.code == 2 && answer.err.contains("`photos`, `orbit`, `spiral`, `hold:NAME`"), "{}", answer.err);
    let answer = nerf(&["render", text(&run), "--path", "/nowhere.json", "--out", text(&frames)]);
    assert!(error_line(&answer).contains("no such file") && error_line(&answer).contains("`photos`"), "{}", answer.err);
    assert!(answer.code == 1 && error_line(&answer).contains("/nowhere.json"), "{}", answer.err);
}
