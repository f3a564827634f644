//! The words of `nerf-dynamic`: time in renders and exports, scores of what moves, a video in a folder.

use crate::tools::{Answer, SMALL, arrays, dataset, error_line, killed, nerf, nerf_dynamic, nerf_wild, newest, text};
use scene_io::export::Ply;
use scene_io::synthetic::{OrbitOptions, write_orbit};
use scene_io::{BitMask, Flow, write_flo};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// 8 training and 2 test views of 24 x 24 pixels in D-NeRF's form, in `DIR/scene`.
fn video() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    let options = OrbitOptions { width: 24, height: 24, train: 8, test: 2, rays: 1, ..OrbitOptions::default() };
    write_orbit(&options, &scene).unwrap();
    (folder, scene)
}

const NARROW: [&str; 4] = ["--set", "warp_width=16", "--set", "warp_depth=2"];

/// Settings that make the field tiny: without a hash grid those of the others.
fn small(extra: &[&str]) -> &'static [&'static str] {
    const VOXELS: [&str; 4] = ["--set", "batch_samples=2048", "--set", "occupancy=16"];
    if extra.contains(&"tineuvox") { &VOXELS } else { &SMALL }
}

fn train(scene: &Path, run: &Path, extra: &[&str]) -> Answer {
    let words = ["train", text(scene), "--out", text(run), "--progress", "off"];
    // These warp nothing and have networks of time alone; `nerf-w` has neither.
    let warpless = ["t-nerf", "nsff", "dynamic-nerf"];
    let narrow = match extra {
        _ if extra.contains(&"nerf-w") => &[][..],
        _ if warpless.iter().any(|name| extra.contains(name)) => &NARROW[..2],
        _ => &NARROW[..],
    };
    nerf_dynamic(&[&words[..], small(extra), narrow, extra].concat())
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Flow of frame `i` of 24 x 24 pixels, row by row, `None` where it is not known: the file, which knows it where the picture has a colour.
fn flow_of_frame(pictures: &Path, i: usize) -> Vec<Option<[f32; 2]>> {
    let bytes = fs::read(pictures.join(format!("flow_{i:04}.flo"))).unwrap();
    assert!(bytes.starts_with(b"PIEH") && bytes.len() == 12 + 8 * 24 * 24, "{} bytes", bytes.len());
    let number = |at: usize| -> [u8; 4] { bytes[at..at + 4].try_into().unwrap() };
    assert_eq!([4, 8].map(|at| i32::from_le_bytes(number(at))), [24, 24]);
    let vector = |k: usize| [0, 4].map(|at| f32::from_le_bytes(number(12 + 8 * k + at)));
    let known = |vector: [f32; 2]| vector.iter().all(|x| x.abs() <= 1e9).then_some(vector);
    let flow: Vec<Option<[f32; 2]>> = (0..24 * 24).map(|k| known(vector(k))).collect();
    let picture = image::open(pictures.join(format!("flow_{i:04}.png"))).unwrap().into_rgb8();
    for (k, (pixel, flow)) in picture.pixels().zip(&flow).enumerate() {
        assert_eq!(flow.is_some(), pixel.0 != [0; 3], "pixel {k} of frame {i}: {flow:?}, {pixel:?}");
    }
    flow
}

#[test]
fn time_is_a_word_of_nerf_dynamic_alone() {
    for word in ["render", "export"] {
        for (program, has) in [(nerf as fn(&[&str]) -> Answer, false), (nerf_wild, false), (nerf_dynamic, true)] {
            let help = program(&[word, "--help"]);
            assert_eq!((help.code, help.out.contains("--time")), (0, has), "{word}: {}", help.out);
        }
    }
    let help = nerf_dynamic(&["--help"]);
    assert!(help.code == 0 && help.out.contains("scenes that move") && !help.out.contains("masks"), "{}", help.out);
    for words in [
        &["render", "x", "--path", "orbit", "--out", "y", "--time", "0..1"][..],
        &["export", "x", "--mesh", "y.ply", "--time", "0.5"],
    ] {
        for program in [nerf as fn(&[&str]) -> Answer, nerf_wild] {
            let answer = program(words);
            assert_eq!(answer.code, 2, "{words:?}");
            assert!(answer.err.contains("`--time` is a word of nerf-dynamic"), "{}", answer.err);
        }
    }
    // Words of other apps are none of this one's.
    let answer = nerf_dynamic(&["masks", "x"]);
    assert!(answer.code == 2 && answer.err.contains("word of nerf-wild:"), "{}", answer.err);
}

#[test]
fn photos_of_a_film_are_shown_in_the_appearance_that_is_asked_for() {
    let (folder, scene) = video();
    let run = folder.path().join("run");
    let codes = ["--steps", "20", "--system", "nerfies", "--set", "appearance=codes", "--eval-appearance", "nearest"];
    let answer = train(&scene, &run, &codes);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("nearest in time; whole views scored"), "{}", answer.out);
    let whole = json(&run.join("eval.json"));
    assert_eq!(whole["protocol"], serde_json::json!({ "appearance": "nearest", "scored": "whole" }));
    let answer = nerf_dynamic(&["eval", text(&run), "--eval-appearance", "fit"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(json(&run.join("eval.json"))["protocol"]["scored"], "right-half");

    let pictures = folder.path().join("pictures");
    let words = ["render", text(&run), "--out", text(&pictures), "--path", "hold:test/r_000", "--time", "0.5"];
    let render = |appearance: &str| nerf_dynamic(&[&words[..], &["--appearance", appearance]].concat());
    let shown = |appearance: &str| {
        let answer = render(appearance);
        assert_eq!(answer.code, 0, "{appearance}: {}", answer.err);
        fs::read(pictures.join("colour_0000.png")).unwrap()
    };
    let all = ["mean", "image:train/r_000", "image:train/r_005", "fit:test/r_001"].map(shown);
    assert!(all[1] != all[2] && all[0] != all[3], "each photo has its own");

    // A photo from elsewhere: where it was taken, and when.
    let photo = folder.path().join("mine.png");
    fs::copy(scene.join("train/r_000.png"), &photo).unwrap();
    let beside = photo.with_extension("json");
    let cameras = json(&scene.join("transforms_train.json"));
    let camera = |time: Value| {
        let matrix = &cameras["frames"][0]["transform_matrix"];
        serde_json::json!({ "time": time, "frames": [{ "transform_matrix": matrix }] }).to_string()
    };
    let word = format!("fit:{}", text(&photo));
    for (beside_it, part) in [
        (None, "its camera is not known"),
        (Some(camera(Value::Null)), "`time` = null"),
        (Some(camera(2.into())), "`time` = 2: must be in 0..=1"),
        (Some(camera(0.into()).replace("\"time\"", "\"when\"")), "when the photo was taken is not known"),
    ] {
        beside_it.iter().for_each(|content| fs::write(&beside, content).unwrap());
        let answer = render(&word);
        assert_eq!(answer.code, 1, "{}", answer.out);
        assert!(error_line(&answer).contains(part), "{part}: {}", answer.err);
    }
    fs::write(&beside, camera(0.into())).unwrap();
    shown(&word);

    let plain = folder.path().join("plain");
    assert_eq!(train(&scene, &plain, &["--steps", "2"]).code, 0);
    for word in ["image:train/r_000", "fit:test/r_000"] {
        let words = ["render", text(&plain), "--out", text(&pictures), "--appearance", word];
        let answer = nerf_dynamic(&words);
        assert_eq!(answer.code, 1, "{word}: {}", answer.out);
        assert!(error_line(&answer).contains("`d-nerf` has one appearance only"), "{}", answer.err);
    }
    // What warps points says where they go; preview and video show the layer that is asked for.
    let words = ["render", text(&plain), "--out", text(&pictures), "--path", "hold:test/r_000", "--frames", "3"];
    let answer = nerf_dynamic(&[&words[..], &["--layers", "flow"]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("flow is drawn ") && !answer.out.contains("the camera alone"), "{}", answer.out);
    assert!(pictures.join("flow_0001.png").exists() && !pictures.join("flow_0002.png").exists(), "{}", answer.out);
    assert_eq!([0, 1].map(|i| flow_of_frame(&pictures, i).len()), [24 * 24; 2]);
    assert!(!pictures.join("flow_0002.flo").exists());
}

#[test]
fn flow_that_is_missing_is_said_and_flow_of_the_wrong_size_is_refused_by_file() {
    let (folder, scene) = video();
    let run = |name: &str| folder.path().join(name);
    let answer = train(&scene, &run("without"), &["--steps", "2", "--system", "nsff"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    for part in ["no optical flow to the neighbouring photos", "no disparities", "no motion masks"] {
        assert!(answer.out.contains(part), "{part}: {}", answer.out);
    }
    // Half as high as its photo.
    let seen = BitMask::from_fn(24, 12, |_, _| true);
    let flow = Flow { width: 24, height: 12, vectors: vec![[1.0, 0.0]; 24 * 12], seen };
    let file = scene.join("train/flow/r_003_fwd.flo");
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    write_flo(&file, &flow).unwrap();
    for name in ["nsff", "dynamic-nerf"] {
        let answer = train(&scene, &run(name), &["--steps", "2", "--system", name]);
        assert_eq!(answer.code, 1, "{name}: {}", answer.out);
        for part in ["r_003_fwd.flo", "the flow is 24x12 and its photo 24x24"] {
            assert!(error_line(&answer).contains(part), "{part}: {}", answer.err);
        }
    }
    // Who looks at no flow does not mind.
    let answer = train(&scene, &run("other"), &["--steps", "2", "--system", "t-nerf"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
}

#[test]
fn times_that_are_none_are_refused_before_anything_is_read() {
    for time in ["2", "-1", "0..2", "nan", "now", "0..", "", "inf"] {
        for words in
            [["render", "x", "--path", "orbit", "--out", "y"], ["export", "x", "--mesh", "y.ply", "--count", "9"]]
        {
            let answer = nerf_dynamic(&[&words[..], &["--time", time]].concat());
            assert_eq!(answer.code, 2, "{} --time {time}: {}{}", words[0], answer.out, answer.err);
            let lines: Vec<&str> = answer.err.lines().filter(|line| line.contains("--time")).collect();
            assert!(!lines.is_empty() && lines[0].starts_with("error: "), "{}", answer.err);
        }
    }
}

#[test]
fn a_video_is_trained_measured_rendered_and_exported() {
    let (folder, scene) = video();
    let run = folder.path().join("run");
    let answer = train(&scene, &run, &["--steps", "20", "--system", "t-nerf"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("things that move: ") && answer.out.contains("everything else: "), "{}", answer.out);

    let answer = nerf_dynamic(&["eval", text(&run)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    for line in ["things that move: ", "everything else: ", "depth: ", "found again in another view"] {
        assert_eq!(answer.out.lines().filter(|l| l.starts_with(line)).count(), 1, "{line}\n{}", answer.out);
    }
    let eval = json(&run.join("eval.json"));
    for score in ["psnr_moving", "psnr_still", "depth_error", "depth_relative", "flow_error", "flow_found"] {
        assert!(eval["motion"][score].as_f64().is_some_and(f64::is_finite), "{score}: {}", eval["motion"]);
        assert!(eval["views"][1]["motion"][score].is_f64(), "{score} of a view: {}", eval["views"][1]);
    }

    let pictures = folder.path().join("pictures");
    let render = |words: &[&str]| nerf_dynamic(&[&["render", text(&run), "--out", text(&pictures)], words].concat());
    let frame = |i: usize| fs::read(pictures.join(format!("colour_{i:04}.png"))).unwrap();
    let answer = render(&["--path", "hold:test/r_000", "--time", "0..1", "--frames", "3"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let [first, middle, last] = [0, 1, 2].map(frame);
    assert!(first != middle && middle != last && first != last, "the camera holds and time goes on");
    assert!(pictures.join("preview.gif").exists());
    // One time of one place is one picture, the same as on the way.
    for (time, same) in [("0.5", &middle), ("1", &last), ("1..1", &last)] {
        fs::remove_dir_all(&pictures).unwrap();
        let answer = render(&["--path", "hold:test/r_000", "--time", time]);
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(frame(0) == *same && !pictures.join("colour_0001.png").exists(), "{time}");
    }
    // Without a word all of the time is shown; backwards is a way, too.
    for time in [&[][..], &["--time", "1..0"]] {
        let answer = render(&[&["--path", "hold:test/r_000", "--frames", "3"], time].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        let ends = if time.is_empty() { [&first, &last] } else { [&last, &first] };
        assert!(frame(0) == *ends[0] && frame(2) == *ends[1], "{time:?}");
    }

    // The camera holds, and this system moves no point: what is seen stands still, and a line says why.
    let answer = render(&["--path", "hold:test/r_000", "--frames", "3", "--layers", "colour,flow"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("flow is that of the camera alone: `t-nerf`"), "{}", answer.out);
    let flow = |i: usize| pictures.join(format!("flow_{i:04}.png"));
    assert_eq!([0, 1, 2].map(|i| flow(i).exists()), [true, true, false]);
    let picture = image::open(flow(0)).unwrap().into_rgb8();
    assert!(picture.pixels().all(|p| p.0 == [255; 3] || p.0 == [0; 3]), "white, and black where nothing is seen");
    for vector in [0, 1].into_iter().flat_map(|i| flow_of_frame(&pictures, i)).flatten() {
        assert!(vector.iter().all(|x| x.abs() < 0.01), "{vector:?}");
    }
    assert!(!pictures.join("flow_0002.flo").exists());
    let answer = render(&["--path", "hold:test/r_000", "--time", "0.5", "--layers", "flow"]);
    assert!(answer.code == 1 && error_line(&answer).contains("the path has one frame only"), "{}", answer.err);

    let mesh = |time: &str| {
        let path = folder.path().join(format!("mesh{time}.ply"));
        let words = ["export", text(&run), "--mesh", text(&path), "--resolution", "16", "--level", "0.5"];
        let answer = nerf_dynamic(&[&words[..], &["--time", time]].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        Ply::read(&path).unwrap();
        fs::read(path).unwrap()
    };
    assert!(mesh("0.5") != mesh("0"), "another time, another surface");
    let points = folder.path().join("points.ply");
    let answer = nerf_dynamic(&["export", text(&run), "--points", text(&points), "--count", "50", "--time", "1"]);
    assert!(answer.code == 0 && points.exists(), "{}", answer.err);

    let clouds = |words: &[&str]| {
        let folder = folder.path().join("clouds");
        let answer = nerf_dynamic(&[&["export", text(&run), "--frames", text(&folder)], words].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        let mut files: Vec<_> = fs::read_dir(&folder).unwrap().map(|f| f.unwrap().path()).collect();
        files.sort();
        files.iter().map(|file| fs::read(file).unwrap()).collect::<Vec<_>>()
    };
    let (smooth, rough) = (clouds(&[]), clouds(&["--rough"]));
    let views = eval["views"].as_array().unwrap().len();
    assert!(smooth.len() > views && smooth.len() == rough.len(), "a file for each photo, also those trained on");
    assert!(smooth.iter().all(|file| file.starts_with(b"ply\n")), "each of them is one");
}

#[test]
fn what_a_system_of_moving_scenes_has_not_is_said_in_one_line() {
    let (folder, scene) = video();
    let run = folder.path().join("run");
    for (extra, part) in [
        (&["--system", "nerfstudio"][..], "tineuvox"),
        (&["--system", "nerf-w", "--set", "warp=se3"], "`set` = warp: there is no such setting"),
        (&["--set", "warp=sideways"], "sideways"),
        (&["--set", "warp_depth=0"], "`warp_depth` = 0"),
        (&["--set", "sampler=\"proposal\""], "`set` = sampler: there is no such setting"),
    ] {
        let answer = train(&scene, &run, &[&["--steps", "1"], extra].concat());
        assert_eq!(answer.code, 1, "{extra:?}: {}", answer.out);
        assert!(error_line(&answer).contains(part), "{}", answer.err);
        assert!(!run.join("checkpoint").exists());
    }
}

#[test]
fn a_system_of_another_app_is_trained_where_it_fits_and_its_words_are_understood() {
    let (folder, scene) = video();
    let run = folder.path().join("run");
    let answer = train(&scene, &run, &["--steps", "2", "--system", "nerf-w"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let pictures = folder.path().join("pictures");
    let words = ["render", text(&run), "--out", text(&pictures), "--frames", "1", "--progress", "off"];
    let render = |extra: &[&str]| nerf_dynamic(&[&words[..], extra].concat());
    let answer = render(&["--appearance", "mean", "--time", "0.5"]);
    assert_eq!(answer.code, 0, "of a run of its family: {}", answer.err);
    let moving = folder.path().join("moving");
    let answer = train(&scene, &moving, &["--steps", "2", "--system", "t-nerf"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let answer = nerf_dynamic(&["masks", text(&moving)]);
    assert!(answer.code == 2 && answer.err.contains("`masks` is a word of nerf-wild: "), "{}", answer.err);
    // Without times of photos nothing moves.
    let (_still, photos) = dataset();
    let answer = nerf(&["train", text(&photos), "--out", text(&folder.path().join("no")), "--system", "d-nerf"]);
    assert_eq!(answer.code, 1, "{}", answer.out);
    assert!(error_line(&answer).contains("no photo has a time; `nerf-dynamic`"), "{}", answer.err);
}

#[test]
fn a_killed_run_resumes_to_the_same_bits() {
    let (folder, scene) = video();
    for system in ["tineuvox", "nerfies"] {
        let own: &[&str] = match system {
            // Doubled after steps 10, 20 and 30.
            "tineuvox" => &["--set", "voxels=24", "--set", "voxels_every=0.25"],
            _ => &["--set", "elastic=0.1", "--set", "warp_anneal=0.75", "--set", "appearance=codes"],
        };
        let place = |name: &str| folder.path().join(format!("{system}-{name}"));
        let (whole, stopped) = (place("whole"), place("killed"));
        // The one that is killed would plan for another stop.
        let extra = [&["--system", system, "--set", "horizon=40"], own].concat();
        let answer = train(&scene, &whole, &[&["--steps", "40"], &extra[..]].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);

        let words = ["train", text(&scene), "--out", text(&stopped), "--steps", "100000", "--progress", "off"];
        killed("nerf-dynamic", &[&words, small(&extra), &NARROW, &extra].concat(), || newest(&stopped) >= 12);
        let step = newest(&stopped);
        assert!((12..40).contains(&step), "{system}: killed at step {step}");

        let resume = ["train", "--resume", "--out", text(&stopped), "--steps", "40", "--progress", "off"];
        let answer = nerf_dynamic(&resume);
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(answer.out.contains("resumed at step"), "{}", answer.out);
        assert!(arrays(&whole, 40) == arrays(&stopped, 40), "{system}: the same bits as an uninterrupted run");
    }
}
