//! The systems by name: for each what differs from its paper, and how it is built.

mod choice;
#[cfg(test)]
mod claim_tests;
#[cfg(test)]
mod tests;

pub use choice::choose;

use crate::claims::{Claim, claims_of, names};
use crate::papers::dynamic::k_planes;
use crate::papers::gaussians::splat;
use crate::papers::static_scenes::{mip_nerf, mip_nerf_360, nerf, ngp};
use crate::plan::{Ask, Built};
use crate::settings::no_such_system;
use engine::data::Dataset;
use engine::options::{Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// A system: its name and what differs from its paper, and how it is built.
pub(crate) struct Known {
    pub(crate) claim: Claim,
    pub(crate) build: fn(Ask<'_>) -> Built,
}

const KNOWN: [Known; 6] = [
    Known { claim: ngp::CLAIM, build: ngp::build },
    Known { claim: nerf::CLAIM, build: nerf::build },
    Known { claim: mip_nerf::CLAIM, build: mip_nerf::build },
    Known { claim: mip_nerf_360::CLAIM, build: mip_nerf_360::build },
    Known { claim: k_planes::CLAIM, build: k_planes::build },
    Known { claim: splat::CLAIM, build: splat::build },
];

/// Systems by name, with what differs from their papers.
pub const CLAIMS: [Claim; KNOWN.len()] = claims_of!(KNOWN);

/// Systems by name.
pub const SYSTEMS: [&str; CLAIMS.len()] = names(&CLAIMS);

/// The claim of a system's name: of those for scenes that stand still, from the wild, or that move. `ngp` is the same everywhere.
#[must_use]
pub fn find(name: &str) -> Option<Claim> {
    let all = CLAIMS.iter().chain(&crate::wild::CLAIMS).chain(&crate::dynamic::CLAIMS);
    all.copied().find(|claim| claim.name == name)
}

/// Build the system `name` for a scene.
///
/// # Errors
/// [`SystemError::Config`] for an unknown name, an unknown setting or one that cannot work; [`SystemError::Scene`] when
/// an image cannot be read.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let known = KNOWN.iter().find(|known| known.claim.name == name).ok_or_else(|| no_such_system(name, SYSTEMS))?;
    (known.build)(Ask::new(known.claim, scene, data, run))
}
