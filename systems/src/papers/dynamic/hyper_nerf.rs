//! HyperNeRF: Nerfies' motions, and coordinates beyond space in which what motion cannot explain may change (Park, Sinha,
//! Hedman, Barron, Bouaziz, Goldman, Martin-Brualla, Seitz, "HyperNeRF: A Higher-Dimensional Representation for
//! Topologically Varying Neural Radiance Fields", 2021).
//!
//! ```text
//! x' = T(x, w_i)                 as Nerfies, without the elastic loss
//! a  = H(gamma(x), w_i)          ambient coordinates: a bendy sheet that cuts the template (section 3.3)
//! (c, sigma) = F(x', gamma_b(a), d, psi_i)    psi_i: a free code of each photo's appearance, where exposures differ
//! ```

use super::appearance;
use super::nerfies::{self, RigidMotion};
use crate::claims::Claim;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::settings::Settings;
use crate::warps::{
    Ambient, AmbientSettings, At, CoherenceSettings, Deform, Deformation, DensityInputs, DensitySettings,
    ElasticSettings, Moved, Origin, Parameters, PlaneSettings, Time, TimePlanes, Times, Windows,
};
use engine::system::SystemError;
use field_core::tape::{Tape, TapeError};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "hypernerf",
    paper: "Park et al., 2021",
    what: "As `nerfies` without the elastic loss, with two coordinates beyond space",
    take: "what opens and closes",
    differs: "As `nerfies` here, on a hash grid with planes of place and time in the warp, which is 3 x 64 instead of 6 x 128. \
              The ambient coordinates are those of the bendy sheet alone, 3 x 64 instead of 6 x 64, and come in from 4 to 20 % \
              of the run. The axis-aligned plane is not built, and photos have appearance codes only where exposures differ.",
    mark: "hash grid, short schedules",
};

/// A sheet in two coordinates, 3 x 64 where the paper has 6 x 64. It comes in over 16 % of the run, once 4 % are over: later than as
/// published (1000 steps of 250 000, then 10 000), as a run has few steps and the warp should have found something before.
const AMBIENT: AmbientSettings = AmbientSettings { dims: 2, octaves: 6, width: 64, depth: 3, from: 0.04, anneal: 0.16 };

struct HyperNerf {
    /// `T`
    t: RigidMotion,
    /// `H`; `None` for `ambient=0`.
    h: Option<Ambient>,
    /// Time and place for density: nothing, as published.
    density: DensityInputs,
    /// Rows of all that density sees besides features.
    rows: usize,
}

impl Deformation for HyperNerf {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError> {
        let p = self.t.planes.of(tape, &at)?;
        // x' = T(x, w_i).
        let x = self.t.of(tape, &at, &p)?;
        // (c, sigma) = F(x', gamma_b(a), d), a = H(gamma(x), w_i) (section 3.3).
        let mut seen = Vec::with_capacity(4);
        if let Some(h) = &self.h {
            seen.push(h.of(tape, &at)?);
        }
        seen.extend(self.density.of(tape, &at)?);
        seen.extend(p.for_density());
        Moved::new(tape, x, &seen)
    }

    fn warps(&self) -> bool {
        self.t.w.is_some()
    }

    fn seen_rows(&self) -> usize {
        self.rows
    }

    fn origin(&self) -> Origin {
        self.t.origin()
    }

    fn windows(&self) -> Windows<'_> {
        Windows::of(self.t.w.as_ref(), self.h.as_ref())
    }

    fn planes(&self) -> Option<&TimePlanes> {
        Some(&self.t.planes)
    }

    fn renew(&mut self, params: &[f32], done: f64) {
        self.t.renew(params, done);
        self.h.iter_mut().for_each(|h| h.renew(params, done));
    }
}

/// Its deformation.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn deform(settings: &mut Settings<'_>, times: Times, seed: u64) -> Result<Deform, SystemError> {
    let mut parameters = Parameters::new(seed);
    let time = Time::new(settings.of(&nerfies::TIME)?, times, &parameters)?;
    let planes: PlaneSettings = settings.of(&nerfies::planes())?;
    let w = RigidMotion::warp(&settings.of(&nerfies::WARP)?, &planes, &time, &mut parameters)?;
    let h = Ambient::new(&settings.of(&AMBIENT)?, time.rows(), &mut parameters)?;
    let density = DensityInputs::new(&settings.of(&DensitySettings::PLACE)?, time.rows(), &parameters)?;
    let rows = h.as_ref().map_or(0, Ambient::rows) + density.rows() + planes.density_rows();
    let t = RigidMotion { planes: TimePlanes::new(planes, &mut parameters)?, w };
    // The elastic loss is off, as published; it can be set, as in the released code. So can coherence, which is not the paper's.
    Deform::new(Box::new(HyperNerf { t, h, density, rows }), time, parameters)
        .with_elastic(settings.of(&ElasticSettings::NONE)?)?
        .with_background(settings.of(&nerfies::BACKGROUND)?)?
        .with_coherence(settings.of(&CoherenceSettings::NONE)?)
}

/// `ngp`'s field, deformed.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { photos: Some(appearance::photo_model), ..Moving::deformed(deform) })
}
