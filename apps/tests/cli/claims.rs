//! What a run says before it starts: how far its system is the paper's, and which views are measured.

use crate::tools::{SMALL, dataset, error_line, nerf, nerf_dynamic, nerf_wild, text};
use std::fs;

#[test]
fn a_training_says_what_its_system_does_otherwise_than_the_paper() {
    let (folder, scene) = dataset();
    for (program, system) in [
        (nerf as fn(&[&str]) -> crate::tools::Answer, "ngp"),
        (nerf_wild, "hugs"),
        (nerf_wild, "robust-nerf"),
        (nerf_dynamic, "d-nerf"),
    ] {
        let run = folder.path().join(system);
        let mut words = vec!["train", text(&scene), "--out", text(&run), "--system", system, "--steps", "1"];
        words.extend(["--progress", "off"]);
        words.extend(SMALL);
        let answer = program(&words);
        assert_eq!(answer.code, 0, "{system}: {}", answer.err);
        let claim = systems::registry::find(system).unwrap().claim;
        assert!(answer.out.contains(&claim.line().unwrap()), "{system}: {}", answer.out);
        let halved = answer.out.contains("patches: 8x8, inner 4x4: half as large as elsewhere (photos of 24 pixels");
        assert_eq!(halved, ["hugs", "robust-nerf"].contains(&system), "{system}: {}", answer.out);
    }
}

#[test]
fn validation_views_are_measured_in_the_place_of_test_views_and_a_resumed_run_knows() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let mut words = vec!["train", text(&scene), "--out", text(&run), "--steps", "2", "--progress", "off"];
    words.extend(["--validation", "every:3"]);
    words.extend(SMALL);
    let answer = nerf(&words);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("4 training views"), "{}", answer.out);
    assert!(
        answer.out.contains("validation: 2 frames are held out and measured (of 6 training frames)"),
        "{}",
        answer.out
    );
    assert!(answer.out.contains("the 2 test frames are not used"), "{}", answer.out);
    assert!(answer.out.contains("validation views, measured (2, see validation.txt): "), "{}", answer.out);
    assert!(answer.out.contains("measured: validation views"), "{}", answer.out);
    let names = fs::read_to_string(run.join("validation.txt")).unwrap();
    assert!(names.lines().count() == 2 && names.lines().all(|n| n.contains("train")), "{names}");
    assert!(fs::read_to_string(run.join("heldout.txt")).unwrap().lines().all(|n| n.contains("test")));

    let measured = |answer: &crate::tools::Answer| {
        assert_eq!(answer.code, 0, "{}", answer.err);
        let eval = fs::read_to_string(run.join("eval.json")).unwrap();
        assert!(eval.contains("\"split\": \"validation\""), "{eval}");
        assert!(names.lines().all(|name| eval.contains(&format!("\"name\": \"{name}\""))), "{eval}");
    };
    measured(&nerf(&["eval", text(&run), "--progress", "off"]));
    let resume = ["train", "--resume", "--out", text(&run), "--steps", "4", "--progress", "off"];
    let other = nerf(&[&resume[..], &["--validation", "every:2"]].concat());
    assert_eq!(other.code, 1);
    let line = error_line(&other);
    assert!(line.contains("--validation every:2") && line.contains("--validation every:3"), "{line}");
    measured(&nerf(&resume));
}

#[test]
fn validation_that_cannot_be_is_one_line() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    for (word, part) in [
        ("every:1", "no frames are left to train on"),
        ("dataset", "no validation split of its own"),
        ("sometimes", "--validation"),
        ("names:/nowhere.txt", "/nowhere.txt"),
    ] {
        let answer = nerf(&["train", text(&scene), "--out", text(&run), "--steps", "1", "--validation", word]);
        assert_eq!(answer.code, 1, "{word}: {}", answer.out);
        error_line(&answer);
        assert!(answer.err.contains(part), "{word}: {}", answer.err);
    }
    let answer = nerf(&["check", text(&scene), "--validation", "every:3"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("validation: 2 frames"), "{}", answer.out);
}
