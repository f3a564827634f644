//! A small but real system, and a small scene, for tests of what stands above systems.

use engine::RunError;
use engine::data::{Batch, Dataset};
use engine::options::{Background, DataOptions, Plan, Request, RunOptions};
use engine::output::{Disk, Storage};
use engine::progress::{Event, Observer, Progress};
use engine::run::{DefaultSystem, Parts, Run};
use engine::system::{Layers, Normals, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorData, TensorMap};
use engine::train::{Ended, Schedule, Stop};
use field_core::rng::Rng;
use glam::DVec3;
use render_core::camera::Camera;
use render_core::pose::Pose;
use render_core::ray::Ray;
use scene_io::{Dialect, Frame, Image, ImageSource, ImageStore, LayoutHint, Scene, Split, StoreOptions};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Cells along each axis of a face of the cube of directions.
const SIDE: usize = 16;
const CELLS: usize = 6 * SIDE * SIDE;
const RAYS: usize = 512;

/// An environment cube: one colour for each direction, learnt by momentum descent. Everything is at infinity.
pub(crate) struct Sky {
    seed: u64,
    lr: f32,
    background: [f32; 3],
    colour: Vec<f32>,
    momentum: Vec<f32>,
    steps: u64,
    batch: Batch,
    seconds: f64,
    /// What it says of a transient part that it has not.
    transient: f64,
}

impl Sky {
    pub(crate) fn build(
        name: &str,
        _scene: &Scene,
        data: &Dataset,
        options: &RunOptions,
    ) -> Result<(Box<dyn System>, Plan), SystemError> {
        assert_eq!(name, "sky");
        let lr = options.set.get("lr").and_then(|v| v.as_float()).unwrap_or(0.5);
        if !(0.0..10.0).contains(&lr) {
            return Err(SystemError::Config {
                field: "lr",
                value: lr.to_string(),
                problem: "must lie in (0, 10)".into(),
            });
        }
        let background = options.background.unwrap_or(Background::White);
        let plan = Plan {
            lines: vec![format!("sky: {} views, so one cube of colours is enough", data.len())],
            background,
            error_budget: options.error_budget.unwrap_or(0.0),
            config: toml::Table::from_iter([("lr".to_string(), toml::Value::Float(lr))]),
        };
        let system = Self {
            seed: options.seed,
            lr: lr as f32,
            background: background.colour(),
            colour: vec![0.5; CELLS * 3],
            momentum: vec![0.0; CELLS * 3],
            steps: 0,
            batch: Batch::default(),
            seconds: 0.0,
            transient: options.set.get("transient").and_then(|v| v.as_float()).unwrap_or(0.0),
        };
        Ok((Box::new(system), plan))
    }

    fn cell(d: DVec3) -> usize {
        let a = d.abs();
        let (face, m, u, v) = if a.x >= a.y && a.x >= a.z {
            (usize::from(d.x < 0.0), a.x, d.y, d.z)
        } else if a.y >= a.z {
            (2 + usize::from(d.y < 0.0), a.y, d.z, d.x)
        } else {
            (4 + usize::from(d.z < 0.0), a.z, d.x, d.y)
        };
        let place = |x: f64| (((x / m + 1.0) * 0.5 * SIDE as f64) as usize).min(SIDE - 1);
        (face * SIDE + place(u)) * SIDE + place(v)
    }
}

