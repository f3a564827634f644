//! Ha-NeRF, and its ablations Ha-NeRF(A) (appearance alone) and Ha-NeRF(T) (occluders alone).
//!
//! Chen, Zhang, Li, Chen, Feng, Wang, Wang, "Hallucinated Neural Radiance Fields in the Wild", 2022, section 3.
//!
//! The appearance of a photo is encoded by a network, so that a photo that was not trained on has one, too
//! (`encoder`). Now and then a lattice of a photo's pixels is rendered with the code of another photo, in
//! which the encoder should find that code again (view consistency; on the hash grid alone).
//!
//! Occluders are found in the plane of the photo: a network (`VisibilityMap`) predicts how far each pixel is left out, `m` in
//! 0 to 1, which has a price:
//!
//! ```text
//! L = (1 - m) |C - Y|^2 + 2 lambda m^2        at best  m = min(1, |C - Y|^2 / (4 lambda))
//! ```
//!
//! (squares are means over channels: twice the loss of [`losses::visibility`], so that a pixel which counts costs what it does
//! elsewhere). `lambda` falls over the first steps: while the scene is not there yet nothing fits it, and all would be left out.
//! On the hash grid what is not left out costs the scene a robust error (`kernel`), as the network needs its time to find
//! occluders; the network learns from the square.
//!
//! The published networks learn from one lattice of one photo in a step, as published. The hash grid learns from random pixels
//! of all photos and free codes, which the encoder learns to predict: docs/decisions/0015-ha-nerf-on-a-fast-field.md.

mod config;
mod visibility;
mod visibility_map;

pub use config::VisibilityConfig;

use super::choice::FieldKind;
use super::nerf_w::{CHARBONNIER, CODES, HASH_GRID_CODES, SQUARED};
use super::planning::{Build, Planning};
use crate::appearance::AppearanceModel;
use crate::appearance::config::{CodeConfig, ConsistencyConfig, PhotoEncoderConfig};
use crate::appearance::encoder::Encoder;
use crate::claims::Claim;
use crate::occluders::OccluderModel;
use crate::occluders::none::NoOccluders;
use crate::occluders::pixel_error::KernelConfig;
use engine::system::SystemError;
use field_core::conv::EncoderConfig;
use visibility::Visibility;

/// `ha-nerf-a`: the encoder of appearance alone.
pub(crate) const HA_NERF_A: Claim = Claim {
    name: "ha-nerf-a",
    paper: "Chen et al., 2022",
    what: "Appearance: an encoder of the photo",
    take: "to show the scene in the appearance of a photo that was not trained on",
    differs: "The field learns with free codes, and the encoder learns to predict them; it also sees means of the photo's channels. The \
              loss is Charbonnier (0.05), weights of view consistency are doubled, the field is ngp's. `--field mlp` learns \
              through the published encoder, without view consistency.",
    mark: "free codes, Charbonnier",
};

/// `ha-nerf-t`: the visibility map alone.
pub(crate) const HA_NERF_T: Claim = Claim {
    name: "ha-nerf-t",
    paper: "Chen et al., 2022",
    what: "Occluders: a visibility network in the photo's plane",
    take: "to compare with `robust-nerf`",
    differs: "The scene's loss is Charbonnier (0.05) instead of the squared error and the visibility network is 2 x 64, on ngp's \
              field. `--field mlp` has published networks and the squared error.",
    mark: "Charbonnier, small network",
};

/// `ha-nerf`: both.
pub(crate) const HA_NERF: Claim = Claim {
    name: "ha-nerf",
    paper: "Chen et al., 2022",
    what: "Appearance: an encoder of the photo; occluders: a visibility network in the photo's plane",
    take: "as `ha-nerf-a`, where there are occluders",
    differs: "The field learns with free codes, and the encoder learns to predict them; it also sees means of the photo's channels. The \
              loss is Charbonnier (0.05), weights of view consistency are doubled, the visibility network is 2 x 64, the field \
              is ngp's. `--field mlp`: published encoder, networks and squared error, without view consistency.",
    mark: "free codes, Charbonnier",
};

/// The encoder on the hash grid: a prediction has an error in each number of a code, so there are few, held nearer to 0.
const HASH_GRID_ENCODED: CodeConfig = CodeConfig { appearance_dims: 6, code_size: 3e-2, ..HASH_GRID_CODES };

/// The encoder as published (section 3.1).
fn published() -> PhotoEncoderConfig {
    PhotoEncoderConfig {
        encoder_side: 128,
        encoder_channels: EncoderConfig::published().channels,
        encoder_lr: 1.0,
        encoder_tilts: vec![],
        lattices: 1,
        lattice: 32,
        encoder_photos: 12,
    }
}

/// The encoder on the hash grid (`docs/decisions/0015-ha-nerf-on-a-fast-field.md`).
fn hash_grid() -> PhotoEncoderConfig {
    PhotoEncoderConfig {
        encoder_side: 32,
        encoder_channels: EncoderConfig::small().channels,
        encoder_lr: 0.2,
        encoder_tilts: vec![-10.0, 0.0, 10.0],
        lattices: 0,
        ..published()
    }
}

/// No second renders: `mlp` does not have them.
const NO_CONSISTENCY: ConsistencyConfig = ConsistencyConfig { view_weight: 0.0, mode_weight: 0.0, view_every: 4 };

/// Twice the published weights, as half the squared error is not what pixels cost here.
const CONSISTENCY: ConsistencyConfig = ConsistencyConfig { view_weight: 2e-3, mode_weight: 2e-6, ..NO_CONSISTENCY };

/// A network that encodes each photo.
pub(super) fn appearance<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn AppearanceModel>, SystemError> {
    let codes: CodeConfig = planning.settings.of(&planning.by_field(HASH_GRID_ENCODED, CODES))?;
    codes.check()?;
    let encoder: PhotoEncoderConfig = planning.settings.of(&planning.by_field(hash_grid(), published()))?;
    encoder.check()?;
    let consistency: ConsistencyConfig = planning.settings.of(&planning.by_field(CONSISTENCY, NO_CONSISTENCY))?;
    consistency.check()?;
    if planning.choice.field == FieldKind::Mlp {
        consistency.check_without_second_render()?;
    }
    let (data, seed) = (planning.data, planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(Encoder::new(&codes, &encoder, &consistency, data, seed)?))))
}

/// Appearance alone: errors are squared, or robust on the hash grid.
pub(super) fn no_occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let settings: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    settings.check()?;
    let kernel = settings.kernel();
    Ok(Box::new(move || Ok(Box::new(NoOccluders { kernel, coarse: kernel }))))
}

/// The visibility map.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let planned = planning.by_field(VisibilityConfig::HASH_GRID, VisibilityConfig::PUBLISHED);
    let settings: VisibilityConfig = planning.settings.of(&planned)?;
    settings.check()?;
    let error: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    error.check()?;
    let (views, seed) = (planning.data.len(), planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(Visibility::new(&settings, error.kernel(), views, seed)?))))
}
