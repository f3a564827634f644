//! `prepare`: photos or a video to a scene with cameras.

use super::check;
use super::watcher::watched;
use crate::app::App;
use crate::cli::{Cli, Command, Prepare};
use crate::session::{Done, Failure, Session, program};
use crate::show::{line, note};
use ::prepare::{Request, Summary, Toolbox, UnknownCameras};
use engine::RunError;
use scene_io::{ErrorKind, SceneError};
use std::error::Error;
use std::path::{Path, PathBuf};
use systems::registry::Family;

/// Photos without a camera that are named.
const SHOWN: usize = 20;

pub(crate) fn run(session: &Session, args: &Prepare, threads: Option<u16>) -> Result<Done, Failure> {
    let app = session.app;
    let request = Request {
        input: args.input.clone(),
        out: args.out.clone(),
        frames: args.frames,
        longest_side: Some(args.longest_side),
        with: args.with.map(Into::into),
        unknown_cameras: if app.family == Family::Wild { UnknownCameras::Each } else { UnknownCameras::Shared },
        threads: threads.map(usize::from),
        tools: Toolbox::from_env(),
    };
    let Some(summary) = watched(session.progress, |watch| ::prepare::prepare(&request, watch))? else {
        return Ok(Done::Interrupted);
    };
    conclude(&summary);
    line("");
    let done = check_scene(app, &args.out)?;
    if done == Done::Finished {
        line("");
        line(format_args!("next: {}", train_command(app, &args.out)));
    }
    Ok(done)
}

/// What came out.
fn conclude(summary: &Summary) {
    let Summary { tool, photos, placed, missing, points, error, cameras } = summary;
    let error = error.map_or_else(String::new, |e| format!(", mean reprojection error {e:.2} pixels"));
    line(format_args!("{tool}: {placed} of {photos} photos placed, {points} points{error}"));
    for camera in cameras.iter().take(SHOWN) {
        line(format_args!("  {camera}"));
    }
    if !missing.is_empty() {
        let more = missing.len().saturating_sub(SHOWN);
        let shown = missing[..missing.len() - more].join(", ");
        let more = if more > 0 { format!(", and {more} more") } else { String::new() };
        line(format_args!("not placed ({}): {shown}{more}", missing.len()));
    }
    for warning in summary.warnings() {
        note(&format!("warning: {warning}"));
    }
}

/// The app's own `check`, as if it were typed.
fn check_scene(app: &'static App, scene: &Path) -> Result<Done, Failure> {
    let words = [app.name.into(), "check".into(), "--".into(), scene.as_os_str().to_os_string()];
    match Cli::read(app, words)?.command {
        Command::Check(args) => check::run(app, &args),
        _ => Ok(Done::Refused),
    }
}

/// `nerf-static train SCENE --out runs/SCENE`, to be typed as it is.
fn train_command(app: &App, scene: &Path) -> String {
    let name = scene.file_name().map_or_else(|| "scene".into(), |n| n.to_string_lossy().into_owned());
    let name = name.strip_suffix("-scene").unwrap_or(&name);
    format!("{} train {} --out {}", program(app), quoted(scene), quoted(&Path::new("runs").join(name)))
}

/// What to type where an error says that photos have no cameras; `None` for other errors.
pub(crate) fn advice(app: &App, error: &(dyn Error + 'static)) -> Option<String> {
    let scene = match error.downcast_ref::<RunError>() {
        Some(RunError::Scene(scene)) => Some(scene),
        Some(_) => None,
        None => error.downcast_ref::<SceneError>(),
    };
    let scene = scene.filter(|e| e.kind() == ErrorKind::NoCameras)?;
    advice_for(app, &scene.problem().file)
}

/// What to type to get from the photos or the video at a path to a trained scene; `None` where there are none.
pub(crate) fn advice_for(app: &App, path: &Path) -> Option<String> {
    let found = scene_io::unposed(path)?;
    let input = relative(found.path());
    // `mine` of `mine/images`: that name says nothing.
    let named = if input.ends_with("images") { input.parent().unwrap_or(&input) } else { &input };
    let full = std::path::absolute(named).unwrap_or_else(|_| named.to_path_buf());
    let stem = full.file_stem().map_or_else(|| "photos".into(), |n| n.to_string_lossy().into_owned());
    let out = PathBuf::from(format!("{stem}-scene"));
    let prepare = format!("{} prepare {} --out {}", program(app), quoted(&input), quoted(&out));
    Some(format!("type: {prepare}\nthen: {}", train_command(app, &out)))
}

/// The path as seen from here, where it lies below.
fn relative(path: &Path) -> PathBuf {
    let here = std::env::current_dir().ok();
    let below = here.and_then(|here| path.strip_prefix(here).ok().map(Path::to_path_buf));
    match below {
        Some(below) if below.as_os_str().is_empty() => PathBuf::from("."),
        Some(below) => below,
        None => path.to_path_buf(),
    }
}

/// As a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    shlex::try_quote(&text).map_or_else(|_| text.clone(), |quoted| quoted.into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::STATIC;

    #[test]
    fn commands_can_be_typed_as_they_are() {
        let called = program(&STATIC);
        let train = |scene: &str| train_command(&STATIC, Path::new(scene));
        assert_eq!(train("fox-scene"), format!("{called} train fox-scene --out runs/fox"));
        assert_eq!(train("my photos-scene"), format!("{called} train 'my photos-scene' --out 'runs/my photos'"));
        assert_eq!(advice_for(&STATIC, Path::new("/nothing/there")), None);
    }
}
