//! `demo`: the whole job without a file.

use super::{Done, Failure, Session, render, settings, train};
use crate::cli::Demo;
use crate::show::line;
use std::fs;
use std::path::Path;
use systems::RunError;
use systems::options::{Request, RunConfig};
use systems::train::{Schedule, Stop};

pub(crate) fn run(session: &Session, args: Demo) -> Result<Done, Failure> {
    let app = session.app;
    remove_earlier_demo(&args.out, app.demo_scene)?;
    let request = Request {
        scene: Some(app.demo_scene.into()),
        system: args.system,
        set: settings(args.set, args.field, None),
        ..Request::default()
    };
    let schedule = Schedule::new(Stop::Steps(args.steps.unwrap_or(app.demo_steps)));
    let done = train::train(session, &args.out, &request, &schedule, false)?;
    if done != Done::Finished {
        return Ok(done);
    }
    let mut show = session.show();
    let run = session.open(&args.out, &mut show)?;
    render::animation(&run, args.frames, &args.out.join("animation"), &mut show)
}

/// A demo may be run again; any other run in the folder is left alone, and starting over it is refused later.
fn remove_earlier_demo(folder: &Path, scene: &str) -> Result<(), RunError> {
    let Ok(text) = fs::read_to_string(folder.join("config.toml")) else { return Ok(()) };
    if toml::from_str::<RunConfig>(&text).is_ok_and(|config| config.scene == scene) {
        line(format_args!("replacing the earlier demo in {}", folder.display()));
        let checkpoints = systems::checkpoint::folder(folder);
        if checkpoints.exists() {
            fs::remove_dir_all(&checkpoints).map_err(RunError::write(&checkpoints))?;
        }
    }
    Ok(())
}
