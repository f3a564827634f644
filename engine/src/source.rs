//! Scenes by word: files, or one of the embedded synthetic scenes.

use crate::error::RunError;
use crate::options::DataOptions;
use scene_io::synthetic::{
    Drawn, Mouth, MouthOptions, Orbit, OrbitMotion, OrbitOptions, PlazaOptions, TabletopOptions, TissueOptions, mouth,
    orbit, plaza, tabletop, tissue,
};
use scene_io::{Depth, PerturbationKind, Report, Scene, TrainPhotos};
use std::path::Path;

/// What embedded scenes begin with.
pub const SYNTHETIC: &str = "synthetic:";
/// What perturbed scenes begin with: `perturbed:c:SCENE`, `perturbed:o:SCENE`, `perturbed:co:SCENE`.
pub const PERTURBED: &str = "perturbed:";
/// Seed of the perturbations: that of the protocol.
const SEED: u64 = 0;

/// The scene a word or path names: `synthetic:tabletop`, `synthetic:orbit`, the same without what moves (`synthetic:orbit-empty`),
/// filmed by a camera that walks (`synthetic:walk`), `synthetic:mouth`, `synthetic:tissue`, `synthetic:plaza`, or a dataset;
/// `perturbed:` before either disturbs its training views (see [`scene_io::perturb`]).
///
/// # Errors
/// [`RunError::Scene`] for datasets that cannot be read, [`RunError::Option`] for words that mean nothing.
pub fn load(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    if let Some((what, inner)) = perturbed(spec)? {
        return Ok(scene_io::perturb(load(inner, data)?, what, SEED));
    }
    match spec.strip_prefix(SYNTHETIC) {
        Some(name) => as_asked(synthetic(name, data)?, data),
        None => Ok(scene_io::load(Path::new(spec), &data.load_options()?)?),
    }
}

/// [`load`] for a scene that moves: images without times are in the order of time.
///
/// # Errors
/// As [`load`].
pub fn load_in_order(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    let mut scene = load(spec, data)?;
    scene.time_by_order();
    Ok(scene)
}

/// What is in a dataset and what is wrong with it.
///
/// # Errors
/// [`RunError::Option`] for words that mean nothing. Everything wrong with the dataset is in the report.
pub fn check(spec: &str, data: &DataOptions, depth: Depth) -> Result<Report, RunError> {
    if let Some((what, inner)) = perturbed(spec)? {
        let mut report = check(inner, data, depth)?;
        if let Some(scene) = report.scene.take() {
            let known = scene.notes.len();
            let scene = scene_io::perturb(scene, what, SEED);
            report.notes.extend_from_slice(&scene.notes[known..]);
            report.scene = Some(scene);
        }
        return Ok(report);
    }
    match spec.strip_prefix(SYNTHETIC) {
        Some(name) => Ok(Report::new(as_asked(synthetic(name, data)?, data)?, Vec::new(), depth)),
        None => Ok(scene_io::check(Path::new(spec), &data.load_options()?, depth)),
    }
}

/// What is done to which scene, where the word asks for a perturbation.
fn perturbed(spec: &str) -> Result<Option<(PerturbationKind, &str)>, RunError> {
    let Some(rest) = spec.strip_prefix(PERTURBED) else { return Ok(None) };
    let Some((what, inner)) = rest.split_once(':').filter(|(_, inner)| !inner.is_empty()) else {
        return Err(RunError::Option(format!("`{spec}`: write `{PERTURBED}c:SCENE`, `o:` or `co:`")));
    };
    if inner.starts_with(PERTURBED) {
        return Err(RunError::Option(format!("`{PERTURBED}`: stands twice; `{PERTURBED}co:SCENE` does both")));
    }
    let what = what.parse().map_err(|e| RunError::Option(format!("`{spec}`: {e}")))?;
    Ok(Some((what, inner)))
}

/// A scene that was not read from files, with the priors of the folder that `--priors` names, and the views held out that
/// `--validation` asks for. Before anything is perturbed: a view that is measured stays as it is.
///
/// # Errors
/// [`RunError::Scene`] for a folder that holds nothing of any training view, and for views that cannot be held out;
/// [`RunError::Option`] for words that mean nothing.
pub fn as_asked(mut scene: Scene, data: &DataOptions) -> Result<Scene, RunError> {
    if let Some(folder) = &data.priors {
        scene.take_priors(folder)?;
    }
    if let Some(validation) = data.validation()? {
        scene.hold_for_validation(&validation)?;
    }
    Ok(scene)
}

/// The scene behind `synthetic:orbit` and `synthetic:walk`, or `synthetic:mouth`, which is known exactly at every time; `None` for all
/// other words.
#[must_use]
pub fn drawn(spec: &str) -> Option<Drawn> {
    match spec.strip_prefix(SYNTHETIC)? {
        "orbit" | "walk" => {
            let OrbitOptions { seed, motion, .. } = OrbitOptions::default();
            Some(Drawn::Orbit(Orbit::new(seed, motion)))
        }
        "mouth" => Some(Drawn::Mouth(Mouth::new(MouthOptions::default().seed))),
        _ => None,
    }
}

