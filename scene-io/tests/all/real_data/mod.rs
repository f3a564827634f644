//! Every published dataset we have, in its own layout. Skipped, and said so, where the data is not there.

mod axes;
mod motion;
mod moving;
mod reconstructed;
mod transforms;

use scene_io::{Depth, Holdout, ImageSource, LoadOptions, Scene, Split, check, load};
use std::path::PathBuf;

/// A dataset's folder, or `None` with a line on why the test is skipped.
fn data(relative: &str) -> Option<PathBuf> {
    testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), relative, "real_data")
}

fn counts(scene: &Scene) -> [usize; 4] {
    Split::ALL.map(|split| scene.count(split))
}

fn with(holdout: Holdout) -> LoadOptions {
    LoadOptions::default().with_holdout(holdout)
}

fn has_note(scene: &Scene, part: &str) {
    assert!(scene.notes.iter().any(|n| n.contains(part)), "no note holds `{part}`: {:#?}", scene.notes);
}

/// Share of the scene's points that every camera projects into its image, and their mean over cameras.
fn share_in_view(scene: &Scene) -> f64 {
    let mut inside = 0;
    for frame in &scene.frames {
        let camera = frame.camera.prepare();
        for point in &scene.points {
            let pixel = camera.project(point.xyz);
            let (w, h) = (f64::from(frame.camera.width), f64::from(frame.camera.height));
            inside += usize::from(pixel.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h));
        }
    }
    inside as f64 / (scene.frames.len() * scene.points.len()) as f64
}

#[test]
fn poses_without_images_say_what_is_missing() {
    let Some(path) = data("endonerf/pulling_soft_tissues_poses_only") else { return };
    let error = load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds no folder of images: there are 63 poses"), "{error}");
    let Some(path) = data("davis/lady-running") else { return };
    let error = load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds 65 photos and no cameras") && error.contains("`prepare`"), "{error}");
}

#[test]
fn all_images_of_the_small_scenes_decode() {
    for relative in ["benchmarks/fox135", "nerf_llff_data/fern", "blender_rendered/plaza_photos"] {
        let Some(path) = data(relative) else { continue };
        let report = check(&path, &LoadOptions::default(), Depth::Pixels);
        assert!(report.can_train() && report.problems.is_empty(), "{report}");
        let scene = report.scene.unwrap();
        assert!(scene.frames.iter().all(|f| matches!(f.image, ImageSource::File(_))));
        assert!(report.image_bytes > 0);
    }
}
