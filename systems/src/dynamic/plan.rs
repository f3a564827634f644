//! What does this video need? The system built from its name and its settings.

use super::config::DynamicConfig;
use super::{d_nerf, endo_nerf, hyper_nerf, nerfies, t_nerf, tineuvox};
use crate::claims::{Claim, names};
use crate::deform::Deform;
use crate::papers::static_scenes::ngp::CLAIM as NGP;
use crate::plan::{
    Ground, NO_PARALLAX, Settings, Shown, accepts_no_parallax, has_no_parallax, ngp_settings, no_parallax,
    no_such_system, refuse_unknown, set_near, settings, split, table,
};
use crate::rays::RayConfig;
use engine::data::Dataset;
use engine::error::RunError;
use engine::options::{DataOptions, Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// A system: what its name claims, its settings, and those of its field.
struct Known {
    claim: Claim,
    settings: fn() -> DynamicConfig,
    field: fn(&mut RayConfig),
}

const KNOWN: [Known; 7] = [
    Known { claim: NGP, settings: DynamicConfig::still, field: |_| {} },
    Known { claim: t_nerf::CLAIM, settings: t_nerf::settings, field: |_| {} },
    Known { claim: d_nerf::CLAIM, settings: d_nerf::settings, field: |_| {} },
    Known { claim: nerfies::CLAIM, settings: nerfies::settings, field: |_| {} },
    Known { claim: hyper_nerf::CLAIM, settings: hyper_nerf::settings, field: |_| {} },
    Known { claim: tineuvox::CLAIM, settings: tineuvox::settings, field: tineuvox::field },
    Known { claim: endo_nerf::CLAIM, settings: endo_nerf::settings, field: |_| {} },
];

/// Systems by name, with what differs from their papers.
pub const CLAIMS: [Claim; KNOWN.len()] = {
    let mut claims = [NGP; KNOWN.len()];
    let mut i = 0;
    while i < claims.len() {
        claims[i] = KNOWN[i].claim;
        i += 1;
    }
    claims
};

/// Systems by name.
pub const SYSTEMS: [&str; KNOWN.len()] = names(&CLAIMS);

/// The scene a word or path names; images that say nothing of time are in the order of time.
///
/// # Errors
/// As [`engine::source::load`].
pub fn load(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    let mut scene = engine::source::load(spec, data)?;
    scene.time_by_order();
    Ok(scene)
}

/// Part of a ray's light that its faintest samples are left out with in training: half a step of 8 bits.
const FAINT: f32 = 0.002;

/// Build the system `name` for a scene.
///
/// # Errors
/// As [`crate::registry::build`].
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let known = KNOWN.iter().find(|known| known.claim.name == name).ok_or_else(|| no_such_system(name, SYSTEMS))?;
    let planned = (known.settings)();
    let (ours, fields) = split(run, &table(&planned));
    let config: DynamicConfig = settings(&planned, &ours)?;
    config.check()?;
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    let measured = has_depth && config.cues.asks();
    let frozen = !accepts_no_parallax(run)? && has_no_parallax(data);
    if frozen && has_depth {
        check_depth(name, data, measured)?;
    }
    let mut ground =
        if measured { Ground::with_depth(scene, data, run) } else { Ground::of_moments(scene, data, run) }?;
    ground.lines.extend(known.claim.line());
    let mut field = ngp_settings(&ground.layout, data, (Shown::Moments, ground.transparent), &mut ground.lines);
    set_near(&mut field.space, &mut ground, data, Shown::Moments);
    if config.deform().is_some() {
        // Cells that are full at some moment are empty at most others.
        field.batch.train_faint = FAINT;
    }
    (known.field)(&mut field);
    let mut parts = Settings::new(&fields);
    let field = field.asked(&mut parts)?;
    let mut all = table(&config);
    all.extend(parts.known().clone());
    refuse_unknown(run, &all)?;
    let deform = config.deform().map(|deform| Deform::new(deform, data, run.seed)).transpose()?;
    let mut system = ground.moving(data, &field, run.seed, scene, known.claim.name, deform)?;
    if config.by_error {
        system.follow_errors(data);
        ground.lines.push("rays: half of them where the errors are".into());
    }
    if config.guided {
        ground.lines.push(match system.follow_masks(data)? {
            Some(0) => "rays: none under the masks, more where they often are".into(),
            Some(hidden) => format!(
                "rays: none under the masks, more where they often are; {hidden} of {} photos lie all under theirs and are \
                 left out",
                data.len()
            ),
            None => "rays: anywhere (no masks, masks over everything, or views of different sizes)".into(),
        });
    }
    if config.cues.asks() {
        let known = system.follow_depth(config.cues, data)?;
        if frozen && !known {
            return Err(no_depth(data));
        }
        ground.lines.push(if known {
            "depth: measured depths lead samples and are held to".into()
        } else {
            "depth: none is measured, so nothing is held to it".into()
        });
    }
    all.extend(run.set.get_key_value(NO_PARALLAX).map(|(k, v)| (k.clone(), v.clone())));
    let Ground { lines, background, error_budget, .. } = ground;
    Ok((Box::new(system), Plan { lines, background, error_budget, config: all }))
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
