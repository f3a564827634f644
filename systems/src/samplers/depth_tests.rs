//! Measured depth: where it is known, the cuts of a march, the loss, and which depths give way.

use super::*;
use glam::{DMat3, DVec3};
use render_core::camera::Camera;
use render_core::pose::Pose;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{DepthMap, DepthSource, Frame, Image, ImageSource, ImageStore, Scene, StoreOptions};
use std::sync::Arc;

#[test]
fn the_worst_share_gives_way_and_what_agrees_stays() {
    let mut t = vec![1.0, 1.0, 1.0, 0.0, 1.0];
    give_way(&mut t, &[0, 1, 2, 4], &[1.0, 1.5, 1.01, 0.0], 0.34);
    assert_eq!(t, [1.0, 1.5, 1.0, 0.0, 1.0], "one of three, not the one without a rendered depth");
    let before = t.clone();
    give_way(&mut t, &[0, 1, 2], &[1.0, 1.5, 1.0], 0.34);
    assert_eq!(t, before, "nothing to replace where rendered equals stored");
    give_way(&mut t, &[], &[], 0.5);
}

/// A photo of 9 x 7 pixels, and what is known of its depth.
fn measured(z: impl Fn(usize) -> f32) -> Dataset {
    let pose = Pose { r: DMat3::from_rotation_y(0.3), c: DVec3::new(0.2, -0.1, -3.0) };
    let camera = Camera::pinhole(9, 7, 8.0, 8.5, 4.2, 3.9, pose);
    let image = Image::rgb(9, 7, vec![80; 3 * 63]).unwrap();
    let mut frame = Frame::new("a", ImageSource::Memory(Arc::new(image)), camera);
    frame.depth = Some(DepthSource::memory(DepthMap::new(9, 7, (0..63).map(z).collect()).unwrap()));
    let mut other = frame.clone();
    (other.name, other.depth) = ("b".into(), None);
    let scene = tabletop(&TabletopOptions { train: 0, test: 0, ..Default::default() });
    let scene = Scene { frames: vec![frame, other], ..scene };
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(&scene, store, vec![0, 1]).unwrap()
}

fn cues(config: DepthCueConfig, z: impl Fn(usize) -> f32) -> MeasuredDepth {
    MeasuredDepth::read(config, &Space::boxed(DVec3::ZERO, 4.0, 0.01), &measured(z)).unwrap().unwrap()
}

const LED: DepthCueConfig = DepthCueConfig { depth: 0.7, cue_samples: 24, ..DepthCueConfig::NONE };

#[test]
fn a_depth_map_is_distances_along_the_rays_and_holes_stay_holes() {
    let z = |k: usize| {
        if k.is_multiple_of(5) { [0.0, f32::NAN, -1.0, f32::INFINITY][k % 4] } else { 2.0 + 0.02 * k as f32 }
    };
    let (space, data, cues) = (Space::boxed(DVec3::ZERO, 4.0, 0.01), measured(z), cues(LED, z));
    let view = data.view(0);
    for k in 0..63_usize {
        let at = [(k % 9) as u16, (k / 9) as u16];
        let t = cues.at(0, at);
        if k % 5 == 0 {
            assert_eq!(t, 0.0, "pixel {k}");
            continue;
        }
        let ray = view.ray(at[0].into(), at[1].into()).unwrap();
        let x = ray.o + ray.d * space.world_distance(&ray, t);
        let found = (x - view.camera.pose.c).dot(view.camera.optical_axis());
        assert!((found - f64::from(z(k))).abs() < 1e-5, "pixel {k}: {found} for {}", z(k));
        assert_eq!(cues.at(1, at), 0.0, "of the photo without depth nothing is known");
    }
}

#[test]
fn depths_that_are_all_the_same_have_a_range_all_the_same_and_none_are_no_cues() {
    let flat = cues(LED, |_| 3.0);
    assert!(flat.range > 0.0 && flat.range.is_finite());
    let space = Space::boxed(DVec3::ZERO, 4.0, 0.01);
    assert!(MeasuredDepth::read(LED, &space, &measured(|_| 0.0)).unwrap().is_none());
}

