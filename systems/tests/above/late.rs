//! What goes wrong after the last step: interrupts, removed folders, deleted files.

use crate::common::{Watch, request, sky_scene, start, with_parts};
use engine::eval::masks::MaskTable;
use engine::folder::MASKS;
use engine::options::Request;
use engine::output::{Disk, Storage, StorageFile};
use engine::progress::{Event, Observer};
use engine::run::Run;
use engine::train::{Reason, Schedule, Stop};
use std::path::Path;
use std::time::Duration;
use std::{fs, io};

/// Asks to stop once a part of some work is done.
struct Stopper {
    what: &'static str,
    asks: bool,
}

impl Observer for Stopper {
    fn event(&mut self, event: Event<'_>) {
        self.asks |= matches!(event, Event::Part(part) if part.what == self.what && part.done == 1);
    }

    fn stop_asked(&self) -> bool {
        self.asks
    }
}

#[test]
fn masks_that_a_stop_cut_short_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let schedule = Schedule::new(Stop::Steps(3));
    let shown = || MaskTable::read(&folder.path().join(MASKS)).unwrap().unwrap().views.len();
    with_parts(&Disk, &sky_scene(8, 16, true), |parts| {
        let mut stopper = Stopper { what: "mask", asks: false };
        let mut run = Run::create(folder.path(), &request(), parts, &mut stopper).unwrap();
        let (ended, _) = run.train(&schedule, None, &mut stopper, &Default::default()).unwrap();
        assert_eq!((ended.reason, shown()), (Reason::Interrupted, 1));
        drop(run);
        let watch = &mut Watch::default();
        let mut run = Run::open_to_write(folder.path(), &Request::default(), parts, watch).unwrap();
        let (ended, _) = run.train(&schedule, None, watch, &Default::default()).unwrap();
        assert_eq!((ended.reason, shown()), (Reason::Finished, 6));
    });
}

/// Replaces the run folder by a folder with other files once a held-out view is measured.
struct Replacer<'a> {
    folder: &'a Path,
    is_done: bool,
}

impl Observer for Replacer<'_> {
    fn event(&mut self, event: Event<'_>) {
        if matches!(event, Event::Part(part) if part.what == "held-out view") && !self.is_done {
            self.is_done = true;
            fs::remove_dir_all(self.folder).unwrap();
            fs::create_dir(self.folder).unwrap();
            fs::write(self.folder.join("letter.txt"), "mine").unwrap();
        }
    }
}

#[test]
fn scores_are_said_where_the_folder_is_replaced_while_they_are_measured() {
    let below = tempfile::tempdir().unwrap();
    let folder = below.path().join("run");
    let schedule = Schedule { disk_wait: Duration::ZERO, ..Schedule::new(Stop::Steps(3)) };
    let evaluation = with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let mut replacer = Replacer { folder: &folder, is_done: false };
        let mut run = Run::create(&folder, &request(), parts, &mut replacer).unwrap();
        run.train(&schedule, None, &mut replacer, &Default::default()).unwrap().1.unwrap()
    });
    assert!(evaluation.psnr.is_some() && !evaluation.unwritten.is_empty(), "{:?}", evaluation.unwritten);
    let there: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(there, ["letter.txt"], "nothing of the run's comes among the files of others");
}

#[test]
fn first_files_that_were_removed_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["config.toml", "heldout.txt"];
    let texts = || names.map(|name| fs::read_to_string(folder.path().join(name)).unwrap());
    let schedule = Schedule::new(Stop::Steps(3));
    let watch = &mut Watch::default();
    with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, watch).unwrap();
        run.train(&schedule, None, watch, &Default::default()).unwrap();
        run.conclude(&Default::default()).unwrap();
        drop(run);
        let before = texts();
        names.iter().for_each(|name| fs::remove_file(folder.path().join(name)).unwrap());
        let mut run = Run::open_to_write(folder.path(), &Request::default(), parts, watch).unwrap();
        assert!(!run.is_finished(schedule.stop));
        run.train(&schedule, None, watch, &Default::default()).unwrap();
        run.conclude(&Default::default()).unwrap();
        assert!(run.is_finished(schedule.stop) && texts() == before);
    });
}

/// Takes nothing.
struct Full;

impl Storage for Full {
    fn create(&self, _: &Path) -> io::Result<Box<dyn StorageFile>> {
        Err(io::ErrorKind::StorageFull.into())
    }
}

#[test]
fn scores_at_all_scales_are_said_where_nothing_can_be_written() {
    let folder = tempfile::tempdir().unwrap();
    start(folder.path(), &Disk, Stop::Steps(3), &mut Watch::default()).unwrap();
    // A lock that cannot be taken.
    fs::remove_file(folder.path().join(".lock")).unwrap();
    fs::create_dir(folder.path().join(".lock")).unwrap();
    let table = with_parts(&Full, &sky_scene(8, 16, false), |parts| {
        let run = Run::open(folder.path(), &Request::default(), parts, &mut Watch::default()).unwrap();
        run.evaluate_scales(2, &mut Watch::default()).unwrap()
    });
    assert!(table.scales.len() == 2 && table.scales.iter().all(|scale| scale.psnr.is_some()));
    assert!(table.unwritten.iter().any(|line| line.contains("eval_scales.json")), "{:?}", table.unwritten);
}

#[test]
fn a_stop_after_the_scores_are_written_is_one_of_the_rest_alone() {
    let folder = tempfile::tempdir().unwrap();
    with_parts(&Disk, &sky_scene(8, 16, true), |parts| {
        let mut run = Run::create(folder.path(), &request(), parts, &mut Watch::default()).unwrap();
        let schedule = Schedule::new(Stop::Steps(3));
        run.train(&schedule, None, &mut Watch::default(), &Default::default()).unwrap();
        run.conclude(&Default::default()).unwrap();
        for (what, written) in [("held-out view", false), ("mask", true)] {
            fs::remove_file(folder.path().join("masks/masks.json")).unwrap();
            let mut stopper = Stopper { what, asks: false };
            let evaluation = run.evaluate(None, &mut stopper).unwrap();
            assert_eq!((evaluation.stopped, evaluation.written), (true, written), "{what}");
            let evaluation = run.evaluate(None, &mut Watch::default()).unwrap();
            assert_eq!((evaluation.stopped, evaluation.written), (false, true), "{what}");
        }
    });
}
