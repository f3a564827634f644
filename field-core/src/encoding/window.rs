//! Windows that open the octaves of a frequency encoding one after the other, coarse to fine.
//!
//! A window is one weight for each octave, for [`Frequency::encode`](super::frequency::Frequency::encode). It follows
//! the schedule of a run, not its gradients.

use float_core::m64;

/// `w_k = (1 - cos(pi clamp(alpha - k, 0, 1))) / 2`: octave `k` opens while `alpha` goes from `k` to `k + 1`.
///
/// Source: Park et al., "Nerfies", 2021, sec. 3.5, eq. 8.
pub fn nerfies(alpha: f64, w: &mut [f32]) {
    for (k, w) in w.iter_mut().enumerate() {
        *w = ease(alpha - k as f64);
    }
}

/// The window of NeRF-OSR: octaves below `min_octave` are always open, the others open during `anneal_steps`.
///
/// `a = (F - min_octave) step / anneal_steps`, `w_k = (1 - cos(pi clamp(a - k + min_octave, 0, 1))) / 2`. With
/// `anneal_steps = 0` everything is open.
///
/// Source: Rudnev et al., "NeRF for outdoor scene relighting", 2022, and its code.
pub fn osr(step: u64, anneal_steps: u64, min_octave: usize, w: &mut [f32]) {
    if anneal_steps == 0 {
        w.fill(1.0);
        return;
    }
    let opening = w.len().saturating_sub(min_octave) as f64;
    nerfies(opening * (step as f64 / anneal_steps as f64) + min_octave as f64, w);
}

/// Smoothly from 0 at 0 to 1 at 1. NaN counts as 0.
fn ease(x: f64) -> f32 {
    let x = if x > 0.0 { x.min(1.0) } else { 0.0 };
    ((1.0 - m64::cos(core::f64::consts::PI * x)) * 0.5) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_open_in_order_from_closed_to_open() {
        let mut before = [0.0; 6];
        for step in 0..=60 {
            let mut w = [0.0; 6];
            nerfies(f64::from(step) / 10.0, &mut w);
            assert!(w.iter().zip(&before).all(|(now, before)| now >= before));
            assert!(w.windows(2).all(|pair| pair[0] >= pair[1]));
            before = w;
        }
        assert_eq!(before, [1.0; 6]);
        nerfies(0.0, &mut before);
        assert_eq!(before, [0.0; 6]);
        nerfies(f64::NAN, &mut before);
        assert_eq!(before, [0.0; 6]);
    }

    #[test]
    fn osr_keeps_the_coarse_octaves_open() {
        let mut w = [0.0; 8];
        osr(0, 1000, 2, &mut w);
        assert_eq!(w, [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        osr(1000, 1000, 2, &mut w);
        assert_eq!(w, [1.0; 8]);
        osr(0, 0, 0, &mut w);
        assert_eq!(w, [1.0; 8]);
        osr(5, 10, 20, &mut w);
        assert_eq!(w, [1.0; 8]);
        osr(5, 10, 0, &mut []);
    }
}