#[test]
fn intervals_are_cut_around_the_measurement_and_cover_what_they_covered() {
    let mut room = CutRoom::default();
    // Two runs of steps with an empty stretch between them, behind those of another ray.
    let marched = || {
        let at: Vec<f32> = [9.0, 0.5, 0.6, 0.7, 0.8, 1.1, 1.2, 1.3, 1.4].into();
        let step = vec![0.1; at.len()];
        (at, step)
    };
    let covered = |t: &[f32], dt: &[f32]| -> f32 { t.iter().zip(dt).skip(1).map(|(_, dt)| dt).sum() };
    for (config, jitter) in [
        (LED, 0.0),
        (LED, 0.999),
        (DepthCueConfig { cue_spread: 0.0, ..LED }, 0.5),
        (DepthCueConfig { cue_anywhere: 0.0, ..LED }, 0.5),
        (DepthCueConfig { cue_anywhere: 1.0, ..LED }, 0.5),
        (DepthCueConfig { cue_samples: 1, ..LED }, 0.3),
    ] {
        let cues = cues(config, |k| 2.0 + 0.02 * k as f32);
        for depth in [0.2, 0.95, 1.25, 4.0, 1e6] {
            let (mut t, mut dt) = marched();
            let n = cues.cut(0.5, 1.5, depth, jitter, Intervals { t: &mut t, dt: &mut dt, first: 1 }, &mut room);
            assert_eq!((t.len(), dt.len()), (9 + n as usize, 9 + n as usize));
            assert!(n as usize <= config.cue_samples && t[0] == 9.0 && dt[0] == 0.1, "the other ray stays");
            assert!(t[1..].windows(2).all(|w| w[0] < w[1]), "{config:?}, {depth}: {t:?}");
            assert!(dt.iter().all(|dt| *dt > 0.0), "{dt:?}");
            assert!((covered(&t, &dt) - 0.8).abs() < 1e-5, "{}", covered(&t, &dt));
            let inside = |t: f32| (0.5..=0.9 + 1e-6).contains(&t) || (1.1 - 1e-6..=1.5).contains(&t);
            assert!(t[1..].iter().all(|t| inside(*t)), "nothing where it is known to be empty: {t:?}");
            if config.cue_spread == 0.0 && config.cue_anywhere == 0.0 && depth == 1.25 {
                assert_eq!(n, 1, "places that fall on each other are one");
            }
        }
        let mut nothing = |start, end, depth| {
            let (mut t, mut dt) = marched();
            assert_eq!(
                cues.cut(start, end, depth, jitter, Intervals { t: &mut t, dt: &mut dt, first: 1 }, &mut room),
                0
            );
            assert_eq!((t, dt), marched(), "nothing is known, or nothing is left");
        };
        nothing(0.5, 1.5, 0.0);
        nothing(1.5, 1.5, 1.0);
    }
    // A surface that was measured inside a run gets its samples.
    let cues = cues(DepthCueConfig { cue_anywhere: 0.0, cue_spread: 0.01, ..LED }, |k| 2.0 + 0.02 * k as f32);
    let (mut t, mut dt) = marched();
    let n = cues.cut(0.5, 1.5, 1.25, 0.5, Intervals { t: &mut t, dt: &mut dt, first: 1 }, &mut room);
    assert!(n >= 20, "{n}");
}

#[test]
fn the_gradient_of_the_depth_loss_is_that_of_differences() {
    let (t, dt) = ([0.6, 0.8, 1.1, 1.3_f32], [0.2, 0.3, 0.2, 0.4_f32]);
    let w = [0.1, 0.4, 0.25, 0.05_f32];
    // Where the kernel is a square, where it is a line, and where next to nothing was hit.
    for (delta, measured, scale) in [(10.0, 0.9, 1.0), (1e-3, 0.4, 1.0), (1e-3, 1.6, 1.0), (0.2, 1.2, 1e-2)] {
        let cues = cues(DepthCueConfig { depth_delta: delta, ..LED }, |k| 2.0 + 0.02 * k as f32);
        let w = w.map(|w| scale * w);
        let value = |w: &[f32]| f64::from(cues.learn(w, &t, &dt, measured, 0.0, &mut [0.0; 4]));
        let mut bar = [1.5; 4];
        cues.learn(&w, &t, &dt, measured, 2.0, &mut bar);
        for i in 0..4 {
            let at = |sign: f32| {
                let mut w = w;
                w[i] += sign * 5e-3 * scale;
                value(&w)
            };
            let want = 1.5 + 2.0 * (at(1.0) - at(-1.0)) / f64::from(1e-2 * scale);
            let room = 1e-2 * want.abs().max(1.0 / f64::from(scale));
            assert!((f64::from(bar[i]) - want).abs() < room, "{delta}, {measured}: {} for {want}", bar[i]);
        }
    }
    let cues = cues(LED, |k| 2.0 + 0.02 * k as f32);
    let mut bar = [0.0; 4];
    let loss = cues.learn(&[0.0; 4], &t, &dt, 0.9, 1.0, &mut bar);
    assert!(loss.is_finite() && bar.iter().all(|b| b.is_finite()), "of a ray that meets nothing");
    assert_eq!(cues.learn(&[], &[], &[], 0.0, 1.0, &mut []), 0.0);
}

#[test]
fn rounds_come_when_they_are_due_and_then_no_more() {
    let cues = cues(DepthCueConfig { refine_every: 5, refine_rounds: 2, ..LED }, |_| 2.0);
    assert_eq!((0..30).filter(|&step| cues.is_due(step)).collect::<Vec<u64>>(), [5, 10]);
    assert!(cues.state().len() == 2 && cues.holds());
    let never = self::cues(LED, |_| 2.0);
    assert!((0..30).all(|step| !never.is_due(step)) && never.state().is_empty());
}
