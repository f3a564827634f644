//! A cloud that is nearly right, fitted to pictures: a short training without density control.

use super::config::{SplatConfig, WideningKind};
use super::frame::Frame;
use super::optimiser::Optimiser;
use super::photo::{Photo, view};
use super::step::{Lens, PARTS, Pass};
use engine::system::{Splats, SystemError};
use field_core::rng::Rng;
use float_core::Simd;
use glam::DVec3;
use render_core::camera::Camera;
use splat_core::Gaussians;
use splat_core::density::{keep_in_range, without_non_finite};

/// Stream of random numbers: the order of the pictures.
const STREAM: u64 = 0x7265_6669_6e65;
/// Steps between two checks for parameters out of range.
const TIDY_EVERY: u64 = 10;
/// A learning rate that changes nothing; the schedule needs a positive one.
const NONE: f64 = 1e-30;

/// A picture to fit to.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// A pinhole camera of the scene's frame.
    pub(crate) camera: Camera,
    /// `[3][rows][columns]`, on the background.
    pub(crate) rgb: Vec<f32>,
}

/// Which parameters are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Learns {
    /// All.
    All,
    /// Colours only: positions, shapes and opacities stay.
    Colours,
}

/// How a cloud is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RefineOptions {
    pub(crate) steps: u64,
    pub(crate) learns: Learns,
    /// What is behind the pictures.
    pub(crate) background: [f32; 3],
    pub(crate) seed: u64,
}

/// Raster settings and world units of the frame that shots are fitted in.
fn settings(shots: &[Shot], options: &RefineOptions) -> (SplatConfig, Frame) {
    let cameras: Vec<DVec3> = shots.iter().map(|s| s.camera.pose.c).collect();
    let (frame, _) = Frame::around(&cameras, &[]);
    let published = SplatConfig::published(frame.centre, frame.scale, options.steps);
    let mut config = SplatConfig {
        // All bands from the first step on.
        sh_every: 0,
        lr_mean_end: published.lr_mean / 20.0,
        lr_dc: 1e-2,
        lr_scale: 1e-2,
        lr_rotation: 2e-3,
        // The pictures are small; what looks at the cloud later may be large.
        widening: WideningKind::Dims,
        ..published
    };
    if options.learns == Learns::Colours {
        (config.lr_mean, config.lr_mean_end) = (NONE, NONE);
        (config.lr_logit, config.lr_scale, config.lr_rotation) = (0.0, 0.0, 0.0);
        config.lr_dc = 2e-2;
    }
    (config, frame)
}

/// `cloud`, of the scene's frame, fitted to `shots`; with no shots or no steps as it is. `None` as soon as `go_on` says no.
///
/// # Errors
/// [`SystemError::Config`] for more Gaussians than the rasteriser can count.
pub(crate) fn refine(
    cloud: &Gaussians,
    shots: &[Shot],
    options: &RefineOptions,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Splats>, SystemError> {
    let (config, frame) = settings(shots, options);
    let rules = config.rules();
    let mut cloud = cloud.clone();
    frame.cloud_to_internal(&mut cloud);
    let steps = if shots.is_empty() || cloud.is_empty() { 0 } else { options.steps };
    let simd = Simd::best();
    let mut pass = Pass::new(simd);
    let mut grad = cloud.clone();
    let mut optimiser = Optimiser::new(&cloud);
    let mut photo = Photo::default();
    let mut seconds = [0.0; PARTS.len()];
    for step in 0..steps {
        if !go_on() {
            return Ok(None);
        }
        let shot = &shots[turn(options.seed, step, shots.len())];
        photo.show(&shot.rgb);
        let view = view(&shot.camera, &frame);
        let degree = cloud.degree();
        let lens =
            Lens { simd, view: &view, rules: &rules, degree, background: options.background, dssim: config.dssim };
        pass.run(&cloud, lens, &photo, &mut grad, &mut seconds).map_err(refused)?;
        let bad = optimiser.step(simd, &config.rates(step), degree, &mut cloud, &mut grad);
        if bad > 0
            && let Some(rows) = without_non_finite(&cloud).map_err(refused)?
        {
            cloud = rows.follow(&cloud).map_err(refused)?;
            optimiser.follow(&rows, cloud.degree()).map_err(refused)?;
            grad = cloud.clone();
        }
        if (step + 1) % TIDY_EVERY == 0 {
            keep_in_range(&mut cloud, 1.0).map_err(refused)?;
        }
    }
    frame.cloud_to_world(&mut cloud);
    let near = (f64::from(rules.near) * frame.scale) as f32;
    Ok(Some(Splats { gaussians: cloud, rules: rules.with_near(near) }))
}

/// The picture of a step: each once, in an order of its own, before any comes again.
pub(super) fn turn(seed: u64, step: u64, pictures: usize) -> usize {
    let n = pictures as u64;
    let rng = Rng::new(seed, STREAM).substream(step / n);
    let mut order: Vec<u32> = (0..pictures as u32).collect();
    for i in (1..pictures).rev() {
        order.swap(i, rng.below_at(i as u64, i as u32 + 1) as usize);
    }
    order[(step % n) as usize] as usize
}

fn refused(e: impl std::fmt::Display) -> SystemError {
    SystemError::Config { field: "max_splats", value: e.to_string(), problem: "allow fewer Gaussians".into() }
}
