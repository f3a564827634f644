//! A cloud that is nearly right, fitted to pictures: a short training without density control.

use super::cloud_frame::CloudFrame;
use super::cloud_parameters::CloudParameters;
use super::config::{CloudRates, PictureConfig, WideningKind};
use super::drawing::DrawnCloud;
use super::optimiser::Optimiser;
use super::pass::{LossParts, PARTS, StepCamera, ViewSpaceGradient, picture_pass};
use super::photo::view;
use super::planes::PlaneLayout;
use super::refusal::refused;
use super::terms::{L1Dssim, L1DssimConfig, PictureTerm, TargetPicture};
use super::turn::turn;
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
pub(crate) struct FittedPicture {
    /// A pinhole camera of the scene's frame.
    pub(crate) camera: Camera,
    /// `[3][rows][columns]`, on the background.
    pub(crate) rgb: Vec<f32>,
}

/// Which parameters are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fitted {
    /// All.
    All,
    /// Colours only: positions, shapes and opacities stay.
    Colours,
}

/// How a cloud is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RefineOptions {
    pub(crate) steps: u64,
    pub(crate) fitted: Fitted,
    /// What is behind the pictures.
    pub(crate) background: [f32; 3],
    pub(crate) seed: u64,
}

/// Learning rates of a fit: higher than those of a training for what is nearly right already.
fn rates(options: &RefineOptions) -> CloudRates {
    match options.fitted {
        Fitted::All => CloudRates {
            horizon: options.steps,
            fade_from: 1.0,
            fade_to: 1.0,
            lr_mean: LR_MEAN,
            lr_mean_end: LR_MEAN / 20.0,
            lr_dc: 1e-2,
            lr_logit: 0.05,
            lr_scale: 1e-2,
            lr_rotation: 2e-3,
        },
        Fitted::Colours => CloudRates {
            horizon: options.steps,
            fade_from: 1.0,
            fade_to: 1.0,
            lr_mean: NONE,
            lr_mean_end: NONE,
            lr_dc: 2e-2,
            lr_logit: 0.0,
            lr_scale: 0.0,
            lr_rotation: 0.0,
        },
    }
}

/// Raster settings: the pictures are small; later pictures of the cloud may be large.
const PICTURES: PictureConfig =
    PictureConfig { near: 0.01, widening: WideningKind::Dims, smoothing: 0.0, coarse: 0, coarse_steps: 1 };
/// Learning rate of the centres at the start.
const LR_MEAN: f64 = 1.6e-4;
const LOSS: L1DssimConfig = L1DssimConfig { dssim: 0.2 };

/// `cloud`, of the scene's frame, fitted to `pictures`; with no pictures or no steps as it is. `None` as soon as `go_on` says no.
///
/// # Errors
/// [`SystemError::Config`] for more Gaussians than the rasteriser can count.
pub(crate) fn refine(
    cloud: &Gaussians,
    pictures: &[FittedPicture],
    options: &RefineOptions,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Splats>, SystemError> {
    let cameras: Vec<DVec3> = pictures.iter().map(|s| s.camera.pose.c).collect();
    let (frame, _) = CloudFrame::around(&cameras, &[]);
    let (rates, settings) = (rates(options), PICTURES.raster());
    let mut cloud = CloudParameters::new(cloud.clone(), 0);
    frame.cloud_to_internal(&mut cloud.gaussians);
    let steps = if pictures.is_empty() || cloud.len() == 0 { 0 } else { options.steps };
    let simd = Simd::best();
    let Some(mut pass) = picture_pass(simd, PlaneLayout::default()) else { return Ok(None) };
    let mut terms: [Box<dyn PictureTerm>; 1] = [Box::new(L1Dssim::new(simd, &LOSS))];
    let mut gradient = [cloud.clone()];
    let mut optimiser = Optimiser::new(&cloud);
    let mut seconds = [0.0; PARTS.len()];
    for step in 0..steps {
        if !go_on() {
            return Ok(None);
        }
        let index = turn(Rng::new(options.seed, STREAM), step, pictures.len());
        let picture = &pictures[index];
        let view = view(&picture.camera, &frame);
        let degree = cloud.gaussians.degree();
        let camera = StepCamera { view: &view, settings: &settings, background: options.background };
        let target = TargetPicture { view: index, colour: &picture.rgb, weights: None };
        let mut parts = LossParts {
            terms: &mut terms,
            appearance: None,
            judge: None,
            judged: None,
            view_space: ViewSpaceGradient::Plain,
            step,
            camera: None,
            seconds: &mut seconds,
        };
        let drawn = [DrawnCloud::alone(&cloud.gaussians)];
        pass.run(&drawn, &camera, &target, &mut parts, &mut gradient).map_err(refused)?;
        let bad = optimiser.step(simd, &rates.at(step, 0.0), degree, &mut cloud, &mut gradient[0]);
        if bad > 0
            && let Some(rows) = without_non_finite(&cloud.gaussians).map_err(refused)?
        {
            cloud = CloudParameters::new(rows.follow(&cloud.gaussians).map_err(refused)?, 0);
            optimiser.follow(&rows, degree).map_err(refused)?;
            gradient = [cloud.clone()];
        }
        if (step + 1) % TIDY_EVERY == 0 {
            keep_in_range(&mut cloud.gaussians, 1.0).map_err(refused)?;
        }
    }
    let mut gaussians = cloud.gaussians;
    frame.cloud_to_world(&mut gaussians);
    let near = (f64::from(settings.near) * frame.scale) as f32;
    Ok(Some(Splats { gaussians, rules: settings.with_near(near) }))
}
