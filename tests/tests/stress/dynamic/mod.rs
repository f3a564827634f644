//! Systems for scenes that move at the edge of their settings, of what a video can be, of what files say of motion, and of learning
//! rates.

mod learning_rates;
mod priors;
mod scenes;
mod settings;

pub(crate) use learning_rates::cases as learning_rates;
pub(crate) use priors::cases as priors;
pub(crate) use scenes::cases as scenes;
pub(crate) use settings::cases as settings;

use crate::common::{QUERY, TINY_NGP, learns, state_is_finite};
use engine::data::Dataset;
use engine::options::{Background, Plan, RunOptions, parse_set};
use engine::render::render;
use engine::system::{Query, System, SystemError};
use scene_io::Scene;
use scene_io::synthetic::{OrbitOptions, TissueOptions, orbit, tissue};
use stress::{Verdict, ensure, finite};

/// Settings with which a step takes milliseconds.
const SMALL: [&str; 8] = [
    "warp_width=8",
    "warp_depth=1",
    "ambient_width=8",
    "ambient_depth=1",
    "background_points=16",
    "plane_features=2",
    "plane_times=3",
    "refine_every=3",
];

/// Those that the published networks have not.
const OF_THE_FIELD: [&str; 10] = [
    "levels",
    "log2_table",
    "n_max",
    "geometry",
    "colour_layers",
    "occupancy",
    "batch_samples",
    "plane_features",
    "plane_times",
    "refine_every",
];

const STEPS: u64 = 5;

/// A stage of a few pixels.
fn stage(options: OrbitOptions) -> Scene {
    orbit(&OrbitOptions { width: 16, height: 16, test: 0, rays: 1, ..options })
}

fn usual_stage() -> Scene {
    stage(OrbitOptions { train: 6, ..OrbitOptions::default() })
}

/// Tissue of a few pixels; its held-out frames are left out.
fn operation(options: TissueOptions) -> Scene {
    let mut scene = tissue(&TissueOptions { width: 16, height: 12, rays: 1, ..options });
    scene.frames.retain(|frame| frame.split == scene_io::Split::Train);
    scene
}

fn usual_operation() -> Scene {
    operation(TissueOptions { frames: 4, ..TissueOptions::default() })
}

/// Build a system with settings written as on the command line; later ones win. It takes those of [`SMALL`] whose part it has.
fn build(name: &str, scene: &Scene, data: &Dataset, set: &[&str]) -> Result<(Box<dyn System>, Plan), SystemError> {
    let own: &[&str] = match name {
        "tineuvox" => &["voxels=12", "horizon=6", "voxels_every=0.33"],
        "k-planes" => &["plane_vertices=8", "plane_scales=[1,2]"],
        "4dgs" => &[
            "plane_vertices=8",
            "motion_width=8",
            "horizon=6",
            "motion_from=0.2",
            "max_splats=300",
            "densify_from=1",
            "densify_every=2",
        ],
        "degauss" => &[
            "plane_vertices=8",
            "motion_width=8",
            "horizon=6",
            "motion_from=0.2",
            "front_from=0.2",
            "front_count=200",
            "max_splats=300",
            "densify_from=1",
            "densify_every=2",
        ],
        "two-parts" => {
            &["moving_levels=4", "moving_n_max=32", "moving_log2_table=10", "batch_rays=2048", "batch_samples=16384"]
        }
        // What photos need is found out by a training.
        "nerfies" | "hypernerf" => &["appearance=none"],
        // Enough pixels that what moves is found by what they show, where it is looked for at all.
        "nsff" | "dynamic-nerf" if set.contains(&"moving_from=0.5") => &["batch_rays=2048", "batch_samples=16384"],
        // The others look at no depth.
        "endo-nerf" => &["cue_samples=8"],
        _ => &[],
    };
    let moves = scene.frames.iter().any(|frame| frame.time.is_some());
    // What stands in the place of the part that these are of; rays are chosen and depths refined where photos have times.
    let replaced = |s: &str| match s.split('=').next() {
        Some(key) if set.contains(&"field=mlp") && OF_THE_FIELD.contains(&key) => true,
        Some("width" | "geometry" | "colour_layers") => set.contains(&"decoder=explicit"),
        Some("occupancy") => set.contains(&"sampler=proposal"),
        Some("refine_every") => !moves,
        _ => false,
    };
    let small = TINY_NGP.iter().chain(&SMALL).filter(|s| has_part(name, s) && !replaced(s));
    let set = small.chain(own).chain(set).map(|s| parse_set(s).unwrap()).collect();
    let options = RunOptions { seed: 1, background: Some(Background::White), error_budget: None, stop: None, set };
    systems::registry::build(name, scene, data, &options)
}

/// Whether a system has the part that a setting is of.
fn has_part(name: &str, setting: &str) -> bool {
    let has = |systems: &[&str]| systems.contains(&name);
    match setting.split(['=', '_']).next().unwrap_or_default() {
        // A cloud has planes, and nothing else of these.
        _ if has(&["4dgs", "degauss"]) => setting.starts_with("plane_features") || setting.starts_with("plane_times"),
        "ambient" => has(&["hypernerf"]),
        "elastic" | "background" => has(&["nerfies", "hypernerf"]),
        "levels" | "log2" | "n" => !has(&["tineuvox", "k-planes"]),
        "plane" | "planes" => !has(&["ngp", "tineuvox", "two-parts"]),
        "time" if setting.starts_with("time_code") || setting.starts_with("time_input") => {
            !has(&["ngp", "k-planes", "two-parts"])
        }
        "warp" if ["warp_width", "warp_lr", "warp_warmup"].iter().any(|s| setting.starts_with(s)) => {
            !has(&["ngp", "k-planes", "two-parts"])
        }
        "warp" => !has(&["ngp", "k-planes", "two-parts", "t-nerf", "nsff", "dynamic-nerf"]),
        _ => true,
    }
}

/// It learns for a few steps: every loss and every gradient is finite, and so is all that it says afterwards.
fn trains(system: &mut dyn System, data: &Dataset, steps: u64) -> Verdict {
    learns(system, data, steps)?;
    is_sound(system, data)
}

/// What a checkpoint holds, and what it renders at some times, are numbers.
fn is_sound(system: &dyn System, data: &Dataset) -> Verdict {
    state_is_finite(system)?;
    let Some(view) = data.views().first() else { return Ok(()) };
    for time in [0.0, 0.3, 1.0] {
        let layers = render(system, &view.camera, &Query { time, ..QUERY }).layers;
        finite("rgb", layers.rgb.as_flattened())?;
        finite("opacity", &layers.opacity)?;
        finite("normal", layers.normal.as_flattened())?;
        ensure(layers.depth.iter().all(|d| *d >= 0.0), || format!("a depth at {time} is negative or NaN"))?;
    }
    Ok(())
}
