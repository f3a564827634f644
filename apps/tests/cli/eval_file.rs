//! `eval FILE --scene SCENE`: Gaussians of any program, measured on the held-out views of a dataset.

use crate::tools::{Answer, dataset, error_line, nerf, text};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A short run, and its Gaussians as a file.
fn trained(background: &str) -> (TempDir, PathBuf, PathBuf) {
    let (folder, scene) = dataset();
    let [run, file] = ["run", "x.ply"].map(|name| folder.path().join(name));
    let words = ["train", text(&scene), "--out", text(&run), "--steps", "60", "--progress", "off", "--system", "splat"];
    let small = ["--max-splats", "400", "--set", "start_count=200", "--background", background];
    let answer = nerf(&[&words[..], &small].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(nerf(&["export", text(&run), "--splats", text(&file)]).code, 0);
    (folder, run, file)
}

/// The row of means, and the fog where it was measured.
fn means(answer: &Answer) -> Vec<String> {
    assert_eq!(answer.code, 0, "{}{}", answer.out, answer.err);
    let wanted = |line: &&str| line.starts_with("mean") || line.starts_with("fog");
    answer.out.lines().filter(wanted).map(Into::into).collect()
}

fn scores(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("eval.json")).unwrap()).unwrap()
}

#[test]
fn a_file_scores_as_the_run_it_was_exported_from() {
    for background in ["white", "black"] {
        let (folder, run, file) = trained(background);
        let (scene, out) = (folder.path().join("scene"), folder.path().join("scores"));
        let words = ["eval", text(&file), "--scene", text(&scene), "--background", background];
        let answer = nerf(&[&words[..], &["--out", text(&out)]].concat());
        let printed = means(&answer);
        assert!(answer.out.contains(" Gaussians") && answer.out.contains(text(&out)), "{}", answer.out);

        let [own, other] = [scores(&run), scores(&out)];
        for metric in ["psnr", "ssim"] {
            let [own, other] = [&own, &other].map(|json| json[metric].as_f64().unwrap());
            println!("{background}: {metric} {own} of the run, {other} of the file");
            assert!((own - other).abs() < 1e-3, "{metric}: {own} of the run, {other} of the file");
        }
        assert_eq!(other["views"].as_array().unwrap().len(), 2);
        assert_eq!(
            fs::read_dir(out.join("renders")).unwrap().count(),
            8,
            "render, truth, error and depth of two views"
        );
        assert!(out.join("eval.csv").exists());

        // Without a folder nothing is written; the scores are the same.
        let before = fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(means(&nerf(&words)), printed);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
        // Again into the same folder; the other two formats.
        assert_eq!(means(&nerf(&[&words[..], &["--out", text(&out)]].concat())), printed);
        for name in ["x.splat", "x.spz"] {
            let other = folder.path().join(name);
            assert_eq!(nerf(&["export", text(&run), "--splats", text(&other)]).code, 0);
            means(&nerf(&["eval", text(&other), "--scene", text(&scene), "--background", background]));
        }
    }
}

#[test]
fn the_dataset_is_read_as_asked_for() {
    let (folder, _, file) = trained("white");
    let scene = folder.path().join("scene");
    let measured = |more: &[&str]| {
        let answer = nerf(&[&["eval", text(&file), "--scene", text(&scene)][..], more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        answer.out
    };
    let views = |out: &str| out.lines().filter(|line| line.contains("r_")).count();
    assert_eq!(views(&measured(&[])), 2);
    let validation = measured(&["--validation", "every:3"]);
    assert!(views(&validation) == 2 && validation.contains("validation views"), "{validation}");
    assert_ne!(measured(&["--longest-side", "12"]), measured(&[]));
}

#[test]
fn a_word_too_many_or_too_few_is_one_clear_line() {
    let (folder, run, file) = trained("white");
    let (scene, missing) = (folder.path().join("scene"), folder.path().join("missing.ply"));
    let (run, file, scene, missing) = (text(&run), text(&file), text(&scene), text(&missing));
    let photo = folder.path().join("photo.ply");
    fs::write(&photo, [0xff, 0xd8, 0xff]).unwrap();
    for (words, parts) in [
        (&["eval", file][..], &["x.ply", "`--scene SCENE`"][..]),
        (&["eval", run, "--scene", scene], &["`--scene`", "run", "leave the option out"]),
        (&["eval", run, "--out", scene], &["`--out`", "leave the option out"]),
        (&["eval", run, "--holdout", "every:3"], &["`--holdout`", "leave the option out"]),
        (&["eval", run, "--background", "black"], &["`--background`"]),
        (&["eval", run, "--masks", "off"], &["how the dataset is read"]),
        (&["eval", missing, "--scene", scene], &["missing.ply", "no such file"]),
        (&["eval", text(&photo), "--scene", scene], &["photo.ply"]),
        (&["eval", file, "--scene", missing], &["missing.ply"]),
        (&["eval", file, "--scene", scene, "--holdout", "none"], &["`--scene ", "scene`", "`--holdout every:8`"]),
        (&["eval", file, "--scene", scene, "--scales", "2"], &["`--scales`", "x.ply"]),
        (&["eval", file, "--scene", scene, "--out", run], &["`--out ", "holds a run"]),
        (&["eval", file, "--scene", scene, "--out", scene], &["choose another `--out`"]),
    ] {
        let answer = nerf(words);
        assert_eq!(answer.code, 1, "{words:?}: {}{}", answer.out, answer.err);
        let line = error_line(&answer);
        println!("{line}");
        assert!(parts.iter().all(|part| line.contains(part)), "{words:?}: {parts:?} are not in: {line}");
    }
    assert!(scores(Path::new(run))["steps"].as_u64() == Some(60), "the run's scores stay");
}
