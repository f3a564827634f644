//! Settings of the driver's parts, each with what it does. Lengths are in *internal* units: the extent of the cameras is 1.

use super::place_codes::PlaceCodes;
use super::sample_places::SamplePlaces;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use splat_core::density::SizeLimit;
use splat_core::{Gaussians, MAX_DEGREE, RasterSettings, Widening};
use std::ops::RangeInclusive;

/// More Gaussians than this have no memory anywhere near a CPU.
pub(crate) const MOST: usize = 50_000_000;

/// Lengths in world units, and how far a scene may be from the origin: powers of them stay numbers in `f32`.
const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;

/// A setting that cannot work: its name, its value, what it must be.
pub(crate) struct Problem {
    pub(crate) field: &'static str,
    pub(crate) value: String,
    pub(crate) problem: &'static str,
}

/// Refuse `value` unless it is `fine`.
pub(crate) fn unless(fine: bool, field: &'static str, value: impl ToString, problem: &'static str) -> Option<Problem> {
    (!fine).then(|| Problem { field, value: value.to_string(), problem })
}

/// Refuse what is not a positive number.
pub(crate) fn positive(field: &'static str, x: f64) -> Option<Problem> {
    unless(x.is_finite() && x > 0.0, field, x, "must be a positive number")
}

/// Refuse what is negative or not a number.
pub(crate) fn not_negative(field: &'static str, x: f64) -> Option<Problem> {
    unless(x.is_finite() && x >= 0.0, field, x, "must be 0 or more")
}

/// # Errors
/// [`SystemError::Config`] naming the first problem.
pub(crate) fn first_of(problems: impl IntoIterator<Item = Option<Problem>>) -> Result<(), SystemError> {
    match problems.into_iter().flatten().next() {
        Some(Problem { field, value, problem }) => Err(SystemError::Config { field, value, problem: problem.into() }),
        None => Ok(()),
    }
}

/// A cloud: where it is, and how much of it there may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CloudConfig {
    /// Centre of the scene, world units.
    pub(crate) centre: [f64; 3],
    /// Internal length 1 in world units: 1.1 times the largest distance of a camera from the mean of all.
    pub(crate) radius: f64,
    /// There are never more Gaussians than this, from the first step on.
    pub(crate) max_splats: usize,
    /// No standard deviation is above this part of the distance to the nearest camera, but for those up to a hundredth: what is large
    /// beside a camera lies like fog over pictures from there. 0: no limit.
    pub(crate) near_size: f32,
    /// Degree of the spherical harmonics, 0 to 3.
    pub(crate) sh_degree: usize,
    /// Steps after which one more degree is active.
    pub(crate) sh_every: u64,
}

impl CloudConfig {
    /// How large Gaussians may be near cameras, where that is limited.
    pub(super) fn size_limit(&self) -> Option<SizeLimit> {
        (self.near_size > 0.0).then(|| SizeLimit::DEFAULT.with_part(self.near_size))
    }

    /// Active degree at a step, counted from 0.
    pub(crate) fn degree(&self, step: u64) -> usize {
        let degrees = step.checked_div(self.sh_every).unwrap_or(u64::MAX);
        self.sh_degree.min(usize::try_from(degrees).unwrap_or(MAX_DEGREE))
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let centre = self.centre;
        first_of([
            unless(LENGTHS.contains(&self.radius), "radius", self.radius, "must be 1e-9 to 1e9"),
            unless(
                centre.iter().all(|x| x.abs() <= *LENGTHS.end()),
                "centre",
                format!("{centre:?}"),
                "must be three numbers of at most 1e9",
            ),
            not_negative("near_size", self.near_size.into()),
            unless(self.sh_degree <= MAX_DEGREE, "sh_degree", self.sh_degree, "must be 0 to 3"),
            unless((1..=MOST).contains(&self.max_splats), "max_splats", self.max_splats, "must be 1 to 50 million"),
        ])
    }
}

/// Learning rates of a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CloudRates {
    /// Steps that the schedule is for: in them the learning rate of the centres falls to its end.
    pub(crate) horizon: u64,
    /// Share of them from which on all learning rates fall to `fade_to` of what they were.
    pub(crate) fade_from: f64,
    /// Factor that is left of all learning rates in the end.
    pub(crate) fade_to: f64,
    /// Learning rate of centres at the start.
    pub(crate) lr_mean: f64,
    /// Learning rate of centres at the end of the schedule.
    pub(crate) lr_mean_end: f64,
    /// Learning rate of colours at degree 0; those above: a twentieth of it.
    pub(crate) lr_dc: f64,
    /// Learning rate of opacities.
    pub(crate) lr_logit: f64,
    /// Learning rate of sizes.
    pub(crate) lr_scale: f64,
    /// Learning rate of rotations.
    pub(crate) lr_rotation: f64,
}

/// Learning rates of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepRates {
    pub(crate) mean: f64,
    dc: f64,
    logit: f64,
    scale: f64,
    rotation: f64,
    /// Of extra rows.
    pub(crate) extra: f64,
}

impl StepRates {
    /// In the order of the optimiser's groups.
    pub(crate) fn groups(&self) -> [f64; 8] {
        let rest = self.dc / 20.0;
        [self.mean, self.scale, self.rotation, self.logit, self.dc, rest, rest, rest]
    }
}

