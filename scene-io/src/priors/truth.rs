//! Truth about photos, for scoring: what does not belong to the place, what moves.

use crate::bit_mask::BitMask;
use crate::perturbation::Bars;
use std::path::PathBuf;
use std::sync::Arc;

/// A set of pixels that is known for certain. For scoring; nothing that trains may read it.
///
/// Passers-by and other things that do not belong to the place ([`Truth::transient`](crate::Truth::transient)) are read from `transient_mask_path`
/// of a frame in any `transforms*.json`, and from `mask_path` of a Blender-form clutter file (see
/// [`crate::TrainPhotos`]), whose sense is the opposite of nerfstudio's. Things that move at some time
/// ([`Truth::moving`](crate::Truth::moving)) are read from `moving_path`. A mask file of zeros and ones counts as one of black and white.
#[derive(Clone, Debug)]
pub enum TruthMask {
    /// In a file.
    File(PathBuf),
    /// Known already, at the photo's native size.
    Memory(Arc<BitMask>),
    /// What a perturbation puts in front of the photo; `None` where that is nothing.
    Bars(Option<Bars>),
}
