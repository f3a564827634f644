//! A field as a cloud of Gaussians: fast to draw, and readable by other programs.
//!
//! ```text
//! shots    pictures of the field from training cameras: colour, opacity, median depth
//! seeds    a Gaussian where pixels see matter, a far one where they see the sky
//! refine   a short fit of the cloud to those pictures
//! cache    the cloud beside the checkpoint it was made from
//! ```
//!
//! The result is a function of the field, the cameras and the options: the same bits with any number of threads.

mod cache;
mod seeds;
mod shots;

pub use cache::{FILE, load, store};

use crate::splats::Cloud;
use crate::views::refine::{Fitted, RefineOptions, refine};
use engine::data::Dataset;
use engine::error::RunError;
use engine::system::{Query, Splats, System};
use losses::metrics::psnr_of_mse;
use shots::{Picture, pictures};
use splat_core::density::{Rows, opacity};

/// Gaussians fainter than this after the fit are left out.
const FAINT: f64 = 0.02;

/// How much work a bake may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeOptions {
    /// Rays the field is asked for, about.
    pub rays: usize,
    /// Gaussians at most.
    pub most: usize,
    /// Steps of the fit; 0: none.
    pub steps: u64,
    /// Degree of the spherical harmonics, 0 to 3.
    pub degree: usize,
    /// Seed of the order of pictures.
    pub seed: u64,
}

impl BakeOptions {
    /// For the viewer and for export: some ten seconds on two cores for a field that draws 50 000 rays a second.
    pub const DEFAULT: Self = Self { rays: 300_000, most: 80_000, steps: 250, degree: 1, seed: 0 };

    /// A quick one: for an appearance or a time step that stays on the screen for a while.
    pub const QUICK: Self = Self { rays: 100_000, most: 40_000, steps: 120, ..Self::DEFAULT };
}

/// A field as a cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Baked {
    /// In the scene's frame and unit.
    pub splats: Splats,
    /// PSNR of the cloud against the field from training cameras that the fit did not see, dB; without such cameras from those it
    /// saw. `None` where there was no picture.
    pub psnr: Option<f64>,
}

/// The cloud that shows what the field shows with the appearance and at the time of `query`. `None` as soon as `go_on` says no; a
/// cloud system ([`System::splats`]) is its own cloud.
///
/// # Errors
/// [`RunError::System`] for options that cannot work.
///
/// # Panics
/// If the system gives fewer values than rays.
pub fn bake(
    system: &dyn System,
    data: &Dataset,
    query: &Query,
    options: &BakeOptions,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Baked>, RunError> {
    if let Some(splats) = system.splats(query) {
        return Ok(Some(Baked { splats, psnr: None }));
    }
    let Some(pictures) = pictures(system, data, query, options.rays, go_on) else { return Ok(None) };
    let fitted: Vec<&Picture> = pictures.iter().filter(|p| !p.is_aside).collect();
    let cloud = seeds::cloud(&fitted, options)?;
    let terms =
        RefineOptions { steps: options.steps, fitted: Fitted::All, background: query.background, seed: options.seed };
    fit(&cloud, &pictures, query, &terms, go_on)
}

/// `baked` with the appearance of `query`: its colours fitted to fewer pictures of the field, its shapes as they are. `None` as
/// soon as `go_on` says no.
///
/// # Errors
/// As [`bake`].
///
/// # Panics
/// When fields of the baked cloud disagree in length.
pub fn recolour(
    baked: &Baked,
    system: &dyn System,
    data: &Dataset,
    query: &Query,
    options: &BakeOptions,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Baked>, RunError> {
    let Some(pictures) = pictures(system, data, query, options.rays, go_on) else { return Ok(None) };
    let terms = RefineOptions {
        steps: options.steps,
        fitted: Fitted::Colours,
        background: query.background,
        seed: options.seed,
    };
    fit(&baked.splats.gaussians, &pictures, query, &terms, go_on)
}

fn fit(
    cloud: &splat_core::Gaussians,
    pictures: &[Picture],
    query: &Query,
    terms: &RefineOptions,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Baked>, RunError> {
    let fitted: Vec<_> = pictures.iter().filter(|p| !p.is_aside).map(Picture::fitted).collect();
    let Some(mut splats) = refine(cloud, &fitted, terms, go_on)? else { return Ok(None) };
    if terms.fitted == Fitted::All {
        let shows = |i: usize| opacity(&splats.gaussians, i) >= FAINT;
        if let Ok(kept) = Rows::keep(splats.gaussians.len(), shows).and_then(|rows| rows.follow(&splats.gaussians)) {
            splats.gaussians = kept;
        }
    }
    let psnr = psnr(&splats, pictures, query);
    Ok(Some(Baked { splats, psnr }))
}

/// PSNR of the cloud against pictures of the field: those kept aside, or all where none is.
fn psnr(splats: &Splats, pictures: &[Picture], query: &Query) -> Option<f64> {
    let cloud = Cloud::exact(splats.clone());
    let any_aside = pictures.iter().any(|p| p.is_aside);
    let (mut sum, mut count) = (0.0, 0_u64);
    for picture in pictures.iter().filter(|p| p.is_aside == any_aside) {
        let Ok(drawn) = cloud.render(&picture.camera, query) else { continue };
        for (a, b) in drawn.layers.rgb.iter().zip(&picture.layers.rgb) {
            for c in 0..3 {
                let difference = f64::from(a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0));
                sum += difference * difference;
            }
        }
        count += 3 * picture.layers.rgb.len() as u64;
    }
    (count > 0).then(|| psnr_of_mse(sum / count as f64))
}
