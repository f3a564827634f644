//! A system that knows the sky and has one code, three offsets of colour, for each photo; and photos of it.

use crate::common::{Watch, sky_of};
use engine::RunError;

use engine::data::Dataset;

use engine::eval::Evaluation;
use engine::halt::Halt;
use engine::options::{Background, DataOptions, Plan, Request, RunOptions};
use engine::output::Disk;
use engine::run::{DefaultSystem, Parts, Run};
use engine::system::{
    Appearance, Fit, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, f32_tensor, take_f32,
};
use engine::train::{Schedule, Stop};
use glam::{DVec2, DVec3};

use render_core::camera::Camera;
use render_core::pose::Pose;
use render_core::ray::Ray;
use scene_io::{BitMask, Frame, Image, ImageSource, Scene, Split, TruthMask};

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Colour of what stands before the sky.
pub(super) const OCCLUDER: [u8; 3] = [255, 0, 255];

/// The sky in the appearance of each photo. With `many` off it knows one only, and no occluders.
pub(super) struct Sky {
    many: bool,
    codes: Vec<f32>,
}

pub(super) fn sky(d: DVec3) -> [f32; 3] {
    d.to_array().map(|c| (c * 0.25 + 0.5) as f32)
}

impl Sky {
    fn build(
        name: &str,
        _: &Scene,
        data: &Dataset,
        options: &RunOptions,
    ) -> Result<(Box<dyn System>, Plan), SystemError> {
        let background = options.background.unwrap_or(Background::Black);
        let plan = Plan { lines: Vec::new(), background, error_budget: 0.0, config: toml::Table::new() };
        Ok((Box::new(Self { many: name == "many", codes: vec![0.0; 3 * data.len()] }), plan))
    }
}

impl System for Sky {
    fn name(&self) -> &'static str {
        if self.many { "many" } else { "one" }
    }

    /// One step learns all codes.
    fn step(&mut self, data: &Dataset, _: u64) -> Result<StepStats, SystemError> {
        for view in 0..data.len() {
            let (rays, rgb) = pixels(data, view, &*data.image(view)?);
            let fit = Fit {
                rays: &rays,
                rgb: &rgb,
                time: 0.0,
                background: [0.0; 3],
                steps: 1,
                lr: 1.0,
                seed: 0,
                halt: &Halt::NEVER,
            };
            if let Some(code) = self.fit_appearance(&fit) {
                self.codes[3 * view..][..3].copy_from_slice(&code);
            }
        }
        Ok(StepStats::default())
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        let n = rays.len();
        let code = self.appearance_code(&query.appearance).unwrap_or_else(|| vec![0.0; 3]);
        Layers {
            rgb: rays.iter().map(|r| [0, 1, 2].map(|c| sky(r.d)[c] + code[c])).collect(),
            opacity: vec![1.0; n],
            depth: vec![10.0; n],
            median_depth: vec![10.0; n],
            normal: Vec::new(),
            canonical: Vec::new(),
            behind: Vec::new(),
        }
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        let views = (self.codes.len() / 3) as f32;
        self.many.then(|| match appearance {
            Appearance::Mean => (0..3).map(|c| self.codes.iter().skip(c).step_by(3).sum::<f32>() / views).collect(),
            Appearance::View(view) => self.codes[3 * view..][..3].to_vec(),
            Appearance::Code(code) => code.to_vec(),
        })
    }

    fn fit_appearance(&self, fit: &Fit<'_>) -> Option<Vec<f32>> {
        assert!(!fit.rays.is_empty() && fit.rays.len() == fit.rgb.len() && fit.steps > 0 && fit.lr > 0.0);
        // The mean of the differences is the least-squares solution; occluders pull at it.
        let mean = |c: usize| fit.rays.iter().zip(fit.rgb).map(|(r, rgb)| rgb[c] - sky(r.d)[c]).sum::<f32>();
        self.many.then(|| (0..3).map(|c| mean(c) / fit.rays.len() as f32).collect())
    }

    fn encode_appearance(&self, photo: &Image) -> Option<Vec<f32>> {
        let pixels = f64::from(photo.width * photo.height);
        let mean = |c: usize| photo.data.chunks_exact(3).map(|p| f64::from(p[c])).sum::<f64>() / pixels;
        self.many.then(|| (0..3).map(|c| (mean(c) / 255.0) as f32 - 0.5).collect())
    }

    fn visibility(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let photo = data.image(view)?;
        let is_static = |p: &[u8]| if p == OCCLUDER { 0.2 } else { 0.9 };
        Ok(self.many.then(|| photo.data.chunks_exact(3).map(is_static).collect()))
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
        vec![f32_tensor("codes", &self.codes)]
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.codes = take_f32(state, "codes", self.codes.len())?;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.codes.len()
    }

    fn memory_bytes(&self) -> usize {
        self.codes.len() * 4
    }

    fn skips(&self) -> Vec<SkipRow> {
        Vec::new()
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

pub(super) fn pixels(data: &Dataset, view: usize, photo: &Image) -> (Vec<Ray>, Vec<[f32; 3]>) {
    let all = (0..photo.height).flat_map(|y| (0..photo.width).map(move |x| (x, y)));
    all.filter_map(|(x, y)| {
        let rgb = photo.pixel(x, y);
        Some((data.ray(view, x, y)?, [0, 1, 2].map(|c| f32::from(rgb[c]) / 255.0)))
    })
    .unzip()
}

pub(super) const WIDTH: u32 = 15;
pub(super) const HEIGHT: u32 = 12;

/// Offset of photo `i`: far apart, and far from the mean.
pub(super) fn offset(i: usize) -> [f32; 3] {
    [0.1 * (i % 3) as f32 - 0.1, 0.08 * (i % 2) as f32, -0.05 * i as f32 / 5.0]
}

/// The picture of a camera in an offset appearance.
pub(super) fn photo(camera: &Camera, offset: [f32; 3]) -> Image {
    let mut data = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let d = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap().d;
            data.extend([0, 1, 2].map(|c| ((sky(d)[c] + offset[c]) * 255.0).round() as u8));
        }
    }
    Image::rgb(camera.width, camera.height, data).unwrap()
}

