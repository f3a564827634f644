//! `prepare`: photos or a video to a scene with cameras.

use super::check;
use crate::app::App;
use crate::cli::{Cli, Command, Prepare, ProgressKind};
use crate::interrupt;
use crate::session::{Done, Failure, Session, program};
use crate::show::{clock, line, note};
use ::prepare::{Event, PrepareError, Request, Summary, Toolbox, UnknownCameras, Watch};
use engine::RunError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use scene_io::{ErrorKind, SceneError};
use std::error::Error;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use systems::registry::Family;

/// Photos without a camera that are named.
const SHOWN: usize = 20;
/// Wall time between two lines of progress, where they are not redrawn.
const LINE_EVERY: Duration = Duration::from_secs(5);

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
    let mut watch = Watcher::new(session.progress)?;
    let result = ::prepare::prepare(&request, &mut watch);
    watch.finish();
    let summary = match result {
        Err(PrepareError::Stopped) => {
            line(PrepareError::Stopped);
            return Ok(Done::Interrupted);
        }
        other => other?,
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

/// Shows what a preparation does, on standard error.
struct Watcher {
    kind: ProgressKind,
    bar: Option<ProgressBar>,
    last: Option<Instant>,
    stage: String,
    stop: Arc<AtomicBool>,
}

impl Watcher {
    fn new(kind: ProgressKind) -> std::io::Result<Self> {
        let is_bar = kind == ProgressKind::Auto && std::io::stderr().is_terminal();
        let bar = is_bar.then(|| {
            let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{bar:28} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style);
            bar
        });
        let said = bar.clone();
        let stop = interrupt::listen(Box::new(move |line| say(said.as_ref(), kind, "interrupted", line)))?;
        Ok(Self { kind, bar, last: None, stage: String::new(), stop })
    }

    fn say(&self, event: &str, text: &str) {
        say(self.bar.as_ref(), self.kind, event, text);
    }

    fn part(&mut self, stage: &str, done: usize, of: usize, eta: Option<f64>) {
        let percent = 100 * done / of.max(1);
        let to_go = eta.map_or_else(String::new, |s| format!(" ({} to go)", clock(s)));
        let text = format!("{stage}: {done} of {of}, {percent} %{to_go}");
        if let Some(bar) = &self.bar {
            bar.set_position(1000 * done as u64 / of.max(1) as u64);
            bar.set_message(text);
            return;
        }
        // The end of a stage is always shown.
        let is_due = self.last.is_none_or(|last| last.elapsed() >= LINE_EVERY) || done >= of || self.stage != stage;
        if !is_due {
            return;
        }
        self.last = Some(Instant::now());
        self.stage = stage.into();
        match self.kind {
            ProgressKind::Json => {
                let json = serde_json::json!({
                    "event": "progress", "stage": stage, "done": done, "of": of, "eta_seconds": eta,
                });
                note(&json.to_string());
            }
            ProgressKind::Off => {}
            ProgressKind::Auto | ProgressKind::Lines => note(&text),
        }
    }

    fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// A line of standard error.
fn say(bar: Option<&ProgressBar>, kind: ProgressKind, event: &str, text: &str) {
    match (bar, kind) {
        (Some(bar), _) => bar.suspend(|| note(text)),
        (None, ProgressKind::Json) => note(&serde_json::json!({ "event": event, "text": text }).to_string()),
        // What asks for an action, or answers one.
        (None, ProgressKind::Off) if !["warning", "interrupted"].contains(&event) => {}
        (None, _) => note(text),
    }
}

impl Watch for Watcher {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Note(text) => self.say("note", text),
            Event::Warning(text) if self.kind == ProgressKind::Json => self.say("warning", text),
            Event::Warning(text) => self.say("warning", &format!("warning: {text}")),
            Event::Part { stage, done, of, eta_seconds } => self.part(stage, done, of, eta_seconds),
            _ => {}
        }
    }

    fn stop_asked(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
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
