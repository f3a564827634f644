//! Photos without cameras: what is said of them, and `prepare`, with programs made up for the test.

use crate::tools::{Answer, called, dataset, error_line, nerf, nerf_dynamic, nerf_wild, program, text};
use scene_io::export::write_colmap;
use scene_io::{LoadOptions, load};
use std::fs;
use std::path::{Path, PathBuf};

/// Eight photos in `DIR/my photos`, and the scene whose photos they are.
fn photos() -> (tempfile::TempDir, PathBuf, scene_io::Scene) {
    let (folder, scene) = dataset();
    let photos = folder.path().join("my photos");
    fs::create_dir(&photos).unwrap();
    let mut loaded = load(&scene, &LoadOptions::default()).unwrap();
    for (i, frame) in loaded.frames.iter_mut().enumerate() {
        frame.name = format!("photo_{i}.png");
        let scene_io::ImageSource::File(file) = &frame.image else { panic!() };
        fs::copy(file, photos.join(&frame.name)).unwrap();
    }
    (folder, photos, loaded)
}

#[test]
fn photos_without_cameras_are_told_the_commands_to_type() {
    let (folder, photos, _) = photos();
    let run = folder.path().join("run");
    type App = fn(&[&str]) -> Answer;
    let apps: [(&str, App); 3] = [("nerf-static", nerf), ("nerf-wild", nerf_wild), ("nerf-dynamic", nerf_dynamic)];
    for (name, app) in apps {
        let answer = app(&["train", text(&photos), "--out", text(&run), "--steps", "1"]);
        assert_eq!(answer.code, 1, "{}", answer.err);
        let line = error_line(&answer);
        assert!(line.contains("8 photos and no cameras"), "{line}");
        let name = called(name);
        let prepare = format!("type: {name} prepare '{}' --out 'my photos-scene'", photos.display());
        let train = format!("then: {name} train 'my photos-scene' --out 'runs/my photos'");
        for wanted in [&prepare, &train] {
            assert!(answer.err.lines().any(|l| l == wanted), "{wanted}\nis not in\n{}", answer.err);
        }
        assert!(!run.join("config.toml").exists());
        let check = app(&["check", text(&photos)]);
        assert_eq!(check.code, 1);
        assert!(check.out.contains(&prepare), "{}", check.out);
    }
    let video = folder.path().join("walk.mp4");
    fs::write(&video, b"x").unwrap();
    let answer = nerf(&["train", text(&video), "--out", text(&run)]);
    assert!(error_line(&answer).contains("is a video"), "{}", answer.err);
    assert!(answer.err.contains("--out walk-scene"), "{}", answer.err);
}

#[test]
fn what_cannot_be_prepared_is_said_in_one_line() {
    let (folder, photos, _) = photos();
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let full = folder.path().join("full");
    fs::create_dir(&full).unwrap();
    fs::write(full.join("thesis.tex"), b"x").unwrap();
    let inside = photos.join("scene");
    let new = folder.path().join("new");
    for (input, out, part) in [
        (&empty, &new, "holds no photos"),
        (&photos.join("photo_1.png"), &new, "is one photo"),
        (&folder.path().join("nothing"), &new, "cannot open"),
        #[cfg(unix)]
        (&photos, &full, "not made by `prepare`"),
        #[cfg(unix)]
        (&photos, &inside, "lies among the photos"),
    ] {
        let tools = fake_colmap(folder.path(), None);
        let answer = prepared(&tools, &["prepare", text(input), "--out", text(out)]);
        assert_eq!(answer.code, 1, "{part}: {}", answer.err);
        assert!(error_line(&answer).contains(part), "{part}: {}", answer.err);
    }
    assert_eq!(nerf(&["prepare", text(&photos)]).code, 2, "--out is needed");
    assert_eq!(nerf(&["prepare", text(&photos), "--out", "x", "--frames", "1"]).code, 2);
}

#[cfg(not(feature = "sfm"))]
#[test]
fn without_a_program_that_finds_cameras_one_line_says_what_to_install() {
    let (folder, photos, _) = photos();
    let tools = folder.path().join("no-tools");
    fs::create_dir(&tools).unwrap();
    let out = folder.path().join("scene-out");
    let answer = prepared(&tools, &["prepare", text(&photos), "--out", text(&out)]);
    assert_eq!(answer.code, 1);
    let line = error_line(&answer);
    assert!(line.contains("colmap") && line.contains("install"), "{line}");
    assert!(!out.exists(), "nothing was begun");
}

