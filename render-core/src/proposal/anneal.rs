//! Weights raised to a power: flat at first, exact in the end.

use float_core::m32;

/// Exponent of the weights after the fraction `fraction` of training: `slope f / ((slope - 1) f + 1)`, 0 at the start, 1 at
/// the end, steeper at the start for a larger slope (10 as published).
#[must_use]
pub fn annealing_exponent(fraction: f32, slope: f32) -> f32 {
    let f = fraction.clamp(0.0, 1.0);
    slope * f / ((slope - 1.0) * f + 1.0)
}

/// `w[i]^exponent`, normalised to sum 1, in place. Intervals without length get nothing, and neither do those without weight
/// unless the exponent is 0: then all with a length get the same, and so they do where there is no weight at all.
///
/// # Shapes and units
/// * `s` `[n + 1]` fenceposts; `w` `[n]` weights, finite, `>= 0`, in and out
///
/// # Numerics
/// Powers are those of `w` over the largest weight: never above 1, whatever the weights' scale. An exponent of 0 is told
/// apart, for `0 * ln 0` is not a number.
///
/// # Panics
/// When the lengths disagree.
pub fn anneal(s: &[f32], exponent: f32, w: &mut [f32]) {
    assert_eq!(s.len(), w.len() + 1, "fenceposts are one more than weights");
    let mut largest = 0.0_f32;
    for (w, s) in w.iter_mut().zip(s.windows(2)) {
        *w = if s[1] > s[0] { *w } else { 0.0 };
        largest = largest.max(*w);
    }
    let flat = exponent == 0.0 || largest == 0.0;
    let mut sum = 0.0_f64;
    for (w, s) in w.iter_mut().zip(s.windows(2)) {
        *w = if flat {
            f32::from(u8::from(s[1] > s[0]))
        } else if *w > 0.0 && exponent != 1.0 {
            m32::exp(exponent * (m32::ln(*w) - m32::ln(largest)))
        } else {
            *w / largest
        };
        sum += f64::from(*w);
    }
    if sum > 0.0 {
        for w in w {
            *w = (f64::from(*w) / sum) as f32;
        }
    }
}
