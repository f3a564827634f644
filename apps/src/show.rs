//! Progress and errors for people, and progress for programs.

use crate::cli::ProgressKind;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::error::Error;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};
use systems::progress::{Event, Observer};
use systems::train::Progress;

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

/// Write a line to standard output; a closed pipe is no failure of ours.
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

    /// Take the bar away, so that results start on a clean line.
    pub(crate) fn finish(&mut self) {
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

    fn say(&self, event: &str, text: &str) {
        match &self.style {
            Style::Bar(bar) => bar.suspend(|| note(text)),
            Style::Lines => note(text),
            Style::Json => json(serde_json::json!({ "event": event, "text": text })),
            Style::Off if event == "warning" => note(text),
            Style::Off => {}
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
            Event::View { done, of } => {
                if let Style::Bar(bar) = &self.style {
                    bar.set_message(format!("held-out view {done} of {of}"));
                }
            }
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
    fn a_summary_leaves_out_what_is_not_known() {
        let p = Progress { step: 3, seconds: 61.0, ..Progress::default() };
        assert_eq!(summary(&p), "step 3, 01:01");
    }
}
