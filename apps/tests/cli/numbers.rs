//! Numbers that no clock, no memory and no whole number holds: a line that says so, or a command that does its work.

use crate::tools::{SMALL, dataset, nerf, newest, text};

const EXTREMES: [&str; 12] = [
    "1e300",
    "-1e300",
    "1e-300",
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "x",
];

/// It ended well, or with one line.
fn is_said(words: &[&str]) -> bool {
    let answer = nerf(words);
    let errors = answer.err.lines().filter(|line| line.starts_with("error: ")).count();
    let well = matches!((answer.code, errors), (0, 0) | (1 | 2, 1));
    assert!(well, "{words:?} ended with {}:\n{}{}", answer.code, answer.out, answer.err);
    answer.code == 0
}

#[test]
fn extreme_numbers_of_a_training_are_said_or_work() {
    let (folder, scene) = dataset();
    let mut worked = 0;
    for word in
        ["--checkpoint-minutes", "--disk-wait", "--eval-at", "--eval-every", "--seed", "--scales", "--image-memory"]
    {
        for extreme in EXTREMES {
            let run = folder.path().join(format!("run{word}{extreme}"));
            let option = format!("{word}={extreme}");
            let words = ["train", text(&scene), "--out", text(&run), "--steps", "1", "--progress", "off", &option];
            if is_said(&[&words[..], &SMALL].concat()) {
                worked += 1;
                assert_eq!(newest(&run), 1);
                // The schedule is read again.
                assert!(is_said(&["train", "--resume", "--out", text(&run), "--progress", "off"]), "{option}");
            }
        }
    }
    assert!(worked > 10, "{worked}");
}

#[test]
fn extreme_settings_are_said_or_work() {
    let (folder, scene) = dataset();
    for key in
        ["lr", "log2_table", "levels", "batch_samples", "batch_rays", "occupancy", "occupancy_every", "n_max", "width"]
    {
        for extreme in ["1e300", "-1", "0", "9223372036854775807", "4294967296", "nan", "inf"] {
            let run = folder.path().join(format!("run-{key}-{extreme}"));
            let set = format!("{key}={extreme}");
            let words = ["train", text(&scene), "--out", text(&run), "--steps", "1", "--progress", "off"];
            is_said(&[&words[..], &SMALL, &["--set", &set]].concat());
        }
    }
}

#[test]
fn extreme_numbers_of_other_commands_are_said_or_work() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let words = ["train", text(&scene), "--out", text(&run), "--steps", "1", "--progress", "off"];
    assert!(is_said(&[&words[..], &SMALL].concat()));
    let out = folder.path().join("out");
    let ply = folder.path().join("out.ply");
    for extreme in EXTREMES {
        for word in ["--fps", "--longest-side", "--error-budget"] {
            let option = format!("{word}={extreme}");
            let words =
                ["render", text(&run), "--path", "orbit", "--frames", "1", "--out", text(&out), "--video", "off"];
            is_said(&[&words[..], &["--progress", "off", &option]].concat());
        }
        for word in ["--level", "--resolution", "--triangles"] {
            // A mesh as fine as it may be is hours of work.
            if extreme != "1e-300" {
                let option = format!("{word}={extreme}");
                is_said(&[
                    "export",
                    text(&run),
                    "--mesh",
                    text(&ply),
                    "--resolution",
                    "8",
                    "--progress",
                    "off",
                    &option,
                ]);
            }
        }
        let count = format!("--count={extreme}");
        is_said(&["export", text(&run), "--points", text(&ply), "--progress", "off", &count]);
        let holdout = format!("every:{extreme}");
        is_said(&["check", text(&scene), "--holdout", &holdout]);
        let frames = format!("--frames={extreme}");
        if extreme != "x" {
            let demo = folder.path().join("demo");
            assert_ne!(nerf(&["demo", "--out", text(&demo), "--steps", "x", &frames]).code, 0);
        }
    }
    // Seconds and steps that no training reaches are stopped by the test of signals; those that it has reached already work.
    for option in ["--steps=18446744073709551615", "--seconds=1e300"] {
        assert_eq!(nerf(&["train", "--resume", "--out", text(&run), option, "--seed", "9"]).code, 1, "{option}");
    }
}
