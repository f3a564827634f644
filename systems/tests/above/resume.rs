//! Stopped and resumed is the same as never stopped.

use crate::common::{Watch, arrays, request, resume, sky_scene, start, with_parts};
use engine::RunError;
use engine::checkpoint::{load_newest, newest_step};
use engine::log;
use engine::options::Request;
use engine::output::Disk;
use engine::run::{Run, planned_schedule};
use engine::train::{Reason, Schedule, Stop};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn stopped_at(step: u64) -> Watch {
    Watch { stop_after: Some(step), ..Watch::default() }
}

#[test]
fn resume_at_any_step_equals_uninterrupted() {
    let whole = tempfile::tempdir().unwrap();
    start(whole.path(), &Disk, Stop::Steps(60), &mut Watch::default()).unwrap();
    for first in [1, 17, 59] {
        let parts = tempfile::tempdir().unwrap();
        let ended = start(parts.path(), &Disk, Stop::Steps(60), &mut stopped_at(first)).unwrap();
        assert_eq!((ended.step, ended.reason), (first, Reason::Interrupted));
        let ended = resume(parts.path(), Stop::Steps(60), &mut Watch::default()).unwrap();
        assert_eq!((ended.step, ended.reason), (60, Reason::Finished));
        assert_eq!(arrays(parts.path(), 60), arrays(whole.path(), 60), "stopped at {first}");
    }
}

#[test]
fn a_run_that_is_stopped_before_its_first_step_is_resumed_from_its_start() {
    let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    start(whole.path(), &Disk, Stop::Steps(10), &mut Watch::default()).unwrap();
    let mut stopped = Watch { interrupt: Arc::new(AtomicBool::new(true)), ..Watch::default() };
    let ended = start(parts.path(), &Disk, Stop::Steps(10), &mut stopped).unwrap();
    assert_eq!((ended.step, ended.reason), (0, Reason::Interrupted));
    resume(parts.path(), Stop::Steps(10), &mut Watch::default()).unwrap();
    assert_eq!(arrays(parts.path(), 10), arrays(whole.path(), 10));
}

#[test]
fn a_folder_that_is_in_use_is_refused_to_writers_and_open_to_readers() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(5), &mut Watch::default()).unwrap();
    with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let watch = &mut Watch::default();
        let run = Run::open_to_write(folder.path(), &request(), parts, watch).unwrap();
        let schedule = Schedule::new(Stop::Steps(9));
        let mut second = Run::open(folder.path(), &request(), parts, watch).unwrap();
        let busy = |error: RunError| matches!(error, RunError::Busy { .. });
        assert!(busy(second.train(&schedule, None, watch, &AtomicBool::new(false)).unwrap_err()));
        assert!(busy(second.evaluate(None, watch).unwrap_err()));
        assert!(busy(Run::open_to_write(folder.path(), &request(), parts, watch).map(|_| ()).unwrap_err()));
        run.conclude(&AtomicBool::new(false)).unwrap();
        assert!(run.is_finished(Stop::Steps(5)) && !run.is_finished(Stop::Steps(9)));
        drop(run);
        second.train(&schedule, None, watch, &AtomicBool::new(false)).unwrap();
        second.conclude(&AtomicBool::new(false)).unwrap();
        assert!(second.is_finished(Stop::Steps(9)));
    });
    let planned = planned_schedule(folder.path()).unwrap();
    assert_eq!(planned, Schedule { row_every: planned.row_every, ..Schedule::new(Stop::Steps(9)) });
}

#[test]
fn train_60_steps_same_bits_with_1_2_and_4_threads() {
    let run = |threads| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| start(folder.path(), &Disk, Stop::Steps(60), &mut Watch::default())).unwrap();
        arrays(folder.path(), 60)
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
}

#[test]
fn metrics_rows_past_the_checkpoint_are_dropped_and_none_is_repeated() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(40), &mut stopped_at(15)).unwrap();
    // As if the process had been killed ten steps after the checkpoint.
    let path = folder.path().join("metrics.csv");
    let mut text = fs::read_to_string(&path).unwrap();
    (16..=25).for_each(|step| text += &format!("{step},9.0,1.0,,,,,\n"));
    fs::write(&path, text + "26,9.").unwrap();
    resume(folder.path(), Stop::Steps(40), &mut Watch::default()).unwrap();
    let rows = log::read(&path).unwrap();
    assert!(rows.windows(2).all(|w| w[0].step < w[1].step || w[0].loss.is_none() || w[1].loss.is_none()));
    assert!(rows.iter().all(|r| r.seconds < 9.0));
    let last = rows.last().unwrap();
    assert!(last.step == 40 && last.psnr_test.is_some());
}

#[test]
fn seconds_are_absolute() {
    let folder = tempfile::tempdir().unwrap();
    let ended = start(folder.path(), &Disk, Stop::Seconds(0.02), &mut Watch::default()).unwrap();
    assert!(ended.seconds >= 0.02 && ended.step > 0);
    let again = resume(folder.path(), Stop::Seconds(0.02), &mut Watch::default()).unwrap();
    assert_eq!((again.step, again.seconds), (ended.step, ended.seconds), "a finished run does no step");
}

