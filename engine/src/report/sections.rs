//! The parts of the page, top to bottom.

use super::plot::{Curve, Marks, Scale, plot};
use super::{ANIMATION, escape};
use crate::eval::{Evaluation, Measured, Protocol, ViewScore};
use crate::log::Row;
use crate::memory::human;
use crate::picture::{ERROR_MAP_TOP, png_bytes};
use crate::summary::{Skip, Summary};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use plotters::style::RGBColor;
use std::fmt::Write;
use std::path::Path;

/// Views whose pictures are in the page; all are in `renders/`.
const SHOWN: usize = 6;
/// Longest side of a picture in the page, pixels.
const SHOWN_SIDE: u32 = 400;

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

/// Sections behind one line that opens them; nothing where all of them are empty.
pub(super) fn folded(title: &str, parts: &[String]) -> String {
    let body = parts.concat();
    match body.is_empty() {
        true => body,
        false => format!("<details class=\"experts\"><summary>{}</summary>\n{body}</details>\n", escape(title)),
    }
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

pub(super) fn pictures(e: &Evaluation, folder: &Path) -> String {
    let mut out = String::new();
    for view in chosen(&e.views) {
        // A name, no way out of the folder.
        let Some(stem) = view.files.as_ref().filter(|stem| !stem.contains(['/', '\\'])) else { continue };
        let figures: String = [("", "render"), ("_truth", "truth"), ("_error", "error"), ("_depth", "depth")]
            .iter()
            .filter_map(|(suffix, caption)| {
                let path = folder.join("renders").join(format!("{stem}{suffix}.png"));
                figure(&path, caption, &format!("{caption} of {}", view.name))
            })
            .collect();
        if !figures.is_empty() {
            let scores = format!("{} · SSIM {}", number(view.psnr, 2, " dB"), number(view.ssim, 4, ""));
            let name = escape(&view.name);
            let _ = writeln!(
                out,
                "<div class=\"panel view\"><h3>{name}<span>{scores}</span></h3><div class=\"strip\">{figures}</div></div>"
            );
        }
    }
    if out.is_empty() {
        return out;
    }
    let top = (ERROR_MAP_TOP * 100.0).round();
    format!(
        "<h2>Held-out views</h2>\n<p class=\"soft\">From the worst to the best by PSNR; all are in <code>renders/</code>. \
         Error maps: mean absolute colour error, black 0, brightest {top}&nbsp;% and above. Depth: near bright, far dark.</p>\n\
         <br>\n{out}"
    )
}

/// At most [`SHOWN`] views, evenly spread from the worst PSNR to the best.
fn chosen(views: &[ViewScore]) -> Vec<&ViewScore> {
    let mut sorted: Vec<&ViewScore> = views.iter().collect();
    sorted.sort_by(|a, b| a.psnr.unwrap_or(f64::MAX).total_cmp(&b.psnr.unwrap_or(f64::MAX)));
    if sorted.len() <= SHOWN {
        return sorted;
    }
    (0..SHOWN).map(|i| sorted[i * (sorted.len() - 1) / (SHOWN - 1)]).collect()
}

/// A picture of the run with a line below it; `None` when it is missing or broken.
pub(super) fn figure(path: &Path, caption: &str, alt: &str) -> Option<String> {
    let (data, caption, alt) = (embedded(path)?, escape(caption), escape(alt));
    Some(format!(
        "<figure><img alt=\"{alt}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
    ))
}

/// A PNG of the run as base64, scaled down to [`SHOWN_SIDE`]; `None` when it is missing or broken.
fn embedded(path: &Path) -> Option<String> {
    let picture = scene_io::decode_photo(path).ok()?;
    let picture = match picture.width().max(picture.height()) > SHOWN_SIDE {
        true => picture.resize(SHOWN_SIDE, SHOWN_SIDE, image::imageops::FilterType::Triangle),
        false => picture,
    };
    Some(STANDARD.encode(png_bytes(&picture.into_rgb8())))
}

pub(super) fn scores(e: &Evaluation) -> String {
    let mut out = String::from(
        "<h2>Scores</h2>\n<div class=\"panel\"><table>\n<tr><th>view</th><th class=\"n\">PSNR, dB</th><th class=\"n\">SSIM</th>\
         <th class=\"n\">MS-SSIM</th><th class=\"n\">LPIPS</th><th class=\"n\">render, s</th></tr>\n",
    );
    let mut row = |class: &str, name: &str, scores: [Option<f64>; 4], seconds: f64| {
        let [psnr, ssim, ms_ssim, lpips] = scores;
        let cells: String = [number(psnr, 3, ""), number(ssim, 4, ""), number(ms_ssim, 4, ""), number(lpips, 4, "")]
            .iter()
            .map(|c| format!("<td class=\"n\">{c}</td>"))
            .collect();
        let _ = writeln!(out, "<tr{class}><td>{}</td>{cells}<td class=\"n\">{seconds:.2}</td></tr>", escape(name));
    };
    for v in &e.views {
        row("", &v.name, [v.psnr, v.ssim, v.ms_ssim, v.lpips], v.render_seconds);
    }
    let mean_seconds = e.views.iter().map(|v| v.render_seconds).sum::<f64>() / e.views.len().max(1) as f64;
    row(" class=\"mean\"", "mean", [e.psnr, e.ssim, e.ms_ssim, e.lpips], mean_seconds);
    out += "</table></div>\n";
    if let Some(db) = e.psnr_object {
        let _ = writeln!(out, "<p class=\"soft\">PSNR inside the masks of the object: {db:.3} dB.</p>");
    }
    if let Some(line) = e.fog_line() {
        let _ = writeln!(out, "<p class=\"soft\">{}.</p>", escape(&line));
    }
    for line in e.motion.words() {
        let _ = writeln!(out, "<p class=\"soft\">{}.</p>", escape(&line));
    }
    if e.protocol != Protocol::default() {
        let _ = writeln!(out, "<p class=\"soft\">Protocol: {}.</p>", escape(&e.protocol.to_string()));
    }
    if !e.notes.is_empty() {
        let _ = writeln!(out, "<br><div class=\"panel\">{}</div>", list(&e.notes));
    }
    out
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

pub(super) fn skips(s: &Summary, evaluation: Option<&Evaluation>) -> String {
    let mut out = String::new();
    if let Some(measured) = evaluation.and_then(|e| e.skips.as_ref()) {
        let _ = write!(
            out,
            "<p class=\"soft\">Measured on {}. Errors are against the full sum. Each skip saves what it saves alone; together they \
             save less than the sum.</p>\n<div class=\"panel\">{}</div>\n",
            escape(&measured.heading()),
            skip_table(&measured.rows)
        );
    }
    if !s.skips.is_empty() {
        let _ = write!(
            out,
            "<p class=\"soft\">Counted over the whole run:</p>\n<div class=\"panel\">{}</div>\n",
            skip_table(&s.skips)
        );
    }
    if out.is_empty() { out } else { format!("<h2>What was skipped</h2>\n{out}") }
}

fn skip_table(rows: &[Skip]) -> String {
    let mut out = String::from(
        "<table>\n<tr><th>what</th><th class=\"n\">skipped</th><th class=\"n\">of</th><th>unit</th><th class=\"n\">share</th>\
         <th class=\"n\">saved, s</th><th>bound on a pixel's error</th><th class=\"n\">largest error</th><th class=\"n\">mean</th></tr>\n",
    );
    for row in rows {
        let share = 100.0 * row.skipped as f64 / row.total.max(1) as f64;
        let error = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.1e}"));
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td><td class=\"n\">{share:.1} %</td>\
             <td class=\"n\">{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            escape(&row.what),
            grouped(row.skipped),
            grouped(row.total),
            escape(&row.unit),
            row.seconds_saved.map_or_else(|| "-".into(), |s| format!("{s:.2}")),
            escape(&row.bound),
            error(row.error.map(|e| e[0])),
            error(row.error.map(|e| e[1]))
        );
    }
    out + "</table>"
}

