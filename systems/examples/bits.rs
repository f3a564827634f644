//! A hash of everything that some short trainings end with, a line each: to compare two commits bit for bit.
//!
//! `cargo run -p systems --example bits [WORD]`: the trainings whose name holds the word.

use engine::checkpoint::{serialise, sha256};
use engine::data::Dataset;
use engine::options::{RunOptions, parse_set};
use engine::render::plain_query;
use engine::system::{Appearance, Behind, Canonical, Fit, LayerRequest, Median, Normals, Query, System, SystemError};
use render_core::camera::{Camera, Lens};
use scene_io::synthetic::{OrbitOptions, PlazaOptions, TabletopOptions, TissueOptions, orbit, plaza, tabletop, tissue};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use splat_core::Gaussians;
use std::sync::Arc;
use systems::bake::{BakeOptions, bake, recolour};

const STEPS: u64 = 40;
/// Steps of a cloud of Gaussians: across some changes of their number.
const CLOUD_STEPS: u64 = 60;

type Build = fn(&str, &Scene, &Dataset, &RunOptions) -> Result<(Box<dyn System>, engine::options::Plan), SystemError>;

const SMALL: &[&str] = &["occupancy=32", "batch_samples=1500", "batch_rays=256", "log2_table=12", "n_max=128"];

/// Settings of clouds besides the planned ones: their number changes at steps 20, 40 and 60.
const BUSY: &[&str] =
    &["densify_from=10", "densify_every=20", "max_splats=3000", "sh_every=15", "coarse=1", "coarse_steps=25"];

/// Networks as published, but small.
const NARROW: &[&str] = &["width=24", "depth=6", "coarse=8", "fine=8", "batch_rays=24"];

/// Networks of mip-NeRF 360, but small.
const NARROW_360: &[&str] = &[
    "width=24",
    "depth=6",
    "bottleneck=12",
    "view_width=16",
    "proposal_width=16",
    "proposal_depth=2",
    "proposal_samples=12",
    "samples=8",
    "batch_rays=24",
];

