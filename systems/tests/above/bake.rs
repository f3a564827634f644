//! A field as a cloud of Gaussians. The field is known exactly: a ball with stripes, lit by a code, before a sky or before
//! nothing.

use crate::common::train_split;
use engine::data::Dataset;
use engine::render::{plain_query, render};
use engine::system::{Appearance, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap};
use glam::DVec3;
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use scene_io::{Dialect, Frame, Image, ImageSource, LayoutHint, Scene};
use std::cell::Cell;
use std::sync::Arc;
use systems::bake::{BakeOptions, Baked, bake, recolour};
use systems::splats::Cloud;

const OPTIONS: BakeOptions = BakeOptions { rays: 40_000, most: 8000, steps: 150, degree: 1, seed: 0 };

struct Ball {
    sky: bool,
}

/// Where a ray meets the unit ball.
fn meets(ray: &Ray) -> Option<f64> {
    let (b, c) = (ray.o.dot(ray.d), ray.o.length_squared() - 1.0);
    let root = b * b - c;
    (root > 0.0).then(|| -b - root.sqrt()).filter(|t| *t > 0.0)
}

impl System for Ball {
    fn name(&self) -> &'static str {
        "ball"
    }

    fn step(&mut self, _: &Dataset, _: u64) -> Result<StepStats, SystemError> {
        Ok(StepStats::default())
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        let mut out = Layers::nothing(rays.len(), query);
        let light = match &query.appearance {
            Appearance::Code(code) => code[0],
            _ => 1.0,
        };
        for (i, ray) in rays.iter().enumerate() {
            if let Some(t) = meets(ray) {
                let x = ray.at(t);
                let stripe = if (x.z * 4.0).floor().rem_euclid(2.0) < 1.0 { 0.2 } else { 0.8 };
                out.rgb[i] = [stripe, 0.5 + 0.4 * x.x as f32, 0.5 - 0.4 * x.y as f32].map(|c| c * light);
                (out.opacity[i], out.depth[i], out.median_depth[i]) = (1.0, t as f32, t as f32);
            } else if self.sky {
                out.rgb[i] = [0.3, 0.5, 0.9].map(|c| c * light);
                out.opacity[i] = 1.0;
            }
        }
        out
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        Some(match appearance {
            Appearance::Code(code) => code.to_vec(),
            _ => vec![1.0],
        })
    }

    fn density(&self, _: &[[f64; 3]], _: f64, out: &mut [f32]) {
        out.fill(0.0);
    }

    fn colour(&self, _: &[[f64; 3]], _: &[[f32; 3]], _: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        [[-1.0; 3], [1.0; 3]]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }

    fn load_state(&mut self, _: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        0
    }

    fn memory_bytes(&self) -> usize {
        0
    }

    fn skips(&self) -> Vec<SkipRow> {
        Vec::new()
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

/// Cameras around the ball; their photos are never looked at.
fn data(views: usize) -> Dataset {
    let frames = (0..views).map(|i| {
        let angle = i as f64 * 2.399;
        let eye = DVec3::new(angle.cos(), angle.sin(), (i % 5) as f64 * 0.4 - 0.8).normalize() * 3.5;
        let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
        let camera = Camera::pinhole(48, 40, 48.0, 48.0, 24.0, 20.0, pose);
        let image = Image::rgb(48, 40, vec![0; 48 * 40 * 3]).unwrap();
        Frame::new(format!("view_{i:02}"), ImageSource::Memory(Arc::new(image)), camera)
    });
    let scene = Scene {
        name: "ball".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: Vec::new(),
        layout: LayoutHint::Unbounded,
        bounds: None,
        notes: Vec::new(),
    };
    train_split(&scene, 1 << 24)
}

fn baked(ball: &Ball, data: &Dataset, query: &Query, options: &BakeOptions) -> Baked {
    bake(ball, data, query, options, &|| true).unwrap().unwrap()
}

#[test]
fn a_baked_ball_looks_like_the_ball() {
    let (ball, data, query) = (Ball { sky: false }, data(16), plain_query([1.0; 3], 0.0));
    let seeds = baked(&ball, &data, &query, &BakeOptions { steps: 0, ..OPTIONS });
    let fitted = baked(&ball, &data, &query, &OPTIONS);
    let (seeds_psnr, psnr) = (seeds.psnr.unwrap(), fitted.psnr.unwrap());
    println!("{} Gaussians: {seeds_psnr:.1} dB as they begin, {psnr:.1} dB fitted", fitted.splats.gaussians.len());
    assert!(seeds_psnr > 17.0 && psnr > 21.0 && psnr > seeds_psnr + 1.5, "{seeds_psnr} {psnr}");
    let cloud = &fitted.splats.gaussians;
    let n = cloud.len();
    assert!(n <= OPTIONS.most);
    let far = (0..n).filter(|&i| {
        let x = DVec3::from([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])));
        (x.length() - 1.0).abs() > 0.2
    });
    assert!(far.count() * 50 < n, "Gaussians lie on the ball");
}

