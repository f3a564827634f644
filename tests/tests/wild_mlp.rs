//! Methods on the published networks: small ones learn a scene despite strangers in its photos, and resume with the same bits.

use field_core::rng::Rng;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Disturbance, ImageSource, Scene, Split, perturb};
use std::sync::Arc;
use systems::data::Dataset;
use systems::options::{Background, RunOptions, parse_set};
use systems::render::{plain_query, render};
use systems::system::{Appearance, Query, System};
use systems::wild::build;
use tests::{assert_same_bits, state_after, views};

const SMALL: [&str; 8] =
    ["field=mlp", "width=32", "depth=2", "coarse=8", "fine=12", "batch_rays=1024", "lr=6e-3", "density_noise=0.0"];

/// Pixels along a side of a photo, and of a stranger.
const SIDE: u32 = 24;
const STRANGER: u32 = 11;

const STEPS: u64 = 150;

fn table() -> Scene {
    tabletop(&TabletopOptions { width: SIDE, height: SIDE, train: 16, test: 4, rays: 2, ..TabletopOptions::default() })
}

/// A square of one colour somewhere in each training photo, elsewhere in each of them.
fn with_strangers(mut scene: Scene) -> Scene {
    let rng = Rng::new(5, 6);
    for (k, frame) in scene.frames.iter_mut().enumerate().filter(|(_, frame)| frame.split == Split::Train) {
        let ImageSource::Memory(image) = &frame.image else { continue };
        let mut image = (**image).clone();
        let [u, v, colour, _] = rng.uniform4_at(k as u64);
        let [left, top] = [u, v].map(|u| (u * (SIDE - STRANGER) as f32) as u32);
        for i in 0..STRANGER * STRANGER {
            let (x, y, n) = (left + i % STRANGER, top + i / STRANGER, u32::from(image.channels));
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
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, set };
    build(name, scene, train, &run).unwrap().0
}

/// PSNR over the pixels of all views, in the light of the first training photo, which nobody disturbed.
fn score(system: &dyn System, views: &Dataset) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    for view in 0..views.len() {
        let query = Query { appearance: Appearance::View(0), ..plain_query([1.0; 3], 0.0) };
        let rgb = render(system, &views.view(view).camera, &query).layers.rgb;
        let image = views.image(view).unwrap();
        for (rgb, photo) in rgb.iter().zip(image.data.chunks(usize::from(image.channels))) {
            let a = photo.get(3).map_or(1.0, |&a| f32::from(a) / 255.0);
            for c in 0..3 {
                let truth = f32::from(photo[c]) / 255.0 * a + 1.0 - a;
                sum += f64::from(rgb[c].clamp(0.0, 1.0) - truth).powi(2);
                n += 1;
            }
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

/// The method's score less that of the plain field, after as many steps.
fn gain(name: &str, scene: &Scene) -> f64 {
    let (train, test) = views(scene, 1);
    let [plain, method] = ["plain", name].map(|name| {
        let mut system = system(name, scene, &train, &[]);
        for step in 0..STEPS {
            system.step(&train, step).unwrap();
        }
        score(system.as_ref(), &test)
    });
    println!("{name}: {method:.2} dB, plain: {plain:.2} dB");
    method - plain
}

#[test]
fn strangers_are_left_out() {
    let gain = gain("robust-nerf", &with_strangers(table()));
    assert!(gain > 1.0, "{gain:.2} dB");
}

#[test]
fn light_is_told_from_the_scene_and_strangers_from_both() {
    let gain = gain("nerf-w", &perturb(table(), Disturbance::Both, 3));
    assert!(gain > 1.0, "{gain:.2} dB");
}

#[test]
fn same_bits_with_any_number_of_threads_and_after_a_resume() {
    let scene = perturb(table(), Disturbance::Both, 3);
    let train = views(&scene, 1).0;
    for name in ["nerf-w", "robust-nerf"] {
        assert_same_bits(|steps, state| {
            state_after(system(name, &scene, &train, &["batch_rays=64"]), &train, steps, state)
        });
    }
}
