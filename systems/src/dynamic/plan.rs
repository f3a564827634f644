//! What does this video need? The system built from its name and its settings.

use super::config::DynamicConfig;
use super::{d_nerf, endo_nerf, hyper_nerf, nerfies, t_nerf, tineuvox};
use crate::data::Dataset;
use crate::deform::Deform;
use crate::error::RunError;
use crate::layout::stands_still;
use crate::options::{DataOptions, Plan, RunOptions};
use crate::plan::{Ground, NO_PARALLAX, ngp_settings, refuse_unknown, settings, split, table};
use crate::system::{System, SystemError};
use render_core::pose::Pose;
use scene_io::Scene;

/// Systems by name.
pub const SYSTEMS: [&str; 7] = ["ngp", "t-nerf", "d-nerf", "nerfies", "hypernerf", "tineuvox", "endo-nerf"];

/// The scene a word or path names; images that say nothing of time are in the order of time.
///
/// # Errors
/// As [`crate::source::load`].
pub fn load(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    let mut scene = crate::source::load(spec, data)?;
    scene.time_by_order();
    Ok(scene)
}

/// Settings of a named system.
fn named(name: &str) -> Result<DynamicConfig, SystemError> {
    Ok(match name {
        "ngp" => DynamicConfig::still(),
        "t-nerf" => t_nerf::settings(),
        "d-nerf" => d_nerf::settings(),
        "nerfies" => nerfies::settings(),
        "hypernerf" => hyper_nerf::settings(),
        "tineuvox" => tineuvox::settings(),
        "endo-nerf" => endo_nerf::settings(),
        other => {
            return Err(SystemError::Config {
                field: "system",
                value: other.into(),
                problem: format!("there is no such system; use one of {}", SYSTEMS.join(", ")),
            });
        }
    })
}

/// Build the system `name` for a scene.
///
/// # Errors
/// As [`crate::plan::build`].
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let planned = named(name)?;
    let (ours, fields) = split(run, &table(&planned));
    let config: DynamicConfig = settings(&planned, &ours)?;
    config.check()?;
    let measured = config.cues.asks() && data.views().iter().any(|view| view.source.depth.is_some());
    let poses: Vec<Pose> = data.views().iter().map(|view| view.camera.pose).collect();
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    let accepted = run.set.get(NO_PARALLAX) == Some(&toml::Value::Boolean(true));
    if stands_still(&poses) && has_depth && !measured && !accepted {
        return Err(SystemError::Config {
            field: "system",
            value: name.into(),
            problem:
                "the camera stands still, so there is no parallax, and this system makes nothing of the depth that was \
                      measured; use `endo-nerf`, set `depth=1`, or set `accept_no_parallax=true`"
                    .into(),
        });
    }
    let mut ground = if measured { Ground::with_depth(scene, data, run) } else { Ground::of(scene, data, run) }?;
    let mut field = ngp_settings(&ground.layout, data, ground.transparent, &mut ground.lines);
    // Each pixel shows a moment of its own: more of them are worth more than each of them done better.
    if field.rays_per_side > 1 {
        field.rays_per_side = 1;
        ground.lines.push("rays: one a pixel (each photo shows a moment of its own)".into());
    }
    field.moves = config.deform().is_some();
    // Slopes of the finest levels say little about where to go.
    field.warp_levels = field.levels.div_ceil(2);
    match name {
        "tineuvox" => tineuvox::field(&mut field),
        "endo-nerf" => endo_nerf::field(&mut field),
        _ => {}
    }
    let mut known = table(&config);
    known.extend(table(&field));
    refuse_unknown(run, &known)?;
    let field = settings(&field, &fields)?;
    let deform = config.deform().map(|deform| Deform::new(deform, data, run.seed)).transpose()?;
    let mut system = ground.moving(data, &field, run.seed, scene, (name_of(name), deform))?;
    if config.by_error && config.curriculum == 0 && !config.guided {
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
        ground.lines.push(if known {
            "depth: measured depths lead samples and are held to".into()
        } else {
            "depth: none is measured, so nothing is held to it".into()
        });
    }
    let mut all = table(&config);
    all.extend(table(&field));
    all.extend(run.set.get_key_value(NO_PARALLAX).map(|(k, v)| (k.clone(), v.clone())));
    let Ground { lines, background, error_budget, .. } = ground;
    Ok((Box::new(system), Plan { lines, background, error_budget, config: all }))
}

fn name_of(name: &str) -> &'static str {
    SYSTEMS.into_iter().find(|n| *n == name).unwrap_or("ngp")
}
