//! 4D Gaussians: one cloud, moved to each time by features of planes of place and time.
//!
//! Wu, Yi, Fang, Xie, Zhang, Wei, Liu, Tian, Wang, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering", 2024.
//!
//! ```text
//! f_h = concat_l prod_{(i,j)} interp(R_l(i, j)),  (i, j) in {xy, xz, yz, xt, yt, zt}          features (equation 5)
//! f_d = phi_d(f_h)                                                                          shared by all offsets
//! dX = phi_x(f_d),  dr = phi_r(f_d),  ds = phi_s(f_d)                                       networks of the offsets (section 4.3)
//! (X', r', s') = (X + dX, r + dr, s + ds)                                                   the cloud at the time (equation 7)
//! L = |C - C'| + L_tv                                                                       the loss (equation 8)
//! ```
//!
//! Planes are those of K-Planes (`field_core::encoding::planes`), drawn and learnt as every cloud here ([`crate::views`]); what moves it:
//! [`crate::cloud_motion`]. Opacities and colours move with `--set motion_opacity=true`, `motion_colour=true`, as released for films of
//! many cameras. What differs from the paper, and why: `docs/decisions/0061-four-dimensional-gaussians.md`.

use super::recipe::Recipe;
use super::splat;
use super::start::StartKind;
use crate::claims::Claim;
use crate::cloud_motion::{MotionParts, MotionSettings};
use crate::fields::{PlaneGridSettings, PlaneGridSource, count_of_times};
use crate::plan::{Ask, Built};
use crate::views::{CloudConfig, L1DssimConfig, PhotoTimes};
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "4dgs",
    paper: "Wu et al., 2024",
    what: "A cloud of Gaussians, moved to each time by features of planes of place and time",
    take: "the default for things that move and are cut out",
    differs: "The cloud is that of `splat` here: splits along the longest axis, opacities fade, pictures are antialiased, schedules \
              fit the run. Planes have 16 features instead of 32, a sixth as many vertices of time as photos have times, and lie in the box \
              that cameras see; those of space are not smoothed. Networks and planes learn ten times as fast, in the end a hundred; offsets begin at 0, what hardly moves is held still.",
    mark: "axis splits, 16 features, own rates",
};

/// Equation 8 has no structural similarity.
const LOSS: L1DssimConfig = L1DssimConfig { dssim: 0.0 };

/// The released networks for D-NeRF's scenes, in which the first 3 000 of 23 000 steps are of what stands still. Rates there fall from
/// 1.6e-4 to 1.6e-6 and from 1.6e-3 to 1.6e-5, in 20 000 steps.
pub(super) const MOTION: MotionSettings = MotionSettings {
    motion_from: 0.1,
    motion_width: 64,
    motion_layers: 0,
    motion_opacity: false,
    motion_colour: false,
    motion_masks: false,
    motion_lr: 1.6e-3,
    motion_lr_end: 1.6e-4,
    motion_feature_lr: 1.6e-2,
    motion_feature_lr_end: 1.6e-3,
    motion_coherence: 0.0,
    motion_reach: 0.02,
    motion_rest: 0.3,
};

/// The planes of D-NeRF's scenes, with half of the features.
pub(super) fn planes(plane_times: u32) -> PlaneGridSettings {
    PlaneGridSettings {
        plane_vertices: 64,
        plane_scales: vec![1, 2],
        plane_features: 16,
        plane_times,
        plane_variation: 0.0,
        plane_smoothness: 0.06,
        plane_transients: 6e-4,
    }
}

/// The motion of a cloud. Its planes have `plane_times` vertices along time; 0: half as many as the photos have times.
pub(super) fn moving(settings: MotionSettings, plane_times: u32, times: Arc<[f32]>) -> MotionParts {
    MotionParts { settings, features: PlaneGridSource::new(planes(plane_times), times) }
}

/// Vertices of time for things that move steadily: a sixth of the times, as of D-NeRF's scenes as released. In short films eight, or
/// half of the times where these are fewer.
pub(super) fn vertices_of_time(times: &[f32]) -> u32 {
    let count = count_of_times(times);
    count.div_ceil(6).max(count.div_ceil(2).min(8)).max(2)
}

fn motion(times: Arc<[f32]>, _: PhotoTimes) -> MotionParts {
    moving(MOTION, vertices_of_time(&times), times)
}

/// The cloud is that of `splat`, of fewer Gaussians; only what moves it, and the loss, are its own.
static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Random,
    cloud: CloudConfig { max_splats: 30_000, ..splat::CLOUD },
    rates: splat::RATES,
    density: splat::CONTROL,
    pictures: splat::PICTURES,
    loss: Some(LOSS),
    motion: Some(motion),
    photos: None,
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}

/// All settings by name, whatever is chosen; values are of no scene.
pub(crate) fn names() -> toml::Table {
    RECIPE.names()
}

#[cfg(test)]
mod tests {
    use super::vertices_of_time;

    #[test]
    fn vertices_of_time_are_a_sixth_of_the_times_and_not_fewer_than_eight_where_there_are_as_many_pairs() {
        let of = |count: u16| {
            // Photos that share a time count once.
            let times: Vec<f32> = (0..2 * count).map(|i| f32::from(i / 2)).collect();
            vertices_of_time(&times)
        };
        assert_eq!([120, 70, 20, 6, 2, 1, 0].map(of), [20, 12, 8, 3, 2, 2, 2]);
    }
}
