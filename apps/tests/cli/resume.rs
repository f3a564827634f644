//! Runs that are killed, resumed, spoilt, or have nowhere to write.

use crate::tools::{SMALL, arrays, checkpoints, dataset, error_line, killed, nerf, newest, program, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const STEPS: &str = "40";

fn words<'a>(scene: &'a Path, out: &'a Path, steps: &'a str) -> Vec<&'a str> {
    let mut words = vec!["train", text(scene), "--out", text(out), "--steps", steps, "--progress", "off"];
    words.extend(SMALL);
    words
}

#[test]
fn a_killed_run_resumes_to_the_same_bits() {
    let (folder, scene) = dataset();
    let (whole, stopped) = (folder.path().join("whole"), folder.path().join("killed"));
    assert_eq!(nerf(&words(&scene, &whole, STEPS)).code, 0);

    killed("nerf-static", &words(&scene, &stopped, "100000"), || checkpoints(&stopped).len() >= 2);
    let step = newest(&stopped);
    assert!((1..40).contains(&step), "killed at step {step}");

    let answer = nerf(&["train", "--resume", "--out", text(&stopped), "--steps", STEPS, "--progress", "off"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("resumed at step"), "{}", answer.out);
    assert!(arrays(&whole, 40) == arrays(&stopped, 40), "the same bits as an uninterrupted run");
}

#[test]
fn resume_keeps_the_run_s_configuration() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    assert_eq!(nerf(&words(&scene, &run, "2")).code, 0);

    let again = nerf(&words(&scene, &run, "2"));
    assert_eq!(again.code, 1);
    assert!(error_line(&again).contains("--resume"), "{}", again.err);

    let resume = ["train", "--resume", "--out", text(&run), "--steps", "4", "--progress", "off"];
    for (extra, given, own) in [
        (["--seed", "9"], "--seed 9", "--seed 0"),
        (["--background", "black"], "--background black", "--background random"),
        (["--set", "levels=5"], "levels=5", "levels=4"),
        (["--longest-side", "12"], "--longest-side 12", "(not given)"),
    ] {
        let answer = nerf(&[&resume[..], &extra].concat());
        assert_eq!(answer.code, 1, "{extra:?}");
        let line = error_line(&answer);
        assert!(line.contains(given) && line.contains(own), "{line}");
    }
    assert_eq!(nerf(&resume).code, 0);

    // The dataset must be the same, too.
    let image = fs::read_dir(scene.join("train")).unwrap().next().unwrap().unwrap().path();
    let other = image::RgbaImage::from_pixel(24, 24, image::Rgba([1, 2, 3, 255]));
    other.save(&image).unwrap();
    let answer = nerf(&resume);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("dataset has changed"), "{}", answer.err);
}

#[test]
fn a_spoilt_checkpoint_is_one_warning_and_the_one_before_is_used() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    assert_eq!(nerf(&words(&scene, &run, "2")).code, 0);
    let resume = ["train", "--resume", "--out", text(&run), "--steps", "4", "--progress", "off"];
    assert_eq!(nerf(&resume).code, 0);
    let path = run.join("checkpoint/step-00000004.safetensors");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();

    let answer = nerf(&["eval", text(&run)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let warnings: Vec<&str> = answer.err.lines().filter(|l| l.starts_with("warning: ")).collect();
    assert_eq!(warnings.len(), 1, "{}", answer.err);
    assert!(warnings[0].contains("truncated") && warnings[0].contains("using step 2"), "{}", warnings[0]);

    fs::write(run.join("checkpoint/step-00000002.json"), b"{}").unwrap();
    let answer = nerf(&["eval", text(&run)]);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("none of the 2 checkpoints"), "{}", answer.err);
}

#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_is_full_for_a_moment_is_a_warning_and_one_that_stays_so_is_one_clear_line() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    assert_eq!(nerf(&words(&scene, &run, "2")).code, 0);
    let before = fs::read(run.join("checkpoint/step-00000002.safetensors")).unwrap();
    // Nothing can be written where a folder is: as on a full disk, until there is room.
    let lump = run.join("checkpoint/step-00000004.safetensors.tmp");
    fs::create_dir(&lump).unwrap();
    let room = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_secs(8));
        fs::remove_dir(lump).unwrap();
    });
    let answer = nerf(&["train", "--resume", "--out", text(&run), "--steps", "4", "--progress", "off"]);
    room.join().unwrap();
    assert_eq!(answer.code, 0, "{}", answer.err);
    let warning = answer.err.lines().find(|line| line.contains("trying again")).unwrap_or_default();
    assert!(warning.starts_with("warning: ") && warning.contains("step-00000004"), "{}", answer.err);
    let blocked = run.join("checkpoint/step-00000006.safetensors.tmp");
    fs::create_dir(&blocked).unwrap();
    let resume = ["train", "--resume", "--out", text(&run), "--steps", "6", "--progress", "off", "--disk-wait", "0.1"];
    let answer = nerf(&resume);
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("step-00000006"), "{}", answer.err);
    assert_eq!(fs::read(run.join("checkpoint/step-00000002.safetensors")).unwrap(), before);
    fs::remove_dir(&blocked).unwrap();
    let answer = nerf(&resume);
    assert_eq!(answer.code, 0, "with room again: {}", answer.err);
}

#[test]
fn an_unwritable_output_folder_is_one_clear_line() {
    let (folder, scene) = dataset();
    let file = folder.path().join("file");
    fs::write(&file, b"").unwrap();
    let answer = nerf(&words(&scene, &file.join("run"), "1"));
    assert_eq!(answer.code, 1);
    assert!(error_line(&answer).contains("cannot write"), "{}", answer.err);
}

#[test]
#[cfg(unix)]
fn ctrl_c_writes_a_checkpoint_and_says_how_to_go_on() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let child = Command::new(program().get_program())
        .args(words(&scene, &run, "1000000"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let since = Instant::now();
    while fs::read_to_string(run.join("metrics.csv")).map_or(0, |t| t.lines().count()) < 2 {
        assert!(since.elapsed() < Duration::from_secs(60), "training has not begun");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("--resume"));
    assert_eq!(checkpoints(&run).len(), 1);
}
