//! NeRF in the Wild, and its ablations NeRF-A (appearance alone) and NeRF-U (occluders alone).
//!
//! Martin-Brualla, Radwan, Sajjadi, Barron, Dosovitskiy, Duckworth, "NeRF in the Wild: Neural Radiance Fields for
//! Unconstrained Photo Collections", 2021, section 4.
//!
//! Each photo has an appearance code, on which colours depend, and a transient code: with it a second, transient field
//! explains what is in this photo alone, composited together with the static one, and predicts how uncertain its colours are.
//! The loss is the likelihood of the photo under that uncertainty:
//!
//! ```text
//! L = |C - Y|^2 / (2 beta^2) + ln beta + lambda_u mean(sigma_t)        beta = beta_min + sum(w_t beta_t)
//! ```
//!
//! A picture from elsewhere shows the static field alone, with a transmittance of its own.

use super::choice::OccluderKind;
use super::combined::Wild;
use super::planning::{Build, Planning};
use crate::appearance::AppearanceModel;
use crate::appearance::codes::FreeCodes;
use crate::appearance::config::CodeConfig;
use crate::claims::Claim;
use crate::codes::CodeTable;
use crate::limits::{MOST, above_0, within};
use crate::occluders::OccluderModel;
use crate::occluders::likelihood::{self, PixelLikelihood, likelihood};
use crate::occluders::none::NoOccluders;
use crate::occluders::pixel_error::{KernelConfig, KernelKind, squared};
use crate::photo_model::{Codes, Outcome, PhotoAndRender, Pixel, PixelBar};
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorMap};
use losses::kernel::Kernel;
use losses::uncertainty::Likelihood;
use serde::{Deserialize, Serialize};

/// `nerf-a`: codes of appearance alone.
pub(crate) const NERF_A: Claim = Claim {
    name: "nerf-a",
    paper: "Martin-Brualla et al., 2021",
    what: "Appearance: a free code for each photo",
    take: "photos that differ in exposure, weather or time of day, without occluders",
    differs: "On ngp's field with codes of 16 numbers and the Charbonnier loss (0.05) instead of the squared error, which also \
              helps against occluders. `--field mlp` has published networks, codes and squared error.",
    mark: "Charbonnier, ngp field",
};

/// `nerf-u`: the transient part alone.
pub(crate) const NERF_U: Claim = Claim {
    name: "nerf-u",
    paper: "Martin-Brualla et al., 2021",
    what: "Occluders: a transient field with uncertainty",
    take: "to compare with `robust-nerf`",
    differs: "On ngp's field with a sample before each camera for occluders, beta_min 0.1, and the loss grows \
              linearly for errors well above 0.05. `--field mlp` has published networks and squared error, but transient \
              density begins at softplus(x - 3).",
    mark: "robust tail, ngp field",
};

/// `nerf-w`: both.
pub(crate) const NERF_W: Claim = Claim {
    name: "nerf-w",
    paper: "Martin-Brualla et al., 2021",
    what: "Appearance: a free code for each photo; occluders: a transient field with uncertainty",
    take: "few photos of a place, of different appearance and with occluders",
    differs: "On ngp's field with codes of 16 numbers, a sample before each camera for occluders, beta_min 0.1, and the \
              loss grows linearly for errors well above 0.05. `--field mlp` has published networks, codes and squared error, but \
              transient density begins at softplus(x - 3).",
    mark: "robust tail, ngp field",
};

/// Settings of the transient field and of the likelihood.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransientConfig {
    /// Length of a transient code.
    pub transient_dims: usize,
    /// Learning rate of transient codes, relative to that of the field's networks.
    pub transient_lr: f32,
    /// Least uncertainty of a pixel, colour units.
    pub beta_min: f32,
    /// Above errors of about this the loss grows linearly instead of as the square, colour units; 0: always the square, as published.
    pub tail: f32,
    /// Factor of the mean transient density.
    pub lambda_u: f32,
}

impl TransientConfig {
    /// As published; `beta_min` as in the released code.
    pub const PUBLISHED: Self =
        Self { transient_dims: 16, transient_lr: 1.0, beta_min: 0.1, tail: 0.0, lambda_u: 0.01 };

    /// On the hash grid (`docs/decisions/0016-nerf-w-on-a-fast-field.md`).
    pub const HASH_GRID: Self = Self { transient_dims: 32, tail: 0.05, ..Self::PUBLISHED };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        within("transient_dims", self.transient_dims, 1..=512)?;
        above_0("transient_lr", self.transient_lr, MOST)?;
        likelihood::check(self.beta_min, self.tail)?;
        within("lambda_u", self.lambda_u, 0.0..=MOST)
    }
}

/// As published: appearance codes of 48 numbers.
pub(super) const CODES: CodeConfig = CodeConfig { appearance_dims: 48, code_lr: 1.0, code_size: 1e-5 };

/// On the hash grid (`docs/decisions/0016-nerf-w-on-a-fast-field.md`).
pub(crate) const HASH_GRID_CODES: CodeConfig = CodeConfig { appearance_dims: 16, code_lr: 0.25, code_size: 1e-2 };

/// Squared errors, as published.
pub(super) const SQUARED: KernelConfig = KernelConfig { kernel: KernelKind::Squared, kernel_scale: 0.05 };

/// On the hash grid, which explains an occluder within a few hundred steps where errors are squared.
pub(super) const CHARBONNIER: KernelConfig = KernelConfig { kernel: KernelKind::Charbonnier, ..SQUARED };

