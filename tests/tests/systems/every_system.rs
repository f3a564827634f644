//! Every system of the registry: the same bits with 1, 2 and 4 threads and after a resume, across updates of the occupancy grid and
//! changes in the number of Gaussians. A system that joins the registry is here without a line of its own.

use engine::options::parse_set;
use engine::system::TensorMap;
use scene_io::Scene;
use scene_io::synthetic::{OrbitOptions, TissueOptions, orbit, tissue};
use std::ops::Range;
use systems::registry::{Entry, Needs, entries};
use tests::{state_after, system, table, try_system, views};

const STEPS: u64 = 14;
/// Between two updates of the occupancy grid or two changes in the number of Gaussians, right after one, and right before one.
const CUTS: [u64; 3] = [5, 7, 9];
/// Of the cells of the occupancy grid.
const THICKNESS: &str = "occupancy.thickness";
/// One number for each Gaussian.
const OPACITIES: &str = "splats.logit";

/// Settings with which a step takes milliseconds, and with which what happens now and then happens within [`STEPS`]. A system takes
/// those that its parts have.
const SMALL: [&str; 54] = [
    // Before steps 0, 3, 6, 9 and 12.
    "occupancy_every=3",
    "occupancy=16",
    "levels=4",
    "log2_table=10",
    "n_max=64",
    "geometry=8",
    "width=16",
    "depth=2",
    "coarse=8",
    "fine=8",
    "samples=8",
    "proposal_samples=8",
    "proposal_width=8",
    "proposal_depth=1",
    "bottleneck=8",
    "view_width=8",
    "position_octaves=4",
    "octaves=4",
    "batch_rays=256",
    "batch_samples=4096",
    "warp_width=8",
    "warp_depth=1",
    "horizon=12",
    "warp_anneal=0.66",
    "ambient_width=8",
    "ambient_depth=1",
    "ambient_from=0.25",
    "ambient_anneal=0.5",
    "background_points=16",
    "elastic=0.1",
    "coherence=0.1",
    "curriculum=0.66",
    "plane_vertices=8",
    "plane_scales=[1,2]",
    "plane_times=3",
    "moving_levels=4",
    "moving_n_max=32",
    "moving_log2_table=10",
    "voxels=16",
    "voxels_every=0.33",
    "cue_samples=8",
    "refine_every=4",
    "refine_share=0.3",
    "judge_first=4",
    "warmup_steps=4",
    "encoder_channels=[4]",
    "encoder_side=16",
    "lattice=16",
    "filter_width=8",
    "start_count=200",
    "max_splats=2000",
    "densify_from=4",
    "densify_every=4",
    "densify_gradient=1e-6",
];

/// What `auto` finds out by a training, told to it.
const AUTO: [&str; 2] = ["appearance=\"codes\"", "occluders=\"robust\""];
/// What systems of scenes that move with codes of appearance find out, told to them.
const CODES: [&str; 1] = ["appearance=\"codes\""];

fn scene_of(entry: &Entry) -> Scene {
    let (width, height) = (24, 24);
    match entry.needs {
        Needs::Photos => table(width),
        // Stereo depth and masks are of use to it.
        Needs::Times if entry.claim.name == "endo-nerf" => {
            tissue(&TissueOptions { width, height, frames: 6, rays: 1, ..TissueOptions::default() })
        }
        Needs::Times => orbit(&OrbitOptions { width, height, train: 12, test: 1, rays: 1, ..OrbitOptions::default() }),
    }
}

/// The settings of [`SMALL`] that the system has, besides those it is given anyway.
fn settings(entry: &Entry, scene: &Scene) -> Vec<&'static str> {
    let name = entry.claim.name;
    let given: &[&str] = match name {
        "auto" => &AUTO,
        "nerfies" | "hypernerf" => &CODES,
        // Rays are drawn in one way: here by curriculum.
        "nsff" | "dynamic-nerf" => &["by_error=false"],
        _ => &[],
    };
    let (train, _) = views(scene, 1);
    let (_, plan) = try_system(name, scene, &train, given).unwrap_or_else(|e| panic!("{name}: {e}"));
    // Of clouds they halve pictures, and end the schedule of `splat` before there are Gaussians.
    let is_cloud = ["splat", "4dgs", "wild-gaussians", "spotless", "gs-w", "wild-gs", "degauss"].contains(&name);
    let is_other = |set: &str| {
        (is_cloud && set.starts_with("coarse="))
            || (["splat", "wild-gaussians", "spotless", "gs-w", "wild-gs"].contains(&name)
                && set.starts_with("horizon="))
    };
    let has = |set: &&&str| plan.config.contains_key(&parse_set(set).expect("written well").0) && !is_other(set);
    given.iter().chain(SMALL.iter().filter(has)).copied().collect()
}

fn on<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads").install(work)
}

#[test]
fn makes_the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let mut grids = 0;
    for entry in entries() {
        let name = entry.claim.name;
        let scene = scene_of(entry);
        let set = settings(entry, &scene);
        let run = |threads: usize, steps: Range<u64>, state: Option<&TensorMap>| {
            on(threads, || {
                let (train, _) = views(&scene, 1);
                state_after(system(name, &scene, &train, &set).0, &train, steps, state)
            })
        };
        let one = run(1, 0..STEPS, None);
        for threads in [2, 4] {
            assert!(run(threads, 0..STEPS, None) == one, "{name}: {threads} threads");
        }
        for at in CUTS {
            let half = run(2, 0..at, None);
            assert!(half != one, "{name} learns after step {at}");
            if one.contains_key(THICKNESS) {
                grids += 1;
                assert!(half[THICKNESS] != one[THICKNESS], "{name}: the grid is updated after step {at}");
            }
            if one.contains_key(OPACITIES) {
                assert!(half[OPACITIES].shape != one[OPACITIES].shape, "{name}: Gaussians come and go after step {at}");
            }
            assert!(run(2, at..STEPS, Some(&half)) == one, "{name}: resumed at {at}");
        }
        println!("{name}: {} arrays, with {}", one.len(), set.join(" "));
    }
    assert!(grids >= 15 * CUTS.len(), "most systems have an occupancy grid: {grids}");
}