/// Family, system, settings besides the small ones.
const RUNS: &[(&str, &str, &[&str])] = &[
    ("still", "ngp", &[]),
    ("still", "ngp", &["rays_per_side=2", "huber=0.1", "distortion=0.01", "sparsity=1e-4", "train_faint=0.002"]),
    ("still", "ngp", &["sampler=proposal", "proposal_samples=[24,16]", "final_samples=12", "distortion=0.02"]),
    ("still", "ngp", &["background_entropy=1e-3", "point_colour=0.01", "precision=bf16", "levels_anneal=20"]),
    ("still", "ngp", &["levels=6", "features=2", "geometry=8"]),
    ("still", "ngp", &["space=contracted", "cascades=3", "sky=true", "free_space=true", "distortion=0.02"]),
    ("still", "splat", &["densify_gradient=1e-6"]),
    ("still", "splat", &["start=random", "start_count=500", "density=adc", "reset_every=30", "prune_size=0.5"]),
    ("still", "splat", &["density=mcmc", "mcmc_cost=0.02", "widening=dims"]),
    ("still", "splat", &["sh_degree=0", "dssim=0.5", "near=0.02", "lr_dc=0.01"]),
    ("still", "splat", &["start=random", "start_count=300", "density=mcmc", "free_space=true"]),
    ("still", "nerf", &["sparsity=0.01"]),
    ("still", "nerf", &["space=contracted", "density_noise=0.5", "lr=0.001", "lr_decay=50"]),
    ("still", "mip-nerf", &["density_noise=0.5"]),
    ("still", "mip-nerf", &["space=contracted", "warmup_steps=10", "lr_steps=50", "resample_padding=0.02"]),
    ("still", "mip-nerf-360", &["steps=50"]),
    ("still", "mip-nerf-360", &["space=contracted", "last=finite", "lr_warmup=10", "dilation=0.01", "clip=0.1"]),
    ("thing", "splat", &["densify_gradient=1e-6"]),
    ("thing", "splat", &["start=random", "start_count=400", "free_space=true"]),
    ("lens", "splat", &["densify_gradient=1e-6"]),
    ("bake", "ngp", &[]),
    ("photos", "nerf-w", &[]),
    ("photos", "nerf-w", &["distortion=0.01", "sparsity=1e-4", "mixture=proportional"]),
    ("photos", "ha-nerf", &["view_every=3"]),
    ("photos", "robust-nerf", &["judging=batch"]),
    ("photos", "robust-nerf", &["judge_first=10"]),
    ("photos", "wild-gaussians", &["judge_first=10"]),
    ("photos", "wild-gaussians", &["start=random", "start_count=300", "occluders=residual", "judge_from=0.0"]),
    ("photos", "spotless", &[]),
    ("photos", "gs-w", &["judge_first=10"]),
    ("photos", "gs-w", &["start=random", "start_count=300", "occluders=visibility", "judge_from=0.0"]),
    ("photos", "wild-gs", &["judge_first=10", "plane_from=0.01"]),
    ("photos", "wild-gs", &["start=random", "start_count=300", "occluders=visibility", "plane_from=0.0"]),
    ("photos", "hugs", &["warmup_steps=20", "restart=anew"]),
    ("photos", "sf-nerf", &[]),
    ("photos", "plain", &[]),
    ("photos", "nerf-a", &["kernel=welsch"]),
    ("photos", "nerf-u", &[]),
    ("photos", "ha-nerf-a", &["encoder_side=32", "lattice=16"]),
    ("photos", "ha-nerf-t", &[]),
    ("photos", "ha-nerf", &["appearance=codes"]),
    ("photos", "nerf-w", &["appearance=encoder", "lattices=2", "lattice=16"]),
    ("photos", "hugs", &["warmup_steps=10", "appearance=encoder"]),
    ("photos", "sf-nerf", &["appearance=none", "filter_smoothness=0"]),
    ("photos", "nerf-w", &["field=mlp", "mixture=proportional"]),
    ("photos", "robust-nerf", &["field=mlp", "judge_first=10"]),
    ("photos", "hugs", &["field=mlp", "warmup_steps=20", "restart=anew"]),
    ("photos", "auto", &[]),
    ("film", "ngp", &[]),
    ("film", "t-nerf", &[]),
    ("film", "d-nerf", &["by_error=true", "curriculum=0.0"]),
    ("film", "d-nerf", &["field=mlp", "warp_width=24", "warp_variation=1e-3", "horizon=40"]),
    ("film", "d-nerf", &["field=mlp", "warp_width=24", "origin=exact", "fine_networks=true", "horizon=40"]),
    ("film", "nerfies", &["appearance=none"]),
    ("film", "nerfies", &["appearance=codes"]),
    ("film", "hypernerf", &["appearance=none", "horizon=40", "ambient_from=0.25", "ambient_anneal=0.5"]),
    ("film", "tineuvox", &["voxels=24", "horizon=40", "voxels_every=0.25"]),
    ("still", "k-planes", &["plane_vertices=16"]),
    ("film", "k-planes", &["plane_vertices=16"]),
    ("film", "two-parts", &["moving_n_max=64", "horizon=40", "moving_from=0.25"]),
    ("tissue", "endo-nerf", &["refine_every=15"]),
];

fn scene(family: &str) -> (Scene, Build) {
    let (width, height) = (32, 24);
    match family {
        "still" | "bake" => (
            tabletop(&TabletopOptions { width, height, train: 8, test: 1, ..Default::default() }),
            systems::registry::build,
        ),
        "thing" => {
            (orbit(&OrbitOptions { width, height, train: 8, test: 1, ..Default::default() }), systems::registry::build)
        }
        // Photos of lenses that bend light, with masks.
        "lens" => {
            let mut scene = tabletop(&TabletopOptions { width, height, train: 8, test: 1, ..Default::default() });
            for frame in &mut scene.frames {
                frame.camera.lens = LENS;
            }
            (scene, systems::registry::build)
        }
        "photos" => {
            (plaza(&PlazaOptions { width, height, train: 8, test: 1, ..Default::default() }), systems::registry::build)
        }
        "film" => {
            (orbit(&OrbitOptions { width, height, train: 8, test: 1, ..Default::default() }), systems::registry::build)
        }
        _ => (tissue(&TissueOptions { width, height, frames: 8, ..Default::default() }), systems::registry::build),
    }
}

const LENS: Lens = Lens::Perspective { k: [0.1, -0.05, 0.0, 0.0, 0.0, 0.0], p: [1e-3, -2e-3] };