/// A `colmap` that knows the answer: it copies `model`, or finds nothing.
#[cfg(unix)]
fn fake_colmap(folder: &Path, model: Option<&Path>) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let tools = folder.join("tools");
    fs::create_dir_all(&tools).unwrap();
    let find = match model {
        Some(model) => format!("echo 'Registering image #2 (2)'; /bin/cp -r '{}' \"$out/0\"", model.display()),
        None => "echo 'No good initial pair' >&2; exit 1".into(),
    };
    let script = format!(
        r#"#!/bin/sh
command=$1; shift
while [ $# -gt 0 ]; do
    case $1 in --database_path) db=$2;; --output_path) out=$2;; esac
    shift
done
case $command in
help) echo "COLMAP 3.8 -- Structure-from-Motion";;
feature_extractor) [ -z "$db" ] && {{ echo "--SiftExtraction.use_gpu"; exit; }}; echo "Processed file [8/8]"; : > "$db";;
exhaustive_matcher) [ -z "$db" ] && {{ echo "--SiftMatching.use_gpu"; exit; }}; echo "Matching block [1/1, 1/1]";;
mapper) {find};;
*) exit 9;;
esac
"#
    );
    let file = tools.join("colmap");
    fs::write(tools.join("colmap.new"), script).unwrap();
    fs::set_permissions(tools.join("colmap.new"), fs::Permissions::from_mode(0o755)).unwrap();
    fs::rename(tools.join("colmap.new"), file).unwrap();
    tools
}

#[cfg(not(unix))]
fn fake_colmap(folder: &Path, _: Option<&Path>) -> PathBuf {
    folder.to_path_buf()
}

/// `nerf-static` with programs of one folder only.
fn prepared(tools: &Path, words: &[&str]) -> Answer {
    let output = program().env("PATH", tools).args(words).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let answer =
        Answer { code: output.status.code().unwrap_or(-1), out: text(&output.stdout), err: text(&output.stderr) };
    assert!(!answer.err.contains("panicked"), "{}", answer.err);
    answer
}

#[cfg(unix)]
#[test]
fn a_folder_becomes_a_scene_and_a_second_call_goes_on_where_the_first_ended() {
    let (folder, photos, scene) = photos();
    let at = |name: &str| folder.path().join(name);
    fs::write(photos.join("notes.txt"), b"x").unwrap();
    fs::write(photos.join("broken.jpg"), b"\xff\xd8\xff").unwrap();
    // One photo of eight is not placed.
    write_colmap(&at("model"), &scene.frames[..7], &scene.points).unwrap();
    let out = at("my-scene");
    let words = ["prepare", text(&photos), "--out", text(&out), "--with", "colmap"];

    // What fails says so, with the program's own words, and is gone on with.
    let tools = fake_colmap(folder.path(), None);
    let failed = prepared(&tools, &words);
    assert_eq!(failed.code, 1);
    assert!(error_line(&failed).contains("colmap failed while it should place the photos"), "{}", failed.err);
    assert!(failed.err.contains("No good initial pair") && failed.err.contains("prepare.log"), "{}", failed.err);

    let tools = fake_colmap(folder.path(), Some(&at("model")));
    let answer = prepared(&tools, &words);
    assert_eq!(answer.code, 0, "{}{}", answer.out, answer.err);
    for part in ["pictures: 8 done before", "features: done before", "matches: done before"] {
        assert!(answer.err.contains(part), "{part}: {}", answer.err);
    }
    assert!(answer.out.contains("colmap 3.8: 7 of 8 photos placed"), "{}", answer.out);
    assert!(answer.out.contains("not placed (1): photo_7.png"), "{}", answer.out);
    let last = format!("next: {} train {} --out runs/my", called("nerf-static"), out.display());
    assert_eq!(answer.out.trim_end().lines().last(), Some(last.as_str()));
    assert!(failed.err.contains("notes.txt") && failed.err.contains("broken.jpg"), "{}", failed.err);

    // Nothing is left to do, then; and a photo more begins anew.
    let again = prepared(&tools, &words);
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(again.err.contains("poses: done before"), "{}", again.err);
    fs::copy(photos.join("photo_1.png"), photos.join("photo_x.png")).unwrap();
    let more = prepared(&tools, &words);
    assert!(!more.err.contains("done before"), "{}", more.err);
    assert!(more.out.contains("7 of 9 photos placed") && more.err.contains("ONLY 7 OF 9"), "{}{}", more.out, more.err);

    let checked = nerf(&["check", text(&out)]);
    assert_eq!(checked.code, 0, "{}", checked.out);
}
