//! NR-NeRF's axes, by patches found again in other pictures.

use super::data;
use glam::DVec2;
use render_core::camera::{Camera, Pose};
use scene_io::{ImageStore, LoadOptions, StoreOptions, load};

/// Poses of `precomputed.json` are in OpenGL axes: what does not move in the video fits its epipolar lines in these
/// axes and in no others. Patches of one picture are looked for in one three frames later.
#[test]
fn nr_nerf_axes_fit_the_pictures() {
    let Some(path) = data("nr_nerf/example_sequence") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    let store = ImageStore::new(&scene.frames, StoreOptions::default().with_longest_side(256)).unwrap();
    // Had the columns been LLFF's (down, right, backwards), the axes would have been these.
    let as_llff = |camera: &Camera| {
        let r = camera.pose.r;
        Camera { pose: Pose { r: glam::DMat3::from_cols(-r.y_axis, r.x_axis, r.z_axis), ..camera.pose }, ..*camera }
    };
    let [mut off, mut wrong] = [Vec::new(), Vec::new()];
    for first in (0..80).step_by(8) {
        let (a, b) = (store.get(first).unwrap(), store.get(first + 3).unwrap());
        let (from, to) = (store.camera(first), store.camera(first + 3));
        for y in (24..168).step_by(12) {
            for x in (24..232).step_by(12) {
                let Some((u, v)) = matched(&a, &b, x, y) else { continue };
                let [here, there] = [(x, y), (u, v)].map(|(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                off.extend(off_the_ray(from, to, here, there));
                wrong.extend(off_the_ray(&as_llff(from), &as_llff(to), here, there));
            }
        }
    }
    assert!(off.len() > 20, "only {} patches found again", off.len());
    let [off, wrong] = [off, wrong].map(|mut off| {
        off.sort_by(f64::total_cmp);
        off[off.len() / 2]
    });
    // Patches are found to whole pixels, and some belong to what moves: about a pixel is what can be asked.
    let what = format!("half of the patches are more than {off} px off their rays, {wrong} in other axes");
    assert!(off < 1.5 && wrong > 3.0 * off, "{what}");
}

/// How far `there` in one picture is from the ray of `here` in another, at whatever depth is best.
fn off_the_ray(from: &Camera, to: &Camera, here: DVec2, there: DVec2) -> Option<f64> {
    let ray = from.ray(here)?;
    let at = |k: i32| to.project(ray.o + ray.d * (0.05 * 1.02_f64.powi(k))).map(|p| p.distance(there));
    (0..200).filter_map(at).reduce(f64::min)
}

/// Where a patch of 9x9 pixels is found again, if it has texture, is found for sure and has moved.
fn matched(a: &scene_io::Image, b: &scene_io::Image, x: u32, y: u32) -> Option<(u32, u32)> {
    const HALF: i64 = 4;
    let patch = |image: &scene_io::Image, x: i64, y: i64| -> Vec<f64> {
        let at = |k: i64| image.pixel((x + k % 9 - HALF) as u32, (y + k / 9 - HALF) as u32)[1];
        let values: Vec<f64> = (0..81).map(|k| f64::from(at(k))).collect();
        let mean = values.iter().sum::<f64>() / 81.0;
        values.iter().map(|v| v - mean).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (x, y) = (i64::from(x), i64::from(y));
    let here = patch(a, x, y);
    let norm = dot(&here, &here);
    if norm < 81.0 * 400.0 {
        return None;
    }
    let mut best = (0.0, 0, 0);
    for v in -12..=12 {
        for u in -12..=12 {
            let there = patch(b, x + u, y + v);
            let likeness = dot(&here, &there) / (norm * dot(&there, &there)).sqrt().max(1e-9);
            if likeness > best.0 {
                best = (likeness, u, v);
            }
        }
    }
    let (likeness, u, v) = best;
    (likeness > 0.97 && u * u + v * v >= 4).then_some(((x + u) as u32, (y + v) as u32))
}
