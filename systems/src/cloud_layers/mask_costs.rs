//! What the masks of the front and the brightness that they give cost.
//!
//! ```text
//! w_p P_f + w_h H(P_f) + w_B(t) |B - 1| + max(w_I - w_B(t), 0) |clamp(B C_b, 0, 1) - I|
//! ```
//!
//! `H` is the entropy of the mask, from the middle of the schedule on. `w_B` grows with the share `t` of the schedule: at first the brightness
//! is what makes the picture behind that of the photo (`C_b` has no gradient there), later it is 1. The share of the front (`w_p`) costs
//! nothing in the paper.
//!
//! # Source
//! Wang et al., "DeGauss", 2025, equations 9 and 10 and released code. As printed, the weights of the two parts of equation 10 change the
//! other way round, against the text: `docs/decisions/0066-degauss.md`.

use super::compare::Which;
use super::seen::{CostBars, Seen};
use super::settings::LayerSettings;
use crate::views::TargetPicture;
use losses::entropy;
use losses::kernel::Kernel;

/// Masks become clear from this share of the schedule on.
const CLEAR_FROM: f64 = 0.5;
/// Brightness is free at first: its weight is this at the start, and grows from a tenth of the schedule on.
const FREE_BRIGHTNESS: f64 = 2.5e-4;
const BRIGHTNESS_FROM: f64 = 0.1;

/// The cost at a share of the schedule; its gradients are added to `bars`.
pub(super) fn add(
    settings: &LayerSettings,
    seen: &Seen<'_>,
    target: &TargetPicture<'_>,
    at: f64,
    bars: &mut CostBars,
) -> f64 {
    let pixels = seen.composed.len();
    let n = pixels.max(1) as f64;
    let entropy = if at < CLEAR_FROM { 0.0 } else { settings.front_entropy / n };
    let grown = ((at - BRIGHTNESS_FROM) / (1.0 - BRIGHTNESS_FROM)).max(0.0) * settings.front_brightness;
    let brightness = FREE_BRIGHTNESS.max(grown) / n;
    let to_photo = (settings.front_brightness_photo - grown).max(0.0) / (3.0 * n);
    let sparsity = settings.sparsity(at) / n;
    let mut sum = 0.0;
    for (i, (pixel, bar)) in seen.composed.iter().zip(&mut bars.composed).enumerate() {
        let counts = target.weights.map_or(1.0, |w| f64::from(w[i]));
        let off = Kernel::L1.value(pixel.brightness, 1.0);
        sum += counts * (entropy * entropy::value(pixel.share) + brightness * f64::from(off));
        sum += counts * sparsity * f64::from(pixel.share);
        bar.share += (counts * (sparsity + entropy * entropy::derivative(pixel.share))) as f32;
        bar.brightness += (counts * brightness) as f32 * Kernel::L1.derivative(pixel.brightness, 1.0);
        if to_photo > 0.0 {
            let unlit = Which::Unlit.of(pixel);
            for (c, lit) in pixel.behind.into_iter().enumerate() {
                let (shown, wanted) = (lit.clamp(0.0, 1.0), target.colour[c * pixels + i]);
                sum += counts * to_photo * f64::from(Kernel::L1.value(shown, wanted));
                if shown == lit {
                    bar.brightness += (counts * to_photo) as f32 * Kernel::L1.derivative(shown, wanted) * unlit[c];
                }
            }
        }
    }
    sum
}
