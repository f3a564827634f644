//! `nerf`: the published shapes and parameter counts, and a small one that learns, resumes and does not mind threads.

use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Split, StoreOptions};
use std::sync::Arc;
use systems::data::Dataset;
use systems::options::{Background, Plan, RunOptions, parse_set};
use systems::plan::build;
use systems::system::{LayerRequest, Normals, Query, System, TensorMap};

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

fn nerf(scene: &scene_io::Scene, train: &Dataset, set: &[&str]) -> (Box<dyn System>, Plan) {
    let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, set };
    build("nerf", scene, train, &run).unwrap()
}

const SMALL: [&str; 8] =
    ["width=32", "depth=4", "coarse=24", "fine=24", "batch_rays=96", "lr=3e-3", "position_octaves=6", "lr_decay=2000"];

#[test]
fn shapes_and_parameter_counts_are_the_published_ones() {
    let (scene, train, _) = data(8);
    let (nerf, plan) = nerf(&scene, &train, &[]);
    // 8 layers of 256 with the skip into the sixth, density head, bottleneck, colour over 256 + 27 inputs; twice.
    let trunk = (63 * 256 + 256) + 6 * (256 * 256 + 256) + ((256 + 63) * 256 + 256);
    let heads = 257 + (256 * 256 + 256) + ((256 + 27) * 128 + 128) + (128 * 3 + 3);
    assert_eq!(trunk + heads, 595_844);
    assert_eq!(nerf.parameter_count(), 2 * 595_844);
    let setting = |name: &str| plan.config[name].to_string();
    let published = [("coarse", "64"), ("fine", "128"), ("position_octaves", "10"), ("direction_octaves", "4")];
    for (name, value) in published {
        assert_eq!(setting(name), value, "{name}");
    }
}

fn psnr(nerf: &dyn System, test: &Dataset) -> f64 {
    let layers = LayerRequest { normals: Normals::Compute };
    let query = Query { layers, ..plain_query([1.0; 3], 0.0) };
    let (mut sum, mut n) = (0.0, 0);
    for v in 0..test.len() {
        let camera = test.view(v).camera;
        let rays: Vec<_> = test.view(v).rays(0..camera.height).map(|r| r.unwrap()).collect();
        let out = nerf.render(&rays, &query);
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
    -10.0 * (sum / n as f64).log10()
}

#[test]
fn a_small_nerf_learns_the_table() {
    let (scene, train, test) = data(32);
    let (mut nerf, _) = nerf(&scene, &train, &SMALL);
    let before = psnr(nerf.as_ref(), &test);
    for step in 0..400 {
        nerf.step(&train, step).unwrap();
    }
    let after = psnr(nerf.as_ref(), &test);
    println!("nerf on the table: {before:.2} dB, after 400 steps {after:.2} dB");
    assert!(after > before + 5.0 && after > 19.0, "{before:.2} dB, then {after:.2} dB");
}

/// All parameters and moments after `steps` steps on `threads` threads, from `state` if there is one.
fn state_after(threads: usize, steps: std::ops::Range<u64>, state: Option<&TensorMap>) -> TensorMap {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (scene, train, _) = data(16);
        let (mut nerf, _) = nerf(&scene, &train, &SMALL);
        if let Some(state) = state {
            nerf.load_state(state).unwrap();
        }
        for step in steps {
            nerf.step(&train, step).unwrap();
        }
        nerf.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
    })
}

#[test]
fn nerf_gives_the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let one = state_after(1, 0..6, None);
    for threads in [2, 4] {
        assert!(state_after(threads, 0..6, None) == one, "{threads} threads");
    }
    let half = state_after(2, 0..3, None);
    assert!(state_after(2, 3..6, Some(&half)) == one, "resumed");
}

#[test]
fn a_state_of_another_shape_is_refused_by_name() {
    let (scene, train, _) = data(8);
    let (mut nerf, _) = nerf(&scene, &train, &SMALL);
    let error = nerf.load_state(&TensorMap::new()).unwrap_err().to_string();
    assert!(error.contains("networks") && error.contains("missing"), "{error}");
}
