//! Networks whose products take bf16 numbers.
//!
//! What is promised ([`Precision::Bf16`](super::Precision::Bf16)), whatever the back end: weights, the input of each
//! layer and the gradient of each layer's output (after its activation's derivative) are rounded to bf16, to nearest,
//! ties to even; products of two such numbers are exact in f32 and are summed in f32. Biases, outputs, input gradients
//! and the accumulators of weight gradients are f32; bias gradients sum the rounded gradients. Numbers below the
//! smallest normal f32 may count as zero.
//!
//! Two back ends: where the CPU has `vdpbf16ps`, kernels on pairs ([`avx512`], [`pass`]); everywhere else the f32 kernels
//! on rounded numbers. They differ in the order of sums, and so, now and then, in the direction in which a number is rounded.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
#[cfg(target_arch = "x86_64")]
pub(super) mod pass;

use super::Layer;
use alloc::vec::Vec;

/// Nearest bf16, ties to even, as f32. Denormal numbers become zero, NaN stays NaN.
#[inline(always)]
pub(super) fn round(x: f32) -> f32 {
    let bits = x.to_bits();
    let nearest = bits.wrapping_add(0x7fff + ((bits >> 16) & 1));
    let exponent = bits & 0x7f80_0000;
    let bits = if exponent == 0 {
        bits & 0x8000_0000
    } else if exponent == 0x7f80_0000 {
        // Infinity as it is; NaN with its quiet bit, lest only the digits below are set.
        if bits & 0x007f_ffff == 0 { bits } else { bits | 0x0040_0000 }
    } else {
        nearest
    };
    f32::from_bits(bits & 0xffff_0000)
}

/// [`round`] each number.
#[inline(always)]
pub(super) fn round_all(x: &mut [f32]) {
    for x in x {
        *x = round(*x);
    }
}

/// Weights as the kernels on pairs read them: per layer `[in / 2][out_pad][2]` for the forward pass, `[out / 2][in_pad][2]`
/// for the backward pass, odd ends filled with zeros. `forward` and `backward` say where the layer's begin, and are
/// large enough: see [`pairs_len`].
pub(super) fn pack_pairs(l: &Layer, w: &[f32], forward: &mut Vec<u16>, backward: &mut Vec<u16>) {
    let (f, b) = (forward.len(), backward.len());
    forward.resize(f + pairs_len(l.inputs, l.outputs_pad), 0);
    backward.resize(b + pairs_len(l.outputs, l.inputs_pad), 0);
    for (o, row) in w.chunks_exact(l.inputs).enumerate() {
        for (i, w) in row.iter().enumerate() {
            let bits = (round(*w).to_bits() >> 16) as u16;
            forward[f + (i / 2 * l.outputs_pad + o) * 2 + i % 2] = bits;
            backward[b + (o / 2 * l.inputs_pad + i) * 2 + o % 2] = bits;
        }
    }
}

/// Numbers of weights in pairs: `depth` rounded up to even, times `width`.
pub(super) fn pairs_len(depth: usize, width: usize) -> usize {
    depth.div_ceil(2) * 2 * width
}

#[cfg(test)]
mod tests {
    use super::round;

    #[test]
    fn rounding_is_to_the_nearest_and_ties_to_even() {
        let step = 2_f32.powi(-7);
        for (x, want) in [
            (1.0, 1.0),
            (1.0 + step / 2.0, 1.0),
            (1.0 + 1.5 * step, 1.0 + 2.0 * step),
            (1.0 + 0.51 * step, 1.0 + step),
            (-1.0 - 0.49 * step, -1.0),
            (1e-40, 0.0),
            (f32::MAX, f32::INFINITY),
            (f32::NEG_INFINITY, f32::NEG_INFINITY),
        ] {
            assert_eq!(round(x).to_bits(), want.to_bits(), "{x}");
        }
        assert!(round(f32::NAN).is_nan() && round(-f32::NAN).is_nan());
        for i in 0..100_000_u32 {
            let x = f32::from_bits(i.wrapping_mul(42_949));
            if x.is_normal() && x.abs() < 1e38 {
                assert!((round(x) - x).abs() <= x.abs() / 256.0, "{x}");
            }
        }
    }
}