fn synthetic(name: &str, data: &DataOptions) -> Result<Scene, RunError> {
    if data.holdout.is_some() {
        return Err(RunError::Option(format!(
            "`--holdout`: `{SYNTHETIC}{name}` has a split of its own; leave the option out"
        )));
    }
    let photos = data.load_options()?.train_photos;
    match name {
        "plaza" => Ok(plaza(&PlazaOptions { photos, ..PlazaOptions::default() })),
        "tabletop" | "orbit" | "orbit-empty" | "walk" | "mouth" | "tissue" if photos == TrainPhotos::Clean => {
            Err(RunError::Option(format!("`{SYNTHETIC}{name}` makes no difference between cluttered and clean photos")))
        }
        "tabletop" => Ok(tabletop(&TabletopOptions::default())),
        "orbit" => Ok(orbit(&OrbitOptions::default())),
        "orbit-empty" => Ok(orbit(&OrbitOptions { motion: OrbitMotion::Gone, ..OrbitOptions::default() })),
        "walk" => Ok(orbit(&OrbitOptions::walk())),
        "mouth" => Ok(mouth(&MouthOptions::default())),
        "tissue" => Ok(tissue(&TissueOptions::default())),
        other => Err(RunError::Option(format!(
            "there is no scene `{SYNTHETIC}{other}`; there are `{SYNTHETIC}tabletop`, `{SYNTHETIC}orbit`, \
             `{SYNTHETIC}orbit-empty`, `{SYNTHETIC}walk`, `{SYNTHETIC}mouth`, `{SYNTHETIC}tissue` and `{SYNTHETIC}plaza`"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::{ImageStore, Split, StoreOptions};

    #[test]
    fn the_mouth_is_known_by_name_and_has_a_validation_split_of_its_own() {
        let data = DataOptions { validation: Some("dataset".into()), ..DataOptions::default() };
        let scene = load_in_order("synthetic:mouth", &data).unwrap();
        assert_eq!([Split::Train, Split::Val, Split::Test].map(|split| scene.count(split)), [80, 8, 12]);
        assert!(scene.notes.iter().any(|note| note.contains("8 frames are held out")), "{:?}", scene.notes);
        let error = load("synthetic:mouths", &data).unwrap_err().to_string();
        assert!(error.contains("`synthetic:mouth`"), "{error}");
        let holdout = DataOptions { holdout: Some("every:8".into()), ..DataOptions::default() };
        assert!(matches!(load("synthetic:mouth", &holdout), Err(RunError::Option(_))));
    }

    #[test]
    fn the_walk_is_a_film_of_the_stage_with_validation_views_of_its_own() {
        let data = DataOptions { validation: Some("dataset".into()), ..DataOptions::default() };
        let scene = load_in_order("synthetic:walk", &data).unwrap();
        assert_eq!([Split::Train, Split::Val, Split::Test].map(|split| scene.count(split)), [24, 8, 12]);
        let train: Vec<_> = scene.split(Split::Train).map(|i| &scene.frames[i]).collect();
        let steps = train.windows(2).map(|pair| pair[0].camera.pose.c.distance(pair[1].camera.pose.c));
        assert!(steps.fold(0.0, f64::max) < 1.0, "it walks");
        assert!(train.windows(2).all(|pair| pair[0].time < pair[1].time));
    }

    #[test]
    fn scenes_of_no_files_take_priors_from_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let data = DataOptions { priors: Some(folder.path().to_path_buf()), ..DataOptions::default() };
        let error = load("synthetic:tabletop", &data).unwrap_err().to_string();
        assert!(error.contains("`--priors`") && error.contains("holds no flow"), "{error}");
        let mask = folder.path().join("motion_masks/train/r_000.png");
        std::fs::create_dir_all(mask.parent().unwrap()).unwrap();
        std::fs::write(&mask, "").unwrap();
        let scene = load("synthetic:tabletop", &data).unwrap();
        let found: Vec<_> = scene.frames.iter().filter_map(|frame| frame.priors.motion.mask.as_ref()).collect();
        assert_eq!(found, [&mask]);
    }

    #[test]
    fn the_empty_stage_has_the_cameras_of_the_full_one_and_other_pictures() {
        let [full, empty] = ["synthetic:orbit", "synthetic:orbit-empty"]
            .map(|word| load_in_order(word, &DataOptions::default()).unwrap());
        assert_eq!(full.frames.len(), empty.frames.len());
        for (a, b) in full.frames.iter().zip(&empty.frames) {
            assert_eq!((&a.name, a.time, a.camera), (&b.name, b.time, b.camera));
        }
        let first = |scene: &Scene| {
            let store = ImageStore::new(&scene.frames[..1], StoreOptions::default()).unwrap();
            store.get(0).unwrap().data.clone()
        };
        assert_ne!(first(&full), first(&empty));
    }

    #[test]
    fn words_name_scenes_that_are_known_at_every_time() {
        for word in ["synthetic:orbit", "synthetic:walk", "synthetic:mouth"] {
            assert_eq!(drawn(word).unwrap().at(0.25).time(), 0.25);
        }
        for word in ["orbit", "synthetic:tabletop", "synthetic:tissue", "perturbed:o:synthetic:orbit", ""] {
            assert!(drawn(word).is_none(), "{word}");
        }
    }

    #[test]
    fn perturbed_scenes_are_scenes_with_perturbed_training_views() {
        let data = DataOptions::default();
        let scene = load("perturbed:co:synthetic:plaza", &data).unwrap();
        let perturbed = scene.split(scene_io::Split::Train).filter(|i| scene.frames[*i].perturbation.is_some()).count();
        assert_eq!(perturbed, scene.count(scene_io::Split::Train) - 1);
        assert!(scene.split(scene_io::Split::Test).all(|i| scene.frames[i].perturbation.is_none()));
        let report = check("perturbed:o:synthetic:plaza", &data, Depth::Headers).unwrap();
        assert!(report.notes.iter().any(|n| n.contains("occluders, seed 0")), "{report}");
        let often = format!("{}synthetic:tabletop", "perturbed:c:".repeat(100_000));
        for wrong in ["perturbed:", "perturbed:c", "perturbed:c:", "perturbed:x:synthetic:tabletop", &often] {
            assert!(matches!(load(wrong, &data), Err(RunError::Option(_))), "{:.40}", wrong);
        }
    }
}
