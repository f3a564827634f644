//! DeGauss: what moves in a cloud of its own, before a cloud of what stands still.
//!
//! Wang, Lohmeyer, Meboldt, Tang, "DeGauss: Dynamic-Static Decomposition with Gaussian Splatting for Distractor-free 3D Reconstruction", 2025.
//!
//! ```text
//! P_f = (M_f + d) / (M_f + M_b + 2 d),  P_b = 1 - P_f           masks, composited from Gaussians in front (equation 1)
//! C = P_f C_f + P_b clamp(B C_b, 0, 1),  B = 1/2 + a(X)         both clouds; B: how bright the one behind is (equation 4)
//! main    = |C - I| + sum_e 1[P_e > t] (|C_e - I| + 0.1 L_ssim(C_e, I)) + depths           (equations 3, 5, 6)
//! utility = L_ssim(C, I) + H(P_f) + |B - 1|                                                (equations 9, 10)
//! ```
//!
//! All parameters learn from both parts; new Gaussians come where the main part says. The cloud in front moves as that of `4dgs`
//! ([`crate::cloud_motion`]), opacities and colours too; the one behind is that of `splat`. Photos without times each show another time of
//! the front: things that stand in the way. How both are put together: [`crate::cloud_layers`]. What differs from the paper, and why:
//! `docs/decisions/0066-degauss.md`.

use super::four_d_gaussians;
use super::layers::{FrontConfig, LayerParts};
use super::recipe::Recipe;
use super::splat;
use super::start::StartKind;
use crate::claims::Claim;
use crate::cloud_layers::LayerSettings;
use crate::cloud_motion::{MotionParts, MotionSettings};
use crate::plan::{Ask, Built};
use crate::views::PhotoTimes;
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "degauss",
    paper: "Wang et al., 2025",
    what: "A cloud of what moves before a cloud of what stands still, by masks that are learnt",
    take: "the scene without what moves, from a film or from photos with people in the way",
    differs: "Clouds are those of `splat` and `4dgs` here, the one behind begins where a field sees surfaces. Where nothing is in front \
              all is of the cloud behind: no Gaussians hold masks alone, none are pruned by utility. Masks of a Gaussian keep their \
              values over time; no loss of structural divergence or (`front_each=0.25`) of each cloud alone, no stage at first.",
    mark: "own clouds, masks by opacity",
};

/// Weights over that of the absolute difference, which is 4 in the supplement; that of each cloud alone is 1 there.
const LAYERS: LayerSettings = LayerSettings {
    front_from: 0.0,
    front_shades: true,
    front_mask_lr: 0.05,
    front_structure: 0.1,
    front_each: 0.0,
    front_entropy: 2.5e-3,
    front_sparsity: 0.0,
    front_separation: 0.025,
    front_smoothness: 0.025,
    front_brightness: 0.125,
};

/// That of `4dgs` here; opacities and colours change, too. Of photos without times each shows another thing: planes have half as many
/// vertices of time as there are photos then.
fn motion(times: Arc<[f32]>, of: PhotoTimes) -> MotionParts {
    let settings = MotionSettings { motion_opacity: true, motion_colour: true, ..four_d_gaussians::MOTION };
    let vertices = match of {
        PhotoTimes::Own => four_d_gaussians::vertices_of_time(&times),
        PhotoTimes::Order => 0,
    };
    four_d_gaussians::moving(settings, vertices, times)
}

static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Field,
    cloud: splat::CLOUD,
    rates: splat::RATES,
    density: splat::CONTROL,
    pictures: splat::PICTURES,
    loss: None,
    motion: Some(motion),
    photos: None,
    layers: Some(LayerParts { settings: LAYERS, front: FrontConfig { front_count: 10_000, front_max: 40_000 } }),
};

/// Clouds at their start, and why they are as they are.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}
