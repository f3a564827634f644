//! SpotLessSplats as a system, with and without features beside the photos: same bits, masks that find what stands in the way and are worth it,
//! features that do not fit.

use crate::wild_clouds::{SIDE, planned, trained};
use engine::data::Dataset;
use engine::render::{plain_query, render};
use engine::system::System;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{PerturbationKind, Scene, perturb};
use std::path::{Path, PathBuf};
use tests::{assert_same_bits, state_after, views, write_features};

const NAME: &str = "spotless";
/// Cells of features along a side.
const CELLS: usize = 12;

fn scene(views: usize) -> Scene {
    let options =
        TabletopOptions { width: SIDE, height: SIDE, train: views, test: 2, rays: 1, ..TabletopOptions::default() };
    perturb(tabletop(&options), PerturbationKind::Occluder, 3)
}

fn is_hidden(scene: &Scene, train: &Dataset, view: usize, x: u32, y: u32) -> bool {
    let bars = scene.frames[train.view(view).frame].perturbation.as_ref().and_then(|p| p.bars);
    bars.is_some_and(|bars| bars.at(x, y).is_some())
}

/// Features beside each training photo, as a network would make them: two channels that tell apart what belongs to the scene, and noise.
fn with_features(scene: &mut Scene, train: &Dataset, folder: &Path) -> Vec<PathBuf> {
    let each = SIDE as usize / CELLS;
    let mut paths = Vec::new();
    for i in 0..train.len() {
        let path = folder.join(format!("{i}.features.npy"));
        let hidden = |cell: usize| {
            let (x, y) = ((cell % CELLS) * each + each / 2, (cell / CELLS) * each + each / 2);
            is_hidden(scene, train, i, x as u32, y as u32)
        };
        write_features(&path, [3, CELLS, CELLS], |k| {
            let (channel, cell) = (k / (CELLS * CELLS), k % (CELLS * CELLS));
            match (channel, hidden(cell)) {
                (0, true) | (1, false) => 2.0,
                (0 | 1, _) => -2.0,
                _ => ((7 * k + 5 * i) % 11) as f32 * 0.2 - 1.0,
            }
        });
        paths.push(path);
    }
    for (view, path) in train.views().iter().zip(&paths) {
        scene.frames[view.frame].priors.features = Some(path.clone());
    }
    paths
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let folder = tempfile::tempdir().unwrap();
    let mut featured = scene(8);
    let train = views(&featured, 1).0;
    with_features(&mut featured, &train, folder.path());
    let plain = scene(8);
    let often = ["densify_from=1", "densify_every=2", "densify_gradient=1e-6"];
    for (name, scene, set) in [
        ("spotless", &plain, &[][..]),
        ("spotless", &featured, &[]),
        ("wild-gaussians", &featured, &["occluders=features"]),
        ("spotless", &featured, &["occluders=errors", "start=field", "field_steps=3"]),
    ] {
        println!("{name} {set:?}");
        assert_same_bits(|steps, state| {
            let set: Vec<&str> = set.iter().copied().chain(often).collect();
            state_after(planned(name, scene, &train, &set).unwrap().0, &train, steps, state)
        });
    }
}

#[test]
fn a_state_holds_what_was_learnt_of_errors_and_features() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(6);
    let train = views(&scene, 1).0;
    let of = |scene: &Scene, set: &[&str]| {
        state_after(planned("spotless", scene, &train, set).unwrap().0, &train, 0..4, None)
    };
    let without = of(&scene, &[]);
    with_features(&mut scene, &train, folder.path());
    let with = of(&scene, &[]);
    assert!(without.contains_key("masks.errors") && !without.contains_key("masks.network"));
    assert!(with.contains_key("masks.errors") && with.contains_key("masks.network"));
    let error = planned("spotless", &scene, &train, &[]).unwrap().0.load_state(&without).unwrap_err();
    assert!(error.to_string().contains("masks.network"), "{error}");
    // Features are asked for or not: without them the cloud is the same.
    assert!(of(&scene, &["occluders=errors"]) == without);
}

/// F1 of the masks, and the share of what is hidden that they find.
fn found(scene: &Scene, train: &Dataset, system: &dyn System) -> (f64, f64) {
    let (mut right, mut marked, mut hidden) = (0.0, 0.0, 0.0);
    for view in 0..train.len() {
        let mask = system.visibility(train, view).unwrap().unwrap();
        for (i, counts) in mask.iter().enumerate() {
            let was_hidden = is_hidden(scene, train, view, i as u32 % SIDE, i as u32 / SIDE);
            let was_marked = *counts == 0.0;
            right += f64::from(u8::from(was_hidden && was_marked));
            marked += f64::from(u8::from(was_marked));
            hidden += f64::from(u8::from(was_hidden));
        }
    }
    (2.0 * right / (marked + hidden), right / hidden)
}