#[test]
fn the_sky_is_far_behind_the_ball() {
    let (ball, data, query) = (Ball { sky: true }, data(40), plain_query([0.0; 3], 0.0));
    let cloud = Cloud::exact(baked(&ball, &data, &query, &OPTIONS).splats);
    // From a camera of the fit: sky that no camera saw is not there, so the cameras kept aside see holes.
    let camera = data.views()[0].camera;
    let drawn = cloud.render(&camera, &query).unwrap().layers;
    let truth = render(&ball, &camera, &query).layers;
    let squares = drawn.rgb.iter().flatten().zip(truth.rgb.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
    let psnr = losses::metrics::psnr_of_mse(squares.sum::<f64>() / (3 * truth.rgb.len()) as f64);
    assert!(psnr > 24.0, "{psnr}");
    let pose = Pose::look_at(DVec3::new(0.0, 3.0, 0.0), DVec3::ZERO, DVec3::Z).unwrap();
    let view = cloud.render(&Camera::pinhole(40, 40, 50.0, 50.0, 20.0, 20.0, pose), &query).unwrap();
    assert!(view.layers.opacity.iter().filter(|o| **o > 0.8).count() > 1300, "the sky is opaque");
    // The mean depth of the ball holds what little of the sky, 200 away, shines through.
    let depth = &view.layers.depth;
    assert!(depth[20 * 40 + 20] < 10.0 && depth[0] > 100.0, "{} {}", depth[20 * 40 + 20], depth[0]);
}

#[test]
fn threads_do_not_change_a_bit_and_a_bake_can_be_stopped() {
    let (ball, data, query) = (Ball { sky: true }, data(9), plain_query([0.0; 3], 0.0));
    let options = BakeOptions { rays: 6000, steps: 12, ..OPTIONS };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| baked(&ball, &data, &query, &options))
    };
    assert!(on(1) == on(3));
    for most in [0, 3, 12] {
        let asked = Cell::new(0);
        let go_on = || {
            asked.set(asked.get() + 1);
            asked.get() <= most
        };
        assert_eq!(bake(&ball, &data, &query, &options, &go_on).unwrap(), None, "stopped after {most}");
    }
}

#[test]
fn another_light_changes_colours_alone() {
    let (ball, data, query) = (Ball { sky: false }, data(12), plain_query([0.0; 3], 0.0));
    let day = baked(&ball, &data, &query, &OPTIONS);
    let dim = Query { appearance: Appearance::Code(Arc::from([0.4].as_slice())), ..query.clone() };
    let night = recolour(&day, &ball, &data, &dim, &OPTIONS, &|| true).unwrap().unwrap();
    assert!(night.psnr.unwrap() > 22.0, "{:?}", night.psnr);
    let (a, b) = (&day.splats.gaussians, &night.splats.gaussians);
    assert_eq!((a.len(), &a.wxyz, &a.logit), (b.len(), &b.wxyz, &b.logit));
    let moved = a.mean.iter().zip(&b.mean).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved < 1e-5 && a.dc != b.dc, "{moved}");
}

#[test]
fn a_dataset_without_cameras_gives_an_empty_cloud() {
    let query = plain_query([0.0; 3], 0.0);
    let none = baked(&Ball { sky: false }, &data(0), &query, &OPTIONS);
    assert!(none.splats.gaussians.is_empty() && none.psnr.is_none());
}
