//! 3D Gaussian splatting: a cloud of Gaussians, drawn and compared photo by photo.
//!
//! Kerbl, Kopanas, Leimkühler, Drettakis, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023.
//!
//! Each step: one photo, all of them before any comes again; the cloud projected, sorted, composited (sections 4 and 6);
//! mean absolute difference and `1 - SSIM` (section 5.1); one step of Adam; now and then Gaussians are cloned, split, moved or
//! removed (section 5.2, or the Markov chain of Kheradmand et al., 2024).

use super::config::SplatConfig;
use super::density::Density;
use super::empty::{self, FreeSpace};
use super::frame::Frame;
use super::look::{Kept, LeftOut, Look};
use super::memory::{self, Pictures};
use super::optimiser::Optimiser;
use super::photo::{Photo, Photos, view};
use super::start::Start;
use super::step::{Lens, PARTS, Pass};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::{Layers, Query, SkipRow, Splats, StepStats, System, SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use glam::{DMat3, DVec3};
use optim::NonFiniteGuard;
use render_core::bounds::{Aabb, robust_box};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use splat_core::density::morton_order;
use splat_core::{Gaussians, View};
use std::sync::Mutex;
use std::time::Instant;

/// Streams of random numbers.
const EPOCHS: u64 = 0x6570_6f63;
const BACKGROUNDS: u64 = 0x6261_636b;
/// Side of the picture that a single ray is drawn as, where nothing is known of its pixel.
const RAY_RADIUS: f32 = 5e-4;

/// The system.
pub struct Splat {
    config: SplatConfig,
    seed: u64,
    background: Background,
    frame: Frame,
    simd: Simd,
    cloud: Gaussians,
    grad: Gaussians,
    optimiser: Optimiser,
    density: Density,
    guard: NonFiniteGuard,
    /// Photos at the size that steps are at.
    photos: Option<(u32, Photos)>,
    /// Where photos show that nothing is, as soon as it is asked for.
    free_space: Option<FreeSpace>,
    pictures: Pictures,
    photo: Photo,
    pass: Pass,
    kept: Kept,
    left_out: Mutex<LeftOut>,
    steps: u64,
    seconds: [f64; PARTS.len() + 2],
}

/// Timed besides the parts of the pass.
const OWN: [&str; 2] = ["optimiser", "density control"];

impl Splat {
    /// A cloud at its start.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(
        config: SplatConfig,
        frame: Frame,
        start: Start,
        background: Background,
        seed: u64,
        data: &Dataset,
    ) -> Result<Self, SystemError> {
        config.check()?;
        let cloud = morton_order(&start.cloud).and_then(|rows| rows.follow(&start.cloud)).map_err(refused)?;
        let mut pictures = Pictures::default();
        for camera in data.views().iter().map(|v| &v.camera) {
            let pixels = camera.width as usize * camera.height as usize;
            pictures.pixels = pictures.pixels.max(pixels);
            if !camera.lens.is_pinhole() {
                pictures.bent = pictures.bent.max(pixels);
                pictures.copied += pixels;
            }
        }
        Ok(Self {
            density: Density::new(&config, cloud.len()),
            grad: cloud.clone(),
            optimiser: Optimiser::new(&cloud),
            config,
            seed,
            background,
            frame,
            simd: Simd::best(),
            cloud,
            guard: NonFiniteGuard::default(),
            photos: None,
            free_space: None,
            pictures,
            photo: Photo::default(),
            pass: Pass::new(Simd::best()),
            kept: Kept::default(),
            left_out: Mutex::default(),
            steps: 0,
            seconds: [0.0; PARTS.len() + 2],
        })
    }

    /// The photo of a step: all of them, in an order of their own, before any comes again.
    fn turn(&self, step: u64, photos: usize) -> usize {
        let n = photos as u64;
        let rng = Rng::new(self.seed, EPOCHS).substream(step / n);
        let mut order: Vec<u32> = (0..photos as u32).collect();
        for i in (1..photos).rev() {
            order.swap(i, rng.below_at(i as u64, i as u32 + 1) as usize);
        }
        order[(step % n) as usize] as usize
    }

    /// The photo of a step: its camera, and what is behind it.
    fn show(&mut self, data: &Dataset, step: u64) -> Result<(Camera, [f32; 3]), SystemError> {
        let clock = Instant::now();
        let level = self.config.level(step);
        // Those of another level go before new ones come.
        let photos = match self.photos.take().filter(|(at, _)| *at == level) {
            Some((_, photos)) => photos,
            None => Photos::new(data, level)?,
        };
        let shown = photos.get(data, self.turn(step, photos.len()));
        self.photos = Some((level, photos));
        let (image, camera) = shown?;
        let rng = Rng::new(self.seed, BACKGROUNDS).substream(step);
        let background = self.background.of_ray(&rng, 0);
        self.photo.fill(&image, background);
        self.seconds[0] += clock.elapsed().as_secs_f64();
        Ok((camera, background))
    }

    /// Learn from the photo that is shown.
    fn learn(&mut self, step: u64, view: &View, background: [f32; 3]) -> Result<StepStats, SystemError> {
        let (rates, degree, rules) = (self.config.rates(step), self.config.degree(step), self.config.rules());
        let lens = Lens { simd: self.simd, view, rules: &rules, degree, background, dssim: self.config.dssim };
        let mut seconds = [0.0; PARTS.len()];
        let outcome = self.pass.run(&self.cloud, lens, &self.photo, &mut self.grad, &mut seconds).map_err(refused)?;
        for (sum, more) in self.seconds.iter_mut().zip(seconds) {
            *sum += more;
        }
        let clock = Instant::now();
        let (footprints, records) = self.pass.seen();
        let mut left_out = LeftOut::default();
        left_out.count(self.cloud.len(), footprints.len(), &outcome.drawn);
        self.note(&left_out);
        self.density.see(step, view.size, footprints, records).map_err(refused)?;
        let cost = self.density.price(&self.cloud, &mut self.grad).map_err(refused)?;
        let bad = self.optimiser.step(self.simd, &rates, degree, &mut self.cloud, &mut self.grad);
        self.guard.record(bad)?;
        self.seconds[PARTS.len()] += clock.elapsed().as_secs_f64();
        Ok(StepStats {
            loss: outcome.loss + cost,
            mse: outcome.mse,
            samples: outcome.drawn.pairs,
            nonfinite: bad as u64,
            ..StepStats::default()
        })
    }

    /// Gaussians come and go, and what belongs to them with them.
    fn change(&mut self, data: &Dataset, step: u64, bad: usize) -> Result<(), SystemError> {
        let clock = Instant::now();
        let (max, lr) = (self.config.max_splats, self.config.rates(step).mean);
        let looks = self.config.free_space && (step + 1).is_multiple_of(self.config.densify_every);
        if looks && self.free_space.is_none() {
            self.free_space = Some(FreeSpace::new(data, &self.frame)?);
        }
        let free_space = self.free_space.as_ref().filter(|_| looks);
        let floaters = |cloud: &_| free_space.map_or(Ok(None), |free| free.without_floaters(cloud, &self.frame));
        let changed =
            self.density.change((self.seed, step), (max, lr), &mut self.cloud, bad, floaters).map_err(refused)?;
        if let Some(rows) = &changed.rows {
            self.optimiser.follow(rows, self.cloud.degree()).map_err(refused)?;
        }
        if changed.faded {
            self.optimiser.forget_opacity();
        }
        if self.grad.len() != self.cloud.len() {
            self.grad = self.cloud.clone();
        }
        self.seconds[PARTS.len() + 1] += clock.elapsed().as_secs_f64();
        Ok(())
    }

    fn look(&self) -> Look<'_> {
        Look {
            cloud: &self.cloud,
            frame: &self.frame,
            rules: self.config.rules(),
            degree: self.config.degree(self.steps),
            simd: self.simd,
        }
    }

    fn note(&self, more: &LeftOut) {
        if let Ok(mut sum) = self.left_out.lock() {
            sum.add(more);
        }
    }

    /// A picture of one ray: a camera of one pixel that looks along it.
    fn ray(&self, ray: &Ray, radius: f32, query: &Query) -> Layers {
        let z = ray.d.normalize();
        let x = z.any_orthonormal_vector();
        let pose = Pose { r: DMat3::from_cols(x, z.cross(x), z), c: ray.o };
        // The radius of a pixel's cone is its half width times 2 / sqrt(12).
        let f = 1.0 / (f64::from(radius.max(1e-7)) * 3.0_f64.sqrt());
        let camera = Camera::pinhole(1, 1, f, f, 0.5, 0.5, pose);
        self.look().layers(&camera, query, &self.kept).map_or_else(|_| Layers::nothing(1, query), |(layers, _)| layers)
    }
}

