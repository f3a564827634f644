//! Training views held out for choosing settings: measured in the place of the test views, which nothing looks at.

use crate::common::{Sky, Watch, arrays, request, sky_scene};
use engine::RunError;
use engine::data::Dataset;
use engine::eval::{Evaluation, Measured};
use engine::options::{DataOptions, Request, RunOptions};
use engine::output::Disk;
use engine::run::{DefaultSystem, Parts, Run};
use engine::train::{Schedule, Stop};
use scene_io::{Image, ImageSource, Point, Scene, Split, TrackPoint};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// With the parts of a run of `scene`, read as `--validation` says.
fn with_parts<R>(scene: &Scene, work: impl FnOnce(Parts<'_>) -> R) -> R {
    let load = |_: &str, data: &DataOptions| -> Result<Scene, RunError> {
        let mut scene = scene.clone();
        if let Some(validation) = data.validation()? {
            scene.hold_for_validation(&validation)?;
        }
        Ok(scene)
    };
    let build =
        |name: &str, scene: &Scene, data: &Dataset, options: &RunOptions| Sky::build(name, scene, data, options);
    work(Parts { load: &load, build: &build, storage: &Disk, default_system: DefaultSystem::Named("sky") })
}

fn asked(validation: &str) -> Request {
    let data = DataOptions { validation: Some(validation.into()), ..DataOptions::default() };
    Request { data, ..request() }
}

/// Train for 60 steps.
fn train(folder: &Path, scene: &Scene, request: &Request) -> Evaluation {
    with_parts(scene, |parts| {
        let mut run = Run::create(folder, request, parts, &mut Watch::default()).unwrap();
        run.train(&Schedule::new(Stop::Steps(60)), None, &mut Watch::default(), &Default::default()).unwrap().1.unwrap()
    })
}

fn names(evaluation: &Evaluation) -> Vec<&str> {
    evaluation.views.iter().map(|v| v.name.as_str()).collect()
}

#[test]
fn validation_views_are_measured_and_test_views_are_not_looked_at() {
    let scene = sky_scene(8, 16, false);
    // The same photos but for the test views, which show something else.
    let mut other = scene.clone();
    for frame in other.frames.iter_mut().filter(|f| f.split == Split::Test) {
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(16, 16, vec![7; 768]).unwrap()));
    }
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    let evaluation = train(&first, &scene, &asked("every:3"));
    // Trained on without: 0, 1, 3, 4, 5, 7.
    assert_eq!(names(&evaluation), ["view_00", "view_04"]);
    assert_eq!(evaluation.split, Measured::Validation);
    assert!(evaluation.table().contains("measured: validation views"));
    let blind = train(&second, &other, &asked("every:3"));
    assert!(arrays(&first, 60) == arrays(&second, 60), "test views change what is trained");
    let scores = |e: &Evaluation| e.views.iter().map(|v| (v.psnr, v.ssim)).collect::<Vec<_>>();
    assert_eq!(scores(&evaluation), scores(&blind), "test views change what is measured");

    let read = |file: &str| fs::read_to_string(first.join(file)).unwrap();
    assert_eq!(read("heldout.txt"), "view_02\nview_06\n");
    assert_eq!(read("validation.txt"), "view_00\nview_04\n");
    assert!(read("eval.json").contains("\"split\": \"validation\""), "{}", read("eval.json"));
    assert!(read("config.toml").contains("validation = \"every:3\""), "{}", read("config.toml"));
    assert!(read("report.html").contains("PSNR, validation views") && read("report.html").contains("validation.txt"));

    // Without the word nothing is different from what it was.
    let plain = folder.path().join("plain");
    let evaluation = train(&plain, &scene, &request());
    assert_eq!((names(&evaluation), evaluation.split), (vec!["view_02", "view_06"], Measured::Test));
    assert!(!plain.join("validation.txt").exists());
    assert!(arrays(&plain, 60) != arrays(&first, 60), "validation views are trained on");
}

#[test]
fn a_resumed_run_keeps_its_validation_views_wherever_the_file_of_names_has_gone() {
    let scene = sky_scene(8, 16, false);
    let folder = tempfile::tempdir().unwrap();
    let (run, file) = (folder.path().join("run"), folder.path().join("names.txt"));
    fs::write(&file, "view_01\nview_07\n").unwrap();
    train(&run, &scene, &asked(&format!("names:{}", file.display())));
    fs::remove_file(&file).unwrap();
    with_parts(&scene, |parts| {
        let open = |request: &Request| Run::open(&run, request, parts, &mut Watch::default());
        let again = open(&Request::default()).unwrap();
        assert_eq!(names(&again.evaluate(None, &mut Watch::default()).unwrap()), ["view_01", "view_07"]);
        drop(again);
        let error = open(&Request { scene: None, seed: None, ..asked("every:3") }).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("`--validation every:3`"), "{error}");
    });
}

#[test]
fn what_cannot_be_held_out_is_refused_before_the_run_begins() {
    let scene = sky_scene(8, 16, false);
    let folder = tempfile::tempdir().unwrap();
    for (word, part) in
        [("every:1", "no frames are left to train on"), ("dataset", "no validation split"), ("some", "--validation")]
    {
        let error = with_parts(&scene, |parts| {
            Run::create(&folder.path().join("run"), &asked(word), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
        });
        let all =
            format!("{error}: {}", std::error::Error::source(&error).map_or_else(String::new, ToString::to_string));
        assert!(all.contains(part), "{word}: {all}");
    }
}

#[test]
fn points_that_validation_views_help_to_place_are_left_out() {
    let mut scene = sky_scene(8, 16, false);
    scene.points = (0..2).map(|i| Point { xyz: [f64::from(i), 5.0, 0.0].into(), rgb: [i as u8; 3] }).collect();
    // Point 0: views 1 and 3, which are trained on. Point 1: views 3 and 4, of which the second is held out.
    let track = |point| TrackPoint { pixel: [8.0; 2], length: 2, point };
    for (view, point) in [(1, 0), (3, 0), (3, 1), (4, 1)] {
        scene.frames[view].tracks.push(track(point));
    }
    let kept = |request: &Request| {
        let folder = tempfile::tempdir().unwrap();
        with_parts(&scene, |parts| {
            let run = Run::create(&folder.path().join("run"), request, parts, &mut Watch::default()).unwrap();
            run.scene.points.iter().map(|p| p.rgb[0]).collect::<Vec<_>>()
        })
    };
    assert_eq!(kept(&request()), [0, 1]);
    assert_eq!(kept(&asked("every:3")), [0]);
}
