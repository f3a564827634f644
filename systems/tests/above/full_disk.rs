//! A disk that fills up costs what was being written and nothing else.

use crate::common::{Watch, arrays, request, resume, sky_scene, start, with_parts};
use engine::RunError;
use engine::checkpoint::newest_step;
use engine::options::Request;
use engine::output::{Disk, Storage, StorageFile, write_file};
use engine::progress::{Event, Observer};
use engine::run::Run;
use engine::train::{Schedule, Stop};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// A file system with `left` bytes.
struct Filling {
    left: Arc<AtomicU64>,
}

struct FillingFile {
    file: File,
    left: Arc<AtomicU64>,
}

impl Storage for Filling {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageFile>> {
        Ok(Box::new(FillingFile { file: File::create(path)?, left: self.left.clone() }))
    }
}

impl Write for FillingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let left = self.left.load(Ordering::Relaxed);
        if left == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let n = self.file.write(&bytes[..bytes.len().min(left as usize)])?;
        self.left.store(left - n as u64, Ordering::Relaxed);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl StorageFile for FillingFile {
    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_all()
    }
}

/// No second try.
fn impatient(steps: u64) -> Schedule {
    Schedule { disk_wait: Duration::ZERO, ..Schedule::new(Stop::Steps(steps)) }
}

/// A run of 20 steps that nothing disturbed.
fn undisturbed() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(20), &mut Watch::default()).unwrap();
    folder
}

#[test]
fn a_full_disk_leaves_the_earlier_checkpoint_usable() {
    let whole = undisturbed();
    // Room for nothing, for a part of the arrays, and for the arrays but not the JSON file.
    let size = arrays(whole.path(), 20).len() as u64;
    for room in [0, size / 2, size + 100] {
        let folder = tempfile::tempdir().unwrap();
        start(folder.path(), &Disk, Stop::Steps(10), &mut Watch::default()).unwrap();
        let storage = Filling { left: Arc::new(AtomicU64::new(room)) };
        let error = with_parts(&storage, &sky_scene(8, 16, false), |parts| {
            let watch = &mut Watch::default();
            let mut run = Run::open(folder.path(), &Request::default(), parts, watch).unwrap();
            run.train(&impatient(20), None, watch, &Default::default()).unwrap_err()
        });
        assert!(
            matches!(&error, RunError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull),
            "{error}"
        );
        assert!(error.to_string().contains("step-00000020"), "{error}");
        assert_eq!(newest_step(folder.path()), Some(10));
        let leftovers = fs::read_dir(folder.path().join("checkpoint")).unwrap();
        assert!(leftovers.flatten().all(|e| e.path().extension().is_some_and(|e| e != "tmp")));
        resume(folder.path(), Stop::Steps(20), &mut Watch::default()).unwrap();
        assert_eq!(arrays(folder.path(), 20), arrays(whole.path(), 20), "resumed once there is room");
    }
}

#[test]
fn a_failed_write_leaves_the_file_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("eval.json");
    write_file(&Disk, &path, b"old").unwrap();
    let storage = Filling { left: Arc::new(AtomicU64::new(2)) };
    assert!(write_file(&storage, &path, b"new and longer").is_err());
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn an_output_folder_that_cannot_be_is_found_out_before_training() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a_file");
    fs::write(&file, b"").unwrap();
    let below = file.join("run");
    let error = with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        Run::create(&below, &request(), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
    });
    assert!(matches!(&error, RunError::Write { path, .. } if *path == below), "{error}");

    let storage = Filling { left: Arc::new(AtomicU64::new(0)) };
    let error = with_parts(&storage, &sky_scene(8, 16, false), |parts| {
        Run::create(&folder.path().join("run"), &request(), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
    });
    assert!(matches!(error, RunError::Write { .. }), "{error}");
}

/// A file system of which one write in a row fails: number `at`, and as many after it as `long` says.
struct Failing {
    at: u64,
    long: u64,
    seen: AtomicU64,
}

impl Storage for Failing {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageFile>> {
        let n = self.seen.fetch_add(1, Ordering::Relaxed);
        let left = if (self.at..self.at.saturating_add(self.long)).contains(&n) { 3 } else { u64::MAX };
        Ok(Box::new(FillingFile { file: File::create(path)?, left: Arc::new(AtomicU64::new(left)) }))
    }
}