/// What a cloud shows of itself: whole pictures, one through a lens, and what is exported.
fn push_pictures(system: &dyn System, camera: &Camera, bytes: &mut Vec<u8>) {
    let layers = LayerRequest {
        median: Median::Compute,
        normals: Normals::Compute,
        canonical: Canonical::Compute,
        behind: Behind::Compute,
    };
    let query = Query { layers, ..plain_query([0.2; 3], 1e-3) };
    for lens in [camera.lens, LENS] {
        let camera = Camera { lens, ..*camera };
        let Some(layers) = system.render_view(&camera, &query) else { return };
        let before = system.render_before(&camera, 2.0, &query).unwrap_or_default();
        let planes = [&layers.opacity, &layers.depth, &layers.median_depth, &before];
        planes.into_iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
        layers.rgb.iter().chain(&layers.normal).flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
        layers.canonical.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    system.splats(&plain_query([0.0; 3], 0.0)).iter().for_each(|splats| push_cloud(&splats.gaussians, bytes));
}

fn push_cloud(cloud: &Gaussians, bytes: &mut Vec<u8>) {
    cloud.fields().iter().flat_map(|(_, values)| *values).for_each(|v| bytes.extend(v.to_le_bytes()));
}

fn hash(family: &str, name: &str, set: &[&str]) -> Result<String, SystemError> {
    let (scene, build) = scene(family);
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default())?);
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect())?;
    let name_of = |set: &str| set.split('=').next().unwrap_or_default().to_owned();
    let absent: &[&str] = match (name, set.first()) {
        ("tineuvox" | "k-planes", _) => &["log2_table", "n_max"],
        (_, Some(&"sampler=proposal")) => &["occupancy"],
        _ => &[],
    };
    let small = match (name, set.first()) {
        ("splat" | "wild-gaussians" | "spotless" | "gs-w" | "wild-gs", _) => BUSY,
        ("mip-nerf-360", _) => NARROW_360,
        ("nerf" | "mip-nerf", _) | (_, Some(&"field=mlp")) => NARROW,
        _ => SMALL,
    };
    let mut all: Vec<&str> = small.iter().copied().filter(|set| !absent.contains(&&*name_of(set))).collect();
    if (family == "tissue" || family == "film") && set.first() != Some(&"field=mlp") {
        all.push("train_stop=1e-3");
    }
    all.extend(set);
    let set = all.iter().map(|s| parse_set(s).expect("a setting")).collect();
    let run = RunOptions { seed: 3, background: None, error_budget: None, stop: None, set };
    let (mut system, _) = build(name, &scene, &data, &run)?;
    let mut loss = 0.0;
    let steps =
        if ["splat", "wild-gaussians", "spotless", "gs-w", "wild-gs"].contains(&name) { CLOUD_STEPS } else { STEPS };
    for step in 0..steps {
        loss += system.step(&data, step)?.mse;
    }
    let mut bytes = serialise(&system.state());
    let view = data.view(0);
    let rays: Vec<_> = (0..200).filter_map(|k| view.ray(k % 20, k / 20)).collect();
    let query = Query { time: view.time, ..plain_query([0.2; 3], 1e-3) };
    let layers = system.render(&rays, &query);
    layers.rgb.iter().flatten().chain(&layers.depth).for_each(|v| bytes.extend(v.to_le_bytes()));
    if system.appearance_code(&Appearance::Mean).is_some() {
        let rgb = vec![[0.4, 0.5, 0.6]; rays.len()];
        let fit = Fit {
            rays: &rays,
            rgb: &rgb,
            time: view.time,
            background: [0.2; 3],
            steps: 10,
            lr: 0.05,
            seed: 5,
            halt: &engine::halt::Halt::NEVER,
        };
        system.fit_appearance(&fit).iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    push_pictures(&*system, &view.camera, &mut bytes);
    if family == "bake" {
        let options = BakeOptions { rays: 5000, most: 400, steps: 20, ..BakeOptions::DEFAULT };
        let query = plain_query([0.2; 3], 1e-3);
        let baked = bake(&*system, &data, &query, &options, &|| true).expect("a bake").expect("not halted");
        push_cloud(&baked.splats.gaussians, &mut bytes);
        let options = BakeOptions { steps: 5, ..options };
        let recoloured =
            recolour(&baked, &*system, &data, &query, &options, &|| true).expect("a bake").expect("not halted");
        push_cloud(&recoloured.splats.gaussians, &mut bytes);
    }
    Ok(format!("{} mse {:.6}", &sha256(&bytes)[..16], loss / steps as f64))
}

fn main() {
    let word = std::env::args().nth(1).unwrap_or_default();
    for (family, name, set) in RUNS {
        let line = format!("{family} {name} {}", set.join(" "));
        if line.contains(&word) {
            match hash(family, name, set) {
                Ok(hash) => println!("{hash}  {line}"),
                Err(e) => println!("error: {e}  {line}"),
            }
        }
    }
}
