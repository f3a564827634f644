//! Systems for scenes that stand still, and what each does otherwise than its paper.

use crate::claims::{Claim, names};

/// The fast field, of all three apps.
pub(crate) const NGP: Claim = Claim {
    name: "ngp",
    paper: "Müller et al., 2022",
    differs: "Set for minutes on a CPU: 8 levels of 4 features, networks half as wide, squared error, no moving average of the \
              weights, cells of the occupancy grid and steps from the size of a pixel. Where space has no end it is contracted \
              and a distortion loss is added.",
    mark: "settings for a CPU",
};

/// Systems by name, with what differs from their papers.
pub const CLAIMS: [Claim; 5] = [
    NGP,
    Claim {
        name: "nerf",
        paper: "Mildenhall et al., 2020",
        differs: "Networks, samples and learning rate are the published ones. Batches are of 128 rays instead of 4096, rays \
                  begin and end at the scene's box, the last interval is finite, and space without an end is contracted.",
        mark: "batches of 128 rays",
    },
    Claim {
        name: "mip-nerf",
        paper: "Barron et al., 2021",
        differs: "Network, intervals, losses and learning rate are the published ones. Batches are of 128 rays instead of 4096, \
                  rays begin and end at the scene's box, the last interval is finite, and space without an end is contracted.",
        mark: "batches of 128 rays",
    },
    Claim {
        name: "mip-nerf-360",
        paper: "Barron et al., 2022",
        differs: "Networks and losses of open scenes are the published ones, batches are of 64 rays instead of 16384; objects \
                  have a squared error and no distortion loss. Annealing and learning rate are spread over the published 250 000 \
                  steps: a run of minutes stays at the start of both.",
        mark: "64 rays, start of 250 000-step schedules",
    },
    Claim {
        name: "splat",
        paper: "Kerbl et al., 2023",
        differs: "Opacities are never reset, large Gaussians are not pruned, there are at most 100 000, the schedules take a \
                  third of the steps, and large photos are drawn at half their size first. Random starts keep to places that \
                  no photo shows to be empty.",
        mark: "no opacity reset, no size prune",
    },
];

/// Systems by name.
pub const SYSTEMS: [&str; CLAIMS.len()] = names(&CLAIMS);