impl System for Splat {
    fn name(&self) -> &'static str {
        "splat"
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        if data.is_empty() {
            return Ok(StepStats::default());
        }
        let (camera, background) = self.show(data, step)?;
        let view = view(&camera, &self.frame);
        let blank = self.photo.is_blank();
        self.note(&LeftOut { blank: [u64::from(blank), 1], ..LeftOut::default() });
        let stats = if blank { StepStats::default() } else { self.learn(step, &view, background)? };
        self.change(data, step, stats.nonfinite as usize)?;
        self.steps = step + 1;
        Ok(StepStats { rays: (view.size[0] * view.size[1]) as u64, ..stats })
    }

    fn render_view(&self, camera: &Camera, query: &Query) -> Option<Layers> {
        // A camera that cannot see shows nothing; ray by ray it would show no more.
        let nothing = || Layers::nothing(camera.width as usize * camera.height as usize, query);
        let drawn = self.look().layers(camera, query, &self.kept);
        Some(drawn.map_or_else(
            |_| nothing(),
            |(layers, left_out)| {
                self.note(&left_out);
                layers
            },
        ))
    }

    fn render_before(&self, camera: &Camera, depth: f64, query: &Query) -> Option<Vec<f32>> {
        let before = nearer(&self.cloud, &camera.pose, depth, &self.frame);
        let look = Look { cloud: &before, ..self.look() };
        let pixels = camera.width as usize * camera.height as usize;
        // A camera that cannot see shows nothing.
        Some(look.layers(camera, query, &self.kept).map_or_else(|_| vec![0.0; pixels], |(layers, _)| layers.opacity))
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![RAY_RADIUS; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let mut out = Layers::default();
        for (ray, &radius) in rays.iter().zip(radii) {
            out.extend(self.ray(ray, radius, query));
        }
        out
    }

    fn splats(&self) -> Option<Splats> {
        let mut gaussians = self.cloud.clone();
        self.frame.cloud_to_world(&mut gaussians);
        let near = (f64::from(self.config.near) * self.frame.scale) as f32;
        Some(Splats { gaussians, rules: self.config.rules().with_near(near) })
    }

    fn density(&self, _points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        // Gaussians are composited, not integrated: they have opacity on a picture and no density in space.
        out.fill(0.0);
    }

    fn colour(&self, _points: &[[f64; 3]], _d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let n = self.cloud.len();
        let points: Vec<DVec3> = (0..n)
            .map(|i| self.frame.to_world([0, 1, 2].map(|k| f64::from(self.cloud.mean[k * n + i])).into()))
            .collect();
        let around = robust_box(&points, 0.02).unwrap_or(Aabb { min: DVec3::ZERO, max: DVec3::ONE });
        [around.min.to_array(), around.max.to_array()]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        super::state::push(&self.cloud, &self.optimiser, &self.density, (self.steps, &self.guard))
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let restored = super::state::take(state, &self.config)?;
        (self.cloud, self.optimiser, self.density, (self.steps, self.guard)) = restored;
        self.grad = self.cloud.clone();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.cloud.len() * self.cloud.parameters_per_gaussian()
    }

    fn memory_bytes(&self) -> usize {
        let free_space = if self.config.free_space { empty::BYTES } else { 0 };
        memory::most(self.cloud.len(), self.cloud.parameters_per_gaussian(), self.pictures) + free_space
    }

    fn growth_bytes(&self) -> usize {
        let most = |splats| memory::most(splats, self.cloud.parameters_per_gaussian(), Pictures::default());
        most(self.config.max_splats).saturating_sub(most(self.cloud.len()))
    }

    fn skips(&self) -> Vec<SkipRow> {
        self.left_out.lock().map_or_else(|_| Vec::new(), |left_out| left_out.rows())
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        PARTS.into_iter().chain(OWN).zip(self.seconds).collect()
    }
}

/// Gaussians whose centres lie before `depth` along a camera's axis, world units; the others become transparent.
fn nearer(cloud: &Gaussians, pose: &Pose, depth: f64, frame: &Frame) -> Gaussians {
    let n = cloud.len();
    let mut before = cloud.clone();
    for i in 0..n {
        let x = frame.to_world([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])).into());
        if pose.to_camera(x).z >= depth {
            before.logit[i] = TRANSPARENT;
        }
    }
    before
}

/// Logit of an opacity that no picture shows.
const TRANSPARENT: f32 = -30.0;

/// A refusal of the rasteriser: more than can be counted.
fn refused(e: impl std::fmt::Display) -> SystemError {
    SystemError::Config { field: "max_splats", value: e.to_string(), problem: "allow fewer Gaussians".into() }
}
