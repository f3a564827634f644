//! The held-out views on the page: pictures and scores.

use super::html::{escape, figure, list, number};
use crate::eval::{Evaluation, Protocol, ViewScore};
use crate::folder::RENDERS;
use crate::picture::ERROR_MAP_TOP;
use std::fmt::Write;
use std::path::Path;

/// Views whose pictures are in the page; all are in `renders/`.
const SHOWN: usize = 6;

pub(super) fn pictures(e: &Evaluation, folder: &Path) -> String {
    let mut out = String::new();
    for view in chosen(&e.views) {
        // A name, no way out of the folder.
        let Some(stem) = view.files.as_ref().filter(|stem| !stem.contains(['/', '\\'])) else { continue };
        let figures: String = [("", "render"), ("_truth", "truth"), ("_error", "error"), ("_depth", "depth")]
            .iter()
            .filter_map(|(suffix, caption)| {
                let path = folder.join(RENDERS).join(format!("{stem}{suffix}.png"));
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
}
