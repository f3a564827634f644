//! Training and measuring at several scales, with the system that is made for it.

use crate::tools::{dataset, error_line, nerf, text};
use serde_json::Value;
use std::fs;

const TINY: [&str; 12] = [
    "--set",
    "width=16",
    "--set",
    "depth=2",
    "--set",
    "coarse=8",
    "--set",
    "fine=8",
    "--set",
    "batch_rays=32",
    "--set",
    "lr_steps=100",
];

#[test]
fn scales_are_trained_on_resumed_and_measured() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let train = ["train", text(&scene), "--out", text(&run), "--system", "mip-nerf", "--scales", "3", "--steps", "4"];
    let answer = nerf(&[&train, &TINY[..]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("6 training views, 24x24, at 3 scales"), "{}", answer.out);
    // The held-out views are measured at full size.
    let eval: Value = serde_json::from_slice(&fs::read(run.join("eval.json")).unwrap()).unwrap();
    assert_eq!(eval["views"].as_array().unwrap().len(), 2);

    let answer = nerf(&["train", "--resume", "--out", text(&run), "--scales", "2", "--steps", "6"]);
    assert!(error_line(&answer).contains("--scales"), "{}", answer.err);
    let answer = nerf(&["train", "--resume", "--out", text(&run), "--steps", "6"]);
    assert_eq!(answer.code, 0, "{}", answer.err);

    let answer = nerf(&["eval", text(&run), "--scales", "2"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        answer.out.contains("24x24") && answer.out.contains("1/2") && answer.out.contains("12x12"),
        "{}",
        answer.out
    );
    let table: Value = serde_json::from_slice(&fs::read(run.join("eval_scales.json")).unwrap()).unwrap();
    let scales = table["scales"].as_array().unwrap();
    assert_eq!(scales.len(), 2);
    // Full size is what `eval` measures.
    let eval: Value = serde_json::from_slice(&fs::read(run.join("eval.json")).unwrap()).unwrap();
    assert_eq!(scales[0]["psnr"], eval["psnr"]);
    assert!(scales[1]["psnr"].as_f64().unwrap() > 0.0);
    let picture = image::open(fs::read_dir(run.join("renders/scale_2")).unwrap().next().unwrap().unwrap().path());
    assert_eq!((picture.as_ref().unwrap().width(), picture.unwrap().height()), (12, 12));
}

#[test]
fn more_scales_than_the_images_have_are_refused() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let train = ["train", text(&scene), "--out", text(&run), "--steps", "1", "--scales"];
    let answer = nerf(&[&train[..], &["6"]].concat());
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("24 pixels"), "{}", answer.err);
    assert_eq!(nerf(&[&train[..], &["0"]].concat()).code, 2);
}