/// Six photos of the sky; the third and the sixth are held out. An occluder stands in the second.
pub(super) fn scene(width: u32) -> Scene {
    let frames = (0..6).map(|i| {
        let angle = i as f64 * 0.4;
        let pose = Pose::look_at(DVec3::ZERO, DVec3::new(angle.cos(), angle.sin(), 0.1), DVec3::Z).unwrap();
        let (cx, cy) = (f64::from(width) / 2.0, f64::from(HEIGHT) / 2.0);
        let camera = Camera::pinhole(width, HEIGHT, 14.0, 14.0, cx, cy, pose);
        let mut image = photo(&camera, offset(i));
        let mut frame = Frame::new(format!("photos/p{i}.png"), ImageSource::File("none".into()), camera);
        if i == 1 {
            // The truth is one column wider than what the system will find.
            for y in 3..9 {
                for x in 2..5 {
                    image.data[3 * (y * width as usize + x)..][..3].copy_from_slice(&OCCLUDER);
                }
            }
            let truth = BitMask::from_fn(width, HEIGHT, |x, y| (3..9).contains(&y) && (2..6).contains(&x));
            frame.truth.transient = Some(TruthMask::Memory(Arc::new(truth)));
        }
        frame.image = ImageSource::Memory(Arc::new(image));
        frame.split = if i % 3 == 2 { Split::Test } else { Split::Train };
        frame
    });
    sky_of(frames)
}

/// Paint columns of a frame's photo.
pub(super) fn paint(scene: &mut Scene, frame: usize, columns: std::ops::Range<u32>, rgb: [u8; 3]) {
    let ImageSource::Memory(image) = &scene.frames[frame].image else { panic!("in memory") };
    let mut image = Image::clone(image);
    for y in 0..image.height {
        for x in columns.clone() {
            image.data[3 * (y * image.width + x) as usize..][..3].copy_from_slice(&rgb);
        }
    }
    scene.frames[frame].image = ImageSource::Memory(Arc::new(image));
}

pub(super) fn with_parts<R>(scene: &Scene, work: impl FnOnce(Parts<'_>) -> R) -> R {
    let load = |_: &str, _: &DataOptions| -> Result<Scene, RunError> { Ok(scene.clone()) };
    work(Parts { load: &load, build: &Sky::build, storage: &Disk, default_system: DefaultSystem::Named("many") })
}

pub(super) fn request(system: &str, appearance: Option<&str>) -> Request {
    Request {
        scene: Some("sky".into()),
        system: Some(system.into()),
        eval_appearance: appearance.map(|word| word.parse().unwrap()),
        ..Request::default()
    }
}

/// Train a run of one step, which knows every training photo's appearance; hand it and its scores to `show`.
pub(super) fn trained<R>(
    folder: &Path,
    scene: &Scene,
    request: &Request,
    show: impl FnOnce(&mut Run<'_>, Evaluation) -> R,
) -> Result<R, RunError> {
    with_parts(scene, |parts| {
        let mut run = Run::create(folder, request, parts, &mut Watch::default())?;
        let schedule = Schedule::new(Stop::Steps(1));
        let evaluation = run.train(&schedule, None, &mut Watch::default(), &AtomicBool::new(false))?.1;
        Ok(show(&mut run, evaluation.unwrap()))
    })
}

pub(super) fn scores(scene: &Scene, system: &str, appearance: Option<&str>) -> Evaluation {
    let folder = tempfile::tempdir().unwrap();
    trained(folder.path(), scene, &request(system, appearance), |_, e| e).unwrap()
}
