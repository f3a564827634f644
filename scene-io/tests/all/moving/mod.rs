//! Moving scenes: what each dialect gives, and what odd ones are promised: one line each.

mod depth;
mod endonerf;
mod nerfies;
mod nr_nerf;
mod times;

use crate::common::{Dataset, npy, poses_bounds, still_poses};
use glam::DVec3;
use proptest::prelude::*;
use scene_io::{
    Depth, DepthMeaning, DepthSource, Dialect, ErrorKind, FrameIds, Holdout, ImageStore, LayoutHint, LoadOptions,
    MaskPolarity, Masks, Scene, Severity, Split, StoreOptions, check, export, load, load_cameras,
};

fn plain(dataset: &Dataset) -> Scene {
    load(dataset.path(), &LoadOptions::default()).unwrap()
}

fn times(scene: &Scene) -> Vec<f64> {
    scene.frames.iter().map(|f| f.time.unwrap()).collect()
}

/// One line, holding all parts.
#[track_caller]
fn refused(dataset: &Dataset, parts: &[&str]) {
    refused_with(dataset, &LoadOptions::default(), parts);
}

#[track_caller]
fn refused_with(dataset: &Dataset, options: &LoadOptions, parts: &[&str]) {
    let text = load(dataset.path(), options).expect_err("the dataset is spoiled").to_string();
    assert!(!text.contains('\n'), "more than one line: {text}");
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

#[track_caller]
fn notes(scene: &Scene, parts: &[&str]) {
    for part in parts {
        let found: Vec<_> = scene.notes.iter().filter(|n| n.contains(part)).collect();
        assert_eq!(found.len(), 1, "`{part}` is in {found:?} of {:#?}", scene.notes);
        assert!(!found[0].contains('\n'));
    }
}

#[track_caller]
fn warns(dataset: &Dataset, part: &str) {
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let found =
        report.problems.iter().filter(|p| p.severity == Severity::Warning && p.to_string().contains(part)).count();
    assert_eq!(found, 1, "`{part}` in\n{report}");
    assert!(report.can_train(), "{report}");
}

#[test]
fn other_dialects_are_named_where_nothing_is_found() {
    let dataset = Dataset::new();
    dataset.write("README", "");
    let error = load(dataset.path(), &LoadOptions::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Layout);
    refused(&dataset, &["precomputed.json (nr-nerf)", "dataset.json with camera/ (nerfies)", "(endonerf)"]);
    for name in ["nr-nerf", "nerfies", "endonerf"] {
        let dialect: Dialect = name.parse().unwrap();
        assert_eq!(dialect.name(), name);
        let options = LoadOptions::default().with_dialect(dialect);
        refused_with(&dataset, &options, &[&format!("holds no {name} dataset")]);
    }
}
