//! What do these photos need? The system built from its name, its parts and its field.

use super::config::{AppearanceKind, FieldKind, OccluderKind, WildConfig};
use super::ha_nerf::HaNerf;
use super::hugs::Hugs;
use super::light::Light;
use super::look;
use super::nerf_w::NerfW;
use super::robust_nerf::RobustNerf;
use super::sf_nerf::SfNerf;
use crate::data::Dataset;
use crate::method::Method;
use crate::options::{Plan, RunOptions};
use crate::plan::{Ground, NO_PARALLAX, ngp_settings, settings, table};
use crate::space::SpaceKind;
use crate::static_scene::ngp::NgpConfig;
use crate::system::{System, SystemError};
use glam::DVec3;
use render_core::bounds::depth_ranges;
use render_core::camera::Camera;
use scene_io::Scene;

/// Systems by name.
pub const SYSTEMS: [&str; 11] = [
    "auto",
    "plain",
    "robust-nerf",
    "nerf-a",
    "nerf-u",
    "nerf-w",
    "ha-nerf-a",
    "ha-nerf-t",
    "ha-nerf",
    "sf-nerf",
    "hugs",
];

/// Light and strangers of a named system; `None` for `auto`.
fn parts(name: &str) -> Result<Option<(AppearanceKind, OccluderKind)>, SystemError> {
    use AppearanceKind as A;
    use OccluderKind as O;
    Ok(Some(match name {
        "auto" => return Ok(None),
        "plain" => (A::None, O::None),
        "robust-nerf" => (A::None, O::Robust),
        "nerf-a" => (A::Codes, O::None),
        "nerf-u" => (A::None, O::Transient),
        "nerf-w" => (A::Codes, O::Transient),
        "ha-nerf-a" => (A::Encoder, O::None),
        "ha-nerf-t" => (A::None, O::Visibility),
        "ha-nerf" => (A::Encoder, O::Visibility),
        "sf-nerf" => (A::Codes, O::Filter),
        "hugs" => (A::None, O::Masks),
        other => {
            return Err(SystemError::Config {
                field: "system",
                value: other.into(),
                problem: format!("there is no such system; use one of {}", SYSTEMS.join(", ")),
            });
        }
    }))
}

/// Build the system `name` for a scene.
///
/// # Errors
/// As [`crate::plan::build`], and for photos that a method cannot work with.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let mut ground = Ground::of(scene, data, run)?;
    let asked = |key: &str| run.set.get(key).is_some();
    let (appearance, occluders) = match parts(name)? {
        Some(parts) => parts,
        // Nothing is left to be found out: a resumed run is told again.
        None if asked("appearance") && asked("occluders") => (AppearanceKind::None, OccluderKind::None),
        None => look::needs(&mut ground, scene, data, run)?,
    };
    let (ours, fields) = split(run, &table(&WildConfig::new(FieldKind::Ngp, appearance, occluders)));
    let field = match run.set.get("field") {
        None => FieldKind::Ngp,
        Some(word) => word.clone().try_into().map_err(|_| SystemError::Config {
            field: "field",
            value: word.to_string(),
            problem: "must be `ngp` or `mlp`".into(),
        })?,
    };
    let mut wild = WildConfig::new(field, appearance, occluders);
    let longest = data.views().iter().map(|v| v.camera.width.max(v.camera.height)).max().unwrap_or(0);
    if longest < SMALL_PHOTO {
        (wild.patch, wild.patch_inner) = (wild.patch / 2, wild.patch_inner / 2);
    }
    let wild: WildConfig = settings(&wild, &ours)?;
    wild.check()?;
    let method = method(&wild, scene, data, run.seed)?;
    let (system, config): (Box<dyn System>, _) = match field {
        FieldKind::Ngp => {
            let mut planned = field_settings(&mut ground, scene, data);
            if wild.draws_patches() && planned.rays_per_side > 1 {
                planned.rays_per_side = 1;
                let side = wild.patch_side();
                let line = format!("rays: one a pixel (patches of {side}x{side} pixels instead of more rays)");
                ground.lines.push(line);
            }
            let config = settings(&planned, &fields)?;
            (Box::new(ground.ngp(data, &config, run.seed, method)?), table(&config))
        }
        FieldKind::Mlp => {
            let config = settings(&ground.nerf_settings(), &fields)?;
            (Box::new(ground.nerf(data, &config, run.seed, method)?), table(&config))
        }
    };
    let mut all = table(&wild);
    all.extend(config);
    all.extend(run.set.get_key_value(NO_PARALLAX).map(|(k, v)| (k.clone(), v.clone())));
    let Ground { lines, background, error_budget, .. } = ground;
    Ok((system, Plan { lines, background, error_budget, config: all }))
}

