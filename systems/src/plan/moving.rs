//! The plan of a field for photos that each show a time of their own: a deformation or none, what photos differ in, which rays are
//! drawn, and what measured depth does.

use super::ask::{Ask, Built, planned};
use super::ground::{Ground, MovingParts};
use super::near::set_near;
use super::ngp_settings::{Shown, ngp_settings, tell_times_apart};
use super::pace::CloudPace;
use super::parallax::{accepts_no_parallax, has_no_parallax, no_parallax};
use super::ray_choice::RaySettings;
use super::still_part::{Background, behind, with_flow};
use crate::photo_model::PhotoModel;
use crate::rays::{FlowConfig, RayConfig, RaySystem};
use crate::samplers::DepthCueConfig;
use crate::schedule::ScheduleSettings;
use crate::settings::Settings;
use crate::warps::{Deform, Times};
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::SystemError;
use std::sync::Arc;

/// A deformation from its settings, the times of the training views and a seed.
pub(crate) type NewDeform = fn(&mut Settings<'_>, Times, u64) -> Result<Deform, SystemError>;

/// A field's settings after `--set`, from those that are planned.
pub(crate) type NewField = fn(RayConfig, &mut Settings<'_>) -> Result<RayConfig, SystemError>;

/// Scene flow of what moves.
pub(crate) type NewFlow = fn(&mut Settings<'_>) -> Result<FlowConfig, SystemError>;

/// What photos differ in, for a field of these settings, or nothing; with its line in the plan. All other settings are known.
pub(crate) type NewPhotoModel = fn(
    &mut Ground,
    &Dataset,
    &RunOptions,
    &RayConfig,
    &mut Settings<'_>,
) -> Result<Option<Box<dyn PhotoModel>>, SystemError>;

/// The parts of a system for scenes that move: its deformation, what photos differ in, its rays, what it makes of measured depth, and
/// what it changes of its field.
pub(crate) struct Moving {
    pub(crate) deform: Option<NewDeform>,
    pub(crate) photos: Option<NewPhotoModel>,
    pub(crate) rays: RaySettings,
    pub(crate) depth: DepthCueConfig,
    /// Scene flow; a system with one always has a still part.
    pub(crate) flow: Option<NewFlow>,
    /// What stands still, where nothing else is asked for.
    pub(crate) background: Background,
    pub(crate) field: fn(&mut RayConfig, &Dataset),
    /// The field's settings as they are asked for.
    pub(crate) asked: NewField,
}

impl Moving {
    /// A field in which nothing moves.
    pub(crate) const STILL: Self = Self {
        deform: None,
        photos: None,
        rays: RaySettings::ANYWHERE,
        depth: DepthCueConfig::NONE,
        flow: None,
        background: Background::Moving,
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
    let schedule = scheduled(&mut settings, run, parts)?;
    let rays = settings.of(&parts.rays)?;
    rays.check()?;
    let depth = settings.of(&depth_rounds(parts.depth, schedule))?;
    depth.check()?;
    let deform = parts.deform.map(|new| new(&mut settings, Times::of(data), run.seed)).transpose()?;
    let deform = deform.filter(Deform::does_something).map(|deform| deform.with_curriculum(rays.curriculum));
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    let measured = has_depth && depth.asks();
    let frozen = !accepts_no_parallax(run)? && has_no_parallax(data);
    check_still_camera(claim.name, data, run, if measured { DepthUse::Asked } else { DepthUse::CouldBeAsked })?;
    let mut ground = if measured { Ground::with_depth(scene, data, run) } else { Ground::of_times(scene, data, run) }?;
    ground.lines.extend(claim.line());
    if deform.as_ref().is_some_and(|deform| deform.coherence_factor() > 0.0) {
        ground.lines.push("motion: as rigid as possible; a changed distance between neighbours costs".into());
    }
    let mut field = ngp_settings(&ground.layout, data, Shown::Times, ground.transparent, &mut ground.lines);
    set_near(&mut field.space, &mut ground, data, Shown::Times);
    if deform.is_some() {
        // Cells that are full at some time are empty at most others.
        field.batch.train_faint = FAINT;
        if ground.transparent {
            tell_times_apart(&mut field, &mut ground.lines);
        }
    }
    let still = field.features.clone();
    (parts.field)(&mut field, data);
    let own = !Arc::ptr_eq(&still, &field.features);
    if run.stop.is_some() {
        field.rates = field.rates.over(schedule.horizon);
    }
    ground.lines.push(format!(
        "schedule: of {} steps; {} are shares of it",
        schedule.horizon,
        if run.stop.is_some() { "rates, windows and doublings" } else { "windows and doublings" }
    ));
    let field = (parts.asked)(field, &mut settings)?;
    // Features that the system did not choose are those of a scene at rest, as they were asked for.
    let still = own.then_some(still);
    let field = match parts.flow {
        Some(flow) => with_flow(field, still, flow, &mut settings, &mut ground)?,
        None if deform.is_some() || own => behind(field, still, parts.background, &mut settings, &mut ground)?,
        None => field,
    };
    let photos = parts.photos.map(|new| new(&mut ground, data, run, &field, &mut settings)).transpose()?;
    let config = settings.all()?;
    let moving = MovingParts { photo_model: photos.flatten(), deform };
    let mut system = ground.moving(data, &field, run.seed, scene, claim.name, moving)?;
    system.follow_schedule(schedule.horizon);
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

/// The schedule of a run until its stop.
fn scheduled(settings: &mut Settings<'_>, run: &RunOptions, parts: &Moving) -> Result<ScheduleSettings, SystemError> {
    let steps = if parts.deform.is_some() { CloudPace::of_moving_field } else { CloudPace::of_field };
    let schedule = settings.of(&ScheduleSettings::until(steps(run.stop)))?;
    schedule.check()?;
    Ok(schedule)
}

/// Rounds in which measured depth gives way, spread over the schedule where there are any.
fn depth_rounds(depth: DepthCueConfig, schedule: ScheduleSettings) -> DepthCueConfig {
    if depth.refine_every == 0 {
        return depth;
    }
    DepthCueConfig { refine_every: (schedule.horizon / (depth.refine_rounds + 1).max(1)).max(1), ..depth }
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

/// What a system makes of measured depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DepthUse {
    /// It is led by it.
    Asked,
    /// It could be, by a setting.
    CouldBeAsked,
    /// Nothing.
    None,
}

/// A camera that stands still sees depth by what was measured, or not at all: refuse it where there are depth maps that say nothing, or
/// that the system makes nothing of.
pub(crate) fn check_still_camera(
    name: &str,
    data: &Dataset,
    run: &RunOptions,
    depth: DepthUse,
) -> Result<(), SystemError> {
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    if !has_depth || accepts_no_parallax(run)? || !has_no_parallax(data) {
        return Ok(());
    }
    if !has_known_depth(data)? {
        return Err(no_depth(data));
    }
    let what = format!("no parallax, and `{name}` makes nothing of the depth that was measured; use `endo-nerf`");
    match depth {
        DepthUse::Asked => Ok(()),
        DepthUse::CouldBeAsked => Err(no_parallax(data, &format!("{what}, set `depth=1`"))),
        DepthUse::None => Err(no_parallax(data, &what)),
    }
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
