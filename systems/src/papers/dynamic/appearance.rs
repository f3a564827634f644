//! What photos of a scene that moves differ in: nothing, or a free code for each (Nerfies, section 3.1; HyperNeRF as it).
//!
//! ```text
//! (c, sigma) = F(x', d, psi_i)        colour sees the code beside the view direction, density does not
//! ```
//!
//! The codes are those of systems for photos from the wild ([`crate::appearance`]), and so is the search that finds out whether
//! photos need them. Photos to which the dataset gives one `appearance_id` share a code.

use crate::appearance::codes::{FreeCodes, code_count, codes_by_id};
use crate::appearance::config::CodeConfig;
use crate::limits::refuse;
use crate::occluders::none::NoOccluders;
use crate::papers::wild::combined::Wild;
use crate::papers::wild::nerf_w::HASH_GRID_CODES;
use crate::papers::wild::{AppearanceKind, auto};
use crate::photo_model::PhotoModel;
use crate::plan::Ground;
use crate::rays::RayConfig;
use crate::settings::{Settings, refuse_unknown, table};
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::SystemError;
use losses::kernel::Kernel;
use serde::{Deserialize, Serialize};

/// The setting that chooses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AppearanceSettings {
    /// `none` or `codes`.
    appearance: AppearanceKind,
}

/// Codes of 8 numbers, as published. Their rate and the penalty on their size, which is not published, are those of codes on the hash
/// grid (`docs/decisions/0016-nerf-w-on-a-fast-field.md`).
const CODES: CodeConfig = CodeConfig { appearance_dims: 8, ..HASH_GRID_CODES };

/// The codes of photos for a field of these settings; `None` for `appearance=none`. The loss of a pixel stays the squared error; with
/// `huber` it grows linearly from where the three errors of its channels are that long together.
///
/// # Errors
/// [`SystemError::Config`] for names of `--set` that no part has, and settings that cannot be; [`SystemError::Scene`] when an image
/// cannot be read.
pub(super) fn photo_model(
    ground: &mut Ground,
    data: &Dataset,
    run: &RunOptions,
    field: &RayConfig,
    settings: &mut Settings<'_>,
) -> Result<Option<Box<dyn PhotoModel>>, SystemError> {
    let mut planned = AppearanceSettings { appearance: AppearanceKind::None };
    // Before the search, which takes a short training.
    let mut known = settings.known().clone();
    known.extend(table(&planned));
    known.extend(table(&CODES));
    refuse_unknown(run, &known)?;
    // A resumed run has it in its settings: nothing is left to be found out.
    if !run.set.contains_key("appearance") {
        let (found, line) = auto::appearance_of_times(ground, data, field, run.seed)?;
        planned.appearance = found;
        ground.lines.push(line);
    }
    let chosen: AppearanceSettings = settings.of(&planned)?;
    match chosen.appearance {
        AppearanceKind::None => refuse_absent(run).map(|()| None),
        AppearanceKind::Codes => codes(ground, data, run, field, settings).map(Some),
        AppearanceKind::Encoder => {
            refuse("appearance", "encoder", "must be none or codes: photos of a scene that moves are not encoded")
        }
    }
}

/// A code for each photo, or for each `appearance_id`.
fn codes(
    ground: &mut Ground,
    data: &Dataset,
    run: &RunOptions,
    field: &RayConfig,
    settings: &mut Settings<'_>,
) -> Result<Box<dyn PhotoModel>, SystemError> {
    let codes: CodeConfig = settings.of(&CODES)?;
    codes.check()?;
    let of_view = codes_by_id(data);
    let (count, views) = (code_count(&of_view), data.len());
    if count < views {
        let line = format!("appearance: {count} codes for {views} photos (those of one `appearance_id` share one)");
        ground.lines.push(line);
    }
    Ok(Box::new(Wild {
        name: "codes",
        appearance: Some(Box::new(FreeCodes::uniform(&codes, of_view, run.seed))),
        occluders: Box::new(NoOccluders { kernel: field.batch.kernel(), coarse: Kernel::Squared }),
    }))
}

/// Refuse settings of codes that are not there.
fn refuse_absent(run: &RunOptions) -> Result<(), SystemError> {
    let of_codes = table(&CODES);
    match of_codes.keys().find(|name| run.set.contains_key(*name)) {
        None => Ok(()),
        Some(name) => {
            refuse("set", name, "is a setting of `appearance = \"codes\"`, and here `appearance` is \"none\"")
        }
    }
}
