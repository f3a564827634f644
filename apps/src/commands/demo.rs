//! `demo`: the whole job without a file.

use super::render;
use super::train::{next_steps, train};
use crate::cli::Demo;
use crate::session::{Done, Failure, Session, settings};
use crate::show::line;
use engine::RunError;
use engine::folder::{self, FolderLock};
use engine::options::Request;
use engine::output::{Disk, write_file};
use engine::run::Run;
use engine::train::{Schedule, Stop};
use std::fs;
use std::path::Path;

/// Marks a run folder as that of a demo, which the next demo may replace.
const MARK: &str = ".demo";

/// Pictures of the demo, in its run folder.
const ANIMATION: &str = "animation";

pub(crate) fn run(session: &Session, args: Demo) -> Result<Done, Failure> {
    let app = session.app;
    remove_earlier_demo(&args.out)?;
    let stop = Stop::Steps(args.steps.unwrap_or(app.demo_steps));
    let request = Request {
        scene: Some(app.demo_scene.into()),
        system: args.system.or_else(|| app.demo_system.map(str::to_string)),
        set: settings(args.set, args.field, None),
        stop: Some(stop),
        rehearsal: true,
        lpips: session.measures_lpips(),
        ..Request::default()
    };
    let schedule = Schedule::new(stop);
    let mut show = session.show();
    let mut run = Run::create(&args.out, &request, session.parts(), &mut show)?;
    write_file(&Disk, &args.out.join(MARK), b"")?;
    let done = train(session, &mut run, &schedule, &mut show)?;
    if done != Done::Finished {
        return Ok(done);
    }
    let done = render::animation(&run, args.frames, &args.out.join(ANIMATION), &mut show)?;
    next_steps(session, &args.out);
    Ok(done)
}

/// A demo may be run again; any other run in the folder is left alone, and starting over it is refused later.
fn remove_earlier_demo(folder: &Path) -> Result<(), RunError> {
    let mark = folder.join(MARK);
    if !mark.exists() {
        return Ok(());
    }
    // Not while it is being made.
    let _lock = FolderLock::take(folder)?;
    line(format_args!("replacing the earlier demo in {}", folder.display()));
    folder::clear(folder)?;
    let animation = folder.join(ANIMATION);
    if animation.exists() {
        fs::remove_dir_all(&animation).map_err(RunError::write(&animation))?;
    }
    fs::remove_file(&mark).map_err(RunError::write(&mark))
}
