//! The parts of the page, top to bottom.

use super::html::{escape, grouped, list, number};
use super::plot::{Curve, Marks, Scale, plot};
use crate::eval::{Evaluation, Measured};
use crate::folder::{ANIMATION, HELD_OUT, VALIDATION};
use crate::log::Row;
use crate::memory::human;
use crate::summary::Summary;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use plotters::style::RGBColor;
use std::fmt::Write;
use std::path::Path;

const BLUE: RGBColor = RGBColor(37, 99, 235);
const ORANGE: RGBColor = RGBColor(234, 88, 12);

pub(super) fn heading(s: &Summary) -> String {
    let sizes = match s.scene.sizes {
        Some([a, b]) if a == b => format!(" at {}×{}", a[0], a[1]),
        Some([a, b]) => format!(" at {}×{} to {}×{}", a[0], a[1], b[0], b[1]),
        None => String::new(),
    };
    let resumed = s.resumed_at.map_or_else(String::new, |step| format!(", resumed at step {}", grouped(step)));
    format!(
        "<h1>{}</h1>\n<p class=\"lead\">{} ({}) · {} training views{sizes} · {} held out{resumed}</p>\n",
        escape(&s.scene.name),
        escape(&s.system),
        escape(&s.scene.format),
        s.scene.train_views,
        s.scene.held_out.len()
    )
}

pub(super) fn cards(s: &Summary, evaluation: Option<&Evaluation>) -> String {
    let mut cards = Vec::new();
    if let Some(e) = evaluation {
        let which = if e.split == Measured::Validation { "PSNR, validation views" } else { "PSNR, held out" };
        cards.push((number(e.psnr, 2, " dB"), which));
        cards.push((number(e.ssim, 4, ""), "SSIM"));
        cards.push((number(e.lpips, 4, ""), "LPIPS"));
        if e.flip.is_some() {
            cards.push((number(e.flip, 4, ""), "FLIP"));
        }
    }
    cards.push((format!("{:.1} s", s.seconds), "training time"));
    cards.push((grouped(s.steps), "steps"));
    cards.push((grouped(s.parameters), "parameters"));
    if let Some(peak) = s.memory.peak {
        cards.push((human(peak), "peak memory"));
    }
    let cards: String =
        cards.iter().map(|(b, l)| format!("<div class=\"card\"><b>{b}</b><span>{l}</span></div>\n")).collect();
    format!("<div class=\"cards\">\n{cards}</div>\n")
}

/// The animation as it is in the run folder; nothing where there is none.
pub(super) fn animation(folder: &Path) -> String {
    let Ok(bytes) = std::fs::read(folder.join(ANIMATION)) else { return String::new() };
    format!(
        "<figure class=\"animation\"><img alt=\"a way along the cameras of the photos\" src=\"data:image/gif;base64,{}\">\
         <figcaption>Along the cameras of the photos. In full size: <code>render</code>; to look around: <code>view</code>.\
         </figcaption></figure>\n",
        STANDARD.encode(bytes)
    )
}

pub(super) fn curves(rows: &[Row]) -> String {
    let curve = |name, colour, marks, value: fn(&Row) -> Option<f64>| Curve {
        name,
        colour,
        marks,
        points: rows.iter().filter_map(|r| Some((r.seconds, value(r)?))).collect(),
    };
    let plots = [
        plot(
            "PSNR",
            "dB",
            Scale::Linear,
            &[
                curve("training rays", BLUE, Marks::Line, |r| r.psnr_train),
                curve("held-out views", ORANGE, Marks::Dots, |r| r.psnr_test),
            ],
        ),
        plot("Loss", "log scale", Scale::Log, &[curve("loss", BLUE, Marks::Line, |r| r.loss)]),
        plot("Rays", "per second", Scale::Linear, &[curve("rays", BLUE, Marks::Line, |r| r.rays_per_s)]),
        plot("Samples", "per second", Scale::Linear, &[curve("samples", BLUE, Marks::Line, |r| r.samples_per_s)]),
    ];
    let plots: String = plots.into_iter().flatten().map(|svg| format!("<div class=\"panel\">{svg}</div>\n")).collect();
    if plots.is_empty() { plots } else { format!("<h2>Curves</h2>\n<div class=\"plots\">\n{plots}</div>\n") }
}