#[test]
fn whichever_write_fails_a_resumed_run_has_the_same_bits_and_scores() {
    let scene = sky_scene(8, 16, false);
    let scores = |folder: &Path| -> serde_json::Value {
        let mut value: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.join("eval.json")).unwrap()).unwrap();
        value["seconds"] = 0.into();
        value["views"].as_array_mut().unwrap().iter_mut().for_each(|view| view["render_seconds"] = 0.into());
        value
    };
    let whole = tempfile::tempdir().unwrap();
    start(whole.path(), &Disk, Stop::Steps(12), &mut Watch::default()).unwrap();
    let (want, want_scores) = (arrays(whole.path(), 12), scores(whole.path()));
    let schedule = Schedule { checkpoint_every: Duration::ZERO, ..impatient(12) };
    let mut ends = [0; 3];
    for long in [1, u64::MAX] {
        for at in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let storage = Failing { at, long, seen: AtomicU64::new(0) };
            let ended = with_parts(&storage, &scene, |parts| {
                let watch = &mut Watch::default();
                let mut run = Run::create(folder.path(), &request(), parts, watch)?;
                run.train(&schedule, None, watch, &Default::default())
            });
            let reached = storage.seen.load(Ordering::Relaxed) > at;
            match &ended {
                Ok((_, Some(evaluation))) if evaluation.unwritten.is_empty() => ends[0] += 1,
                // The scores are there, and it is said what is not.
                Ok((_, Some(evaluation))) => {
                    assert!(evaluation.psnr.is_some());
                    ends[1] += 1;
                }
                Ok((_, None)) => panic!("write {at}: no scores"),
                Err(error) => {
                    assert!(matches!(error, RunError::Write { .. }), "write {at}: {error}");
                    ends[2] += 1;
                }
            }
            match newest_step(folder.path()) {
                Some(_) => drop(resume(folder.path(), Stop::Steps(12), &mut Watch::default()).unwrap()),
                None => drop(start(folder.path(), &Disk, Stop::Steps(12), &mut Watch::default()).unwrap()),
            }
            assert_eq!(arrays(folder.path(), 12), want, "write {at}");
            assert_eq!(scores(folder.path()), want_scores, "write {at}");
            if !reached {
                break;
            }
        }
    }
    assert!(ends.iter().all(|&n| n > 1), "well, with what is unwritten, with an error: {ends:?}");
}

#[test]
fn a_disk_that_is_full_for_a_while_costs_no_step() {
    let whole = undisturbed();
    let size = arrays(whole.path(), 20).len() as u64;
    let folder = tempfile::tempdir().unwrap();
    let left = Arc::new(AtomicU64::new(u64::MAX));
    let storage = Filling { left: left.clone() };
    let mut watch = Filler { left, at: [4, 12], size, removes: None, warnings: Vec::new() };
    let schedule = Schedule { checkpoint_every: Duration::ZERO, ..impatient(20) };
    with_parts(&storage, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, &mut watch).unwrap();
        run.train(&schedule, None, &mut watch, &Default::default()).unwrap();
    });
    let said: Vec<&String> = watch.warnings.iter().filter(|line| line.contains("training goes on")).collect();
    assert!(said.len() == 1 && said[0].contains("on disk: step"), "{:?}", watch.warnings);
    assert_eq!(arrays(folder.path(), 20), arrays(whole.path(), 20));
}

#[test]
fn a_run_folder_that_is_removed_on_a_full_disk_is_made_again_once_there_is_room() {
    let (whole, below) = (undisturbed(), tempfile::tempdir().unwrap());
    let folder = below.path().join("run");
    let left = Arc::new(AtomicU64::new(u64::MAX));
    let storage = Filling { left: left.clone() };
    let mut watch = Filler { left, at: [4, 12], size: 0, removes: Some(folder.clone()), warnings: Vec::new() };
    let schedule = Schedule { checkpoint_every: Duration::ZERO, ..impatient(20) };
    with_parts(&storage, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::create(&folder, &request(), parts, &mut watch).unwrap();
        run.train(&schedule, None, &mut watch, &Default::default()).unwrap();
    });
    assert!(watch.warnings.iter().any(|line| line.contains("training goes on")), "{:?}", watch.warnings);
    assert_eq!(arrays(&folder, 20), arrays(whole.path(), 20));
}

