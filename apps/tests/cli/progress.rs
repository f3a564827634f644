//! Long work says how far it is, and ends soon after Ctrl-C with what it has.

use crate::tools::{Answer, SMALL, dataset, nerf, nerf_wild, text};
use serde_json::Value;
use std::path::Path;

fn trained(scene: &Path, run: &Path) {
    let words = ["train", text(scene), "--out", text(run), "--steps", "20", "--progress", "off"];
    let answer = nerf(&[&words[..], &SMALL].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
}

/// What the parts of an answer given as JSON were called; all have their numbers, and the last is the whole.
fn parts(answer: &Answer) -> Vec<String> {
    assert_eq!(answer.code, 0, "{}", answer.err);
    let events: Vec<Value> = answer.err.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let parts: Vec<&Value> = events.iter().filter(|e| e["event"] == "part").collect();
    for part in &parts {
        // Before the first is done nothing is known of the others.
        assert!(part["eta_seconds"].is_number() || part["done"] == 0, "{part}");
        assert!(part["seconds"].is_number(), "{part}");
        assert!(part["done"].as_u64() <= part["of"].as_u64(), "{part}");
    }
    let mut names: Vec<String> = parts.iter().map(|p| p["what"].as_str().unwrap().to_string()).collect();
    names.dedup();
    for name in &names {
        let last = parts.iter().rfind(|p| p["what"] == name.as_str()).unwrap();
        assert_eq!(last["done"], last["of"], "{name}");
    }
    names
}

#[test]
fn rendering_export_masks_and_eval_say_how_far_they_are() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    trained(&scene, &run);
    let out = |name: &str| folder.path().join(name).display().to_string();
    let json = |words: &[&str]| nerf(&[&["--progress", "json"], words].concat());
    let render = |frames: &'static str| ["render", text(&run), "--path", "orbit", "--frames", frames, "--out"];

    assert_eq!(parts(&json(&[&render("3")[..], &[&out("a")]].concat())), ["frame"]);
    assert_eq!(parts(&json(&["eval", text(&run)])), ["held-out view"]);
    assert_eq!(parts(&json(&["export", text(&run), "--points", &out("p.ply")])), ["view for points"]);
    let mesh = ["export", text(&run), "--mesh", &out("m.ply"), "--resolution", "8"];
    assert_eq!(parts(&json(&mesh)), ["picture"]);
    assert_eq!(parts(&json(&["export", text(&run), "--frames", &out("clouds")])), ["photo"]);

    // Lines where nobody looks at a terminal, nothing where nothing is wanted.
    let answer = nerf(&[&render("3")[..], &[&out("b")]].concat());
    assert!(answer.err.contains("frame 1 of 3 (00:0"), "{}", answer.err);
    let answer = nerf(&[&["--progress", "off"], &render("3")[..], &[&out("c")]].concat());
    assert_eq!(answer.err, "");

    let judged = folder.path().join("judged");
    let words = ["train", text(&scene), "--out", text(&judged), "--system", "robust-nerf", "--steps", "3"];
    let answer = nerf_wild(&[&words[..], &SMALL, &["--set", "judge_first=2", "--progress", "json"]].concat());
    assert!(parts(&answer).contains(&"held-out view".to_string()), "the final evaluation of a training");
    assert_eq!(parts(&nerf_wild(&["--progress", "json", "masks", text(&judged)])), ["mask"]);
}

#[cfg(unix)]
mod stopped {
    use super::*;
    use crate::tools::{Running, checkpoints, files_in};
    use scene_io::synthetic::{TabletopOptions, tabletop, write_blender};

