//! Systems for scenes that move: each learns, shows the time asked for, and makes the same bits with any number of
//! threads and after a resume. What a part adds is nothing where the part is switched off.

mod linear_maps;
mod settings;
mod still_part;
mod switched_off;
mod training;

use engine::data::Dataset;
use engine::options::Plan;
use engine::render::{plain_query, render};
use engine::system::{Layers, Query, System, TensorData, TensorMap};
use scene_io::synthetic::{OrbitOptions, TissueOptions, orbit, tissue};
use scene_io::{Image, ImageSource, Point, Scene};
use std::ops::Range;
use std::sync::Arc;
use tests::state_after;

/// Settings with which a step takes milliseconds; a system takes those that its parts have.
const SMALL: [&str; 14] = [
    // What photos need is found out by a training.
    "appearance=none",
    "levels=4",
    "log2_table=12",
    "n_max=64",
    "width=16",
    "geometry=8",
    "occupancy=16",
    "batch_rays=512",
    "batch_samples=8192",
    "warp_width=16",
    "warp_depth=2",
    "ambient_width=16",
    "ambient_depth=2",
    "cue_samples=16",
];

/// What each system needs to be small, so that each of its schedules has something to do within six steps.
pub(super) fn schedules(name: &str) -> &'static [&'static str] {
    match name {
        "d-nerf" => &[
            "horizon=6",
            "curriculum=0.8",
            "planes=[4,8]",
            "plane_features=2",
            "plane_times=4",
            "levels_anneal=4",
            "coherence=0.5",
        ],
        "nerfies" => &[
            "horizon=6",
            "warp_anneal=0.67",
            "elastic=0.5",
            "elastic_at=all",
            "background_loss=1.0",
            "background_points=32",
            "appearance=codes",
        ],
        "hypernerf" => {
            &["horizon=6", "warp_anneal=0.67", "ambient_from=0.3", "ambient_anneal=0.5", "background_points=32"]
        }
        // Doubled after steps 2, 4 and 6.
        "tineuvox" => &["horizon=6", "voxels=24", "voxels_every=0.33", "voxel_variation=0.01"],
        "k-planes" => &["plane_vertices=8", "plane_scales=[1,2]", "plane_features=4"],
        // What moves comes after half of the steps, from enough pixels to be found.
        "two-parts" => &[
            "moving_levels=4",
            "moving_n_max=32",
            "moving_log2_table=10",
            "batch_rays=1024",
            "batch_samples=16384",
            "horizon=60",
            "moving_from=0.5",
        ],
        // Depths give way before steps 2 and 4.
        "endo-nerf" => &["refine_every=2", "refine_share=0.3"],
        // What moves comes after half of the steps, from enough pixels to be found; then chains come, and priors fade
        // three times.
        "nsff" | "dynamic-nerf" => &[
            "batch_rays=1024",
            "batch_samples=16384",
            "horizon=60",
            "moving_from=0.5",
            "flow_chain_from=0.67",
            "flow_fades_in=0.17",
            "planes=[4,8]",
            "plane_features=2",
            "plane_times=4",
        ],
        // It moves from step 2 on, and Gaussians come and go after every second one.
        "4dgs" => &[
            "start=random",
            "start_count=300",
            "max_splats=600",
            "horizon=6",
            "densify_from=1",
            "densify_every=2",
            "densify_gradient=1e-6",
            "motion_from=0.33",
            "motion_width=8",
            "plane_vertices=8",
            "plane_features=4",
            "plane_times=4",
        ],
        // The same, with a cloud in front from step 2 on.
        "degauss" => &[
            "start=random",
            "start_count=300",
            "max_splats=600",
            "horizon=6",
            "densify_from=1",
            "densify_every=2",
            "densify_gradient=1e-6",
            "front_from=0.33",
            "front_count=300",
            "front_max=500",
            "motion_from=0.33",
            "motion_width=8",
            "plane_vertices=8",
            "plane_features=4",
            "plane_times=4",
        ],
        _ => &[],
    }
}

