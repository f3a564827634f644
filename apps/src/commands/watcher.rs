//! Progress of work that the crate `prepare` does.

use crate::cli::ProgressKind;
use crate::interrupt;
use crate::session::Failure;
use crate::show::{clock, line, note};
use ::prepare::{Event, PrepareError, Watch};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Wall time between two lines of progress, where they are not redrawn.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// What `work` makes while its progress is shown; `None` where it was stopped, which is said.
pub(super) fn watched<T>(
    kind: ProgressKind,
    work: impl FnOnce(&mut Watcher) -> Result<T, PrepareError>,
) -> Result<Option<T>, Failure> {
    let mut watch = Watcher::new(kind)?;
    let result = work(&mut watch);
    watch.finish();
    match result {
        Err(PrepareError::Stopped) => {
            line(PrepareError::Stopped);
            Ok(None)
        }
        other => Ok(Some(other?)),
    }
}

/// Shows what a preparation does, on standard error, and hears a wish to stop.
pub(super) struct Watcher {
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