pub(super) fn plan(s: &Summary) -> String {
    if s.plan.is_empty() && s.scene.notes.is_empty() {
        return String::new();
    }
    let mut out = String::from("<h2>What was decided, and why</h2>\n<div class=\"panel\">\n");
    out += &list(&s.plan);
    if !s.scene.notes.is_empty() {
        let _ = write!(out, "<p class=\"soft\">From the dataset:</p>{}", list(&s.scene.notes));
    }
    out + "</div>\n"
}

pub(super) fn costs(s: &Summary) -> String {
    let total: f64 = s.timings.iter().map(|(_, t)| t).sum();
    let mut out = String::from("<h2>Time and memory</h2>\n<div class=\"two\">\n");
    if total > 0.0 {
        out += "<div class=\"panel\"><table>\n<tr><th>part</th><th class=\"n\">seconds</th><th class=\"n\">share</th><th></th></tr>\n";
        let mut timings: Vec<_> = s.timings.iter().collect();
        timings.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (name, seconds) in timings {
            let share = 100.0 * seconds / total;
            let _ = writeln!(
                out,
                "<tr><td>{}</td><td class=\"n\">{seconds:.2}</td><td class=\"n\">{share:.1} %</td><td class=\"bar\" \
                 style=\"--w:{share:.1}%\"></td></tr>",
                escape(name)
            );
        }
        out += "</table></div>\n";
    }
    let mut rows = vec![
        ("decoded images, expected".to_string(), human(s.memory.images)),
        ("parameters, moments, gradients, scratch".to_string(), human(s.memory.system)),
    ];
    if s.memory.expected > 0 {
        rows.push(("whole process, expected at most".to_string(), human(s.memory.expected)));
    }
    rows.extend(s.memory.peak.map(|p| ("whole process, peak".to_string(), human(p))));
    rows.push(("threads".into(), s.machine.threads.to_string()));
    rows.extend(s.machine.cpu.clone().map(|cpu| ("processor".to_string(), cpu)));
    let rows: String = rows
        .iter()
        .map(|(k, v)| format!("<tr><td>{}</td><td class=\"n\">{}</td></tr>\n", escape(k), escape(v)))
        .collect();
    out + &format!("<div class=\"panel\"><table>\n{rows}</table></div>\n</div>\n")
}

pub(super) fn held_out(s: &Summary, evaluation: Option<&Evaluation>) -> String {
    let names = &s.scene.held_out;
    if names.is_empty() {
        return "<h2>Held-out views</h2>\n<p class=\"soft\">None: nothing was measured.</p>\n".into();
    }
    let (title, file) = match evaluation.map(|e| e.split) {
        Some(Measured::Validation) => ("Names of the validation views", VALIDATION),
        _ => ("Held-out names", HELD_OUT),
    };
    format!(
        "<h2>{title}</h2>\n<div class=\"panel\"><details><summary>{} views, also in <code>{file}</code></summary>\
         <pre>{}</pre></details></div>\n",
        names.len(),
        escape(&names.join("\n"))
    )
}

pub(super) fn config(text: &str) -> String {
    match text.is_empty() {
        true => String::new(),
        false => format!(
            "<h2>Configuration</h2>\n<div class=\"panel\"><details><summary><code>config.toml</code></summary><pre>{}</pre>\
             </details></div>\n",
            escape(text)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_animation_is_in_the_page_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(animation(folder.path()), "");
        std::fs::write(folder.path().join(ANIMATION), b"GIF89a").unwrap();
        assert!(animation(folder.path()).contains("data:image/gif;base64,R0lGODlh"));
    }
}
