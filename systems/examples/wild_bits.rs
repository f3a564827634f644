//! Trains systems for photos from the wild for a few steps and prints a hash of each checkpoint.

use engine::data::Dataset;
use engine::options::{Background, RunOptions, parse_set};
use engine::system::{TensorData, TensorMap};
use scene_io::synthetic::{PlazaOptions, plaza};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

const NGP: &[&str] = &["batch_rays=512", "batch_samples=8192", "levels=6", "log2_table=12"];
const MLP: &[&str] = &["field=mlp", "width=32", "depth=2", "coarse=8", "fine=8", "batch_rays=256", "lr=5e-3"];
/// Name, settings on the hash grid alone, settings on both fields.
const CASES: &[(&str, &[&str])] = &[
    ("plain", &[]),
    ("nerf-a", &[]),
    ("nerf-u", &[]),
    ("nerf-w", &[]),
    ("ha-nerf-a", &["encoder_side=32", "lattice=16"]),
    ("ha-nerf-t", &[]),
    ("ha-nerf", &["encoder_side=32", "encoder_channels=[8,12,16]", "lattice=16"]),
    ("sf-nerf", &[]),
    ("robust-nerf", &["judge_first=5"]),
    ("hugs", &["warmup_steps=6"]),
    ("robust-nerf", &["judging=photos", "judge_first=5", "appearance=codes"]),
    ("robust-nerf", &["judging=batch", "appearance=codes"]),
    ("robust-nerf", &["judging=never", "kernel=gemanmcclure", "kernel_scale=0.1"]),
    ("hugs", &["warmup_steps=6", "restart=anew", "segments=pixels", "appearance=codes"]),
    (
        "hugs",
        &[
            "warmup_steps=6",
            "restart=on",
            "appearance=encoder",
            "encoder_side=32",
            "lattice=16",
            "appearance_dims=6",
            "code_size=3e-2",
        ],
    ),
    (
        "sf-nerf",
        &[
            "appearance=encoder",
            "encoder_side=32",
            "lattice=16",
            "appearance_dims=6",
            "code_size=3e-2",
            "lattices=0",
            "encoder_photos=4",
        ],
    ),
    ("sf-nerf", &["appearance=none", "filter_smoothness=0"]),
    (
        "nerf-w",
        &["appearance=encoder", "encoder_side=32", "lattice=16", "lattices=2", "appearance_dims=6", "code_size=3e-2"],
    ),
    ("ha-nerf", &["appearance=codes", "appearance_dims=16", "code_size=1e-5"]),
    ("nerf-a", &["kernel=welsch"]),
    ("auto", &["appearance=codes", "occluders=robust", "judge_first=5"]),
    ("auto", &[]),
];

fn hash(state: &TensorMap) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut eat = |bytes: &[u8]| {
        for &b in bytes {
            hash = (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    let mut names: Vec<&String> = state.keys().collect();
    names.sort();
    for name in names {
        eat(name.as_bytes());
        match &state[name].data {
            TensorData::F32(data) => data.iter().for_each(|x| eat(&x.to_bits().to_le_bytes())),
            TensorData::U64(data) => data.iter().for_each(|x| eat(&x.to_le_bytes())),
        }
    }
    hash
}

fn main() {
    let only = std::env::args().nth(1);
    let options = PlazaOptions { width: 32, height: 24, train: 12, test: 1, rays: 1, ..PlazaOptions::default() };
    let scene: Scene = plaza(&options);
    let store =
        Arc::new(ImageStore::new(&scene.frames, StoreOptions { longest_side: None, budget_bytes: 1 << 30 }).unwrap());
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    for (field, of_field, steps) in [("ngp", NGP, 30), ("mlp", MLP, 14)] {
        for (name, set) in CASES {
            if only.as_deref().is_some_and(|only| only != *name)
                || (field == "mlp" && *name == "auto" && set.is_empty())
            {
                continue;
            }
            let set = of_field.iter().chain(*set).map(|s| parse_set(s).unwrap()).collect();
            let run = RunOptions { seed: 3, background: Some(Background::Random), error_budget: None, set };
            let (mut system, _) = match systems::wild::build(name, &scene, &data, &run) {
                Ok(built) => built,
                Err(e) => {
                    println!("{field} {name} {}: {e}", run.set.len());
                    continue;
                }
            };
            let mut loss = 0.0;
            for step in 0..steps {
                loss = system.step(&data, step).unwrap().loss;
            }
            let state: TensorMap = system.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
            let seen = system.visibility(&data, 1).unwrap().map(|v| v.iter().sum::<f32>());
            println!(
                "{field} {name} {set:?}: {:016x} {} tensors, {} parameters, loss {loss}, seen {seen:?}",
                hash(&state),
                state.len(),
                system.parameter_count(),
                set = run
                    .set
                    .iter()
                    .filter(|(k, _)| !of_field.iter().any(|s| s.starts_with(&format!("{k}="))))
                    .map(|(k, v)| format!("{k}={v}"))
                    .collect::<Vec<_>>()
            );
        }
    }
}
