//! Systems for photographs from the wild: the parts that each is made of, and what it does otherwise than its paper.

use super::choice::{AppearanceKind, OccluderKind};
use crate::claims::{Claim, claim, names};
use engine::system::SystemError;

const MARTIN_BRUALLA: &str = "Martin-Brualla et al., 2021";
const CHEN_HA: &str = "Chen et al., 2022";

/// Systems by name, with what differs from their papers.
pub const CLAIMS: [Claim; 11] = [
    Claim {
        name: "auto",
        paper: "",
        differs: "Appearance and occluders are chosen after a short training that is compared with the photos.",
        mark: "",
    },
    Claim { name: "plain", paper: "", differs: "The field alone: one appearance, no occluders.", mark: "" },
    Claim {
        name: "robust-nerf",
        paper: "Sabour et al., 2023",
        differs: "Masks are found on whole photos from time to time, not in each batch, by a rule of our own, and what is kept \
                  costs Charbonnier 0.05 instead of its square, on ngp's field. `--field mlp` has published networks, batches of \
                  patches and squares. Below 320 pixels patches are half as large.",
        mark: "own masks, Charbonnier",
    },
    Claim {
        name: "nerf-a",
        paper: MARTIN_BRUALLA,
        differs: "On ngp's field with codes of 16 numbers, and errors cost Charbonnier 0.05 instead of their square, which also \
                  helps against occluders. `--field mlp` has published networks, codes and squares.",
        mark: "Charbonnier, ngp field",
    },
    Claim {
        name: "nerf-u",
        paper: MARTIN_BRUALLA,
        differs: "On ngp's field with a sample before each camera for occluders, beta_min 0.1, and errors well above 0.05 cost \
                  their length. `--field mlp` has published networks and squares, but transient density begins at \
                  softplus(x - 3).",
        mark: "robust tail, ngp field",
    },
    Claim {
        name: "nerf-w",
        paper: MARTIN_BRUALLA,
        differs: "On ngp's field with codes of 16 numbers, a sample before each camera for occluders, beta_min 0.1, and errors \
                  well above 0.05 cost their length. `--field mlp` has published networks, codes and squares, but transient \
                  density begins at softplus(x - 3).",
        mark: "robust tail, ngp field",
    },
    Claim {
        name: "ha-nerf-a",
        paper: CHEN_HA,
        differs: "The field learns with free codes and the encoder, whose input has tones besides, learns to predict them; errors cost \
                  Charbonnier 0.05, weights of view consistency are doubled, ngp's field. `--field mlp` learns through the \
                  published encoder, without view consistency.",
        mark: "free codes, Charbonnier",
    },
    Claim {
        name: "ha-nerf-t",
        paper: CHEN_HA,
        differs: "The scene's errors cost Charbonnier 0.05 instead of their square and the visibility network is 2 x 64, on ngp's \
                  field. `--field mlp` has published networks and squares.",
        mark: "Charbonnier, small network",
    },
    Claim {
        name: "ha-nerf",
        paper: CHEN_HA,
        differs: "The field learns with free codes and the encoder, whose input has tones besides, learns to predict them; errors cost \
                  Charbonnier 0.05, weights of view consistency are doubled, the visibility network is 2 x 64, ngp's field. \
                  `--field mlp`: published encoder, networks and squares, without view consistency.",
        mark: "free codes, Charbonnier",
    },
    Claim {
        name: "sf-nerf",
        paper: "Lee et al., 2023",
        differs: "On ngp's field with a filter 64 wide, beta_min 0.1 and a hold of 250 steps; features only from files beside the \
                  photos, a pretrained filter only from another run. `--field mlp` has the published sizes and steps.",
        mark: "small filter, ngp field",
    },
    Claim {
        name: "hugs",
        paper: "Chen et al., 2024",
        differs: "Not HuGS: training masks come from our own rule of robust-nerf on whole photos, then segments vote. The \
                  published residual heuristic and its join with point tracks are not used: what tracks or segments rescue is \
                  still left out where that rule leaves it out.",
        mark: "not HuGS: own masks",
    },
];

/// Systems by name.
pub const SYSTEMS: [&str; CLAIMS.len()] = names(&CLAIMS);

/// Appearance and occluders of a named system; `None` for `auto`.
pub(super) type Parts = Option<(AppearanceKind, OccluderKind)>;

/// What a name claims, and the parts of its system.
pub(super) fn known(name: &str) -> Result<(Claim, Parts), SystemError> {
    use AppearanceKind as A;
    use OccluderKind as O;
    let claim = claim(&CLAIMS, name)?;
    let parts = match name {
        "robust-nerf" => (A::None, O::Robust),
        "nerf-a" => (A::Codes, O::None),
        "nerf-u" => (A::None, O::Transient),
        "nerf-w" => (A::Codes, O::Transient),
        "ha-nerf-a" => (A::Encoder, O::None),
        "ha-nerf-t" => (A::None, O::Visibility),
        "ha-nerf" => (A::Encoder, O::Visibility),
        "sf-nerf" => (A::Codes, O::Filter),
        "hugs" => (A::None, O::Masks),
        "plain" => (A::None, O::None),
        _ => return Ok((claim, None)),
    };
    Ok((claim, Some(parts)))
}
