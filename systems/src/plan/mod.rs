//! What does this scene need? Settings from the scene, a line of reason for each, and the system built from them.
//!
//! * `ground`: the layout, the background and the alpha of a scene;
//! * `field_settings`: where rays of a field begin and end, and what is empty before the first step;
//! * `known`: the systems by name, and what each does otherwise than its paper;
//! * `choice`: which system is taken where none is named;
//! * `backdrop`: whether the photos stand before one plain colour.

mod backdrop;
mod choice;
mod field_settings;
mod ground;
mod known;
#[cfg(test)]
pub(crate) mod made;
mod near;
mod ngp_settings;
mod parallax;
mod settings;
#[cfg(test)]
mod tests;

pub use choice::choose;
pub(crate) use field_settings::field_settings;
pub(crate) use ground::{Ground, space};
pub(crate) use known::NGP;
pub use known::{CLAIMS, SYSTEMS};
pub(crate) use near::set_near;
#[cfg(test)]
pub(crate) use ngp_settings::HASH_GRID;
pub(crate) use ngp_settings::{Shown, chosen_sampler, ngp_settings};
pub(crate) use parallax::{NO_PARALLAX, accepts_no_parallax, has_no_parallax, no_parallax};
pub(crate) use settings::{Settings, no_such_system, refuse_unknown, settings, split, table};

use crate::claims::claim;
use crate::static_scene::mip_nerf::{MipNerf, MipNerfConfig};
use crate::static_scene::mip_nerf_360::{MipNerf360, MipNerf360Config};
use engine::data::Dataset;
use engine::options::{Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// Build the system `name` for a scene.
///
/// # Errors
/// [`SystemError::Config`] for an unknown name, an unknown setting or one that cannot work; [`SystemError::Scene`] when
/// an image cannot be read.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let known = claim(&CLAIMS, name)?;
    if name == "splat" {
        let (system, mut plan) = crate::splats::build(scene, data, run)?;
        plan.lines.extend(known.line());
        return Ok((system, plan));
    }
    let Ground { layout, mut lines, background, transparent, error_budget } = Ground::of(scene, data, run)?;
    lines.extend(known.line());
    let mut settings = Settings::new(run);
    let plan = |lines, config| Plan { lines, background, error_budget, config };
    match name {
        "ngp" => {
            let mut ground = Ground { layout, lines, background, transparent, error_budget };
            let config = chosen_sampler(field_settings(&mut ground, data), &mut settings)?;
            let all = settings.all()?;
            let ngp = ground.ngp(data, &config, run.seed, None)?;
            Ok((Box::new(ngp), plan(ground.lines, all)))
        }
        "nerf" => {
            let mut ground = Ground { layout, lines, background, transparent, error_budget };
            let config = settings.of(&ground.nerf_settings())?;
            let all = settings.all()?;
            let nerf = ground.nerf(data, &config, run.seed, None)?;
            Ok((Box::new(nerf), plan(ground.lines, all)))
        }
        "mip-nerf" => {
            let planned = MipNerfConfig {
                centre: layout.centre.to_array(),
                radius: layout.radius,
                extent: f64::from(1_u32 << (layout.cascades - 1)),
                point_size: layout.footprint as f32,
                ..MipNerfConfig::published(layout.kind)
            };
            let config = settings.of(&planned)?;
            let all = settings.all()?;
            let place = (config.centre, config.radius, config.extent);
            let space = space(&layout, data, config.space, place, config.near)?;
            let system = MipNerf::new(config.clone(), space, background, run.seed)?;
            Ok((Box::new(system), plan(lines, all)))
        }
        "mip-nerf-360" => {
            // Objects and open scenes have different settings: those of the space asked for.
            let asked = run.set.get("space").and_then(|word| word.clone().try_into().ok());
            let planned = MipNerf360Config {
                centre: layout.centre.to_array(),
                radius: layout.radius,
                ..MipNerf360Config::published(asked.unwrap_or(layout.kind))
            };
            let config: MipNerf360Config = settings.of(&planned)?;
            let all = settings.all()?;
            config.check()?;
            let place = (config.centre, config.radius, f64::from(config.far));
            let space = space(&layout, data, config.space, place, config.near)?;
            let system = MipNerf360::new(config.clone(), space, background, run.seed)?;
            Ok((Box::new(system), plan(lines, all)))
        }
        other => Err(no_such_system(other, SYSTEMS)),
    }
}