/// Settings of `ngp` for photos from the wild: what one photo alone shows must not find a place right before its camera.
pub(super) fn field_settings(ground: &mut Ground, scene: &Scene, data: &Dataset) -> NgpConfig {
    let mut config = ngp_settings(&ground.layout, data, ground.transparent, &mut ground.lines);
    if ground.layout.kind == SpaceKind::Contracted {
        config.sky = true;
        ground.lines.push("sky: every ray ends at infinity, in a colour of its direction".into());
        let features: usize = data.views().iter().map(|v| v.points.len()).sum();
        config.free_space = features > 0;
        if config.free_space {
            let line = format!("free space: what lies before the points of {features} features of the photos is empty");
            ground.lines.push(line);
        }
        let (near, why) = nearest(scene, data, ground.layout.centre);
        let near = (near / ground.layout.radius) as f32;
        if near.is_finite() && near > config.near {
            config.near = near;
            ground.lines.push(format!("near: {near:.2} radii ({why})"));
        }
    }
    config
}

/// Where rays begin in open scenes, world units, and why: what stands before all that the photos have in common is a
/// stranger.
fn nearest(scene: &Scene, data: &Dataset, centre: DVec3) -> (f64, String) {
    let cameras: Vec<Camera> = data.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect();
    let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
    if let Some(ranges) = depth_ranges(&cameras, &points, NEAR_PERCENTILE, NEAR_POINTS) {
        let nearest = ranges.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min);
        return (NEAR_POINT_SHARE * nearest, format!("{NEAR_POINT_SHARE} of the nearest points' depth"));
    }
    let nearest = cameras.iter().map(|c| c.pose.c.distance(centre)).fold(f64::INFINITY, f64::min);
    (NEAR_SHARE * nearest, format!("{NEAR_SHARE} of the nearest camera's distance from the centre"))
}

/// Of the depths of the points in a photo, this percentile is the nearest that is trusted; photos with fewer points are not.
const NEAR_PERCENTILE: f64 = 0.02;
const NEAR_POINTS: usize = 20;
/// Rays begin at this share of it.
const NEAR_POINT_SHARE: f64 = 0.7;
/// Without points: at this share of the nearest camera's distance from the centre.
const NEAR_SHARE: f64 = 0.35;

/// Photos below this longest side are judged by patches of half the size.
const SMALL_PHOTO: u32 = 320;

/// `--set` for the method and for the field.
fn split(run: &RunOptions, ours: &toml::Table) -> (RunOptions, RunOptions) {
    let keep = |mine: bool| RunOptions {
        set: run
            .set
            .iter()
            .filter(|(key, _)| ours.contains_key(*key) == mine)
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect(),
        ..run.clone()
    };
    (keep(true), keep(false))
}

/// The method of a pair of parts; `None` where the photos show the scene as it is.
fn method(
    config: &WildConfig,
    scene: &Scene,
    data: &Dataset,
    seed: u64,
) -> Result<Option<Box<dyn Method>>, SystemError> {
    let light = Light::new(config, data, seed)?;
    Ok(match config.occluders {
        OccluderKind::None if light.is_none() => None,
        OccluderKind::None if config.appearance == AppearanceKind::Encoder => {
            Some(Box::new(HaNerf::new(config, light, data, seed)?))
        }
        OccluderKind::Visibility => Some(Box::new(HaNerf::new(config, light, data, seed)?)),
        OccluderKind::None | OccluderKind::Transient => Some(Box::new(NerfW::new(config, light, data, seed))),
        OccluderKind::Robust => Some(Box::new(RobustNerf::new(config, light, data)?)),
        OccluderKind::Masks => Some(Box::new(Hugs::new(config, light, scene, data)?)),
        OccluderKind::Filter => Some(Box::new(SfNerf::new(config, light, scene, data, seed)?)),
    })
}