pub(super) fn held_out(s: &Summary, evaluation: Option<&Evaluation>) -> String {
    let names = &s.scene.held_out;
    if names.is_empty() {
        return "<h2>Held-out views</h2>\n<p class=\"soft\">None: nothing was measured.</p>\n".into();
    }
    let (title, file) = match evaluation.map(|e| e.split) {
        Some(Measured::Validation) => ("Names of the validation views", "validation.txt"),
        _ => ("Held-out names", "heldout.txt"),
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

fn list(lines: &[String]) -> String {
    let items: String = lines.iter().map(|l| format!("<li>{}</li>\n", escape(l))).collect();
    format!("<ul>\n{items}</ul>\n")
}

pub(super) fn number(x: Option<f64>, digits: usize, unit: &str) -> String {
    // What is not measured and what is not a number are both said in words.
    x.filter(|x| !x.is_nan()).map_or_else(|| "n/a".into(), |x| format!("{x:.digits$}{unit}"))
}

/// `1234567` as `1 234 567`, with narrow spaces at which no line breaks.
fn grouped(x: u64) -> String {
    let digits = x.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(name: &str, psnr: f64) -> ViewScore {
        let name = name.to_string();
        ViewScore {
            name,
            psnr: Some(psnr),
            psnr_object: None,
            motion: crate::eval::MotionScore::default(),
            fog: None,
            ssim: None,
            ms_ssim: None,
            lpips: None,
            flip: None,
            render_seconds: 0.0,
            files: None,
        }
    }

    #[test]
    fn shown_views_include_the_worst_and_the_best() {
        let views: Vec<_> = (0..20).map(|i| score("v", f64::from((i * 7) % 20))).collect();
        let shown = chosen(&views);
        assert_eq!(shown.len(), SHOWN);
        assert_eq!((shown[0].psnr, shown[SHOWN - 1].psnr), (Some(0.0), Some(19.0)));
        assert_eq!(chosen(&views[..2]).len(), 2);
        assert!(chosen(&[]).is_empty());
    }

    #[test]
    fn expert_tables_are_folded_and_numbers_are_whole() {
        assert_eq!(folded("more", &[String::new(), String::new()]), "");
        let page = folded("more", &["<p>a</p>".into()]);
        assert!(page.starts_with("<details") && page.contains("<p>a</p>") && !page.contains("open"), "{page}");
        assert_eq!(number(Some(f64::NAN), 2, " dB"), "n/a");
        assert_eq!(number(Some(12.5), 2, " dB"), "12.50 dB");
    }

    #[test]
    fn the_animation_is_in_the_page_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(animation(folder.path()), "");
        std::fs::write(folder.path().join(ANIMATION), b"GIF89a").unwrap();
        assert!(animation(folder.path()).contains("data:image/gif;base64,R0lGODlh"));
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(list(&["<b>&".into()]), "<ul>\n<li>&lt;b&gt;&amp;</li>\n</ul>\n");
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
    }
}
