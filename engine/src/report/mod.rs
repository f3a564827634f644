//! `report.html`: one self-contained page about a run, made from the files of its folder.

mod html;
mod plot;
mod sections;
mod skips;
mod views;
mod wild;

use crate::error::RunError;
use crate::eval::Evaluation;
use crate::eval::masks::MaskTable;
use crate::folder::{CONFIG, EVAL, MASKS, METRICS, REPORT};
use crate::log;
use crate::output::{Storage, write_file};
use crate::summary::Summary;
use std::fs;
use std::path::Path;

pub use wild::AppearanceRow;

/// What the page is made of.
struct Sources {
    summary: Summary,
    rows: Vec<log::Row>,
    evaluation: Option<Evaluation>,
    config: String,
    appearance: Option<AppearanceRow>,
    masks: Option<MaskTable>,
}

/// Write the report of the run in `folder` from `summary.json`, `metrics.csv`, `eval.json`, `config.toml`, `renders/`,
/// `appearance/`, `masks/` and `animation.gif`.
/// Files that are missing leave their section out; `summary.json` must be there.
///
/// # Errors
/// [`RunError::Read`], [`RunError::Content`], [`RunError::Write`].
pub fn write(storage: &dyn Storage, folder: &Path) -> Result<(), RunError> {
    let metrics = folder.join(METRICS);
    let eval = folder.join(EVAL);
    let sources = Sources {
        summary: Summary::read(folder)?,
        rows: if metrics.exists() { log::read(&metrics)? } else { Vec::new() },
        evaluation: match fs::read_to_string(&eval) {
            Ok(text) => Some(
                serde_json::from_str(&text)
                    .map_err(|e| RunError::Content { path: eval, problem: format!("{e}: run `eval` again") })?,
            ),
            Err(_) => None,
        },
        config: fs::read_to_string(folder.join(CONFIG)).unwrap_or_default(),
        appearance: AppearanceRow::read(folder)?,
        masks: MaskTable::read(&folder.join(MASKS))?,
    };
    write_file(storage, &folder.join(REPORT), page(&sources, folder).as_bytes())
}

fn page(sources: &Sources, folder: &Path) -> String {
    let s = &sources.summary;
    let title = html::escape(&format!("{} · {}", s.scene.name, s.system));
    let body = [
        sections::heading(s),
        sections::cards(s, sources.evaluation.as_ref()),
        sections::animation(folder),
        sections::curves(&sources.rows),
        sources.evaluation.as_ref().map(|e| views::pictures(e, folder)).unwrap_or_default(),
        sources.evaluation.as_ref().map(views::scores).unwrap_or_default(),
        sources.appearance.as_ref().map(|row| wild::appearance(row, folder)).unwrap_or_default(),
        sources.masks.as_ref().map(|table| wild::masks(table, folder)).unwrap_or_default(),
        sections::plan(s),
        sections::held_out(s, sources.evaluation.as_ref()),
        html::folded(
            "For experts: time, memory, what was skipped, configuration",
            &[sections::costs(s), skips::skips(s, sources.evaluation.as_ref()), sections::config(&sources.config)],
        ),
    ];
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n<style>\n{}</style>\n</head>\n<body>\n\
         <main>\n{}</main>\n</body>\n</html>\n",
        include_str!("style.css"),
        body.concat()
    )
}