impl System for Sky {
    fn name(&self) -> &'static str {
        "sky"
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let clock = std::time::Instant::now();
        let mut batch = std::mem::take(&mut self.batch);
        data.draw(self.seed, step, RAYS, &mut batch)?;
        let mut gradient = vec![0.0_f32; CELLS * 3];
        let mut mse = 0.0;
        // A pinch of noise that must come from (seed, step): a resumed run that restarts the stream would differ.
        let noise = Rng::new(self.seed, 99).substream(step);
        for i in 0..batch.len() {
            let cell = Self::cell(batch.rays[i].d);
            for c in 0..3 {
                let truth = batch.rgb[i][c] * batch.alpha[i] + self.background[c] * (1.0 - batch.alpha[i]);
                let error = self.colour[cell * 3 + c] - truth + 1e-3 * (noise.uniform_at(i as u64) - 0.5);
                gradient[cell * 3 + c] += batch.weight[i] * error;
                mse += f64::from(error * error) / (3 * RAYS) as f64;
            }
        }
        for ((x, m), g) in self.colour.iter_mut().zip(&mut self.momentum).zip(&gradient) {
            *m = 0.9 * *m + 0.1 * g;
            *x -= self.lr * *m;
        }
        self.batch = batch;
        self.steps += 1;
        self.seconds += clock.elapsed().as_secs_f64();
        Ok(StepStats {
            loss: mse,
            mse,
            rays: RAYS as u64,
            samples: RAYS as u64,
            nonfinite: 0,
            transient: self.transient,
        })
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        let n = rays.len();
        Layers {
            rgb: rays.iter().map(|r| self.colour[Self::cell(r.d) * 3..][..3].try_into().unwrap()).collect(),
            opacity: vec![1.0; n],
            depth: vec![100.0; n],
            median_depth: vec![100.0; n],
            normal: match query.layers.normals {
                Normals::Compute => rays.iter().map(|r| (-r.d).as_vec3().to_array()).collect(),
                Normals::Skip => Vec::new(),
            },
            canonical: Vec::new(),
            behind: Vec::new(),
        }
    }

    fn density(&self, points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        // A solid unit ball: something to export.
        for (p, out) in points.iter().zip(out) {
            *out = if DVec3::from(*p).length() < 1.0 { 100.0 } else { 0.0 };
        }
    }

    fn colour(&self, points: &[[f64; 3]], _d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        for (p, out) in points.iter().zip(out) {
            let cell = Self::cell(DVec3::from(*p));
            *out = self.colour[cell * 3..][..3].try_into().unwrap();
        }
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        [[-2.0; 3], [2.0; 3]]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let f32s = |name: &str, data| Tensor {
            name: name.into(),
            shape: vec![CELLS, 3],
            data: TensorData::F32(Cow::Borrowed(data)),
        };
        let steps =
            Tensor { name: "steps".into(), shape: vec![1], data: TensorData::U64(Cow::Owned(vec![self.steps])) };
        vec![f32s("colour", &self.colour), f32s("momentum", &self.momentum), steps]
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let get = |name: &str| {
            let missing = || SystemError::State { name: name.into(), problem: "is missing".into() };
            state.get(name).ok_or_else(missing)
        };
        for (name, into) in [("colour", &mut self.colour), ("momentum", &mut self.momentum)] {
            match &get(name)?.data {
                TensorData::F32(x) if x.len() == into.len() => into.copy_from_slice(x),
                _ => return Err(SystemError::State { name: name.into(), problem: "has another shape".into() }),
            }
        }
        if let TensorData::U64(x) = &get("steps")?.data {
            self.steps = x[0];
        }
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.colour.len()
    }

    fn memory_bytes(&self) -> usize {
        (self.colour.len() + self.momentum.len()) * 4
    }

    fn skips(&self) -> Vec<SkipRow> {
        vec![SkipRow::counted("nothing", 0, self.steps, "steps", "0".into())]
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("step", self.seconds)]
    }
}