    #[test]
    fn rendering_ends_after_the_frame_it_is_at_and_keeps_the_others() {
        let (folder, scene) = dataset();
        let (run, out) = (folder.path().join("run"), folder.path().join("pictures"));
        trained(&scene, &run);
        let words = ["render", text(&run), "--path", "orbit", "--frames", "50000", "--out", text(&out)];
        let answer = Running::start(&words).until("there are frames", || files_in(&out) >= 3).interrupted();
        assert_eq!(answer.code, 130, "{}", answer.err);
        assert!(answer.err.contains("stopping; what is done is kept"), "{}", answer.err);
        let line = answer.out.lines().find_map(|line| line.split_once(" frames of 50000 (stopped)"));
        let frames: usize = line.unwrap_or_else(|| panic!("{}", answer.out)).0.parse().unwrap();
        let pictures = std::fs::read_dir(&out).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap());
        assert_eq!(pictures.filter(|name| name.starts_with("colour_")).count(), frames);
        assert!(frames < 50_000 && out.join("coverage.csv").exists());
        assert!(out.join("preview.gif").exists() && out.join("colour_0000.png").exists());
    }

    #[test]
    fn a_final_evaluation_that_is_stopped_is_made_up_for_by_the_command_that_is_printed() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, run) = (folder.path().join("scene"), folder.path().join("run"));
        let options = TabletopOptions { width: 24, height: 24, train: 6, test: 120, rays: 1, ..Default::default() };
        write_blender(&tabletop(&options), &scene).unwrap();
        let words = ["train", text(&scene), "--out", text(&run), "--steps", "2", "--progress", "off"];
        let renders = run.join("renders");
        let answer = Running::start(&[&words[..], &SMALL].concat())
            .until("views are measured", || files_in(&renders) >= 8)
            .interrupted();
        assert_eq!(answer.code, 130, "{}{}", answer.out, answer.err);
        assert!(answer.out.contains("of 120 views: the mean is over these alone"), "{}", answer.out);
        assert!(
            answer.out.contains("continue with: ") && answer.out.contains("train --resume --out"),
            "{}",
            answer.out
        );
        assert!(!run.join("eval.json").exists() && checkpoints(&run) == [2]);

        // The run is at its stop, and not finished before its views are measured.
        let resume = ["train", "--resume", "--out", text(&run), "--progress", "off"];
        let answer = nerf(&resume);
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(run.join("eval.json").exists() && run.join("report.html").exists());
        assert!(nerf(&resume).out.contains("is finished"));

        // An evaluation that is stopped leaves the scores as they were.
        let before = std::fs::read(run.join("eval.json")).unwrap();
        let changed = || std::fs::metadata(&renders).unwrap().modified().unwrap();
        let since = changed();
        let again = Running::start(&["eval", text(&run)]);
        let answer = again.until("views are measured again", || changed() > since).interrupted();
        assert_eq!(answer.code, 130, "{}{}", answer.out, answer.err);
        assert_eq!(std::fs::read(run.join("eval.json")).unwrap(), before);
    }

    #[test]
    fn a_view_that_takes_minutes_is_given_up_at_once_and_the_views_before_it_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, run) = (folder.path().join("scene"), folder.path().join("run"));
        let options = TabletopOptions { width: 600, height: 600, train: 2, test: 2, rays: 1, ..Default::default() };
        write_blender(&tabletop(&options), &scene).unwrap();
        // So many samples a ray that a view takes many times as long as is waited here.
        let slow = ["--system", "nerf", "--set", "width=256", "--set", "coarse=128", "--set", "fine=256"];
        let words = ["train", text(&scene), "--out", text(&run), "--steps", "1", "--progress", "off"];
        let renders = run.join("renders");
        let running = Running::start(&[&words[..], &slow, &["--set", "batch_rays=16"]].concat())
            .until("the evaluation begins", || renders.exists());
        std::thread::sleep(std::time::Duration::from_millis(500));
        let since = std::time::Instant::now();
        let answer = running.interrupted();
        let seconds = since.elapsed().as_secs_f64();
        println!("{seconds:.2} s from the signal to the end");
        assert_eq!(answer.code, 130, "{}{}", answer.out, answer.err);
        assert!(answer.err.contains("interrupt heard: stopping"), "{}", answer.err);
        assert!(answer.out.contains("continue with: "), "{}", answer.out);
        assert!(seconds < 10.0, "{seconds} s");
        assert!(files_in(&renders) == 0 && checkpoints(&run) == [1]);
    }

    #[test]
    fn views_that_were_measured_are_not_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, run, whole) = (folder.path().join("scene"), folder.path().join("run"), folder.path().join("whole"));
        let options = TabletopOptions { width: 24, height: 24, train: 6, test: 90, rays: 1, ..Default::default() };
        write_blender(&tabletop(&options), &scene).unwrap();
        let words = |run: &Path| {
            let words = ["train", text(&scene), "--out", text(run), "--steps", "2", "--progress", "off"];
            [&words[..], &SMALL].concat().iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let own = words(&run);
        let own: Vec<&str> = own.iter().map(String::as_str).collect();
        let renders = run.join("renders");
        let answer = Running::start(&own).until("views are measured", || files_in(&renders) >= 12).interrupted();
        assert_eq!(answer.code, 130, "{}{}", answer.out, answer.err);
        let times = || -> Vec<_> {
            let kept: Value = serde_json::from_slice(&std::fs::read(run.join("eval_views.json")).unwrap()).unwrap();
            let kept = kept["views"].as_object().unwrap().values();
            let path = |view: &Value| renders.join(format!("{}.png", view["score"]["files"].as_str().unwrap()));
            kept.map(|view| (path(view), std::fs::metadata(path(view)).unwrap().modified().unwrap())).collect()
        };
        let before = times();
        assert!(before.len() >= 2, "{before:?}");
        assert_eq!(nerf(&["train", "--resume", "--out", text(&run), "--progress", "off"]).code, 0);
        for (path, time) in before {
            assert_eq!(std::fs::metadata(&path).unwrap().modified().unwrap(), time, "{}", path.display());
        }
        assert!(!run.join("eval_views.json").exists());
        let other = words(&whole);
        assert_eq!(nerf(&other.iter().map(String::as_str).collect::<Vec<_>>()).code, 0);
        let scores = |run: &Path| -> Vec<(Value, Value)> {
            let all: Value = serde_json::from_slice(&std::fs::read(run.join("eval.json")).unwrap()).unwrap();
            let views = all["views"].as_array().unwrap().iter();
            views
                .map(|view| (view["psnr"].clone(), view["ssim"].clone()))
                .chain([(all["psnr"].clone(), all["ssim"].clone())])
                .collect()
        };
        assert_eq!(scores(&run), scores(&whole), "the same bits as of an evaluation that nobody stopped");
    }
}