fn two_checkpoints(folder: &Path) {
    start(folder, &Disk, Stop::Steps(30), &mut stopped_at(10)).unwrap();
    resume(folder, Stop::Steps(30), &mut stopped_at(20)).unwrap();
    assert_eq!(newest_step(folder), Some(20));
}

#[test]
fn a_broken_newest_checkpoint_is_named_in_one_line_and_the_one_before_is_used() {
    let folder = tempfile::tempdir().unwrap();
    two_checkpoints(folder.path());
    let tensors = folder.path().join("checkpoint/step-00000020.safetensors");
    let json = folder.path().join("checkpoint/step-00000020.json");
    let (good_tensors, good_json) = (fs::read(&tensors).unwrap(), fs::read(&json).unwrap());
    let mut flipped = good_tensors.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    let broken: [(&str, &[u8], &[u8]); 5] = [
        ("truncated", &good_tensors[..good_tensors.len() / 2], &good_json),
        ("truncated", &[], &good_json),
        ("corrupted", &flipped, &good_json),
        ("JSON file is broken", &good_tensors, &good_json[..good_json.len() / 2]),
        ("JSON file", &good_tensors, &[0xff, 0xfe]),
    ];
    for (what, tensor_bytes, json_bytes) in broken {
        fs::write(&tensors, tensor_bytes).unwrap();
        fs::write(&json, json_bytes).unwrap();
        let checkpoint = load_newest(folder.path()).unwrap();
        assert_eq!(checkpoint.meta.step, 10);
        let [warning] = checkpoint.warnings.as_slice() else { panic!("{:?}", checkpoint.warnings) };
        assert!(warning.contains("step-00000020") && warning.contains(what), "{warning}");
        assert!(warning.contains("using step 10") && !warning.contains('\n'), "{warning}");
    }
    // And the run goes on from there to the same bits.
    let mut watch = Watch::default();
    resume(folder.path(), Stop::Steps(30), &mut watch).unwrap();
    assert_eq!(watch.warnings.len(), 1);
    let whole = tempfile::tempdir().unwrap();
    start(whole.path(), &Disk, Stop::Steps(30), &mut Watch::default()).unwrap();
    assert_eq!(arrays(folder.path(), 30), arrays(whole.path(), 30));
}

#[test]
fn only_broken_checkpoints_are_an_error_that_names_them_all() {
    let folder = tempfile::tempdir().unwrap();
    two_checkpoints(folder.path());
    for step in [10, 20] {
        fs::write(folder.path().join(format!("checkpoint/step-{step:08}.safetensors")), b"nothing").unwrap();
    }
    let error = load_newest(folder.path()).unwrap_err();
    assert!(matches!(&error, RunError::AllCheckpointsBroken { problems, .. } if problems.len() == 2), "{error}");
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(load_newest(empty.path()), Err(RunError::NoCheckpoint(_))));
}

#[test]
fn the_last_two_checkpoints_are_kept() {
    assert_eq!(after_resume("step-00000025.safetensors.tmp", 30), files_of([20, 30]));
}

/// The files in the checkpoint folder of a run with checkpoints of 10 and 20 steps, one file of it broken, that went on to `steps`.
fn after_resume(broken: &str, steps: u64) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    two_checkpoints(folder.path());
    let checkpoints = folder.path().join("checkpoint");
    fs::write(checkpoints.join(broken), b"cut off").unwrap();
    resume(folder.path(), Stop::Steps(steps), &mut Watch::default()).unwrap();
    let entries = fs::read_dir(checkpoints).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn files_of(steps: [u64; 2]) -> Vec<String> {
    steps.map(|s| [format!("step-{s:08}.json"), format!("step-{s:08}.safetensors")]).concat()
}

#[test]
fn a_broken_checkpoint_costs_no_good_one_its_place() {
    assert_eq!(after_resume("step-00000020.safetensors", 12), files_of([10, 12]));
}

#[test]
fn a_new_run_does_not_overwrite_an_old_one() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(5), &mut Watch::default()).unwrap();
    let error = start(folder.path(), &Disk, Stop::Steps(5), &mut Watch::default()).unwrap_err();
    assert!(matches!(error, RunError::RunExists { step: 5, .. }), "{error}");
}

#[test]
fn resume_refuses_another_configuration_and_another_dataset() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(5), &mut Watch::default()).unwrap();
    let open = |request: &Request, views| {
        with_parts(&Disk, &sky_scene(views, 16, false), |parts| {
            Run::open(folder.path(), request, parts, &mut Watch::default()).map(|_| ())
        })
    };
    open(&request(), 8).unwrap();
    open(&Request { set: toml::toml! { lr = 0.5 }, ..request() }, 8).unwrap();
    let error = open(&Request { seed: Some(6), ..request() }, 8).unwrap_err().to_string();
    assert!(error.contains("`--seed 6`") && error.contains("`--seed 5`"), "{error}");
    let error = open(&Request { set: toml::toml! { lr = 0.1 }, ..request() }, 8).unwrap_err().to_string();
    assert!(error.contains("lr=0.1") && error.contains("lr=0.5"), "{error}");
    let error = open(&request(), 9).unwrap_err();
    assert!(matches!(error, RunError::DatasetChanged { .. }), "{error}");
}
