//! What two clouds cost at first, while both stand still.
//!
//! ```text
//! main    = mean |P_f C_f + P_b clamp(B C_b, 0, 1) - 0.9 I| + mean |C_b - I|
//! utility = 0.05 (1 - SSIM(C_b, I)) + 0.05 (1 - SSIM(C_f, I))
//! ```
//!
//! The variation of depths behind counts as after it ([`super::costs`]). In the first term `C_b` has no gradient: the cloud behind learns the photos by itself, as if nothing moved, and the front learns what is
//! left. That is held to be a little darker than the photo, so that it does not cover walls without texture.
//!
//! # Source
//! Wang et al., "DeGauss", 2025, supplement and released code; weights over that of the absolute difference, 4.

use super::compare::{Comparison, Counted, Which};
use super::seen::{PartBars, Seen};
use crate::views::TargetPicture;
use losses::LossError;
use losses::kernel::Kernel;

/// What both clouds show together, as a share of the photo.
const DARKER: f32 = 0.9;
/// Weight of structure beside the absolute difference.
const STRUCTURE: f32 = 0.05;

/// The cost; its gradients are added to `bars`.
pub(super) fn add(
    comparison: &mut Comparison,
    seen: &Seen<'_>,
    target: &TargetPicture<'_>,
    bars: PartBars<'_>,
) -> Result<f64, LossError> {
    let n = seen.composed.len();
    let each = 1.0 / (3 * n).max(1) as f32;
    let mut sum = 0.0;
    for (i, (pixel, bar)) in seen.composed.iter().zip(&mut bars.main.composed).enumerate() {
        let counts = each * target.weights.map_or(1.0, |w| w[i]);
        let unlit = Which::Unlit.of(pixel);
        for (c, lit) in pixel.behind.into_iter().enumerate() {
            let (seen, wanted) = (pixel.colour[c], DARKER * target.colour[c * n + i]);
            sum += f64::from(counts * Kernel::L1.value(seen, wanted));
            let seen_bar = counts * Kernel::L1.derivative(seen, wanted);
            let shown = lit.clamp(0.0, 1.0);
            bar.share += seen_bar * (pixel.front[c] - shown);
            bar.front[c] += seen_bar * pixel.share;
            if shown == lit {
                bar.brightness += seen_bar * (1.0 - pixel.share) * unlit[c];
            }
        }
    }
    sum += comparison.add(Which::Unlit, seen, target, Counted::All, [1.0, 0.0], bars.main)?;
    for which in [Which::Unlit, Which::Front] {
        sum += comparison.add(which, seen, target, Counted::All, [0.0, STRUCTURE], bars.utility)?;
    }
    Ok(sum)
}
