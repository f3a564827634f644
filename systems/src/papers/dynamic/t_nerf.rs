//! T-NeRF: a field that depends on time (Pumarola, Corona, Pons-Moll, Moreno-Noguer, "D-NeRF: Neural Radiance Fields for
//! Dynamic Scenes", 2021, section 4, the baseline without deformation).
//!
//! ```text
//! (c, sigma) = F(gamma(x), gamma(t), gamma(d))
//! ```
//!
//! Nothing ties one time step to the next but the smoothness of the network, and that of planes `p` of features of place and time
//! (Fridovich-Keil et al., "K-Planes", 2023), which it sees as the field sees a grid of features of place: minutes instead of
//! days. `planes=[]` leaves the network alone.

use crate::claims::Claim;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::settings::Settings;
use crate::warps::{
    At, Deform, Deformation, DensityInputs, DensitySettings, Moved, Parameters, PlaneSettings, SeenBy, Sees, Time,
    TimeKind, TimePlanes, TimeSettings, Times,
};
use engine::system::SystemError;
use field_core::tape::{Tape, TapeError};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "t-nerf",
    paper: "Pumarola et al., 2021",
    what: "Density and colour depend on time; nothing is displaced",
    take: "the fastest; what appears and disappears",
    differs: "A hash grid and planes of features of place and time instead of the published 8 x 256 network, and 3 \
              octaves of the time instead of 10. `planes=[]` leaves the hash grid and a small network.",
    mark: "hash grid, planes of time",
};

/// The time, for minutes of training: 3 octaves instead of 10.
pub(super) const TIME: TimeSettings =
    TimeSettings { kind: TimeKind::Time, octaves: 3, dims: 8, width: 64, rate: 0.1, code_rate: 1.0, warmup: 0.0 };

/// Planes of place and time, of two sizes; the factor of their variation was found on `workbench` (docs/decisions/0021), that of their
/// smoothness is about the released one of K-Planes: 0.1 in the mean over their planes of time, where ours is the sum over six.
pub(super) fn planes() -> PlaneSettings {
    PlaneSettings {
        cells: vec![32, 64],
        seen_by: SeenBy::Density,
        variation: 1e-3,
        smoothness: 1e-2,
        ..PlaneSettings::NONE
    }
}

struct TNerf {
    planes: TimePlanes,
    density: DensityInputs,
    /// Rows of time and planes that density sees.
    rows: usize,
}

impl Deformation for TNerf {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError> {
        // (c, sigma) = F(gamma(x), gamma(t), p(x, t), gamma(d)): density sees the time, and points stay where they are.
        let p = self.planes.of(tape, &at)?;
        let mut seen = self.density.of(tape, &at)?;
        seen.extend(p.for_density());
        Moved::new(tape, None, &seen)
    }

    fn warps(&self) -> bool {
        false
    }

    fn seen_rows(&self) -> usize {
        self.rows
    }

    fn planes(&self) -> Option<&TimePlanes> {
        Some(&self.planes)
    }

    fn renew(&mut self, _params: &[f32], _done: f64) {}
}

/// Its deformation.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn deform(settings: &mut Settings<'_>, times: Times, seed: u64) -> Result<Deform, SystemError> {
    let mut parameters = Parameters::new(seed);
    let time = Time::new(settings.of(&TIME)?, times, &parameters)?;
    let planes: PlaneSettings = settings.of(&planes())?;
    let density = DensitySettings { sees: Sees::Time, ..DensitySettings::PLACE };
    let density = DensityInputs::new(&settings.of(&density)?, time.rows(), &parameters)?;
    let rows = density.rows() + planes.density_rows();
    let planes = TimePlanes::new(planes, &mut parameters)?;
    Ok(Deform::new(Box::new(TNerf { planes, density, rows }), time, parameters))
}

/// `ngp`'s field, deformed.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving::deformed(deform))
}
