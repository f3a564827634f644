//! A pixel of two clouds.
//!
//! With `C_f`, `M_f`, `M_b`, `X` the colour and the masks of the cloud in front, composited over nothing, `T` its transmittance, and `C_b`
//! the colour of the cloud behind:
//!
//! ```text
//! P = (M_f + d) / (M_f + M_b + T + 2 d),  d = 1e-6          the share of the front
//! B = 1/2 + a(X + T / 2),  a(x) = x up to 3/4, then 37 times as steep
//! C = P C_f / (1 - T) + (1 - P) clamp(B C_b, 0, 1)
//! ```
//!
//! Where no Gaussian is in front, `T` is 1: the share is 0 and the brightness 1. In the paper both are one half there, colours are not
//! divided by their opacity, and Gaussians that show nothing hold the masks (its "utility" Gaussians).
//!
//! # Source
//! Wang et al., "DeGauss", 2025, equations 1 and 4, supplement and released code.

/// Added to both masks.
const LEAST_MASK: f32 = 1e-6;
/// Added to the opacity that a colour is divided by.
const LEAST_OPACITY: f32 = 1e-4;
/// Where the mask of the brightness is above the knee, the brightness rises this many times as fast.
const KNEE: f32 = 0.75;
const STEEP: f32 = 37.0;

/// What the cloud in front shows of a pixel, composited over nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FrontPixel {
    pub(crate) colour: [f32; 3],
    /// Of the front, of what is behind, of the brightness of that.
    pub(crate) masks: [f32; 3],
    pub(crate) transmittance: f32,
}

/// A pixel of both clouds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Composed {
    /// What is seen.
    pub(crate) colour: [f32; 3],
    /// Of the front alone.
    pub(crate) front: [f32; 3],
    /// Of what is behind alone, as bright as it is here; not clamped.
    pub(crate) behind: [f32; 3],
    /// Share of the front.
    pub(crate) share: f32,
    /// Brightness of what is behind.
    pub(crate) brightness: f32,
}

/// Gradients with respect to [`Composed`]: the same numbers.
pub(crate) type ComposedBar = Composed;

/// Gradients with respect to both clouds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PixelBars {
    pub(crate) front: FrontPixel,
    pub(crate) behind: [f32; 3],
}

/// How much the front and what is behind have of a pixel, without the share's smallest masks.
fn shares(front: &FrontPixel) -> (f32, f32) {
    let sum = front.masks[0] + front.masks[1] + front.transmittance + 2.0 * LEAST_MASK;
    ((front.masks[0] + LEAST_MASK) / sum, sum)
}

fn brightness(front: &FrontPixel) -> (f32, f32) {
    let x = front.masks[2] + 0.5 * front.transmittance;
    if x <= KNEE { (0.5 + x, 1.0) } else { (0.5 + KNEE + STEEP * (x - KNEE), STEEP) }
}

/// The pixel; `shades`: the front changes the brightness of what is behind.
pub(crate) fn compose(front: &FrontPixel, behind: [f32; 3], shades: bool) -> Composed {
    let (share, _) = shares(front);
    let brightness = if shades { brightness(front).0 } else { 1.0 };
    let opacity = 1.0 - front.transmittance + LEAST_OPACITY;
    let own = front.colour.map(|c| c / opacity);
    let lit = behind.map(|c| brightness * c);
    let colour = [0, 1, 2].map(|c| share * own[c] + (1.0 - share) * lit[c].clamp(0.0, 1.0));
    Composed { colour, front: own, behind: lit, share, brightness }
}

/// Backward twin of [`compose`], which gave `seen`.
pub(crate) fn pull_back(
    front: &FrontPixel,
    behind: [f32; 3],
    shades: bool,
    seen: &Composed,
    bar: &ComposedBar,
) -> PixelBars {
    let (share, sum) = shares(front);
    let opacity = 1.0 - front.transmittance + LEAST_OPACITY;
    let mut out = PixelBars::default();
    let (mut share_bar, mut brightness_bar, mut transmittance) = (bar.share, bar.brightness, 0.0);
    for (c, under) in behind.into_iter().enumerate() {
        let lit = seen.behind[c];
        share_bar += bar.colour[c] * (seen.front[c] - lit.clamp(0.0, 1.0));
        let own_bar = bar.front[c] + share * bar.colour[c];
        out.front.colour[c] = own_bar / opacity;
        transmittance += own_bar * seen.front[c] / opacity;
        let inside = if (0.0..=1.0).contains(&lit) { (1.0 - share) * bar.colour[c] } else { 0.0 };
        let lit_bar = bar.behind[c] + inside;
        out.behind[c] = seen.brightness * lit_bar;
        brightness_bar += lit_bar * under;
    }
    out.front.masks[0] = share_bar * (1.0 - share) / sum;
    let of_behind = -share_bar * share / sum;
    out.front.masks[1] = of_behind;
    transmittance += of_behind;
    if shades {
        let of_mask = brightness_bar * brightness(front).1;
        out.front.masks[2] = of_mask;
        transmittance += 0.5 * of_mask;
    }
    out.front.transmittance = transmittance;
    out
}
