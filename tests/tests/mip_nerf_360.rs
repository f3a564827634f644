//! `mip-nerf-360`: published shapes, and a small one that learns, resumes and does not mind threads.

use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Split, StoreOptions};
use std::sync::Arc;
use systems::data::Dataset;
use systems::options::{Background, Plan, RunOptions, parse_set};
use systems::plan::build;
use systems::render::render;
use systems::system::{LayerRequest, Normals, Query, System, SystemError, TensorMap};

fn data(size: u32) -> (scene_io::Scene, Dataset, Dataset) {
    let options =
        TabletopOptions { width: size, height: size, train: 20, test: 2, rays: 2, ..TabletopOptions::default() };
    let scene = tabletop(&options);
    let store = StoreOptions { longest_side: None, budget_bytes: 1 << 30 };
    let store = Arc::new(ImageStore::new(&scene.frames, store).unwrap());
    let of = |split| Dataset::new(&scene, store.clone(), scene.split(split).collect()).unwrap();
    let (train, test) = (of(Split::Train), of(Split::Test));
    (scene, train, test)
}

fn try_system(scene: &scene_io::Scene, train: &Dataset, set: &[&str]) -> Result<(Box<dyn System>, Plan), SystemError> {
    let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, set };
    build("mip-nerf-360", scene, train, &run)
}

fn system(scene: &scene_io::Scene, train: &Dataset, set: &[&str]) -> Box<dyn System> {
    try_system(scene, train, set).unwrap().0
}

/// Small enough for a test. The gradient of so few rays is noisier than that of 16384, so its norm may be larger; and the
/// table, most of whose picture is background, wants the squared error.
const SMALL: [&str; 15] = [
    "octaves=6",
    "width=48",
    "depth=3",
    "bottleneck=24",
    "view_width=24",
    "proposal_width=16",
    "proposal_depth=2",
    "proposal_samples=24",
    "samples=16",
    "batch_rays=64",
    "steps=1000",
    "lr_warmup=20",
    "lr=5e-3",
    "clip=0.1",
    "charbonnier=1.0",
];

#[test]
fn shapes_are_the_published_ones() {
    let (scene, train, _) = data(8);
    let (system, plan) = try_system(&scene, &train, &["space=\"contracted\""]).unwrap();
    let rows = 21 * 12 * 2;
    let proposal = (rows * 256 + 256) + 3 * (256 * 256 + 256) + 257;
    let trunk = (rows * 1024 + 1024) + 6 * (1024 * 1024 + 1024) + ((1024 + rows) * 1024 + 1024);
    let heads = 1025 + (1024 * 256 + 256) + ((256 + 27) * 128 + 128) + (128 * 3 + 3);
    assert_eq!(system.parameter_count(), proposal + trunk + heads);
    let setting = |name: &str| plan.config[name].to_string();
    for (name, value) in
        [("proposals", "2"), ("proposal_samples", "64"), ("samples", "32"), ("octaves", "12"), ("last", "\"opaque\"")]
    {
        assert_eq!(setting(name), value, "{name}");
    }
}

/// PSNR over held-out views, pixels as cones; layers are checked on the way.
fn psnr(system: &dyn System, test: &Dataset) -> f64 {
    let layers = LayerRequest { normals: Normals::Compute };
    let query = Query { layers, ..plain_query([1.0; 3], 0.0) };
    let (mut sum, mut n) = (0.0, 0);
    for v in 0..test.len() {
        let out = render(system, &test.view(v).camera, &query).layers;
        let image = test.image(v).unwrap();
        for (i, rgb) in out.rgb.iter().enumerate() {
            let a = f32::from(image.data[4 * i + 3]) / 255.0;
            for (c, value) in rgb.iter().enumerate() {
                let truth = f32::from(image.data[4 * i + c]) / 255.0 * a + 1.0 - a;
                sum += f64::from(value.clamp(0.0, 1.0) - truth).powi(2);
                n += 1;
            }
            let length = out.normal[i].iter().map(|n| n * n).sum::<f32>();
            assert!(length < 1.001 && (0.0..=1.0).contains(&out.opacity[i]) && out.depth[i] > 0.0);
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

fn learns(space: &str, steps: u64, least: f64) {
    let (scene, train, test) = data(32);
    let mut system = system(&scene, &train, &[&SMALL[..], &[space]].concat());
    let before = psnr(system.as_ref(), &test);
    let (mut losses, mut errors) = (Vec::new(), Vec::new());
    for step in 0..steps {
        let stats = system.step(&train, step).unwrap();
        assert!(stats.nonfinite == 0, "step {step}: {stats:?}");
        losses.push(stats.loss);
        errors.push(stats.mse);
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (first, last) = (mean(&errors[..20]), mean(&errors[errors.len() - 20..]));
    assert!(mean(&losses[..20]) > mean(&losses[losses.len() - 20..]));
    let after = psnr(system.as_ref(), &test);
    println!("{space}: error {first:.4}, then {last:.4}; {before:.2} dB, after {steps} steps {after:.2} dB");
    assert!(last < 0.3 * first, "error {first:.4}, then {last:.4}");
    // A picture that is all background, which the loss may fall into, has 12.7 dB.
    assert!(after > before + 5.0 && after > least, "{before:.2} dB, then {after:.2} dB");
}

#[test]
fn a_small_one_learns_the_table_in_its_box() {
    learns("space=\"box\"", 120, 17.0);
}

#[test]
fn a_small_one_learns_the_table_in_contracted_space_with_distortion() {
    learns("space=\"contracted\"", 250, 15.0);
}

/// All parameters and moments after `steps` steps on `threads` threads, from `state` if there is one.
fn state_after(threads: usize, steps: std::ops::Range<u64>, state: Option<&TensorMap>) -> TensorMap {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (scene, train, _) = data(16);
        let mut system = system(&scene, &train, &[&SMALL[..], &["space=\"contracted\""]].concat());
        if let Some(state) = state {
            system.load_state(state).unwrap();
        }
        for step in steps {
            system.step(&train, step).unwrap();
        }
        system.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
    })
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let one = state_after(1, 0..6, None);
    for threads in [2, 4] {
        assert!(state_after(threads, 0..6, None) == one, "{threads} threads");
    }
    let half = state_after(2, 0..3, None);
    assert!(state_after(2, 3..6, Some(&half)) == one, "resumed");
}

#[test]
fn settings_that_cannot_work_are_named() {
    let (scene, train, _) = data(8);
    for (set, field) in [
        ("space=\"ndc\"", "space"),
        ("samples=1", "samples"),
        ("far=0.01", "far"),
        ("clip=-1.0", "clip"),
        ("octaves=0", "octaves"),
    ] {
        let error = try_system(&scene, &train, &["space=\"contracted\"", set]).err().unwrap().to_string();
        assert!(error.contains(field), "{set}: {error}");
    }
}
