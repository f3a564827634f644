//! Samples around a depth that is known beforehand.

use float_core::m64;

/// How samples lie around a measured depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCue {
    /// Standard deviation of the normal distribution around the depth, unit of the distances, `>= 0`.
    pub sigma: f32,
    /// Share of the samples spread evenly over the whole ray, in `[0, 1]`: without any the surface can never be found
    /// elsewhere than measured.
    pub uniform_share: f32,
}

impl DepthCue {
    /// A twentieth of the length of the ray, and every tenth sample anywhere.
    #[must_use]
    pub fn for_range(near: f32, far: f32) -> Self {
        Self { sigma: 0.05 * (far - near).max(0.0), uniform_share: 0.1 }
    }
}

/// `n` stratified samples of a mixture: the uniform distribution on `[near, far]` with the share `cue.uniform_share`, and a
/// normal distribution around `depth` cut off at `near` and `far` with the rest. Non-decreasing.
///
/// Sample `i` is where the mixture's mass reaches `(i + u[i]) / n`, of its uniform part first. A depth outside the ray
/// counts as the end nearest to it; one that is not a measurement (NaN, infinite, `<= 0`) gives uniform samples.
///
/// # Shapes and units
/// * `u` `[n]` in `[0, 1)`; `t` `[n]` out, unit of `near`; `near <= far`, finite
///
/// # Panics
/// When the lengths differ.
///
/// # Source
/// Wang et al., "Neural rendering for stereo 3D reconstruction of deformable tissues in robotic surgery" (EndoNeRF),
/// 2022, depth-cueing ray marching; there without a uniform part and not cut off, which puts samples behind the camera.
pub fn depth_cued(near: f32, far: f32, depth: f32, cue: DepthCue, u: &[f32], t: &mut [f32]) {
    assert_eq!(u.len(), t.len(), "one random number a sample");
    let (low, high) = (f64::from(near), f64::from(far));
    let is_measured = depth.is_finite() && depth > 0.0;
    let uniform = if is_measured { f64::from(cue.uniform_share).clamp(0.0, 1.0) } else { 1.0 };
    let centre = f64::from(depth).max(low).min(high);
    let normal = Truncated::new(centre, f64::from(cue.sigma), low, high);
    let n = u.len() as f64;
    for (i, (t, &u)) in t.iter_mut().zip(u).enumerate() {
        let share = (i as f64 + f64::from(u)) / n;
        let place = if share < uniform {
            low + share / uniform * (high - low)
        } else {
            normal.at(((share - uniform) / (1.0 - uniform)).min(1.0))
        };
        // Rounding to f32 may step over an end.
        *t = (place as f32).max(near).min(far);
    }
    // Two increasing runs.
    t.sort_unstable_by(f32::total_cmp);
}

/// A normal distribution between two bounds around its centre.
struct Truncated {
    centre: f64,
    sigma: f64,
    low: f64,
    high: f64,
    /// Mass below the lower bound, and between the bounds.
    below: f64,
    inside: f64,
}

impl Truncated {
    /// `low <= centre <= high`: at least half of one side lies inside, so its mass has its digits.
    fn new(centre: f64, sigma: f64, low: f64, high: f64) -> Self {
        let below = cumulative((low - centre) / sigma);
        // Upper tail as the lower tail of its mirror image.
        let inside = 1.0 - below - cumulative((centre - high) / sigma);
        Self { centre, sigma, low, high, below, inside }
    }

    fn at(&self, share: f64) -> f64 {
        let (length, share) = (self.high - self.low, share.max(0.0));
        if self.sigma.is_nan() || self.sigma <= 0.0 {
            return self.centre;
        }
        if self.sigma > 1e3 * length {
            // Flat to 1e-6: the mass between the bounds would lose its digits.
            return self.low + share * length;
        }
        (self.centre + self.sigma * quantile(self.below + share * self.inside)).max(self.low).min(self.high)
    }
}

/// Mass of the standard normal distribution below `x`, for `x <= 0` to 1e-7 of itself; above 0 as 1 less the mirror image.
fn cumulative(x: f64) -> f64 {
    if x > 0.0 {
        return 1.0 - cumulative(-x);
    }
    // Chebyshev fit of erfc (Press et al., "Numerical recipes", 2nd ed., section 6.2).
    let z = -x * core::f64::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    const FIT: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let fit = FIT.iter().rev().fold(0.0, |sum, c| sum * t + c);
    0.5 * t * m64::exp(fit - z * z)
}

/// The `x` with mass `p` below it: a rational fit (Acklam, 2003), good to 2e-9 of `x`. `p` of 0 and 1 give infinities.
fn quantile(p: f64) -> f64 {
    const A: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const B: [f64; 6] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
        1.0,
    ];
    const C: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const D: [f64; 5] =
        [7.784_695_709_041_462e-3, 3.224_671_290_700_398e-1, 2.445_134_137_142_996, 3.754_408_661_907_416, 1.0];
    const TAIL: f64 = 0.02425;
    let polynomial = |c: &[f64], x: f64| c.iter().fold(0.0, |sum, c| sum * x + c);
    if p <= 0.0 {
        f64::NEG_INFINITY
    } else if p >= 1.0 {
        f64::INFINITY
    } else if p < TAIL {
        let q = m64::sqrt(-2.0 * m64::ln(p));
        polynomial(&C, q) / polynomial(&D, q)
    } else if p > 1.0 - TAIL {
        -quantile(1.0 - p)
    } else {
        let (q, r) = (p - 0.5, (p - 0.5) * (p - 0.5));
        q * polynomial(&A, r) / polynomial(&B, r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cumulative_and_quantile_have_their_known_values() {
        for (x, p) in [
            (0.0, 0.5),
            (-1.0, 0.158_655_253_931_457),
            (-1.959_963_984_540_054, 0.025),
            (-3.0, 1.349_898_031_630_095e-3),
            (-6.0, 9.865_876_450_376_98e-10),
            (2.0, 0.977_249_868_051_821),
        ] {
            assert!((cumulative(x) / p - 1.0).abs() < 2e-7, "{x}: {}", cumulative(x));
            assert!((quantile(p) - x).abs() < 1e-8, "{p}: {}", quantile(p));
        }
        assert_eq!((quantile(0.0), quantile(1.0)), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