impl CloudRates {
    /// Rates of a step, counted from 0; `extra` is that of extra rows. That of the centres falls log-linearly, all of them fade in
    /// half a period of a cosine.
    pub(crate) fn at(&self, step: u64, extra: f64) -> StepRates {
        let part = (step as f64 / self.horizon.max(1) as f64).min(1.0);
        let mean = (self.lr_mean.ln() * (1.0 - part) + self.lr_mean_end.ln() * part).exp();
        let faded = ((part - self.fade_from) / (1.0 - self.fade_from).max(f64::EPSILON)).clamp(0.0, 1.0);
        let factor = self.fade_to + (1.0 - self.fade_to) * 0.5 * (1.0 + (std::f64::consts::PI * faded).cos());
        StepRates {
            mean: factor * mean,
            dc: factor * self.lr_dc,
            logit: factor * self.lr_logit,
            scale: factor * self.lr_scale,
            rotation: factor * self.lr_rotation,
            extra: factor * extra,
        }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([
            unless((0.0..=1.0).contains(&self.fade_from), "fade_from", self.fade_from, "must be a share, 0 to 1"),
            unless((0.0..=1.0).contains(&self.fade_to), "fade_to", self.fade_to, "must be a factor, 0 to 1"),
            positive("lr_mean", self.lr_mean),
            positive("lr_mean_end", self.lr_mean_end),
            not_negative("lr_dc", self.lr_dc),
            not_negative("lr_logit", self.lr_logit),
            not_negative("lr_scale", self.lr_scale),
            not_negative("lr_rotation", self.lr_rotation),
        ])
    }
}

/// Rows of parameters of each Gaussian beyond those that every cloud has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ExtraRows {
    /// How many.
    pub(crate) rows: usize,
    /// How many are composited, the first ones, as features of the picture.
    pub(crate) composited: usize,
    /// Their learning rate.
    pub(crate) rate: f64,
    /// What they are where a Gaussian begins.
    pub(crate) start: RowStart,
}

/// What extra rows are where a Gaussian begins.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum RowStart {
    /// 0.
    #[default]
    Zero,
    /// The code of the place where it begins.
    Place(PlaceCodes),
    /// The same, then where it looks in feature maps.
    PlaceAndSamples(PlaceCodes, SamplePlaces),
}

impl ExtraRows {
    /// `[rows][n]`, where the Gaussians of a cloud begin.
    pub(super) fn at_start(&self, cloud: &Gaussians) -> Vec<f32> {
        let mut rows = match self.start {
            RowStart::Zero => Vec::new(),
            RowStart::Place(codes) => codes.rows(cloud),
            RowStart::PlaceAndSamples(codes, samples) => [codes.rows(cloud), samples.rows(cloud)].concat(),
        };
        rows.resize(self.rows * cloud.len(), 0.0);
        rows
    }
}

/// [`Widening`] as a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum WideningKind {
    /// Opacity stays.
    Keeps,
    /// Opacity falls with the area gained.
    Dims,
}

/// Pictures: how they are rasterised, and how large they are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PictureConfig {
    /// Gaussians at this depth or nearer are left out.
    pub(crate) near: f32,
    /// What widening to a pixel does to opacity: `keeps` (as 3DGS) or `dims` (antialiased).
    pub(crate) widening: WideningKind,
    /// Variance of the 3D filter, squared pixels of the photos (Mip-Splatting: 0.2): no Gaussian is drawn smaller than about its root, so
    /// that pictures from nearer by than all photos show no needles; 0: there is none.
    pub(crate) smoothing: f32,
    /// Pictures begin at `2^-coarse` of their size.
    pub(crate) coarse: u32,
    /// Steps after which pictures double, until they have their size.
    pub(crate) coarse_steps: u64,
}

impl PictureConfig {
    /// What rasterising goes by.
    pub(crate) fn raster(&self) -> RasterSettings {
        let widening = match self.widening {
            WideningKind::Keeps => Widening::Keeps,
            WideningKind::Dims => Widening::Dims,
        };
        RasterSettings::DEFAULT.with_near(self.near).with_widening(widening)
    }

    /// By how many halvings the picture of a step is smaller.
    pub(crate) fn level(&self, step: u64) -> u32 {
        let doubled = step.checked_div(self.coarse_steps).unwrap_or(u64::MAX);
        self.coarse.saturating_sub(u32::try_from(doubled).unwrap_or(u32::MAX))
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([
            positive("near", self.near.into()),
            not_negative("smoothing", self.smoothing.into()),
            unless(self.coarse <= 6, "coarse", self.coarse, "must be at most 6"),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_is_where_its_numbers_work() {
        let cloud =
            CloudConfig { centre: [0.0; 3], radius: 1.0, max_splats: 9, near_size: 0.0, sh_degree: 1, sh_every: 3 };
        let said = |cloud: CloudConfig| cloud.check().map_err(|e| e.to_string());
        for radius in [1e-9, 1.0, 1e9] {
            assert_eq!(said(CloudConfig { radius, centre: [-1e9, 0.0, 1e9], ..cloud }), Ok(()));
        }
        for radius in [1e-300, 0.0, -1.0, 1e10, f64::INFINITY, f64::NAN] {
            let line = format!("`radius` = {radius}: must be 1e-9 to 1e9");
            assert_eq!(said(CloudConfig { radius, ..cloud }), Err(line));
        }
        for x in [1e10, f64::NAN, f64::NEG_INFINITY] {
            let centre = [0.0, x, 0.0];
            let line = format!("`centre` = {centre:?}: must be three numbers of at most 1e9");
            assert_eq!(said(CloudConfig { centre, ..cloud }), Err(line));
        }
    }
}
