//! TiNeuVox: voxels that know of time (Fang, Yi, Wang, Xie, Zhang, Liu, Niessner, Tian, "Fast Dynamic Radiance Fields with
//! Time-Aware Neural Voxels", 2022).
//!
//! ```text
//! t' = MLP_t(gamma(t))
//! x' = x + MLP_d(gamma(x), t')
//! f  = gamma(V(x'), V/2(x'), V/4(x'))       one grid at three distances (section 3.3)
//! (c, sigma) = MLP(f, t', gamma(x); d)      x where it is, not where it was
//! ```
//!
//! Voxels double in number after 10, 20 and 30 % of the run, as released (2000, 4000 and 6000 steps of 20 000), and keep the moments of
//! their optimiser. `t = 0` is a time like any other. Beside the error of pixels it has the released code's losses on the ends of
//! rays (`background_entropy`), on the colours of samples (`point_colour`) and, for captures, on neighbouring voxels
//! (`voxel_variation`), with its factors. What was changed and why: docs/decisions/0050.

use crate::claims::Claim;
use crate::fields::VoxelSettings;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::rays::RayConfig;
use crate::settings::Settings;
use crate::space::SpaceKind;
use crate::warps::{
    At, CoherenceSettings, Deform, Deformation, DensityInputs, DensitySettings, Motion, Moved, Origin, Parameters,
    Sees, Time, TimeKind, TimeSettings, Times, Warp, WarpSettings, Windows, moving,
};
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::tape::{Node, Tape, TapeError};
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "tineuvox",
    paper: "Fang et al., 2022",
    what: "Voxels seen at three distances, a displacement by a small network of time",
    take: "to compare; runs of more than a minute or two",
    differs: "The small model, with an occupancy grid and steps from the size of a pixel; density is an exponential \
              (released: softplus), rates of networks are 3 to 4 times as high, held for half of the run (released: they \
              fall at once), that of the displacement rises at first, octaves that it sees come in over 30 % of the \
              run, the optimiser goes on where voxels double. No codes of cameras, no background points.",
    mark: "exponential density, own schedule",
};

/// Features of a voxel, and voxels along an axis, of the small model (table 1, "S").
const FEATURES: usize = 4;
const VOXELS: usize = 100;
/// Share of the run between one doubling of the voxels and the next.
const VOXELS_EVERY: f64 = 0.1;

/// Learning rates: of voxels as released; of the displacement and of the network of the time four times, of all others three times as high as
/// released, as a run has hundreds of steps and not 20 000 (docs/decisions/0060).
const VOXEL_RATE: f64 = 8e-2;
const WARP_RATE: f64 = 4.0 * 6e-4;
const TIME_RATE: f64 = 4.0 * 8e-4;
const NETWORK_RATE: f64 = 3.0 * 8e-4;
/// Share of the run over which the first two rise.
const WARP_WARMUP: f64 = 0.1;

/// What the density network hands to the colour network: as many features as it is wide.
const GEOMETRY: usize = 64;
/// Opacity across a voxel of the whole grid before the first step (the small model's `alpha_init`).
const ALPHA_0: f64 = 1e-2;

/// Factors of its losses beside the error of pixels, as released.
const BACKGROUND_ENTROPY: f32 = 1e-3;
const POINT_COLOUR: f32 = 0.01;
/// That of the variation of voxels, in means where the released code has sums: about what its 1e-5 comes to.
const VOXEL_VARIATION: f32 = 1e-3;

/// `t'` is as long as a voxel's features with 2 octaves, and both networks have one width, as released.
const TIME: TimeSettings = TimeSettings {
    kind: TimeKind::Network,
    octaves: 8,
    dims: 5 * FEATURES,
    width: 64,
    rate: WARP_RATE / VOXEL_RATE,
    code_rate: TIME_RATE / WARP_RATE,
    warmup: WARP_WARMUP,
};

/// The displacement: 10 octaves as released, 2 x 64. They come in while voxels double: the fine ones move single points, before the
/// coarse ones have moved what belongs together.
const WARP: WarpSettings =
    WarpSettings { motion: Motion::Translation, origin: Origin::Free, octaves: 10, anneal: 0.3, depth: 2 };

