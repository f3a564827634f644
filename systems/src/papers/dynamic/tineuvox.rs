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
//! Voxels double in number three times. `t = 0` is a time like any other. Beside the error of pixels it has the released
//! code's losses on the ends of rays (`background_entropy`) and on the colours of samples (`point_colour`), with its factors.

use crate::claims::Claim;
use crate::fields::VoxelSettings;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::rays::RayConfig;
use crate::settings::Settings;
use crate::warps::{
    At, Deform, Deformation, DensityInputs, DensitySettings, Motion, Moved, Origin, Parameters, Sees, Time, TimeKind,
    TimeSettings, Times, Warp, WarpSettings, Windows, moving,
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
    take: "to compare; runs of more than a few minutes",
    differs: "Networks learn at the grid's 2e-2 (released: 8e-4) and the colour network sees 16 geometry features (released: 64); there \
              is no variation loss of voxels. Voxels double every 500 steps, whatever the length of the run: a run of a \
              minute never reaches the full grid.",
    mark: "own rates, grid not grown in minutes",
};

/// Features of a voxel, and voxels along an axis, of the small model (table 1, "S").
const FEATURES: usize = 4;
const VOXELS: usize = 100;
/// Steps between one doubling of the voxels and the next.
const VOXELS_EVERY: u64 = 500;

/// Factors of its losses beside the error of pixels, as released.
const BACKGROUND_ENTROPY: f32 = 1e-3;
const POINT_COLOUR: f32 = 0.01;

/// `t'` is as long as a voxel's features with 2 octaves, and both networks have one width, as released. They learn at 0.03 of the
/// field's rate (docs/decisions/0018).
const TIME: TimeSettings =
    TimeSettings { kind: TimeKind::Network, octaves: 8, dims: 5 * FEATURES, width: 64, rate: 0.03, code_rate: 1.0 };

/// The displacement: 10 octaves as released, 2 x 64.
const WARP: WarpSettings =
    WarpSettings { motion: Motion::Translation, origin: Origin::Free, octaves: 10, anneal: 0, depth: 2 };

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

    fn is_canonical(&self, time: f64) -> bool {
        self.mlp_d.as_ref().is_some_and(|mlp_d| mlp_d.rests(time))
    }

    fn windows(&self) -> Windows<'_> {
        Windows::of(self.mlp_d.as_ref(), None)
    }

    fn renew(&mut self, params: &[f32], steps: u64) {
        self.mlp_d.iter_mut().for_each(|mlp_d| mlp_d.renew(params, steps));
    }
}

/// Its deformation.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn deform(settings: &mut Settings<'_>, times: Times, seed: u64) -> Result<Deform, SystemError> {
    let mut parameters = Parameters::new(seed);
    let time = Time::new(settings.of(&TIME)?, times, &parameters)?;
    let mlp_d = Warp::new(&settings.of(&WARP)?, time.settings().width, time.rows(), 0, &mut parameters)?;
    let density = DensityInputs::new(&settings.of(&DENSITY)?, time.rows(), &parameters)?;
    Ok(Deform::new(Box::new(TiNeuVox { mlp_d, density }), time, parameters))
}

/// Its field.
fn field(config: &mut RayConfig, _: &Dataset) {
    config.features = Arc::new(VoxelSettings { voxels: VOXELS, voxels_every: VOXELS_EVERY, features: FEATURES });
    config.networks.width = 64;
    config.terms.background_entropy = BACKGROUND_ENTROPY;
    config.terms.point_colour = POINT_COLOUR;
}

/// Its voxels, deformed.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { field, ..Moving::deformed(deform) })
}
