//! Runs that are interrupted, resumed to their own stop, started twice in one folder, or put among other files.

use crate::tools::{
    Answer, Running, SMALL, arrays, checkpoints, dataset, error_line, files_in, nerf, newest, rows, text,
};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, SystemTime};

fn words<'a>(scene: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    [&["train", text(scene), "--out", text(out), "--progress", "off"], &SMALL[..], more].concat()
}

/// The commands between backticks of a line.
fn commands(line: &str) -> Vec<&str> {
    line.split('`').skip(1).step_by(2).collect()
}

fn after<'a>(answer: &'a Answer, start: &str) -> &'a str {
    let line = answer.out.lines().find_map(|line| line.split_once(start)).map(|(_, rest)| rest.trim());
    line.unwrap_or_else(|| panic!("`{start}` is not in:\n{}{}", answer.out, answer.err))
}

/// Some number of milliseconds below `most`, another one each time.
fn some_milliseconds(most: u32) -> Duration {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    Duration::from_millis(u64::from(now.subsec_micros() % most))
}

#[test]
#[cfg(unix)]
fn a_run_that_is_interrupted_again_and_again_ends_at_its_own_stop_with_the_same_bits() {
    const STEPS: u64 = 400;
    let (folder, scene) = dataset();
    // A name that a shell would take apart.
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("it's in parts"));
    let more = ["--steps", "400", "--eval-every", "150", "--checkpoint-minutes", "60"];
    assert_eq!(nerf(&words(&scene, &whole, &more)).code, 0);

    let first = Running::start(&words(&scene, &parts, &more)).until("it trains", || rows(&parts) > 0);
    let mut answer = first.interrupted();
    let (mut interruptions, mut again) = (0, String::new());
    while answer.code == 130 {
        interruptions += 1;
        assert!(answer.err.contains("interrupt heard"), "it was heard: {}", answer.err);
        // Where it was still reading there was nothing to lose, and the command is the same.
        if !answer.err.contains("nothing to lose") {
            again = after(&answer, "continue with: ").to_string();
        }
        answer = match interruptions {
            // Ten times at most; then it may end.
            10.. => Running::typed(&again).end(),
            _ => {
                let before = newest(&parts);
                let running = Running::typed(&again);
                std::thread::sleep(some_milliseconds(700));
                let answer = running.interrupted();
                // Killed before it listened: nothing is lost.
                if answer.code == -1 {
                    assert_eq!(newest(&parts), before);
                    Running::typed(&again).end()
                } else {
                    answer
                }
            }
        };
    }
    assert!(interruptions > 0 && answer.code == 0, "{}{}", answer.out, answer.err);
    assert!(arrays(&whole, STEPS) == arrays(&parts, STEPS), "{interruptions} interruptions: not the same bits");
    let schedule = |run: &Path| fs::read_to_string(run.join("schedule.json")).unwrap();
    assert_eq!(schedule(&whole), schedule(&parts), "the rest of the schedule is kept, too");
}

/// Words of a line that was quoted for a shell.
#[cfg(unix)]
fn shell_words(line: &str) -> Vec<String> {
    let output = Command::new("sh").args(["-c", &format!("printf '%s\\n' {line}")]).output().unwrap();
    String::from_utf8(output.stdout).unwrap().lines().map(ToString::to_string).collect()
}

