//! What do these photos need? The system built from its name: its parts, and its field.

use super::auto;
use super::choice::{AppearanceKind, Choice, FieldKind, OccluderKind};
use super::combined::Wild;
use super::planning::{AppearancePlan, OccluderPlan, Planning};
use super::{ha_nerf, hugs, nerf_w, robust_nerf, sf_nerf};
use crate::limits::refuse;
use crate::occluders::outliers::Backdrop;
use crate::papers::static_scenes::nerf;
use crate::photo_model::{Drawing, PhotoModel};
use crate::plan::{Ask, Built, chosen_sampler, field_settings, planned};
use crate::rays::HeadConfig;
use engine::options::RunOptions;
use engine::system::{System, SystemError};

/// The plans of a pair of parts. `None` for an appearance that all photos have; for occluders where nothing is known of the
/// photos at all.
fn plans(choice: Choice) -> (Option<AppearancePlan>, Option<OccluderPlan>) {
    use AppearanceKind as A;
    use OccluderKind as O;
    let appearance: Option<AppearancePlan> = match choice.appearance {
        A::None => None,
        A::Codes => Some(nerf_w::appearance),
        A::Encoder => Some(ha_nerf::appearance),
    };
    let occluders: Option<OccluderPlan> = match (choice.occluders, choice.appearance) {
        (O::None, A::None) => None,
        (O::None, A::Codes) => Some(nerf_w::no_occluders),
        (O::None, A::Encoder) => Some(ha_nerf::no_occluders),
        (O::Transient, _) => Some(nerf_w::occluders),
        (O::Visibility, _) => Some(ha_nerf::occluders),
        (O::Robust, _) => Some(robust_nerf::occluders),
        (O::Masks, _) => Some(hugs::occluders),
        (O::Filter, _) => Some(sf_nerf::occluders),
    };
    (appearance, occluders)
}

/// A system of these parts; `None`: those that the photos need.
pub(crate) fn build(ask: Ask<'_>, parts: Option<(AppearanceKind, OccluderKind)>) -> Built {
    let mut ground = ask.ground()?;
    let Ask { scene, data, run, .. } = ask;
    let (appearance, occluders) = match parts {
        Some(parts) => parts,
        // A resumed run has both in its settings: nothing is left to be found out.
        None if run.set.contains_key("appearance") && run.set.contains_key("occluders") => Default::default(),
        None => auto::needs(&mut ground, data, run)?,
    };
    let backdrop = Backdrop::new(ground.background);
    let mut planning =
        Planning::new(Choice { field: FieldKind::Ngp, appearance, occluders }, scene, data, run, backdrop);
    planning.choice = planning.settings.of(&planning.choice)?;
    refuse_absent(&planning)?;
    let photo_model = photo_model(&mut planning)?;
    let Planning { choice, mut settings, lines, of_field, .. } = planning;
    ground.lines.extend(lines);
    let (system, config): (Box<dyn System>, _) = match choice.field {
        FieldKind::Ngp => {
            let mut planned = field_settings(&mut ground, data);
            planned.terms.sparsity = of_field.sparsity;
            if of_field.transient {
                planned.head = Some(HeadConfig::default());
                planned.batch.batch_samples += planned.batch.batch_samples / 2;
                let samples = planned.batch.batch_samples;
                ground.lines.push(format!("batches: {samples} samples (rays have more of them with a transient part)"));
            }
            if let Some(Drawing::Patches(patches, _)) = photo_model.as_ref().map(|photo_model| photo_model.drawing())
                && planned.batch.rays_per_side > 1
            {
                planned.batch.rays_per_side = 1;
                let side = patches.side;
                let line = format!("rays: one a pixel (patches of {side}x{side} pixels instead of more rays)");
                ground.lines.push(line);
            }
            let config = chosen_sampler(planned, &mut settings)?;
            let all = settings.all()?;
            (Box::new(ground.ngp(data, &config, run.seed, photo_model)?), all)
        }
        FieldKind::Mlp => {
            let mut planned = nerf::settings(&ground);
            planned.training.sparsity = of_field.sparsity;
            let config = planned.asked(&mut settings)?;
            let all = settings.all()?;
            (Box::new(nerf::system(&ground, data, &config, run.seed, photo_model)?), all)
        }
    };
    Ok((system, planned(ground, config)))
}

/// The photo model of the parts; `None` where the photos show the scene as it is.
fn photo_model(planning: &mut Planning<'_>) -> Result<Option<Box<dyn PhotoModel>>, SystemError> {
    let (appearance, occluders) = plans(planning.choice);
    let appearance = appearance.map(|plan| plan(planning)).transpose()?;
    let Some(occluders) = occluders else { return Ok(None) };
    let occluders = occluders(planning)?;
    let appearance = appearance.map(|build| build()).transpose()?;
    Ok(Some(Box::new(Wild { name: planning.choice.name(), appearance, occluders: occluders()? })))
}

/// Refuse settings of parts that are not there, naming the part that has them.
fn refuse_absent(planning: &Planning<'_>) -> Result<(), SystemError> {
    let choice = planning.choice;
    let there = names_of(planning, choice)?;
    let unknown: Vec<&String> = planning.run.set.keys().filter(|name| !there.contains(name)).collect();
    if unknown.is_empty() {
        return Ok(());
    }
    for (setting, word, other) in others(choice) {
        let names = names_of(planning, other)?;
        if let Some(name) = unknown.iter().find(|name| names.contains(name)) {
            let here = match setting {
                "appearance" => word_of(choice.appearance),
                _ => word_of(choice.occluders),
            };
            return refuse(
                "set",
                name,
                format!("is a setting of `{setting} = \"{word}\"`, and here `{setting}` is \"{here}\""),
            );
        }
    }
    Ok(())
}

/// The parts that are not there, each in the place of one that is: the setting that chooses it, its word, and the choice.
fn others(choice: Choice) -> impl Iterator<Item = (&'static str, String, Choice)> {
    use AppearanceKind as A;
    use OccluderKind as O;
    let occluders = [O::Robust, O::Transient, O::Visibility, O::Filter, O::Masks];
    let occluders = occluders.into_iter().filter(move |kind| *kind != choice.occluders);
    let appearances = [A::Codes, A::Encoder].into_iter().filter(move |kind| *kind != choice.appearance);
    appearances
        .map(move |appearance| ("appearance", word_of(appearance), Choice { appearance, ..choice }))
        .chain(occluders.map(move |occluders| ("occluders", word_of(occluders), Choice { occluders, ..choice })))
}

/// A part by its word on the command line.
fn word_of<K: serde::Serialize>(kind: K) -> String {
    toml::Value::try_from(kind).ok().and_then(|word| word.as_str().map(str::to_string)).unwrap_or_default()
}

/// The names of the settings of these parts.
fn names_of(planning: &Planning<'_>, choice: Choice) -> Result<Vec<String>, SystemError> {
    let run = RunOptions { set: toml::Table::new(), ..planning.run.clone() };
    let Planning { scene, data, backdrop, .. } = *planning;
    let mut dry = Planning::new(choice, scene, data, &run, backdrop);
    let (appearance, occluders) = plans(choice);
    // What a plan would build is of no interest here.
    appearance.map(|plan| plan(&mut dry).map(drop)).transpose()?;
    occluders.map(|plan| plan(&mut dry).map(drop)).transpose()?;
    Ok(dry.settings.known().keys().cloned().collect())
}
