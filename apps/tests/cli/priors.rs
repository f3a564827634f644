//! `nerf-dynamic priors`: flow and masks of a scene that has none.

use crate::tools::{Answer, error_line, nerf, nerf_dynamic, nerf_wild, text};
use scene_io::synthetic::{OrbitCamera, OrbitOptions, write_orbit};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// 6 training and 2 test views of 40 x 36 pixels in D-NeRF's form, in `DIR/scene`.
fn video(camera: OrbitCamera) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    let options = OrbitOptions { width: 40, height: 36, train: 6, test: 2, rays: 1, camera, ..OrbitOptions::default() };
    write_orbit(&options, &scene).unwrap();
    (folder, scene)
}

fn flow(priors: &Path, name: &str) -> PathBuf {
    priors.join("flow").join("train").join(name)
}

#[test]
fn they_are_made_beside_the_scene_and_made_once() {
    let (_folder, scene) = video(OrbitCamera::Walking);
    let answer = nerf_dynamic(&["priors", text(&scene), "--progress", "lines"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("6 photos: ") && answer.out.contains("motion masks"), "{}", answer.out);
    assert!(answer.err.contains("flow and masks: 6 of 6, 100 %"), "{}", answer.err);
    let priors = scene.join("priors");
    let forward = fs::read(flow(&priors, "r_000_fwd.flo")).unwrap();
    assert_eq!((&forward[..4], forward.len()), (b"PIEH".as_slice(), 12 + 8 * 40 * 36));
    assert!(flow(&priors, "r_005_bwd.flo").is_file() && !flow(&priors, "r_005_fwd.flo").exists());
    assert!(priors.join("motion_masks/train/r_003.png").is_file());

    // They are read with the scene, and nothing is left to do.
    let check = nerf_dynamic(&["check", text(&scene)]);
    assert_eq!(check.code, 0, "{}", check.out);
    for part in ["flow to the next photo of 5", "flow to the photo before of 5", "masks of what moves of 6"] {
        assert!(check.out.contains(part), "{part}: {}", check.out);
    }
    let again = nerf_dynamic(&["priors", text(&scene), "--progress", "lines"]);
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(again.err.contains("6 of 6 photos done before"), "{}", again.err);
    assert_eq!((again.out, fs::read(flow(&priors, "r_000_fwd.flo")).unwrap()), (answer.out, forward));
}

#[test]
fn few_photos_smaller_ones_and_another_folder_can_be_asked_for() {
    let (folder, scene) = video(OrbitCamera::Walking);
    let out = folder.path().join("elsewhere");
    let words = ["priors", text(&scene), "--out", text(&out), "--frames", "3", "--longest-side", "20"];
    let answer = nerf_dynamic(&words);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("3 photos: ") && !scene.join("priors").exists(), "{}", answer.out);
    assert_eq!(fs::read(flow(&out, "r_001_bwd.flo")).unwrap().len(), 12 + 8 * 20 * 18);
    assert!(!flow(&out, "r_003_bwd.flo").exists());
}

#[test]
fn what_is_known_exactly_of_a_drawn_scene_is_written_and_read_from_another_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("exact");
    let words = ["priors", "synthetic:orbit", "--exact", "--out", text(&out), "--frames", "3", "--longest-side", "32"];
    let answer = nerf_dynamic(&words);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("3 photos: ") && answer.out.contains("exact flow, disparities"), "{}", answer.out);
    let disparity = fs::read(out.join("disp/train/r_002.npy")).unwrap();
    assert_eq!((&disparity[..6], disparity.len()), (b"\x93NUMPY".as_slice(), 128 + 4 * 32 * 32));
    let words = ["check", "synthetic:orbit", "--quick", "--priors", text(&out)];
    let check = nerf_dynamic(&words);
    assert_eq!(check.code, 0, "{}", check.out);
    for part in ["flow to the next photo of 2", "flow to the photo before of 2", "disparity of 3", "what moves of 3"] {
        assert!(check.out.contains(part), "{part}: {}", check.out);
    }
    let answer = nerf(&words);
    assert!(answer.code == 2 && answer.err.contains("`--priors` is a word of nerf-dynamic"), "{}", answer.err);
}

