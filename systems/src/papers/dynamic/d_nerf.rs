//! D-NeRF: a canonical scene and where each point of a time lies in it (Pumarola, Corona, Pons-Moll, Moreno-Noguer,
//! "D-NeRF: Neural Radiance Fields for Dynamic Scenes", 2021).
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t), p(x, t))
//! (c, sigma) = Psi_x(gamma(x + dx), p(x, t), gamma(d))                              (equation 2)
//! ```
//!
//! As published (equation 3) the canonical scene is that of `t = 0`, where `dx` is 0: nothing ties the scene of that time to those beside
//! it, and only photos of exactly `t = 0` hold it in place. Where next to none have that time, the scene of `t = 0` may be anywhere: 16 dB on
//! the published bouncingballs beside 38 dB at all other times. Here no time is special (docs/decisions/0051); `origin=exact` is as published,
//! and `origin=tied` takes the displacement less that at `t = 0`:
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t), p(x, t)) - Psi_t(gamma(x), gamma(0), p(x, 0))
//! ```
//!
//! Besides the octaves of place and time both networks see `p`, planes of features of both, as the field sees a grid of features of
//! place: minutes instead of days, and what no displacement explains in so short a time is there all the same.
//! `planes_seen_by=warp` is the published density, `planes=[]` leaves hash grid and displacement,
//! `field=mlp` takes the [published networks](super::d_nerf_published).
//!
//! Nothing in the paper holds the displacements of neighbours together; `coherence` does (`losses::coherence`), if that is asked for.

use super::{d_nerf_published, t_nerf};
use crate::claims::Claim;
use crate::papers::field_kind::FieldKind;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::settings::Settings;
use crate::warps::{
    At, CoherenceSettings, Deform, Deformation, DensityInputs, DensitySettings, Motion, Moved, Origin, Parameters,
    PlaneFeatures, PlaneSettings, SeenBy, Time, TimePlanes, TimeSettings, Times, Warp, WarpSettings, Windows, moving,
    since_origin,
};
use engine::system::SystemError;
use field_core::tape::{Node, Tape, TapeError};
use serde::{Deserialize, Serialize};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "d-nerf",
    paper: "Pumarola et al., 2021",
    what: "A displacement from each time into one scene; density depends on time besides",
    take: "the geometry of things that move and are cut out; seconds of training",
    differs: "A hybrid: a hash grid, a displacement of 3 x 64 with 4 octaves of the point and 6 of the time, and \
              planes of place and time that density sees directly, instead of two 8 x 256 networks with 10 \
              octaves. `planes=[]` leaves hash grid and displacement. No time is special: the displacement is the \
              network's at time 0, too; `origin=exact` leaves it out there, as published.",
    mark: "hybrid: hash grid, planes of time",
};

/// What is deformed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FieldChoice {
    /// The field: `ngp` (fast), or `mlp` (the published networks: days).
    field: FieldKind,
}

/// The time: 6 octaves, where the released code has 4 or 10.
const TIME: TimeSettings = TimeSettings { octaves: 6, ..t_nerf::TIME };

/// The displacement: 3 x 64 with 4 octaves, where the paper has 8 x 256 with 10.
const WARP: WarpSettings =
    WarpSettings { motion: Motion::Translation, origin: Origin::Free, octaves: 4, anneal: 0.0, depth: 3 };

struct DNerf {
    planes: TimePlanes,
    /// `Psi_t`; `None` for `warp=none`.
    psi_t: Option<Warp>,
    /// Time and place for density: nothing, as published.
    density: DensityInputs,
    /// Rows of all that density sees besides features.
    rows: usize,
}

impl DNerf {
    /// `x + dx`; `None` where nothing moves.
    fn displaced<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        at: &At<'_>,
        p: &PlaneFeatures<'_>,
    ) -> Result<Option<Node>, TapeError> {
        // Where t = 0 is special nothing moves then (equation 3).
        let Some(psi_t) = moving(&self.psi_t, at) else { return Ok(None) };
        let gamma = psi_t.octaves.of(tape, at.x)?;
        let psi = psi_t.network.of(tape, &[&[gamma, at.time], p.for_warp()].concat())?;
        // Delta x = Psi_t(gamma(x), gamma(t), p(x, t)); tied, less that at t = 0.
        let delta_x = since_origin(tape, at, psi, |tape, at_0| {
            let p_0 = self.planes.for_warp(tape, at_0)?;
            psi_t.network.of(tape, &[&[gamma, at_0.time], &p_0[..]].concat())
        })?;
        // x + Delta x (equation 2).
        psi_t.moved(tape, at.x, delta_x).map(Some)
    }
}

impl Deformation for DNerf {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError> {
        let p = self.planes.of(tape, &at)?;
        let x = self.displaced(tape, &at, &p)?;
        // (c, sigma) = Psi_x(gamma(x + Delta x), p, gamma(d)) (equation 2): density sees the planes, too.
        let mut seen = self.density.of(tape, &at)?;
        seen.extend(p.for_density());
        Moved::new(tape, x, &seen)
    }

    fn warps(&self) -> bool {
        self.psi_t.is_some()
    }

    fn seen_rows(&self) -> usize {
        self.rows
    }

    fn origin(&self) -> Origin {
        Warp::origin(self.psi_t.as_ref())
    }

    fn windows(&self) -> Windows<'_> {
        Windows::of(self.psi_t.as_ref(), None)
    }

    fn planes(&self) -> Option<&TimePlanes> {
        Some(&self.planes)
    }

    fn renew(&mut self, params: &[f32], done: f64) {
        self.psi_t.iter_mut().for_each(|psi_t| psi_t.renew(params, done));
    }
}

/// Its deformation.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn deform(settings: &mut Settings<'_>, times: Times, seed: u64) -> Result<Deform, SystemError> {
    let mut parameters = Parameters::new(seed);
    let time = Time::new(settings.of(&TIME)?, times, &parameters)?;
    let planes: PlaneSettings = settings.of(&PlaneSettings { seen_by: SeenBy::Both, ..t_nerf::planes() })?;
    let psi_t = Warp::new(&settings.of(&WARP)?, &time, planes.warp_rows(), &mut parameters)?;
    let density = DensityInputs::new(&settings.of(&DensitySettings::PLACE)?, time.rows(), &parameters)?;
    let rows = density.rows() + planes.density_rows();
    let planes = TimePlanes::new(planes, &mut parameters)?;
    Deform::new(Box::new(DNerf { planes, psi_t, density, rows }), time, parameters)
        .with_coherence(settings.of(&CoherenceSettings::NONE)?)
}

/// `ngp`'s field, deformed; or the published networks.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let FieldChoice { field } = ask.settings.of(&FieldChoice { field: FieldKind::Ngp })?;
    match field {
        FieldKind::Ngp => moving_field(ask, &Moving::deformed(deform)),
        FieldKind::Mlp => d_nerf_published::build(ask),
    }
}
