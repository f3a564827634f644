//! What do these photos need? The system built from its name, its parts and its field.

use super::config::{AppearanceKind, FieldKind, OccluderKind, WildConfig};
use super::ha_nerf::HaNerf;
use super::hugs::Hugs;
use super::known::known;
use super::light::Light;
use super::look;
use super::nerf_w::NerfW;
use super::photo_judge::Backdrop;
use super::pretrained::FilterStart;
use super::robust_nerf::RobustNerf;
use super::sf_nerf::SfNerf;
use crate::method::Method;
use crate::papers::static_scenes::nerf::NerfConfig;
use crate::plan::{
    Ground, NO_PARALLAX, Settings, chosen_sampler, field_settings, refuse_unknown, settings, split, table,
};
use crate::rays::HeadConfig;
use engine::data::Dataset;
use engine::options::{Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;
use serde::Serialize;

/// Build the system `name` for a scene.
///
/// # Errors
/// As [`crate::registry::build`], and for photos that a method cannot work with.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let mut ground = Ground::of(scene, data, run)?;
    let asked = |key: &str| run.set.get(key).is_some();
    let (claim, parts) = known(name)?;
    ground.lines.extend(claim.line());
    let (appearance, occluders) = match parts {
        Some(parts) => parts,
        // Nothing is left to be found out: a resumed run is told again.
        None if asked("appearance") && asked("occluders") => (AppearanceKind::None, OccluderKind::None),
        None => look::needs(&mut ground, data, run)?,
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
        if uses_patches(&wild) && !asked("patch") && !asked("patch_inner") {
            ground.lines.push(format!(
                "patches: {0}x{0}, inner {1}x{1}: half as large as elsewhere (photos of {longest} pixels, below {SMALL_PHOTO})",
                wild.patch, wild.patch_inner
            ));
        }
    }
    let mut wild: WildConfig = settings(&wild, &ours)?;
    wild.check()?;
    let start = FilterStart::of(&mut wild)?;
    if wild.occluders == OccluderKind::Filter {
        ground.lines.push(start.line(wild.filter_freeze));
    }
    let backdrop = Backdrop::new(ground.background);
    let method = method(&wild, scene, data, (start, run.seed), backdrop)?;
    let sparsity = if wild.occluders == OccluderKind::Filter { SPARSITY } else { 0.0 };
    let (system, config): (Box<dyn System>, _) = match field {
        FieldKind::Ngp => {
            let mut planned = field_settings(&mut ground, data);
            planned.terms.sparsity = sparsity;
            if wild.occluders == OccluderKind::Transient {
                planned.head = Some(HeadConfig::default());
                planned.batch.batch_samples += planned.batch.batch_samples / 2;
                let samples = planned.batch.batch_samples;
                ground.lines.push(format!("batches: {samples} samples (rays have more of them with a transient part)"));
            }
            if wild.draws_patches() && planned.batch.rays_per_side > 1 {
                planned.batch.rays_per_side = 1;
                let side = wild.patch_side();
                let line = format!("rays: one a pixel (patches of {side}x{side} pixels instead of more rays)");
                ground.lines.push(line);
            }
            let mut settings = Settings::new(&fields);
            let config = chosen_sampler(planned, &mut settings)?;
            let mut field = settings.known().clone();
            field.extend(table(&wild));
            refuse_unknown(run, &field)?;
            (Box::new(ground.ngp(data, &config, run.seed, method)?), settings.all()?)
        }
        FieldKind::Mlp => {
            let planned = NerfConfig { sparsity, ..ground.nerf_settings() };
            names_of(run, &wild, &planned)?;
            let config = settings(&planned, &fields)?;
            (Box::new(ground.nerf(data, &config, run.seed, method)?), table(&config))
        }
    };
    let mut all = table(&wild);
    all.extend(config);
    all.extend(run.set.get_key_value(NO_PARALLAX).map(|(k, v)| (k.clone(), v.clone())));
    let Ground { lines, background, error_budget, .. } = ground;
    Ok((system, Plan { lines, background, error_budget, config: all }))
}

/// SF-NeRF's weight of the prior on densities.
const SPARSITY: f32 = 1e-10;

/// Photos below this longest side are judged by patches of half the size.
const SMALL_PHOTO: u32 = 320;

/// Whether masks are found by patches.
fn uses_patches(wild: &WildConfig) -> bool {
    matches!(wild.occluders, OccluderKind::Robust | OccluderKind::Masks)
}

/// Refuse what is a setting neither of the method nor of the field.
fn names_of<C: Serialize>(run: &RunOptions, wild: &WildConfig, field: &C) -> Result<(), SystemError> {
    let mut known = table(wild);
    known.extend(table(field));
    refuse_unknown(run, &known)
}

/// The method of a pair of parts; `None` where the photos show the scene as it is.
fn method(
    config: &WildConfig,
    scene: &Scene,
    data: &Dataset,
    (start, seed): (FilterStart, u64),
    backdrop: Backdrop,
) -> Result<Option<Box<dyn Method>>, SystemError> {
    let light = Light::new(config, data, seed)?;
    Ok(match config.occluders {
        OccluderKind::None if light.is_none() => None,
        OccluderKind::None if config.appearance == AppearanceKind::Encoder => {
            Some(Box::new(HaNerf::new(config, light, data, seed)?))
        }
        OccluderKind::Visibility => Some(Box::new(HaNerf::new(config, light, data, seed)?)),
        OccluderKind::None | OccluderKind::Transient => Some(Box::new(NerfW::new(config, light, data, seed))),
        OccluderKind::Robust => Some(Box::new(RobustNerf::new(config, light, data, backdrop)?)),
        OccluderKind::Masks => Some(Box::new(Hugs::new(config, light, scene, data, backdrop)?)),
        OccluderKind::Filter => Some(Box::new(SfNerf::new(config, light, scene, data, (start, seed))?)),
    })
}