#[test]
#[cfg(unix)]
fn a_finished_run_is_left_alone_and_says_how_to_go_on() {
    let (folder, scene) = dataset();
    let run = folder.path().join("a run");
    let answer = nerf(&words(&scene, &run, &["--steps", "20", "--eval-every", "15"]));
    assert_eq!(answer.code, 0, "{}", answer.err);
    let last = answer.out.lines().last().unwrap();
    let next = commands(last);
    assert!(next.len() == 2 && next[0].contains("nerf-static view ") && next[1].contains(" render "), "{last}");
    assert_eq!(shell_words(next[1])[1..], ["render", text(&run), "--out", text(&run.join("pictures"))]);
    assert_eq!(shell_words(next[0])[1..], ["view", text(&run)]);

    let state = || {
        let files = ["eval.json", "metrics.csv", "schedule.json", "report.html", "config.toml"];
        files.map(|name| fs::metadata(run.join(name)).unwrap().modified().unwrap())
    };
    let before = state();
    // With nothing said, and with a stop that is behind it.
    for more in [&[][..], &["--steps", "10"]] {
        let resume = ["train", "--resume", "--out", text(&run), "--progress", "off"];
        let answer = nerf(&[&resume, more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(answer.out.contains("is finished") && answer.out.contains("nothing was changed"), "{}", answer.out);
        assert_eq!(state(), before);
        assert_eq!(checkpoints(&run), [20]);
    }
    let answer = nerf(&["train", "--resume", "--out", text(&run), "--progress", "off"]);
    let further = Running::typed(after(&answer, "to train it further: ")).end();
    assert_eq!(further.code, 0, "{}", further.err);
    assert!(newest(&run) == 40 && further.out.contains("training to step 40"), "{}", further.out);
    // What the first command said of the way there still holds.
    let text = fs::read_to_string(run.join("metrics.csv")).unwrap();
    let measured = |step: &str| text.lines().any(|l| l.starts_with(step) && l.split(',').nth(4) != Some(""));
    assert!(measured("30,"), "{text}");
}

#[test]
fn a_run_that_has_reached_its_seconds_goes_on_for_more_of_them() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    assert_eq!(nerf(&words(&scene, &run, &["--seconds", "0.05"])).code, 0);
    let step = newest(&run);
    let resume = ["train", "--resume", "--out", text(&run), "--progress", "off"];
    let answer = nerf(&resume);
    assert!(answer.out.contains("is finished") && answer.out.contains("--seconds 2"), "{}", answer.out);
    let answer = nerf(&[&resume[..], &["--seconds", "0.2"]].concat());
    assert!(answer.code == 0 && answer.out.contains("training for 0.2 s"), "{}{}", answer.out, answer.err);
    assert!(newest(&run) > step);
    assert!(nerf(&resume).out.contains("is finished"), "the new stop is the run's own now");
}

#[test]
#[cfg(unix)]
fn two_trainings_in_one_folder_the_second_is_refused_and_the_first_is_unharmed() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let more = ["--steps", "1000000", "--checkpoint-minutes", "0.01"];
    let first =
        Running::start(&words(&scene, &run, &more)).until("there is a checkpoint", || !checkpoints(&run).is_empty());
    let pid = format!("process {}", first.id());
    let resume = ["train", "--resume", "--out", text(&run)];
    for second in [&words(&scene, &run, &["--steps", "5"])[..], &resume, &["eval", text(&run)], &["masks", text(&run)]]
    {
        let answer = match second[0] {
            "masks" => crate::tools::nerf_wild(second),
            _ => nerf(second),
        };
        assert_eq!(answer.code, 1, "{second:?}: {}", answer.out);
        let line = error_line(&answer);
        assert!(line.contains("is in use") && line.contains(&pid), "{second:?}: {line}");
    }
    // Who only reads may.
    let pictures = folder.path().join("pictures");
    let look = ["render", text(&run), "--path", "orbit", "--frames", "1", "--out", text(&pictures)];
    assert_eq!(nerf(&look).code, 0);

    let answer = first.interrupted();
    assert_eq!(answer.code, 130, "{}", answer.err);
    let step = newest(&run);
    let alone = folder.path().join("alone");
    let steps = step.to_string();
    assert_eq!(nerf(&words(&scene, &alone, &["--steps", &steps])).code, 0);
    assert!(arrays(&run, step) == arrays(&alone, step), "the first run was disturbed");
}

#[test]
fn a_folder_with_other_files_in_it_is_refused_and_left_as_it_was() {
    let (folder, scene) = dataset();
    let out = folder.path().join("photos");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("IMG_1.jpg"), b"").unwrap();
    for place in [&out, &scene] {
        let before = files_in(place);
        let answer = nerf(&words(&scene, place, &["--steps", "1"]));
        assert_eq!(answer.code, 1);
        let line = error_line(&answer);
        assert!(line.contains("is not a run folder") && line.contains("--out"), "{line}");
        assert_eq!(files_in(place), before, "{}", place.display());
    }
    let answer = nerf(&words(&scene, &out, &["--steps", "1"]));
    assert!(error_line(&answer).contains("`IMG_1.jpg`"), "{}", answer.err);
}

#[test]
fn a_demo_replaces_a_demo_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let small =
        [&["demo", "--out", text(&out), "--steps", "2", "--frames", "1", "--progress", "off"], &SMALL[..]].concat();
    let answer = nerf(&small);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.lines().last().unwrap().contains(" view "), "{}", answer.out);
    fs::write(out.join("mine.txt"), b"").unwrap();
    let answer = nerf(&small);
    assert!(answer.code == 0 && answer.out.contains("replacing the earlier demo"), "{}{}", answer.out, answer.err);
    assert!(out.join("mine.txt").exists() && checkpoints(&out) == [2]);

    // The same scene, but somebody's own run.
    let own = folder.path().join("own");
    let train = ["train", "synthetic:tabletop", "--out", text(&own), "--steps", "1", "--progress", "off"];
    assert_eq!(nerf(&[&train[..], &["--longest-side", "40"], &SMALL].concat()).code, 0);
    let answer = nerf(&["demo", "--out", text(&own), "--steps", "2"]);
    assert!(answer.code == 1 && error_line(&answer).contains("already holds a run"), "{}", answer.err);
    assert_eq!(checkpoints(&own), [1]);
}

#[test]
fn resuming_where_no_run_is_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none");
    let answer = nerf(&["train", "--resume", "--out", text(&none)]);
    assert!(answer.code == 1 && error_line(&answer).contains("holds no checkpoint"), "{}", answer.err);
    assert!(!none.exists());
}
