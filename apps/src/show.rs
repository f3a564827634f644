//! Progress and errors for people, and progress for programs.

use crate::cli::ProgressKind;
use crate::interrupt;
use engine::halt::Halt;
use engine::progress::Progress;
use engine::progress::{Event, Observer, Part};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::error::Error;
use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// One line for the person, causes below.
pub(crate) fn error(error: &dyn Error) {
    let mut lines = vec![one_line(&error.to_string())];
    let mut source = error.source();
    while let Some(cause) = source {
        let text = one_line(&cause.to_string());
        // Some errors already say what their cause says.
        if !lines.last().is_some_and(|line| line.contains(&text)) {
            lines.push(text);
        }
        source = cause.source();
    }
    let mut out = std::io::stderr().lock();
    // Nobody is left to tell when standard error is closed.
    let _ = writeln!(out, "error: {}", lines[0]);
    for cause in &lines[1..] {
        let _ = writeln!(out, "  caused by: {cause}");
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Write a line to standard output; a closed pipe is not a failure of ours.
pub(crate) fn line(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// Seconds of wall time between two lines.
const LINE_EVERY: Duration = Duration::from_secs(10);
const JSON_EVERY: Duration = Duration::from_secs(1);
const REDRAW_EVERY: Duration = Duration::from_millis(200);

/// Shows what a run does, on standard error.
pub(crate) struct Show {
    style: Style,
    /// When something was last shown.
    last: Option<Instant>,
    /// The last step that was shown.
    step: u64,
}

#[derive(Clone)]
enum Style {
    Bar(ProgressBar),
    Lines,
    Json,
    Off,
}

impl Show {
    pub(crate) fn new(kind: ProgressKind) -> Self {
        let style = match kind {
            ProgressKind::Auto if std::io::stderr().is_terminal() => {
                let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
                bar.set_style(
                    ProgressStyle::with_template("{bar:28} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar()),
                );
                Style::Bar(bar)
            }
            ProgressKind::Auto | ProgressKind::Lines => Style::Lines,
            ProgressKind::Json => Style::Json,
            ProgressKind::Off => Style::Off,
        };
        Self { style, last: None, step: 0 }
    }

    /// From now on Ctrl-C ends the program at once, with a line: nothing has begun that could be lost.
    ///
    /// # Errors
    /// Where signals cannot be listened to.
    pub(crate) fn begin(&self) -> std::io::Result<()> {
        let said = self.style.clone();
        interrupt::begin(Box::new(move |line| said.say("interrupted", line)))
    }

    /// From now on a first Ctrl-C asks to stop, and is answered at once.
    ///
    /// # Errors
    /// Where signals cannot be listened to.
    pub(crate) fn listen(&self) -> std::io::Result<Arc<AtomicBool>> {
        let said = self.style.clone();
        interrupt::listen(Box::new(move |line| said.say("interrupted", line)))
    }

    /// Take the bar away, so that results start on a clean line. The next part of some work brings it back.
    pub(crate) fn finish(&mut self) {
        interrupt::answered();
        if let Style::Bar(bar) = &self.style {
            bar.finish_and_clear();
        }
    }

    fn due(&mut self, every: Duration, always: bool) -> bool {
        let due = always || self.last.is_none_or(|last| last.elapsed() >= every);
        if due {
            self.last = Some(Instant::now());
        }
        due
    }

    fn step(&mut self, progress: &Progress) {
        // The last step is always shown, and shown once.
        let end = progress.done >= 1.0 && progress.step != self.step;
        match &self.style {
            Style::Bar(_) => {
                if self.due(REDRAW_EVERY, end) {
                    let Style::Bar(bar) = &self.style else { return };
                    bar.set_position((progress.done * 1000.0) as u64);
                    bar.set_message(summary(progress));
                }
            }
            Style::Lines => {
                if self.due(LINE_EVERY, end) {
                    self.step = progress.step;
                    note(&summary(progress));
                }
            }
            Style::Json => {
                if self.due(JSON_EVERY, end) {
                    self.step = progress.step;
                    json(serde_json::json!({
                        "event": "progress", "step": progress.step, "seconds": progress.seconds, "done": progress.done,
                        "eta_seconds": progress.eta_seconds, "loss": progress.loss, "psnr_train": progress.psnr_train,
                        "psnr_test": progress.psnr_test, "rays_per_s": progress.rays_per_s,
                        "samples_per_s": progress.samples_per_s, "memory_mb": progress.memory_mb,
                    }));
                }
            }
            Style::Off => {}
        }
    }

    /// Part of a piece of work was done.
    fn part(&mut self, part: &Part<'_>) {
        let end = part.done == part.of;
        match &self.style {
            Style::Bar(_) => {
                if self.due(REDRAW_EVERY, end) {
                    let Style::Bar(bar) = &self.style else { return };
                    if bar.is_finished() {
                        bar.reset();
                    }
                    bar.set_position((part.done as f64 / part.of.max(1) as f64 * 1000.0) as u64);
                    bar.set_message(part_summary(part));
                }
            }
            // What comes of it is said in the next line.
            Style::Lines => {
                if !end && self.due(LINE_EVERY, false) {
                    note(&part_summary(part));
                }
            }
            Style::Json => {
                if self.due(JSON_EVERY, end) {
                    json(serde_json::json!({
                        "event": "part", "what": part.what, "done": part.done, "of": part.of, "seconds": part.seconds,
                        "eta_seconds": part.eta_seconds,
                    }));
                }
            }
            Style::Off => {}
        }
    }

    fn say(&self, event: &str, text: &str) {
        self.style.say(event, text);
    }
}

impl Style {
    fn say(&self, event: &str, text: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| note(text)),
            Self::Lines => note(text),
            Self::Json => json(serde_json::json!({ "event": event, "text": text })),
            // What asks for an action, or answers one.
            Self::Off if ["warning", "interrupted"].contains(&event) => note(text),
            Self::Off => {}
        }
    }
}

impl Observer for Show {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Note(text) => self.say("note", text),
            Event::Warning(text) => match &self.style {
                Style::Json => self.say("warning", text),
                _ => self.say("warning", &format!("warning: {text}")),
            },
            Event::Step(progress) => self.step(progress),
            Event::Part(part) => self.part(&part),
            Event::Evaluated { step, seconds, psnr } => {
                if let Style::Json = self.style {
                    json(serde_json::json!({ "event": "evaluated", "step": step, "seconds": seconds, "psnr": psnr }));
                } else {
                    let psnr = psnr.map_or_else(|| "n/a".into(), |p| format!("{p:.2} dB"));
                    self.say("evaluated", &format!("step {step}, {seconds:.0} s: held-out PSNR {psnr}"));
                }
            }
            Event::Saved { step, path } => {
                if let Style::Json = self.style {
                    json(serde_json::json!({ "event": "saved", "step": step, "path": path }));
                }
            }
            _ => {}
        }
    }

    fn halt(&self) -> Halt {
        interrupt::raised().map_or(Halt::NEVER, Halt::on)
    }

    fn stop_asked(&self) -> bool {
        interrupt::answered()
    }
}

