//! What tests of whole systems share: a small scene, systems as the command line builds them, and checks that all of them
//! must pass.
#![expect(clippy::missing_panics_doc, reason = "these are assertions of tests")]

pub mod sources;

use engine::data::Dataset;
use engine::options::{Background, Plan, RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::system::{LayerRequest, Normals, Query, System, SystemError, TensorMap};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use systems::registry::build;

/// The table top in pictures of `size` pixels a side: 20 to train on, 2 held out.
#[must_use]
pub fn table(size: u32) -> Scene {
    tabletop(&TabletopOptions { width: size, height: size, train: 20, test: 2, rays: 2, ..TabletopOptions::default() })
}

/// Training views at `levels` scales, and the held-out ones at the first.
#[must_use]
pub fn views(scene: &Scene, levels: u32) -> (Dataset, Dataset) {
    let store = StoreOptions::default().with_budget_bytes(1 << 30);
    let store = Arc::new(ImageStore::new(&scene.frames, store).expect("pictures in memory have headers"));
    let of = |split, levels| {
        let frames = scene.split(split).collect();
        Dataset::with_levels(scene, store.clone(), frames, levels).expect("pictures in memory can be read")
    };
    (of(Split::Train, 0..levels), of(Split::Test, 0..1))
}

/// [`table`] and its [`views`] at one scale.
#[must_use]
pub fn table_data(size: u32) -> (Scene, Dataset, Dataset) {
    let scene = table(size);
    let (train, test) = views(&scene, 1);
    (scene, train, test)
}

/// A system as `--system NAME --set ...` builds it, before white.
///
/// # Errors
/// What the plan refuses.
pub fn try_system(
    name: &str,
    scene: &Scene,
    train: &Dataset,
    set: &[&str],
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let set = set.iter().map(|s| parse_set(s).expect("tests write `--set` well")).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    build(name, scene, train, &run)
}

/// [`try_system`] with settings that work.
#[must_use]
pub fn system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> (Box<dyn System>, Plan) {
    try_system(name, scene, train, set).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// PSNR over the pixels of all views on white, pixels as cones; the other layers are checked on the way.
#[must_use]
pub fn psnr(system: &dyn System, views: &Dataset) -> f64 {
    let layers = LayerRequest { normals: Normals::Compute, ..LayerRequest::default() };
    let query = Query { layers, ..plain_query([1.0; 3], 0.0) };
    let (mut sum, mut n) = (0.0, 0);
    for v in 0..views.len() {
        let out = render(system, &views.view(v).camera, &query).layers;
        let image = views.image(v).expect("pictures in memory can be read");
        for (i, (rgb, photo)) in out.rgb.iter().zip(image.data.chunks(usize::from(image.channels))).enumerate() {
            let a = photo.get(3).map_or(1.0, |&a| f32::from(a) / 255.0);
            for (value, photo) in rgb.iter().zip(photo) {
                let truth = f32::from(*photo) / 255.0 * a + 1.0 - a;
                sum += f64::from(value.clamp(0.0, 1.0) - truth).powi(2);
                n += 1;
            }
            let length = out.normal[i].iter().map(|n| n * n).sum::<f32>();
            assert!(length < 1.001 && (0.0..=1.0).contains(&out.opacity[i]) && out.depth[i] > 0.0, "view {v}, {i}");
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

/// All that a checkpoint holds.
#[must_use]
pub fn state_of(system: &dyn System) -> TensorMap {
    system.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

/// The state of `system` after steps of training, from `state` if there is one.
#[must_use]
pub fn state_after(
    mut system: Box<dyn System>,
    train: &Dataset,
    steps: Range<u64>,
    state: Option<&TensorMap>,
) -> TensorMap {
    if let Some(state) = state {
        system.load_state(state).expect("a state of the same system");
    }
    for step in steps {
        system.step(train, step).expect("a step of training");
    }
    state_of(system.as_ref())
}

/// A feature file of `f32`.
///
/// # Panics
/// If it cannot be written.
pub fn write_features(path: &Path, [channels, height, width]: [usize; 3], value: impl Fn(usize) -> f32) {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({channels}, {height}, {width}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend(u16::try_from(header.len()).expect("a short header").to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..channels * height * width).flat_map(|i| value(i).to_le_bytes()));
    std::fs::write(path, bytes).expect("a file");
}

/// Six steps make the same bits on 1, 2 and 4 threads, and when a state is saved and loaded between them. `run` builds a
/// system and gives its [`state_after`] steps.
pub fn assert_same_bits(run: impl Fn(Range<u64>, Option<&TensorMap>) -> TensorMap + Sync) {
    let on = |threads: usize, steps: Range<u64>, state: Option<&TensorMap>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads");
        pool.install(|| run(steps, state))
    };
    let one = on(1, 0..6, None);
    for threads in [2, 4] {
        assert!(on(threads, 0..6, None) == one, "{threads} threads");
    }
    for at in [2, 3] {
        let half = on(2, 0..at, None);
        assert!(on(2, at..6, Some(&half)) == one, "resumed at {at}");
    }
}