#[test]
fn a_camera_that_stands_still_is_warned_of() {
    let (_folder, scene) = video(OrbitCamera::Frozen);
    let answer = nerf_dynamic(&["priors", text(&scene)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.err.contains("warning: 6 of 6 photos were taken from nearly the same place"), "{}", answer.err);
}

/// The training photos of [`video`] without what says where they were taken, in `DIR/film/rgb`.
fn film() -> (TempDir, PathBuf) {
    let (folder, scene) = video(OrbitCamera::Walking);
    let film = folder.path().join("film");
    fs::create_dir_all(film.join("rgb")).unwrap();
    for i in 0..6 {
        fs::copy(scene.join(format!("train/r_{i:03}.png")), film.join(format!("rgb/{i:04}.png"))).unwrap();
    }
    (folder, film)
}

#[test]
fn a_film_without_cameras_has_priors_and_is_not_trained_on() {
    let (folder, film) = film();
    let answer = nerf_dynamic(&["priors", text(&film), "--progress", "lines"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.err.contains("no cameras: what moves is what leaves the fundamental matrix"), "{}", answer.err);
    assert!(answer.out.contains("6 photos: ") && answer.out.contains("no cameras: "), "{}", answer.out);
    let priors = film.join("priors");
    assert!(priors.join("flow/0000_fwd.flo").is_file() && !priors.join("flow/0005_fwd.flo").exists());
    assert_eq!(fs::read(priors.join("flow/0005_bwd.flo")).unwrap().len(), 12 + 8 * 40 * 36);
    assert!(priors.join("motion_masks/0003.png").is_file());
    let again = nerf_dynamic(&["priors", text(&film), "--progress", "lines"]);
    assert!(again.err.contains("6 of 6 photos done before") && again.out == answer.out, "{}", again.err);
    // The folder of the photos itself, fewer and smaller.
    let (photos, out) = (film.join("rgb"), folder.path().join("small"));
    let words = ["priors", text(&photos), "--out", text(&out), "--frames", "2", "--longest-side", "20"];
    let answer = nerf_dynamic(&words);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(fs::read(out.join("flow/0001_bwd.flo")).unwrap().len(), 12 + 8 * 20 * 18);
    assert!(answer.out.contains("2 photos: ") && !photos.join("priors").exists(), "{}", answer.out);

    let run = folder.path().join("run");
    for (scene, part) in [(&film, "holds no dataset that is known"), (&photos, "holds 6 photos and no cameras")] {
        let answer = nerf_dynamic(&["train", text(scene), "--out", text(&run), "--steps", "1"]);
        assert!(answer.code == 1 && error_line(&answer).contains(part), "{}", answer.err);
    }
}

#[test]
fn photos_that_are_no_film_are_refused_in_one_line() {
    let (folder, film) = film();
    let photos = film.join("rgb");
    let refused = |words: &[&str], part: &str| {
        let answer = nerf_dynamic(words);
        assert_eq!(answer.code, 1, "{words:?}: {}", answer.err);
        assert!(error_line(&answer).contains(part), "{part}: {}", answer.err);
    };
    refused(&["priors", text(&film), "--holdout", "none"], "`--holdout`: for datasets with cameras");
    refused(&["priors", text(&film), "--priors", text(&film)], "`--priors`: for datasets with cameras");
    refused(&["priors", text(&film), "--exact"], "is not known exactly");
    let one = folder.path().join("one");
    fs::create_dir(&one).unwrap();
    refused(&["priors", text(&one)], "holds no dataset that is known");
    fs::copy(photos.join("0000.png"), one.join("a.png")).unwrap();
    refused(&["priors", text(&one)], "holds one photo; flow needs two");
    image::RgbImage::new(41, 36).save(photos.join("0006.png")).unwrap();
    refused(&["priors", text(&film)], "0006.png: is 41x36, and rgb/0000.png is 40x36");
    // A dataset that is broken is no film.
    fs::write(film.join("transforms.json"), b"{").unwrap();
    refused(&["priors", text(&film)], "transforms.json");
    assert!(!film.join("priors").exists());
}

#[test]
fn what_is_wrong_is_said_in_one_line() {
    let (folder, scene) = video(OrbitCamera::Walking);
    let [foreign, run] = ["foreign", "run"].map(|name| folder.path().join(name));
    fs::create_dir_all(foreign.join("flow")).unwrap();
    fs::write(foreign.join("flow/r_000_fwd.flo"), b"of a network").unwrap();
    for (words, part) in [
        (&["priors", "synthetic:orbit"][..], "--out"),
        (&["priors", "synthetic:tabletop", "--exact", "--out", "d"], "`synthetic:orbit` and `synthetic:mouth` are"),
        (&["priors", text(&scene), "--exact"], "is not known exactly"),
        (&["train", text(&scene), "--out", text(&run), "--priors", text(&run)], "holds no flow"),
        (&["priors", text(&scene), "--out", text(&foreign)], "not made by `priors`"),
        (&["priors", "/nowhere"], "/nowhere"),
    ] {
        let answer = nerf_dynamic(words);
        assert_eq!(answer.code, 1, "{words:?}: {}", answer.err);
        assert!(error_line(&answer).contains(part), "{}", answer.err);
    }
    for program in [nerf as fn(&[&str]) -> Answer, nerf_wild] {
        let answer = program(&["priors", text(&scene)]);
        assert!(answer.code == 2 && answer.err.contains("`priors` is a word of nerf-dynamic"), "{}", answer.err);
    }
    assert_eq!(nerf_dynamic(&["priors", text(&scene), "--frames", "1"]).code, 2);
}