/// Time and place beside voxels: 10 octaves of the point, as released.
const DENSITY: DensitySettings = DensitySettings { sees: Sees::Point, octaves: 10 };

struct TiNeuVox {
    /// `MLP_d`; `None` for `warp=none`.
    mlp_d: Option<Warp>,
    density: DensityInputs,
}

impl TiNeuVox {
    /// `x'`; `None` where nothing moves.
    fn displaced<'a>(&'a self, tape: &mut Tape<'a>, at: &At<'_>) -> Result<Option<Node>, TapeError> {
        let Some(mlp_d) = moving(&self.mlp_d, at) else { return Ok(None) };
        // x' = x + MLP_d(gamma(x), t'), t' = MLP_t(gamma(t)).
        let gamma = mlp_d.octaves.of(tape, at.x)?;
        let delta_x = mlp_d.network.of(tape, &[gamma, at.time])?;
        mlp_d.moved(tape, at.x, delta_x).map(Some)
    }
}

impl Deformation for TiNeuVox {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError> {
        let x = self.displaced(tape, &at)?;
        // (c, sigma) = MLP(f(x'), t', gamma(x); d): density sees the time, and where the point is now.
        let seen = self.density.of(tape, &at)?;
        Moved::new(tape, x, &seen)
    }

    fn warps(&self) -> bool {
        self.mlp_d.is_some()
    }

    fn seen_rows(&self) -> usize {
        self.density.rows()
    }

    fn origin(&self) -> Origin {
        Warp::origin(self.mlp_d.as_ref())
    }

    fn windows(&self) -> Windows<'_> {
        Windows::of(self.mlp_d.as_ref(), None)
    }

    fn renew(&mut self, params: &[f32], done: f64) {
        self.mlp_d.iter_mut().for_each(|mlp_d| mlp_d.renew(params, done));
    }
}

/// Its deformation.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn deform(settings: &mut Settings<'_>, times: Times, seed: u64) -> Result<Deform, SystemError> {
    let mut parameters = Parameters::new(seed);
    let time = Time::new(settings.of(&TIME)?, times, &parameters)?;
    let mlp_d = Warp::new(&settings.of(&WARP)?, &time, 0, &mut parameters)?;
    let density = DensityInputs::new(&settings.of(&DENSITY)?, time.rows(), &parameters)?;
    // Not the paper's: off unless it is asked for.
    Deform::new(Box::new(TiNeuVox { mlp_d, density }), time, parameters)
        .with_coherence(settings.of(&CoherenceSettings::NONE)?)
}

/// The bias with which a voxel of `size` internal units has the opacity [`ALPHA_0`]: `alpha_0 = 1 - exp(-exp(b) size)`.
fn density_bias(size: f64) -> f32 {
    (-(-ALPHA_0).ln_1p() / size).ln() as f32
}

/// Its field.
fn field(config: &mut RayConfig, _: &Dataset) {
    // A capture, whose space has no end, or what fits into a box; the grid spans two internal units, four where space is contracted.
    let (voxel_variation, span) =
        if config.space.space == SpaceKind::Contracted { (VOXEL_VARIATION, 4.0) } else { (0.0, 2.0) };
    config.features =
        Arc::new(VoxelSettings { voxels: VOXELS, voxels_every: VOXELS_EVERY, features: FEATURES, voxel_variation });
    (config.rates.lr, config.rates.network_lr) = (VOXEL_RATE as f32, (NETWORK_RATE / VOXEL_RATE) as f32);
    (config.networks.width, config.networks.geometry) = (64, GEOMETRY);
    config.networks.density_bias = density_bias(span / VOXELS as f64);
    config.terms.background_entropy = BACKGROUND_ENTROPY;
    config.terms.point_colour = POINT_COLOUR;
}

/// Its voxels, deformed.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { field, ..Moving::deformed(deform) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_begins_with_the_opacity_of_the_paper() {
        for size in [2.0 / 100.0, 4.0 / 100.0, 1.0] {
            let alpha = 1.0 - (-f64::from(density_bias(size)).exp() * size).exp();
            assert!((alpha - ALPHA_0).abs() < 1e-6, "{size}: {alpha}");
        }
    }
}