/// Fills a disk after one step, when it may remove a folder, too, and gives room again after another.
struct Filler {
    left: Arc<AtomicU64>,
    at: [u64; 2],
    size: u64,
    removes: Option<PathBuf>,
    warnings: Vec<String>,
}

impl Observer for Filler {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Step(progress) if progress.step == self.at[0] => {
                self.left.store(self.size / 2, Ordering::Relaxed);
                self.removes.iter().for_each(|folder| fs::remove_dir_all(folder).unwrap());
            }
            Event::Step(progress) if progress.step == self.at[1] => self.left.store(u64::MAX, Ordering::Relaxed),
            Event::Warning(line) => self.warnings.push(line.into()),
            _ => {}
        }
    }
}

#[test]
fn an_evaluation_on_a_disk_that_takes_nothing_says_its_scores() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(6), &mut Watch::default()).unwrap();
    let before = fs::read(folder.path().join("eval.json")).unwrap();
    let storage = Filling { left: Arc::new(AtomicU64::new(0)) };
    let evaluation = with_parts(&storage, &sky_scene(8, 16, false), |parts| {
        let run = Run::open(folder.path(), &Request::default(), parts, &mut Watch::default()).unwrap();
        run.evaluate(None, &mut Watch::default()).unwrap()
    });
    assert!(evaluation.psnr.is_some() && evaluation.left == 0);
    assert!(evaluation.unwritten.iter().any(|line| line.contains("eval.json")), "{:?}", evaluation.unwritten);
    assert_eq!(fs::read(folder.path().join("eval.json")).unwrap(), before);
}

/// Removes the run folder after a step, and puts something at its place.
struct Remover<'a> {
    folder: &'a Path,
    at: u64,
    then: fn(&Path),
    warnings: Vec<String>,
}

impl Observer for Remover<'_> {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Step(progress) if progress.step == self.at => {
                self.at = u64::MAX;
                fs::remove_dir_all(self.folder).unwrap();
                (self.then)(self.folder);
            }
            Event::Warning(line) => self.warnings.push(line.into()),
            _ => {}
        }
    }
}

#[test]
fn a_run_folder_that_is_removed_on_the_way_is_made_again_with_all_that_is_known() {
    let (whole, below) = (undisturbed(), tempfile::tempdir().unwrap());
    let folder = below.path().join("run");
    type Then = fn(&Path);
    let places: [(Then, bool); 3] = [
        (|_| {}, true),
        (|folder| fs::create_dir(folder).unwrap(), true),
        (
            |folder| {
                fs::create_dir(folder).unwrap();
                fs::write(folder.join("letter.txt"), "mine").unwrap();
            },
            false,
        ),
    ];
    for (then, is_made) in places {
        for at in [10, 20] {
            let _ = fs::remove_dir_all(&folder);
            let mut watch = Remover { folder: &folder, at, then, warnings: Vec::new() };
            let schedule = Schedule { checkpoint_every: Duration::ZERO, row_every: 0.0, ..impatient(20) };
            let ended = with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
                let mut run = Run::create(&folder, &request(), parts, &mut watch).unwrap();
                run.train(&schedule, None, &mut watch, &Default::default())?;
                run.conclude(&Default::default())
            });
            if !is_made {
                let error = ended.unwrap_err().to_string();
                assert!(error.contains("cannot write"), "{error}");
                let names: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
                assert_eq!(names, ["letter.txt"], "what is not ours is left alone");
                continue;
            }
            ended.unwrap();
            assert!(watch.warnings.iter().any(|line| line.contains("made again")), "{:?}", watch.warnings);
            assert_eq!(arrays(&folder, 20), arrays(whole.path(), 20));
            for name in ["config.toml", "heldout.txt", "eval.json", "summary.json", "report.html", "finished.json"] {
                assert!(folder.join(name).is_file(), "{name}");
            }
            assert!(engine::log::read(&folder.join("metrics.csv")).unwrap().len() >= 20);
        }
    }
}
