//! The words of `nerf-wild`, with a system that knows one light and takes every pixel for static.

use crate::tools::{Answer, SMALL, dataset, error_line, nerf, nerf_wild, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn train(scene: &Path, run: &Path, extra: &[&str]) -> Answer {
    let words = ["train", text(scene), "--out", text(run), "--system", "ngp", "--steps", "3", "--progress", "off"];
    nerf_wild(&[&words, &SMALL[..], extra].concat())
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn words_of_the_wild_are_refused_by_the_app_for_static_scenes() {
    for words in [
        &["masks", "x"][..],
        &["train", "x", "--out", "y", "--field", "mlp"],
        &["train", "x", "--out", "y", "--eval-appearance", "fit"],
        &["eval", "x", "--eval-appearance", "mean"],
        &["render", "x", "--path", "orbit", "--out", "y", "--appearance", "mean"],
    ] {
        let answer = nerf(words);
        assert_eq!(answer.code, 2, "{words:?}");
        assert!(answer.err.contains("word of nerf-wild"), "{}", answer.err);
    }
    for (program, has) in [(nerf as fn(&[&str]) -> Answer, false), (nerf_wild, true)] {
        let help = program(&["--help"]);
        assert_eq!((help.code, help.out.contains("masks")), (0, has), "{}", help.out);
        let help = program(&["train", "--help"]);
        assert_eq!((help.code, help.out.contains("--eval-appearance")), (0, has), "{}", help.out);
    }
    assert_eq!(nerf_wild(&["masks", "x", "--every", "0"]).code, 2);
    assert_eq!(nerf_wild(&["eval", "x", "--eval-appearance", "encode:right"]).code, 2);
}

#[test]
fn halves_are_scored_where_that_is_asked_for_and_it_is_said() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let answer = train(&scene, &run, &["--eval-appearance", "fit"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("one light, nothing to fit; right half scored"), "{}", answer.out);
    let half = json(&run.join("eval.json"));
    assert_eq!(half["protocol"], serde_json::json!({ "appearance": "fit", "scored": "right-half" }));
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("eval_appearance = \"fit\""));

    let answer = nerf_wild(&["eval", text(&run), "--eval-appearance", "mean"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let whole = json(&run.join("eval.json"));
    assert_eq!(whole["protocol"]["scored"], "whole");
    assert_ne!(whole["psnr"], half["psnr"]);
    let answer = nerf_wild(&["eval", text(&run)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(json(&run.join("eval.json"))["psnr"], half["psnr"], "the run's own protocol again");

    let resume = ["train", "--resume", "--out", text(&run), "--steps", "4", "--eval-appearance", "mean"];
    let answer = nerf_wild(&resume);
    assert_eq!(answer.code, 1);
    let line = error_line(&answer);
    assert!(line.contains("--eval-appearance mean") && line.contains("--eval-appearance fit"), "{line}");
}

#[test]
fn what_a_system_has_not_is_said_in_one_line() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let answer = train(&scene, &run, &["--eval-appearance", "image:r_0"]);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("one light only"), "{}", answer.err);
    assert!(!run.join("checkpoint").exists());
    let answer = train(&scene, &run, &["--eval-appearance", "encode:left"]);
    assert!(error_line(&answer).contains("no encoder"), "{}", answer.err);
    let answer = train(&scene, &run, &["--train-split", "clean"]);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("clean"), "{}", answer.err);

    assert_eq!(train(&scene, &run, &["--train-split", "clutter"]).code, 0);
    let resume = ["train", "--resume", "--out", text(&run), "--steps", "4", "--train-split", "clean"];
    let answer = nerf_wild(&resume);
    assert!(error_line(&answer).contains("--train-split clean"), "{}", answer.err);
    let answer = nerf_wild(&["masks", text(&run)]);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("`ngp` finds no masks"), "{}", answer.err);
    let pictures = folder.path().join("pictures");
    let render = |words: &[&str]| nerf_wild(&[&["render", text(&run), "--out", text(&pictures)], words].concat());
    for light in ["image:r_000", "fit:/nowhere.png", "mean..image:r_000"] {
        let answer = render(&["--path", "orbit", "--frames", "2", "--appearance", light]);
        assert_eq!(answer.code, 1);
        assert!(error_line(&answer).contains("one light only"), "{light}: {}", answer.err);
    }
    let answer = render(&["--path", "hold:nobody"]);
    assert!(error_line(&answer).contains("hold:nobody"), "{}", answer.err);
    let answer = render(&["--path", "hold:train/r_000", "--appearance", "mean"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(pictures.join("colour_0000.png").exists() && !pictures.join("colour_0001.png").exists());
}

#[test]
fn check_says_what_lies_beside_the_photos() {
    let (_folder, scene) = dataset();
    let check = || nerf_wild(&["check", text(&scene)]);
    assert!(!check().out.contains("beside"), "{}", check().out);
    let photo = fs::read_dir(scene.join("train")).unwrap().next().unwrap().unwrap().path();
    image::GrayImage::from_pixel(24, 24, image::Luma([1])).save(photo.with_extension("segs.png")).unwrap();
    let answer = check();
    assert_eq!(answer.code, 0, "{}{}", answer.out, answer.err);
    assert!(answer.out.contains("beside 6 training photos: segments of 1"), "{}", answer.out);
}
