//! What goes wrong after the last step: stops, folders that go away, files that somebody deleted.

use crate::common::{Watch, request, sky_scene, with_parts};
use systems::eval::masks::{self, MaskTable};
use systems::options::Request;
use systems::output::Disk;
use systems::progress::{Event, Observer};
use systems::run::Run;
use systems::train::{Reason, Schedule, Stop};

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
    let shown = || MaskTable::read(&folder.path().join(masks::FOLDER)).unwrap().unwrap().views.len();
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