/// Codes of `dims` numbers and robust errors on the hash grid: the photo model of a field that is trained for something else.
pub(crate) fn with_codes(dims: usize, data: &Dataset, seed: u64) -> Wild {
    let codes = CodeConfig { appearance_dims: dims, ..HASH_GRID_CODES };
    Wild {
        name: "nerf-a",
        appearance: Some(Box::new(FreeCodes::new(&codes, data.len(), seed))),
        occluders: Box::new(NoOccluders { kernel: CHARBONNIER.kernel(), coarse: Kernel::Squared }),
    }
}

/// A free code for each photo.
pub(super) fn appearance<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn AppearanceModel>, SystemError> {
    let mut planned = planning.by_field(HASH_GRID_CODES, CODES);
    // Where occluders have codes in image space, too, appearance has to be free to move first.
    if matches!(planning.choice.occluders, OccluderKind::Visibility | OccluderKind::Filter) {
        planned.code_size = CODES.code_size;
    }
    let settings: CodeConfig = planning.settings.of(&planned)?;
    settings.check()?;
    let (views, seed) = (planning.data.len(), planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(FreeCodes::new(&settings, views, seed)))))
}

/// Appearance alone: errors are squared, or robust on the hash grid.
pub(super) fn no_occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let settings: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    settings.check()?;
    let kernel = settings.kernel();
    Ok(Box::new(move || Ok(Box::new(NoOccluders { kernel, coarse: Kernel::Squared }))))
}

/// The transient field.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let planned = planning.by_field(TransientConfig::HASH_GRID, TransientConfig::PUBLISHED);
    let settings: TransientConfig = planning.settings.of(&planned)?;
    settings.check()?;
    planning.of_field.transient = true;
    let (views, seed) = (planning.data.len(), planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(Transient::new(&settings, views, seed)))))
}

/// The codes of the transient field, and the loss.
struct Transient {
    codes: CodeTable,
    lr: f64,
    likelihood: Likelihood,
    lambda_u: f32,
}

impl Transient {
    fn new(settings: &TransientConfig, views: usize, seed: u64) -> Self {
        Self {
            codes: CodeTable::new("transient", views, settings.transient_dims, seed),
            lr: f64::from(settings.transient_lr),
            likelihood: likelihood(settings.beta_min, settings.tail),
            lambda_u: settings.lambda_u,
        }
    }

    /// `beta = beta_min + sum(w_t beta_t)`
    fn beta(&self, pixel: &Pixel) -> f32 {
        self.likelihood.beta_min + pixel.beta
    }
}

impl OccluderModel for Transient {
    fn transient_codes(&self) -> Option<Codes<'_>> {
        Some(self.codes.codes())
    }

    /// `|C - Y|^2 / (2 beta^2) + ln beta + lambda_u mean(sigma_t)`
    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let PixelLikelihood { loss, rgb_bar, beta_bar } =
            likelihood::pixel(&self.likelihood, pixel.rgb, truth, self.beta(pixel));
        let bar = PixelBar { rgb: rgb_bar, beta: beta_bar, sigma_t: self.lambda_u };
        (loss + self.lambda_u * pixel.sigma_t, bar)
    }

    /// Half the squared error, which is the loss of the fine render where nothing is uncertain (equation 14).
    fn coarse_loss(&self, _i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = squared(rgb, truth, 0.5);
        (loss, bar.rgb)
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.codes.learn(outcome.simd, outcome.lr * self.lr, &outcome.batch.view, outcome.transient_bar, 0.0)
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        Some(seen.pixels.iter().map(|pixel| if pixel.transient < 0.5 { 1.0 } else { 0.0 }).collect())
    }

    fn uncertainty(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        Some(seen.pixels.iter().map(|pixel| self.beta(pixel)).collect())
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.codes.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.codes.load_state(state)
    }

    fn parameter_count(&self) -> usize {
        self.codes.len()
    }

    fn memory_bytes(&self) -> usize {
        self.codes.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coarse_render_weighs_half_beside_a_likelihood_and_in_full_beside_squares() {
        let (rgb, truth) = ([0.5, 0.75, 0.25], [0.25, 0.75, 0.75]);
        let squares = (0.0625 + 0.25) / 3.0;
        let settings = TransientConfig::PUBLISHED;
        let transient: Box<dyn OccluderModel> = Box::new(Transient::new(&settings, 3, 0));
        let none = Box::new(NoOccluders { kernel: SQUARED.kernel(), coarse: Kernel::Squared });
        for (model, factor) in [(transient, 0.5), (none, 1.0)] {
            let (loss, bar) = model.coarse_loss(0, rgb, truth);
            assert!((loss - factor * squares).abs() < 1e-7, "{loss}");
            assert!((bar[2] + factor * 2.0 * 0.5 / 3.0).abs() < 1e-7 && bar[1] == 0.0, "{bar:?}");
            // The same as the fine render costs, but for a summand, where the uncertainty is 1 and nothing is transient.
            let fine = |rgb| model.loss(0, &Pixel { rgb, beta: 1.0 - settings.beta_min, ..Pixel::default() }, truth).0;
            assert!((fine(rgb) - fine(truth) - loss).abs() < 1e-6, "{}", fine(rgb) - fine(truth));
        }
    }

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let good = TransientConfig::HASH_GRID;
        good.check().unwrap();
        for (settings, want) in [
            (TransientConfig { transient_dims: 0, ..good.clone() }, "`transient_dims` = 0: must be in 1..=512"),
            (TransientConfig { beta_min: 9e-7, ..good.clone() }, "`beta_min` = 0.0000009: must be in 0.000001..=1000"),
            (TransientConfig { lambda_u: -1.0, ..good }, "`lambda_u` = -1: must be in 0..=1000"),
        ] {
            assert_eq!(settings.check().unwrap_err().to_string(), want);
        }
    }
}
