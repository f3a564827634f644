//! Whether what stands still is a field of its own, behind the part that moves.

use super::ground::Ground;
use super::pace::CloudPace;
use crate::fields::{DecoderKind, FeatureSource};
use crate::rays::{MovingConfig, MovingSettings, RayConfig};
use crate::settings::Settings;
use engine::options::Stop;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What stands still behind what moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Background {
    /// Part of the one field, which moves.
    #[default]
    Moving,
    /// A field of its own, as for a scene at rest.
    Static,
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BackgroundChoice {
    /// What stands still: `moving` (part of the one field) or `static` (a field of its own; the system's moves before it).
    background: Background,
}

/// Steps of the still part alone, where no stop is known, and as a share of those until a stop.
const STILL_STEPS: u64 = 400;
const STILL_SHARE: f64 = 0.15;

/// What a part for what moves costs, and when it begins in a run of `steps` steps.
fn moving_settings(steps: Option<u64>) -> MovingSettings {
    let from = steps.map_or(STILL_STEPS, |steps| (STILL_SHARE * steps as f64).round() as u64).max(1);
    MovingSettings { moving_from: from, moving_share: 1e-3, moving_entropy: 1e-3 }
}

/// The field as it is, or with a part of its own for what moves, as it is asked for: what the system made of its features is that part's
/// then, `still` are those of the rest.
///
/// # Errors
/// [`SystemError::Config`] naming the setting that cannot be.
pub(super) fn behind(
    field: RayConfig,
    still: Arc<dyn FeatureSource>,
    stop: Option<Stop>,
    settings: &mut Settings<'_>,
    ground: &mut Ground,
) -> Result<RayConfig, SystemError> {
    if settings.of(&BackgroundChoice::default())?.background == Background::Moving {
        return Ok(field);
    }
    if field.decoder.is_some_and(|choice| choice.decoder == DecoderKind::Explicit) {
        return Err(SystemError::Config {
            field: "background",
            value: "static".into(),
            problem: "two parts are mixed before one network of colours: set `decoder=hybrid`".into(),
        });
    }
    let planned = moving_settings(CloudPace::of_field(stop));
    let moving = MovingConfig::new(field.features.clone(), planned).asked(settings)?;
    ground.lines.push(format!(
        "background: a field of what stands still; after {} steps what its photos show otherwise moves, in a field of its own; nothing \
         more is trained where nothing does",
        moving.from()
    ));
    Ok(RayConfig { features: still, moving: Some(moving), ..field })
}