/// `views` cameras at the origin that look along half a horizon, at a sky whose colour is its direction; one of four, from
/// the third, is held out. With
/// `masked`, the left half of every image is ignored and holds nonsense.
pub(crate) fn sky_scene(views: usize, side: u32, masked: bool) -> Scene {
    let frames = (0..views).map(|i| {
        let angle = i as f64 / views as f64 * std::f64::consts::PI;
        let target = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let pose = Pose::look_at(DVec3::ZERO, target, DVec3::Z).unwrap();
        let centre = f64::from(side) / 2.0;
        let camera = Camera::pinhole(side, side, centre, centre, centre, centre, pose);
        let (mut data, mut mask) = (Vec::new(), Vec::new());
        for y in 0..side {
            for x in 0..side {
                let d = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap().d;
                let ignored = masked && x < side / 2;
                data.extend(d.to_array().map(|c| if ignored { 255 } else { ((c * 0.4 + 0.5) * 255.0) as u8 }));
                mask.push(if ignored { 0 } else { 255 });
            }
        }
        let mut image = Image::rgb(side, side, data).unwrap();
        image.mask = masked.then_some(mask);
        let mut frame = Frame::new(format!("view_{i:02}"), ImageSource::Memory(Arc::new(image)), camera);
        frame.split = if i % 4 == 2 { Split::Test } else { Split::Train };
        frame
    });
    sky_of(frames)
}

/// A scene of photos of the sky.
pub(crate) fn sky_of(frames: impl Iterator<Item = Frame>) -> Scene {
    Scene {
        name: "sky".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: Vec::new(),
        layout: LayoutHint::Unbounded,
        bounds: None,
        notes: Vec::new(),
    }
}

/// The train split of a scene with room for `budget` bytes of images.
pub(crate) fn train_split(scene: &Scene, budget: u64) -> Dataset {
    let options = StoreOptions::default().with_budget_bytes(budget);
    let store = Arc::new(ImageStore::new(&scene.frames, options).unwrap());
    Dataset::new(scene, store, scene.split(Split::Train).collect()).unwrap()
}

/// The parts of a run of [`Sky`] on `scene`.
pub(crate) fn with_parts<R>(storage: &dyn Storage, scene: &Scene, work: impl FnOnce(Parts<'_>) -> R) -> R {
    let load = |_: &str, _: &DataOptions| -> Result<Scene, RunError> { Ok(scene.clone()) };
    let build =
        |name: &str, scene: &Scene, data: &Dataset, options: &RunOptions| Sky::build(name, scene, data, options);
    work(Parts { load: &load, build: &build, storage, default_system: DefaultSystem::Named("sky") })
}

/// What `train sky --seed 5` asks for.
pub(crate) fn request() -> Request {
    Request { scene: Some("sky".into()), seed: Some(5), ..Request::default() }
}

/// Remembers what was said, and raises `interrupt` after the step given.
#[derive(Default)]
pub(crate) struct Watch {
    pub(crate) warnings: Vec<String>,
    pub(crate) last: Progress,
    pub(crate) stop_after: Option<u64>,
    pub(crate) interrupt: Arc<AtomicBool>,
}

impl Observer for Watch {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Warning(line) => self.warnings.push(line.into()),
            Event::Step(progress) => {
                self.last = *progress;
                self.interrupt.store(self.stop_after.is_some_and(|at| progress.step >= at), Ordering::Relaxed);
            }
            _ => {}
        }
    }
}

/// Train a new run to `stop`, or until `watch` stops it.
pub(crate) fn start(folder: &Path, storage: &dyn Storage, stop: Stop, watch: &mut Watch) -> Result<Ended, RunError> {
    with_parts(storage, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::create(folder, &request(), parts, watch)?;
        let interrupt = watch.interrupt.clone();
        Ok(run.train(&schedule(stop), None, watch, &interrupt)?.0)
    })
}

/// Resume a run and train it to `stop`.
pub(crate) fn resume(folder: &Path, stop: Stop, watch: &mut Watch) -> Result<Ended, RunError> {
    with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        let mut run = Run::open(folder, &Request::default(), parts, watch)?;
        let interrupt = watch.interrupt.clone();
        Ok(run.train(&schedule(stop), None, watch, &interrupt)?.0)
    })
}

fn schedule(stop: Stop) -> Schedule {
    Schedule { row_every: 0.0, ..Schedule::new(stop) }
}

/// The array file of a checkpoint.
pub(crate) fn arrays(folder: &Path, step: u64) -> Vec<u8> {
    std::fs::read(folder.join(format!("checkpoint/step-{step:08}.safetensors"))).unwrap()
}