/// Ten steps for each one: schedules of sixty in the place of six.
pub(super) fn of_sixty(steps: Range<u64>) -> Range<u64> {
    10 * steps.start..10 * steps.end
}

/// A small stage, with a few points of what stays where it is.
pub(super) fn stage() -> Scene {
    let options = OrbitOptions { width: 32, height: 32, train: 20, test: 1, rays: 1, ..OrbitOptions::default() };
    let mut scene = orbit(&options);
    let at = |k: u32| [f64::from(k % 4) * 0.2 - 0.3, f64::from(k / 4) * 0.2 - 0.3, 0.0];
    scene.points = (0..16).map(|k| Point { xyz: at(k).into(), rgb: [90; 3] }).collect();
    scene
}

/// Tissue behind a tool, with stereo depth.
pub(super) fn operation() -> Scene {
    tissue(&TissueOptions { width: 32, height: 24, frames: 6, rays: 1, ..TissueOptions::default() })
}

/// The stage before white, without alpha, all of it at time 0.
pub(super) fn stopped() -> Scene {
    let mut scene = stage();
    scene.points.clear();
    for frame in &mut scene.frames {
        frame.time = Some(0.0);
        let ImageSource::Memory(image) = &frame.image else { panic!("drawn in memory") };
        let over_white = |p: &[u8]| {
            let a = u32::from(p[3]);
            [0, 1, 2].map(|c| ((u32::from(p[c]) * a + 255 * (255 - a)) / 255) as u8)
        };
        let rgb = image.data.chunks_exact(4).flat_map(over_white).collect();
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(image.width, image.height, rgb).unwrap()));
    }
    scene
}

/// The scene a system is for.
pub(super) fn scene_of(name: &str) -> Scene {
    if name == "endo-nerf" { operation() } else { stage() }
}

/// Whether a system has the part that a setting of [`SMALL`] is of.
fn has_part(name: &str, setting: &str) -> bool {
    let has = |systems: &[&str]| systems.contains(&name);
    match setting.split('=').next().unwrap() {
        // A cloud has no rays.
        _ if has(&["4dgs", "degauss"]) => false,
        "levels" | "log2_table" | "n_max" => !has(&["tineuvox", "k-planes"]),
        "warp_width" => !has(&["ngp", "k-planes", "two-parts"]),
        "warp_depth" => !has(&["ngp", "k-planes", "two-parts", "t-nerf", "nsff", "dynamic-nerf"]),
        "ambient_width" | "ambient_depth" => has(&["hypernerf"]),
        "appearance" => has(&["nerfies", "hypernerf"]),
        _ => true,
    }
}

/// A system with those settings of [`SMALL`] that it has, then others.
pub(super) fn planned(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> (Box<dyn System>, Plan) {
    let small = SMALL.iter().filter(|s| has_part(name, s));
    tests::system(name, scene, train, &small.chain(set).copied().collect::<Vec<_>>())
}

/// The same without its plan.
pub(super) fn system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Box<dyn System> {
    planned(name, scene, train, set).0
}

/// What the first training camera sees at a time.
pub(super) fn seen(system: &dyn System, train: &Dataset, time: f64) -> Layers {
    render(system, &train.view(0).camera, &Query { time, ..plain_query([1.0; 3], 0.0) }).layers
}

/// The state after steps of a system's own training.
pub(super) fn trained(name: &str, scene: &Scene, train: &Dataset, set: &[&str], steps: u64) -> TensorMap {
    state_after(system(name, scene, train, set), train, 0..steps, None)
}

/// An array of a state.
pub(super) fn floats<'a>(state: &'a TensorMap, name: &str) -> &'a [f32] {
    match &state[name].data {
        TensorData::F32(data) => data,
        TensorData::U64(_) => panic!("{name} holds counters"),
    }
}
