//! What a run on photos from the wild shows besides: appearances, and masks of occluders.

use super::html::{escape, figure, number};
use crate::error::RunError;
use crate::eval::masks::{MaskTable, PhotoMask, SIDE_BY_SIDE, Scores};
use crate::folder::{APPEARANCE, MASKS};
use crate::output::read_json;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

/// Photos whose masks are in the page; all are in `masks/`.
const SHOWN: usize = 6;

/// One view in several appearances: the content of `appearance/appearance.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AppearanceRow {
    /// Name of the view that is shown.
    pub view: String,
    /// The photo whose appearance it is, and the picture's file beside this one.
    pub pictures: Vec<(String, String)>,
}

impl AppearanceRow {
    /// Folder in the run.
    pub const FOLDER: &'static str = APPEARANCE;
    /// Name in that folder.
    pub const FILE: &'static str = "appearance.json";

    /// The row of the run in `folder`, if it has one.
    ///
    /// # Errors
    /// [`RunError::Content`].
    pub fn read(folder: &Path) -> Result<Option<Self>, RunError> {
        read_json(&folder.join(Self::FOLDER).join(Self::FILE))
    }
}

/// One view in the appearance of several photos.
pub(super) fn appearance(row: &AppearanceRow, folder: &Path) -> String {
    let folder = folder.join(AppearanceRow::FOLDER);
    let figures: String = row
        .pictures
        .iter()
        .filter_map(|(name, file)| {
            figure(&folder.join(file), name, &format!("{} in the appearance of {name}", row.view))
        })
        .collect();
    if figures.is_empty() {
        return figures;
    }
    format!(
        "<h2>Appearance</h2>\n<div class=\"panel view\"><h3>{}<span>in the appearance of training photos</span></h3>\
         <div class=\"strip\">{figures}</div></div>\n",
        escape(&row.view)
    )
}

/// What was taken for static.
pub(super) fn masks(table: &MaskTable, folder: &Path) -> String {
    let folder = folder.join(MASKS).join(SIDE_BY_SIDE);
    let every = table.views.len().div_ceil(SHOWN).max(1);
    let figures: String = table
        .views
        .iter()
        .step_by(every)
        .filter_map(|v| figure(&folder.join(&v.file), &caption(v), &format!("photo and mask of {}", v.name)))
        .collect();
    let mut out = format!("<h2>Masks</h2>\n<p class=\"soft\">{}.", escape(table.legend().trim_end()));
    let was_given = table.views.iter().any(|v| v.given_share.is_some());
    out += if was_given {
        " Photo, mask as given (white: used), mask as found (white: static)"
    } else {
        " Photo, mask as found (white: static)"
    };
    out += if table.with_truth > 0 { ", truth.</p>\n" } else { ".</p>\n" };
    if !figures.is_empty() {
        let _ = writeln!(out, "<div class=\"panel view\"><div class=\"strip wide\">{figures}</div></div>");
    }
    if table.with_truth > 0 {
        out += "<div class=\"panel\"><table>\n<tr><th>mean over</th><th class=\"n\">mIoU</th><th class=\"n\">F1</th>\
                <th class=\"n\">IoU static</th><th class=\"n\">IoU transient</th></tr>\n";
        for (name, s) in [("photos", &table.per_image), ("all pixels together", &table.pooled)] {
            let Scores { miou, iou_static, iou_transient, f1 } = *s;
            let cells: String = [miou, f1, iou_static, iou_transient]
                .iter()
                .map(|x| format!("<td class=\"n\">{}</td>", number(*x, 4, "")))
                .collect();
            let _ = writeln!(out, "<tr><td>{name}</td>{cells}</tr>");
        }
        out += "</table></div>\n";
    }
    out
}

fn caption(v: &PhotoMask) -> String {
    let f1 = v.scores.f1.map_or_else(String::new, |f1| format!(" · F1 {f1:.3}"));
    let given = v.given_share.map_or_else(String::new, |share| format!(" · given {:.0} % white", 100.0 * share));
    format!("{}{given} · {:.0} % static{f1}", v.name, 100.0 * v.static_share)
}
