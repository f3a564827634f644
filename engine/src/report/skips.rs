//! What was skipped, on the page.

use super::html::{escape, grouped};
use crate::eval::Evaluation;
use crate::eval::skips::SkipSummary;
use crate::summary::Summary;
use std::fmt::Write;

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

fn skip_table(rows: &[SkipSummary]) -> String {
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