/// Root of the mean square error of views that were not trained on.
fn error_of_others(test: &Dataset, system: &dyn System) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for view in 0..test.len() {
        let rgb = render(system, &test.view(view).camera, &plain_query([1.0; 3], 0.0)).layers.rgb;
        let photo = test.image(view).unwrap();
        for (rgb, p) in rgb.iter().zip(photo.data.chunks(usize::from(photo.channels))) {
            let alpha = p.get(3).map_or(1.0, |a| f32::from(*a) / 255.0);
            let truth = [0, 1, 2].map(|c| f32::from(p[c]) / 255.0 * alpha + 1.0 - alpha);
            sum += rgb.iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
            count += 3;
        }
    }
    (sum / count as f32).sqrt()
}

#[test]
fn masks_find_what_stands_before_the_scene_and_those_of_features_are_worth_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(24);
    let (train, test) = views(&scene, 1);
    let none = trained(NAME, &scene, &train, &["occluders=none"], 600);
    let off = error_of_others(&test, none.as_ref());
    let errors = trained(NAME, &scene, &train, &[], 600);
    let (by_errors, (f1, share)) = (error_of_others(&test, errors.as_ref()), found(&scene, &train, errors.as_ref()));
    println!("none: off by {off}; errors: {by_errors}, F1 {f1:.2}, {share:.2} found");
    let fewer = trained(NAME, &scene, &train, &["inlier_share=0.9"], 600);
    let (by_fewer, f1_of_fewer) = (error_of_others(&test, fewer.as_ref()), found(&scene, &train, fewer.as_ref()).0);
    println!("errors, fewer left out: off by {by_fewer}, F1 {f1_of_fewer:.2}");
    assert!(f1_of_fewer > f1);
    with_features(&mut scene, &train, folder.path());
    let features = trained(NAME, &scene, &train, &[], 600);
    let by_features = error_of_others(&test, features.as_ref());
    let (f1_of_features, share_of_features) = found(&scene, &train, features.as_ref());
    println!("features: off by {by_features}, F1 {f1_of_features:.2}, {share_of_features:.2} found");
    // A share of 0.3 is left out whatever there is: here that is most of the thing, too.
    assert!(share > 0.9 && f1_of_features > 0.75 && share_of_features > 0.7);
    assert!(by_features < 0.97 * off, "off by {by_features} with features, {off} without masks");
}

#[test]
fn features_that_are_missing_or_do_not_fit_are_named_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(4);
    let train = views(&scene, 1).0;
    let refused = |name: &str, scene: &Scene, set: &[&str]| {
        let error = planned(name, scene, &train, set).map(|_| ()).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    // None at all: only where they are demanded; the plan says which masks there are.
    let said = |scene: &Scene, what: &str| {
        let lines = planned("spotless", scene, &train, &[]).unwrap().1.lines;
        assert!(lines.iter().any(|line| line.starts_with("occluders") && line.contains(what)), "{lines:?}");
    };
    said(&scene, "RobustFilter");
    for name in ["spotless", "wild-gaussians"] {
        let error = refused(name, &scene, &["occluders=features"]);
        assert!(error.contains(".features.npy") && error.contains("occluders=errors"), "{error}");
    }
    let paths = with_features(&mut scene, &train, folder.path());
    said(&scene, "SLS-mlp");
    // Vectors of another length.
    write_features(&paths[2], [4, 3, 3], |_| 0.0);
    for name in ["spotless", "wild-gaussians"] {
        let error = refused(name, &scene, &["occluders=features"]);
        assert!(error.contains("2.features.npy: holds 4 channels"), "{error}");
    }
    // One is missing.
    with_features(&mut scene, &train, folder.path());
    let frame = train.view(1).frame;
    scene.frames[frame].priors.features = None;
    let error = refused("spotless", &scene, &[]);
    assert!(error.contains(&scene.frames[frame].name) && error.contains("occluders=errors"), "{error}");
    assert!(planned("spotless", &scene, &train, &["occluders=errors"]).is_ok());
}

#[test]
fn a_setting_that_cannot_work_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(2);
    let train = views(&scene, 1).0;
    let named = |scene: &Scene, set: &str, word: &str| {
        let error = planned("spotless", scene, &train, &[set]).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(word)), "{word}: {error:?}");
    };
    for (set, word) in [
        ("inlier_share=1.5", "inlier_share"),
        ("chance_fade=-1.0", "chance_fade"),
        ("occluders=clusters", "occluders"),
        ("mask_lr=0.1", "mask_lr"),
    ] {
        named(&scene, set, word);
    }
    with_features(&mut scene, &train, folder.path());
    for (set, word) in
        [("mask_lr=0.0", "mask_lr"), ("inlier_least=0.95", "inlier_least"), ("inlier_share=0.5", "inlier_share")]
    {
        named(&scene, set, word);
    }
}
