//! DeGauss: what moves in a cloud of its own, before a cloud of what stands still.
//!
//! Wang, Lohmeyer, Meboldt, Tang, "DeGauss: Dynamic-Static Decomposition with Gaussian Splatting for Distractor-free 3D Reconstruction", 2025.
//!
//! ```text
//! P_f = (M_f + d) / (M_f + M_b + 2 d),  P_b = 1 - P_f           masks, composited from Gaussians in front (equation 1)
//! C = P_f C_f + P_b clamp(B C_b, 0, 1),  B = 1/2 + a(X)         both clouds; B: how bright the one behind is (equation 4)
//! main    = |C - I| + sum_e 1[P_e > t] (|C_e - I| + 0.1 L_ssim(C_e, I)) + depths           (equations 3, 5, 6)
//! utility = L_ssim(C, I) + H(P_f) + |B - 1| + |clamp(B C_b) - I| + sizes   (equations 9 and 10; ratios of sizes)
//! ```
//!
//! In a first stage of films (a twentieth of a training) the cloud behind learns all of the photos, and the front what is left.
//!
//! All parameters learn from both parts; new Gaussians come where the main part says. The cloud in front moves as that of `4dgs`
//! ([`crate::cloud_motion`]), opacities and colours too; the one behind is that of `splat`. Photos without times each show another time of
//! the front, which is a sheet before their cameras then: things that stand in the way. How both are put together:
//! [`crate::cloud_layers`]. What differs from the paper, and why: `docs/decisions/0066-degauss.md`.

use super::four_d_gaussians;
use super::layers::{FrontConfig, LayerKind, LayerParts};
use super::recipe::Recipe;
use super::splat;
use super::start::StartKind;
use crate::claims::Claim;
use crate::cloud_layers::LayerSettings;
use crate::cloud_motion::{MotionParts, MotionSettings};
use crate::fields::{PlaneGridSettings, PlaneGridSource, count_of_times};
use crate::plan::{Ask, Built};
use crate::views::PhotoTimes;
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "degauss",
    paper: "Wang et al., 2025",
    what: "A cloud of what moves before a cloud of what stands still, by masks that are learnt",
    take: "the scene without what moves, from a film or from photos with people in the way",
    differs: "Clouds are those of `splat` and `4dgs` here; of films all is of the cloud behind where nothing is in front. Of photos without \
              times the front is a sheet before each camera, and masks learn by how far the cloud behind is off. Planned as off: each \
              cloud alone, structural divergence, brightness held to photos, pruning by utility; of photos without times the losses \
              of a first stage, too.",
    mark: "own clouds, masks by opacity",
};

/// Weights over that of the absolute difference, which is 4 in the supplement; that of each cloud alone is 1 there.
const LAYERS: LayerSettings = LayerSettings {
    front_from: 0.0,
    front_first_stage: 0.05,
    front_at_camera: false,
    front_apart: false,
    front_shades: true,
    front_mask_lr: 0.05,
    front_structure: 0.1,
    front_each: 0.0,
    front_divergence: 0.0,
    front_entropy: 2.5e-3,
    front_sparsity: 0.0,
    front_sparsity_start: 0.0,
    front_separation: 0.025,
    front_smoothness: 0.025,
    front_brightness: 0.125,
    front_brightness_photo: 0.0,
    front_anisotropy: 0.025,
    front_prune: 0.0,
};

/// What stands before single photos has no place in the scene, and no other photo shows it: the cloud in front goes with the camera, and
/// nothing of it is the same in two photos but by chance. What both could show is of the cloud behind.
const BEFORE_PHOTOS: LayerSettings = LayerSettings {
    front_from: BEFORE_PHOTOS_FROM,
    front_first_stage: 0.0,
    front_at_camera: true,
    front_apart: true,
    front_shades: false,
    front_mask_lr: 0.0,
    front_structure: 0.25,
    front_sparsity: 0.15,
    front_sparsity_start: 0.05,
    front_separation: 0.0,
    front_anisotropy: 0.0,
    ..LAYERS
};

/// From this share of the schedule on: what photos share is known by then, as well as it is with what stands before it.
const BEFORE_PHOTOS_FROM: f64 = 0.2;

const FRONT: FrontConfig = FrontConfig { front_count: 10_000, front_max: 40_000, front_opacity: 0.1 };

/// More vertices of time have no memory.
const MOST_VERTICES: u32 = 1024;

/// That of `4dgs` here; opacities, colours and masks change, too. Of photos without times each shows another thing: planes have a
/// vertex of time for each, and are not smoothed along the time.
fn motion(times: Arc<[f32]>, of: PhotoTimes) -> MotionParts {
    let moving = MotionSettings { motion_colour: true, motion_masks: true, ..four_d_gaussians::MOTION };
    let (settings, planes) = match of {
        PhotoTimes::Own => {
            let settings = MotionSettings { motion_opacity: true, ..moving };
            (settings, four_d_gaussians::planes(four_d_gaussians::vertices_of_time(&times)))
        }
        PhotoTimes::Order => {
            let settings = MotionSettings {
                motion_from: BEFORE_PHOTOS_FROM,
                motion_lr: 2e-3,
                motion_lr_end: 5e-4,
                motion_feature_lr: 0.05,
                motion_feature_lr_end: 0.01,
                // Each photo has a time of its own: what comes in one of them is at rest in all others.
                motion_rest: 0.0,
                ..moving
            };
            let vertices = count_of_times(&times).min(MOST_VERTICES);
            (
                settings,
                PlaneGridSettings {
                    plane_vertices: 32,
                    plane_scales: vec![1],
                    plane_smoothness: 0.0,
                    ..four_d_gaussians::planes(vertices)
                },
            )
        }
    };
    MotionParts { settings, features: PlaneGridSource::new(planes, times) }
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
    layers: Some(LayerParts {
        film: LayerKind { settings: LAYERS, front: FRONT },
        photos: LayerKind { settings: BEFORE_PHOTOS, front: FrontConfig { front_opacity: 0.9, ..FRONT } },
    }),
};

/// Clouds at their start, and why they are as they are.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}
