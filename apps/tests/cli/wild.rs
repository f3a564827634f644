//! The words of `nerf-wild`, with a system that knows one light and takes every pixel for static, and with others.

use crate::tools::{Answer, SMALL, dataset, error_line, nerf, nerf_wild, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn train(scene: &Path, run: &Path, extra: &[&str]) -> Answer {
    train_as("plain", scene, run, &[&SMALL[..], extra].concat())
}

fn train_as(system: &str, scene: &Path, run: &Path, extra: &[&str]) -> Answer {
    let words = ["train", text(scene), "--out", text(run), "--system", system, "--steps", "3", "--progress", "off"];
    nerf_wild(&[&words, extra].concat())
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
    assert!(answer.out.contains("one appearance, nothing to fit; right half scored"), "{}", answer.out);
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
    assert!(error_line(&answer).contains("one appearance only"), "{}", answer.err);
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
        assert!(error_line(&answer).contains("one appearance only"), "{light}: {}", answer.err);
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

#[test]
fn a_system_with_codes_is_fitted_to_photos_and_rendered_in_their_light() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let answer = train_as("nerf-a", &scene, &run, &SMALL);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("appearance fitted on the left half of each view"), "{}", answer.out);
    let eval = json(&run.join("eval.json"));
    assert_eq!((&eval["protocol"]["appearance"], &eval["protocol"]["scored"]), (&"fit".into(), &"right-half".into()));
    let row = json(&run.join("appearance/appearance.json"));
    assert_eq!(row["pictures"].as_array().unwrap().len(), 7, "the mean and six photos");
    assert!(fs::read_to_string(run.join("report.html")).unwrap().contains("<h2>Appearance</h2>"));

    let pictures = folder.path().join("pictures");
    let render = |words: &[&str]| nerf_wild(&[&["render", text(&run), "--out", text(&pictures)], words].concat());
    let path = ["--path", "hold:test/r_000", "--frames", "3", "--appearance"];
    let answer = render(&[&path[..], &["image:train/r_000..fit:test/r_000"]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    let frame = |i: usize| fs::read(pictures.join(format!("colour_{i:04}.png"))).unwrap();
    assert!(frame(0) != frame(2), "the light has changed and nothing else");
    let (first, last) = (frame(0), frame(2));
    for (light, same) in [("image:r_000", None), ("image:train/r_000", Some(first)), ("fit:test/r_000", Some(last))] {
        let answer = render(&[&path[..], &[light]].concat());
        match same {
            // One of the test views is called so, too; but only training photos have a light.
            None => assert_eq!(answer.code, 0, "{}", answer.err),
            Some(same) => assert!(answer.code == 0 && frame(1) == same, "{light}: {}", answer.err),
        }
    }
    let answer = render(&[&path[..], &["image:test/r_000"]].concat());
    assert!(error_line(&answer).contains("no such photo"), "{}", answer.err);
    let answer = render(&[&path[..], &["fit:/nowhere.png"]].concat());
    assert!(error_line(&answer).contains("/nowhere.png"), "{}", answer.err);
}

#[test]
fn a_system_with_masks_writes_them() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let judged = [&SMALL[..], &["--set", "judge_first=2"]].concat();
    let answer = train_as("robust-nerf", &scene, &run, &judged);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let answer = nerf_wild(&["masks", text(&run), "--every", "4", "--empty-class", "zero"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("2 of 6 training photos, no truth"), "{}", answer.out);
    let table = json(&run.join("masks/masks.json"));
    assert_eq!((table["views"].as_array().unwrap().len(), &table["empty_class"]), (2, &"zero".into()));
    let name = table["views"][0]["file"].as_str().unwrap();
    let mask = image::open(run.join("masks").join(name)).unwrap();
    assert!(mask.color() == image::ColorType::L8 && (mask.width(), mask.height()) == (24, 24));
    assert!(run.join("masks/side_by_side").join(name).exists());
    assert!(fs::read_to_string(run.join("report.html")).unwrap().contains("<h2>Masks</h2>"));
}

#[test]
fn the_field_is_chosen_by_a_word_of_its_own() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let small = ["width=8", "depth=1", "coarse=4", "fine=4", "batch_rays=16"].map(|s| ["--set", s]).concat();
    let answer = train_as("plain", &scene, &run, &[&["--field", "mlp"], &small[..]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("field = \"mlp\""));
    let answer = nerf_wild(&["train", "--resume", "--out", text(&run), "--steps", "4", "--field", "ngp"]);
    let line = error_line(&answer);
    assert!(line.contains("field=\"ngp\"") && line.contains("field=\"mlp\""), "{line}");
}

#[test]
fn masks_that_came_with_photos_are_shown_beside_those_that_were_found() {
    let (folder, scene) = dataset();
    // In every photo the left third is not to be looked at.
    let photos: Vec<_> = fs::read_dir(scene.join("train")).unwrap().map(|photo| photo.unwrap().path()).collect();
    for photo in photos {
        let mask = image::GrayImage::from_fn(24, 24, |x, _| image::Luma([if x < 8 { 0 } else { 255 }]));
        mask.save(photo.with_extension("mask.png")).unwrap();
    }
    let judged = [&SMALL[..], &["--set", "judge_first=2"]].concat();
    for (system, extra) in [("robust-nerf", &judged[..]), ("plain", &SMALL[..])] {
        let run = folder.path().join(system);
        let answer = train_as(system, &scene, &run, extra);
        assert_eq!(answer.code, 0, "{}", answer.err);
        let table = json(&run.join("masks/masks.json"));
        let view = &table["views"][0];
        assert!((view["given_share"].as_f64().unwrap() - 2.0 / 3.0).abs() < 1e-6, "{view}");
        let name = view["file"].as_str().unwrap();
        let given = image::open(run.join("masks/given").join(name)).unwrap().into_luma8();
        assert_eq!([given.get_pixel(3, 3).0, given.get_pixel(20, 3).0], [[0], [255]]);
        let together = image::open(run.join("masks/side_by_side").join(name)).unwrap();
        assert!(together.width() >= 3 * 24, "photo, mask as given, mask as found: {}", together.width());
        if system == "plain" {
            assert_eq!(view["static_share"], 1.0, "nothing is left out");
        }
    }
}
