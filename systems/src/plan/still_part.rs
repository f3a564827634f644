//! Whether what stands still is a field of its own, behind the part that moves.

use super::ground::{Ground, percent};
use super::moving::NewFlow;
use crate::fields::{DecoderKind, FeatureSource};
use crate::rays::{MovingConfig, MovingSettings, RayConfig};
use crate::settings::Settings;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What stands still behind what moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Background {
    /// Part of the one field, which moves.
    #[default]
    Moving,
    /// A field of its own, as for a scene at rest.
    Static,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BackgroundChoice {
    /// What stands still: `moving` (part of the one field) or `static` (a field of its own; the system's moves before it).
    background: Background,
}

/// What a part for what moves costs, and when it begins.
const MOVING: MovingSettings = MovingSettings { moving_from: 0.15, moving_share: 3e-4, moving_entropy: 3e-4 };

/// The field as it is, or with a part of its own for what moves, as it is asked for: what the system made of its features is that part's
/// then; `still` are those of the rest, where they are others.
///
/// # Errors
/// [`SystemError::Config`] naming the setting that cannot be.
pub(super) fn behind(
    field: RayConfig,
    still: Option<Arc<dyn FeatureSource>>,
    background: Background,
    settings: &mut Settings<'_>,
    ground: &mut Ground,
) -> Result<RayConfig, SystemError> {
    if settings.of(&BackgroundChoice { background })?.background == Background::Moving {
        return Ok(field);
    }
    let moving = moving_part(&field, settings, ground)?;
    let features = match (still, background) {
        // Made for two parts: settings of both have names of their own.
        (Some(still), Background::Static) => still.asked(settings)?,
        (Some(still), Background::Moving) => still,
        (None, _) => field.features.clone(),
    };
    Ok(RayConfig { features, moving: Some(moving), ..field })
}

/// The field with a part of its own for what moves, which has scene flow.
///
/// # Errors
/// [`SystemError::Config`] naming the setting that cannot be.
pub(super) fn with_flow(
    field: RayConfig,
    still: Option<Arc<dyn FeatureSource>>,
    flow: NewFlow,
    settings: &mut Settings<'_>,
    ground: &mut Ground,
) -> Result<RayConfig, SystemError> {
    let moving = moving_part(&field, settings, ground)?.with_flow(flow(settings)?);
    let features = still.unwrap_or_else(|| field.features.clone());
    Ok(RayConfig { features, moving: Some(moving), ..field })
}

fn moving_part(
    field: &RayConfig,
    settings: &mut Settings<'_>,
    ground: &mut Ground,
) -> Result<MovingConfig, SystemError> {
    if field.decoder.is_some_and(|choice| choice.decoder == DecoderKind::Explicit) {
        return Err(SystemError::Config {
            field: "background",
            value: "static".into(),
            problem: "two parts are mixed before one network of colours: set `decoder=hybrid`".into(),
        });
    }
    let moving = MovingConfig::new(field.features.clone(), MOVING).asked(settings)?;
    ground.lines.push(format!(
        "background: a field of what stands still; what moves is looked for after {} of the run and twice more after as long again \
         (once where motion masks say it), and has a field of its own; nothing more is trained where nothing does",
        percent(moving.from())
    ));
    Ok(moving)
}
