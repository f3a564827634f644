//! What a finished run leaves: scores, pictures, the curve, the report.

use crate::common::{Watch, request, sky_scene, start, with_parts};
use engine::log;
use engine::options::Request;
use engine::output::Disk;
use engine::run::Run;
use engine::train::{Schedule, Stop};
use std::fs;

#[test]
fn a_run_folder_holds_everything_and_the_report_stands_alone() {
    let folder = tempfile::tempdir().unwrap();
    let ended = start(folder.path(), &Disk, Stop::Steps(200), &mut Watch::default()).unwrap();
    assert!(ended.psnr_test.unwrap() > 20.0, "the sky is learnt: {:?} dB", ended.psnr_test);
    for file in ["config.toml", "heldout.txt", "metrics.csv", "eval.json", "eval.csv", "summary.json", "report.html"] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 0, "{file}");
    }
    assert_eq!(fs::read_to_string(folder.path().join("heldout.txt")).unwrap(), "view_02\nview_06\n");
    for picture in ["", "_truth", "_error", "_depth"] {
        let path = folder.path().join(format!("renders/001_view_06{picture}.png"));
        assert_eq!(image::open(path).unwrap().into_rgb8().dimensions(), (16, 16));
    }
    let report = fs::read_to_string(folder.path().join("report.html")).unwrap();
    for part in ["<svg", "data:image/png;base64,", "view_06", "one cube of colours", "seed = 5", "bound on a pixel"] {
        assert!(report.contains(part), "{part} is missing");
    }
    for outside in ["<script", "<link", "src=\"http", "href=", "url(", "@import"] {
        assert!(!report.contains(outside), "{outside} reaches outside of the page");
    }
}

#[test]
fn a_scene_that_empties_is_told_of_once() {
    for (transient, lines) in [(0.0, 0), (0.5, 0), (0.9, 1)] {
        let folder = tempfile::tempdir().unwrap();
        let set = toml::Table::from_iter([("transient".to_string(), toml::Value::Float(transient))]);
        let mut watch = Watch::default();
        with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
            let mut run = Run::create(folder.path(), &Request { set, ..request() }, parts, &mut watch).unwrap();
            let interrupt = watch.interrupt.clone();
            run.train(&Schedule::new(Stop::Steps(40)), None, &mut watch, &interrupt).unwrap();
        });
        // That the capture is of few photos is said before, and nothing else.
        let (few, others): (Vec<_>, Vec<_>) = watch.warnings.iter().partition(|line| line.contains("photos are few"));
        assert_eq!((few.len(), others.len()), (1, lines), "{transient}: {:?}", watch.warnings);
        assert!(others.iter().all(|line| line.contains("lambda_u") && line.contains("beta_min")));
    }
}

#[test]
fn eval_json_has_the_agreed_fields_and_means_of_views() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(30), &mut Watch::default()).unwrap();
    let read = || -> serde_json::Value {
        serde_json::from_slice(&fs::read(folder.path().join("eval.json")).unwrap()).unwrap()
    };
    let json = read();
    assert_eq!(json["steps"], 30);
    assert!(json["seconds"].as_f64().unwrap() > 0.0);
    assert!(json["lpips"].is_null(), "no weights were given");
    let views = json["views"].as_array().unwrap();
    let names: Vec<_> = views.iter().map(|v| v["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["view_02", "view_06"]);
    for metric in ["psnr", "ssim"] {
        let mean = views.iter().map(|v| v[metric].as_f64().unwrap()).sum::<f64>() / 2.0;
        assert!((json[metric].as_f64().unwrap() - mean).abs() < 1e-12);
    }
    let csv = fs::read_to_string(folder.path().join("eval.csv")).unwrap();
    assert_eq!(csv.lines().count(), 3);
    assert!(csv.starts_with("name,psnr,ssim,"));

    // `eval` on the finished run finds the same numbers.
    let evaluation = with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let run = Run::open(folder.path(), &Request::default(), parts, &mut Watch::default()).unwrap();
        run.evaluate(None, &mut Watch::default()).unwrap()
    });
    assert_eq!(evaluation.psnr, json["psnr"].as_f64());
    assert_eq!(read()["psnr"], json["psnr"]);
    assert!(evaluation.table().lines().count() == 4 && evaluation.table().contains("n/a"));
}

#[test]
fn the_curve_is_measured_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, &mut Watch::default()).unwrap();
        let schedule = Schedule { eval_every: Some(10), ..Schedule::new(Stop::Steps(35)) };
        run.train(&schedule, None, &mut Watch::default(), &Default::default()).unwrap();
    });
    let rows = log::read(&folder.path().join("metrics.csv")).unwrap();
    let measured: Vec<u64> = rows.iter().filter(|r| r.psnr_test.is_some()).map(|r| r.step).collect();
    assert_eq!(measured, [10, 20, 30, 35]);
    let first_line = fs::read_to_string(folder.path().join("metrics.csv")).unwrap().lines().next().unwrap().to_string();
    assert_eq!(first_line, "step,seconds,loss,psnr_train,psnr_test,rays_per_s,samples_per_s,memory_mb");
}

#[test]
fn ignored_pixels_count_in_no_score() {
    let folder = tempfile::tempdir().unwrap();
    let scene = sky_scene(8, 32, true);
    let evaluation = with_parts(&Disk, &scene, |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, &mut Watch::default()).unwrap();
        run.train(&Schedule::new(Stop::Steps(300)), None, &mut Watch::default(), &Default::default()).unwrap().1
    });
    // The left halves are nonsense (white); counted, they would hold the PSNR below 10 dB.
    let psnr = evaluation.unwrap().psnr.unwrap();
    assert!(psnr > 18.0, "{psnr} dB");
}

#[test]
fn a_run_without_held_out_views_trains_and_says_that_nothing_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = sky_scene(4, 16, false);
    scene.frames.iter_mut().for_each(|f| f.split = scene_io::Split::Train);
    with_parts(&Disk, &scene, |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, &mut Watch::default()).unwrap();
        let (ended, evaluation) =
            run.train(&Schedule::new(Stop::Steps(5)), None, &mut Watch::default(), &Default::default()).unwrap();
        assert!(ended.psnr_test.is_none() && evaluation.is_none());
        assert!(run.evaluate(None, &mut Watch::default()).unwrap_err().to_string().contains("--holdout"));
    });
    let report = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(report.contains("nothing was measured"));
}

#[test]
fn a_scene_without_training_views_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = sky_scene(4, 16, false);
    scene.frames.iter_mut().for_each(|f| f.split = scene_io::Split::Test);
    let error = with_parts(&Disk, &scene, |parts| {
        Run::create(folder.path(), &request(), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
    });
    assert!(error.to_string().contains("no training views"), "{error}");
}
