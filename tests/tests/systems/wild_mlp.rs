//! Methods on the published networks: small ones learn a scene despite occluders in its photos, and resume with the same bits.

use engine::data::Dataset;
use engine::options::{Background, RunOptions, parse_set};
use engine::system::System;
use field_core::rng::Rng;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageSource, Scene, Split};
use std::sync::Arc;
use systems::registry::build;
use tests::{assert_same_bits, psnr, state_after, views};

const SMALL: [&str; 8] =
    ["field=mlp", "width=32", "depth=2", "coarse=8", "fine=12", "batch_rays=1024", "lr=6e-3", "density_noise=0.0"];

/// Pixels along a side of a photo, and of an occluder.
const SIDE: u32 = 24;
const OCCLUDER: u32 = 11;

const STEPS: u64 = 100;

fn table() -> Scene {
    tabletop(&TabletopOptions { width: SIDE, height: SIDE, train: 16, test: 4, rays: 2, ..TabletopOptions::default() })
}

/// A square of one colour somewhere in each training photo, elsewhere in each of them.
fn with_occluders(mut scene: Scene) -> Scene {
    let rng = Rng::new(5, 6);
    for (k, frame) in scene.frames.iter_mut().enumerate().filter(|(_, frame)| frame.split == Split::Train) {
        let ImageSource::Memory(image) = &frame.image else { continue };
        let mut image = (**image).clone();
        let [u, v, colour, _] = rng.uniform4_at(k as u64);
        let [left, top] = [u, v].map(|u| (u * (SIDE - OCCLUDER) as f32) as u32);
        for i in 0..OCCLUDER * OCCLUDER {
            let (x, y, n) = (left + i % OCCLUDER, top + i / OCCLUDER, u32::from(image.channels));
            let at = ((y * SIDE + x) * n) as usize;
            let seen = [255 * u8::from(colour > 0.5), 255 * u8::from(u > 0.5), 255 * u8::from(v > 0.5), 255];
            image.data[at..at + n as usize].copy_from_slice(&seen[..n as usize]);
        }
        frame.image = ImageSource::Memory(Arc::new(image));
    }
    scene
}

fn system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Box<dyn System> {
    let set = SMALL.iter().chain(set).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    build(name, scene, train, &run).unwrap().0
}

#[test]
fn the_scene_is_learnt_despite_occluders() {
    let scene = with_occluders(table());
    let (train, test) = views(&scene, 1);
    let [plain, robust, nerf_w] = ["plain", "robust-nerf", "nerf-w"].map(|name| {
        let mut system = system(name, &scene, &train, &[]);
        for step in 0..STEPS {
            system.step(&train, step).unwrap();
        }
        psnr(system.as_ref(), &test)
    });
    println!("plain {plain:.2} dB, robust-nerf {robust:.2} dB, nerf-w {nerf_w:.2} dB");
    // One leaves occluders out from the start; the other has to learn first what they are.
    assert!(robust > plain + 3.0 && nerf_w > plain + 1.0);
}

#[test]
fn same_bits_with_any_number_of_threads_and_after_a_resume() {
    let scene = with_occluders(table());
    let train = views(&scene, 1).0;
    for name in ["nerf-w", "robust-nerf"] {
        assert_same_bits(|steps, state| {
            state_after(system(name, &scene, &train, &["batch_rays=64"]), &train, steps, state)
        });
    }
}