/// `frame 12 of 60 (01:10 to go)`.
fn part_summary(part: &Part<'_>) -> String {
    let to_go = part.eta_seconds.map_or_else(String::new, |s| format!(" ({} to go)", clock(s)));
    format!("{} {} of {}{to_go}", part.what, part.done, part.of)
}

/// `step 1200, 00:34 (00:26 to go), train 27.31 dB, held out 26.90 dB, 310k rays/s, 4.1M samples/s, 512 MB`.
fn summary(p: &Progress) -> String {
    let mut parts = vec![format!("step {}", p.step)];
    let to_go = p.eta_seconds.map_or_else(String::new, |s| format!(" ({} to go)", clock(s)));
    parts.push(format!("{}{to_go}", clock(p.seconds)));
    parts.extend(p.psnr_train.map(|x| format!("train {x:.2} dB")));
    parts.extend(p.psnr_test.map(|x| format!("held out {x:.2} dB")));
    parts.extend(p.rays_per_s.map(|x| format!("{} rays/s", short(x))));
    parts.extend(p.samples_per_s.map(|x| format!("{} samples/s", short(x))));
    parts.extend(p.memory_mb.map(|x| format!("{x:.0} MB")));
    parts.join(", ")
}

pub(crate) fn clock(seconds: f64) -> String {
    let s = seconds.round().max(0.0) as u64;
    match s {
        0..3600 => format!("{:02}:{:02}", s / 60, s % 60),
        _ => format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60),
    }
}

fn short(x: f64) -> String {
    match x {
        x if x >= 1e6 => format!("{:.1}M", x / 1e6),
        x if x >= 1e3 => format!("{:.0}k", x / 1e3),
        x => format!("{x:.0}"),
    }
}

/// Write a line to standard error.
pub(crate) fn note(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

fn json(value: serde_json::Value) {
    note(&value.to_string());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_rates_are_short() {
        assert_eq!([0.0, 59.6, 3599.0, 3661.0].map(clock), ["00:00", "01:00", "59:59", "1:01:01"]);
        assert_eq!([12.0, 3_400.0, 2_300_000.0].map(short), ["12", "3k", "2.3M"]);
    }

    #[test]
    fn parts_are_counted_with_the_time_to_go() {
        let part = Part { what: "frame", done: 12, of: 60, seconds: 17.5, eta_seconds: Some(70.0) };
        assert_eq!(part_summary(&part), "frame 12 of 60 (01:10 to go)");
        assert_eq!(part_summary(&Part { eta_seconds: None, done: 0, ..part }), "frame 0 of 60");
    }

    #[test]
    fn a_summary_leaves_out_what_is_not_known() {
        let p = Progress { step: 3, seconds: 61.0, ..Progress::default() };
        assert_eq!(summary(&p), "step 3, 01:01");
    }
}
