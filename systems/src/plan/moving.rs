//! The plan of a field for photos that each show a time of their own: a deformation or none, which rays are drawn, and what
//! measured depth does.

use super::ask::{Ask, Built, planned};
use super::ground::Ground;
use super::near::set_near;
use super::pace::CloudPace;
use super::ngp_settings::{Shown, ngp_settings};
use super::parallax::{accepts_no_parallax, has_no_parallax, no_parallax};
use super::ray_choice::RaySettings;
use crate::fields::{DecoderKind, FeatureSource};
use crate::rays::{FlowConfig, MovingConfig, MovingSettings, RayConfig, RaySystem};
use crate::samplers::DepthCueConfig;
use crate::settings::Settings;
use crate::warps::{Deform, Times};
use engine::data::Dataset;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A deformation from its settings, the times of the training views and a seed.
pub(crate) type NewDeform = fn(&mut Settings<'_>, Times, u64) -> Result<Deform, SystemError>;

/// A field's settings after `--set`, from those that are planned.
pub(crate) type NewField = fn(RayConfig, &mut Settings<'_>) -> Result<RayConfig, SystemError>;

/// Scene flow of what moves, from the step from which something does and the steps that are left then.
pub(crate) type NewFlow = fn(&mut Settings<'_>, u64, u64) -> Result<FlowConfig, SystemError>;

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
/// Steps with what moves that schedules of scene flow are for, where no stop is known.
const FLOW_STEPS: u64 = 4000;

/// What a part for what moves costs, and when it begins in a run of `steps` steps.
fn moving_settings(steps: Option<u64>) -> MovingSettings {
    let from = steps.map_or(STILL_STEPS, |steps| (STILL_SHARE * steps as f64).round() as u64).max(1);
    MovingSettings { moving_from: from, moving_share: 1e-3, moving_entropy: 1e-3 }
}

/// The field with a part of its own for what moves: what the system made of its features is that part's, `still` are those of the rest.
fn with_still_part(
    field: RayConfig,
    still: &Arc<dyn FeatureSource>,
    steps: Option<u64>,
    flow: Option<NewFlow>,
    settings: &mut Settings<'_>,
) -> Result<RayConfig, SystemError> {
    if field.decoder.is_some_and(|choice| choice.decoder == DecoderKind::Explicit) {
        return Err(SystemError::Config {
            field: "background",
            value: "static".into(),
            problem: "two parts are mixed before one network of colours: set `decoder=hybrid`".into(),
        });
    }
    let mut moving = MovingConfig::new(field.features.clone(), moving_settings(steps)).asked(settings)?;
    if let Some(flow) = flow {
        let left = steps.map_or(FLOW_STEPS, |steps| steps.saturating_sub(moving.from()));
        let from = moving.from();
        moving = moving.with_flow(flow(settings, from, left)?);
    }
    Ok(RayConfig { features: still.clone(), moving: Some(moving), ..field })
}

/// The parts of a system for scenes that move: its deformation, its rays, what it makes of measured depth, and what it changes of
/// its field.
pub(crate) struct Moving {
    pub(crate) deform: Option<NewDeform>,
    pub(crate) rays: RaySettings,
    pub(crate) depth: DepthCueConfig,
    /// Scene flow; a system with one always has a still part.
    pub(crate) flow: Option<NewFlow>,
    pub(crate) field: fn(&mut RayConfig, &Dataset),
    /// The field's settings as they are asked for.
    pub(crate) asked: NewField,
}

impl Moving {
    /// A field in which nothing moves.
    pub(crate) const STILL: Self = Self {
        deform: None,
        rays: RaySettings::ANYWHERE,
        depth: DepthCueConfig::NONE,
        flow: None,
        field: |_, _| {},
        asked: |field, settings| field.asked(settings),
    };

    /// A field that a deformation moves.
    pub(crate) const fn deformed(deform: NewDeform) -> Self {
        Self { deform: Some(deform), ..Self::STILL }
    }
}

/// Weight of a ray that its faintest samples may have together to be left out in training: half a step of 8 bits.
const FAINT: f32 = 0.002;

/// A field made of these parts.
pub(crate) fn moving_field(ask: Ask<'_>, parts: &Moving) -> Built {
    let Ask { claim, scene, data, run, mut settings } = ask;
    let rays = settings.of(&parts.rays)?;
    rays.check()?;
    let depth = settings.of(&parts.depth)?;
    depth.check()?;
    let deform = parts.deform.map(|new| new(&mut settings, Times::of(data), run.seed)).transpose()?;
    let deform = deform.filter(Deform::does_something).map(|deform| deform.with_curriculum(rays.curriculum));
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    let measured = has_depth && depth.asks();
    let frozen = !accepts_no_parallax(run)? && has_no_parallax(data);
    if frozen && has_depth {
        check_depth(claim.name, data, measured)?;
    }
    let mut ground = if measured { Ground::with_depth(scene, data, run) } else { Ground::of_times(scene, data, run) }?;
    ground.lines.extend(claim.line());
    let mut field = ngp_settings(&ground.layout, data, Shown::Times, ground.transparent, &mut ground.lines);
    set_near(&mut field.space, &mut ground, data, Shown::Times);
    if deform.is_some() {
        // Cells that are full at some time are empty at most others.
        field.batch.train_faint = FAINT;
    }
    let still = field.features.clone();
    (parts.field)(&mut field, data);
    let own = !Arc::ptr_eq(&still, &field.features);
    let mut field = (parts.asked)(field, &mut settings)?;
    let moves = deform.is_some() || own;
    let is_static = parts.flow.is_some()
        || moves && settings.of(&BackgroundChoice::default())?.background == Background::Static;
    if is_static {
        // Features that the system did not choose are those of a scene at rest, as they were asked for.
        let still = if own { still } else { field.features.clone() };
        field = with_still_part(field, &still, CloudPace::of_field(run.stop), parts.flow, &mut settings)?;
        ground.lines.push(static_line(&field));
    }
    let config = settings.all()?;
    let mut system = ground.moving(data, &field, run.seed, scene, claim.name, deform)?;
    ground.lines.extend(follow(&mut system, data, &rays)?);
    system.watch(data);
    ground.lines.extend(system.follow_film(data)?);
    if depth.asks() {
        let known = system.follow_depth(depth, data)?;
        if frozen && !known {
            return Err(no_depth(data));
        }
        ground.lines.push(if known {
            "depth: measured depths lead samples and are held to".into()
        } else {
            "depth: none is measured, so nothing is held to it".into()
        });
    }
    Ok((Box::new(system), planned(ground, config)))
}

/// When what moves is looked for.
fn static_line(field: &RayConfig) -> String {
    let from = field.moving.as_ref().map_or(0, MovingConfig::from);
    format!(
        "background: a field of what stands still; after {from} steps what its photos show otherwise moves, in a field of its own, and \
         nothing more is trained where nothing does"
    )
}

/// Let errors or masks lead the rays. Returns what is done, a line each.
fn follow(system: &mut RaySystem, data: &Dataset, rays: &RaySettings) -> Result<Vec<String>, SystemError> {
    let mut lines = Vec::new();
    if rays.by_error {
        system.follow_errors(data);
        lines.push("rays: half of them where the errors are".into());
    }
    if rays.guided {
        lines.push(match system.follow_masks(data)? {
            Some(0) => "rays: none under the masks, more where they often are".into(),
            Some(hidden) => format!(
                "rays: none under the masks, more where they often are; {hidden} of {} photos lie all under theirs and are \
                 left out",
                data.len()
            ),
            None => "rays: anywhere (no masks, masks over everything, or views of different sizes)".into(),
        });
    }
    Ok(lines)
}

/// A camera that stands still sees depth by what was measured, or not at all.
fn check_depth(name: &str, data: &Dataset, measured: bool) -> Result<(), SystemError> {
    if !has_known_depth(data)? {
        return Err(no_depth(data));
    }
    if measured {
        return Ok(());
    }
    let what = format!("no parallax, and `{name}` makes nothing of the depth that was measured");
    Err(no_parallax(data, &format!("{what}; use `endo-nerf`, set `depth=1`")))
}

/// Whether any pixel of any depth map is known: usually the first map answers.
fn has_known_depth(data: &Dataset) -> Result<bool, SystemError> {
    for view in data.views() {
        if view.source.read_depth()?.is_some_and(|map| map.z.iter().any(|&z| z > 0.0)) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn no_depth(data: &Dataset) -> SystemError {
    let and =
        "no parallax, and their depth maps are nothing but holes (0, or no number), so no depth; check the depth maps";
    no_parallax(data, and)
}
