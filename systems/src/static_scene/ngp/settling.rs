//! What draws a field to a decision (TiNeuVox, Fang et al., 2022, released code): rays that end on something or nothing, samples
//! that have the colour of their pixel. Both are means over the rays that count.

use super::config::NgpConfig;
use losses::{entropy, point_colour};

/// Factors; 0: none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settling {
    /// Of the entropy of what reaches the background.
    pub(super) entropy: f32,
    /// Of the squared errors of samples' colours.
    pub(super) point_colour: f32,
}

impl Settling {
    pub(super) fn new(config: &NgpConfig) -> Self {
        Self { entropy: config.background_entropy, point_colour: config.point_colour }
    }
}

/// What the ends of the rays cost, `weight` of each times `factor`; `share` times the derivative is written to `end_bar`.
pub(super) fn ends(
    trans_end: &[f32],
    weight: impl Fn(usize) -> f32,
    factor: f32,
    share: f32,
    end_bar: &mut [f32],
) -> f64 {
    let mut loss = 0.0;
    for (r, (&p, bar)) in trans_end.iter().zip(end_bar).enumerate() {
        let factor = f64::from(weight(r) * factor);
        loss += factor * entropy::value(p);
        *bar = (factor * f64::from(share) * entropy::derivative(p)) as f32;
    }
    loss
}

/// What the colours `[3][n]` of the samples of rays cost, given offsets and weights of these, and weight and true colour of each
/// ray; `share` times the derivative is added to `rgb_bar`.
pub(super) fn colours(
    (offsets, w, rgb): (&[u32], &[f32], &[f32]),
    (weight, truth): (impl Fn(usize) -> f32, impl Fn(usize) -> [f32; 3]),
    factor: f32,
    share: f32,
    rgb_bar: &mut [f32],
) -> f64 {
    let n = w.len();
    let (r_bar, rest) = rgb_bar[..3 * n].split_at_mut(n);
    let (g_bar, b_bar) = rest.split_at_mut(n);
    let mut loss = 0.0;
    for (r, ends) in offsets.windows(2).enumerate() {
        let span = ends[0] as usize..ends[1] as usize;
        let factor = f64::from(weight(r) * factor);
        // Nothing is known of what a pixel that does not count shows.
        if factor == 0.0 {
            continue;
        }
        let (w, rgb) = (&w[span.clone()], [0, 1, 2].map(|c| &rgb[c * n..][span.clone()]));
        let bars = [&mut r_bar[span.clone()], &mut g_bar[span.clone()], &mut b_bar[span]];
        let fits = "samples are those of the rays";
        loss += factor * point_colour::of_ray(w, rgb, truth(r)).expect(fits);
        point_colour::of_ray_backward(w, rgb, truth(r), factor * f64::from(share), bars).expect(fits);
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_of_the_ends_is_that_of_differences_and_what_does_not_count_has_none() {
        let (p, weight) = ([0.2_f32, 0.7, 0.9], [1.0, 0.0, 0.5]);
        let cost = |p: &[f32]| ends(p, |r| weight[r], 0.3, 0.25, &mut [0.0; 3]);
        let mut bar = [f32::NAN; 3];
        ends(&p, |r| weight[r], 0.3, 0.25, &mut bar);
        for i in 0..3 {
            let at = |step: f32| {
                let mut p = p;
                p[i] += step;
                cost(&p)
            };
            let want = 0.25 * (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((f64::from(bar[i]) - want).abs() < 1e-5, "{i}: {} for {want}", bar[i]);
        }
        assert_eq!(bar[1], 0.0);
        assert_eq!(ends(&[], |_| 1.0, 1.0, 1.0, &mut []), 0.0);
    }

    #[test]
    fn the_gradient_of_colours_is_that_of_differences_and_is_added() {
        // A ray of two samples, one of none, one that does not count, one of one sample.
        let (offsets, w) = ([0, 2, 2, 3, 4], [0.3_f32, 0.5, 0.9, 0.7]);
        let rgb: Vec<f32> = (0..12).map(|i| (i * 5 % 12) as f32 / 12.0).collect();
        let weight = |r: usize| [1.0, 1.0, 0.0, 0.5][r];
        let truth = |r: usize| [0.1 * r as f32, 0.5, 0.9];
        let cost = |rgb: &[f32], bar: &mut [f32]| colours((&offsets, &w, rgb), (weight, truth), 0.3, 0.25, bar);
        let mut bar = vec![2.0; 12];
        cost(&rgb, &mut bar);
        for i in 0..12 {
            let at = |step: f32| {
                let mut rgb = rgb.clone();
                rgb[i] += step;
                cost(&rgb, &mut [0.0; 12])
            };
            let want = 2.0 + 0.25 * (at(1e-2) - at(-1e-2)) / 2e-2;
            assert!((f64::from(bar[i]) - want).abs() < 1e-5, "{i}: {} for {want}", bar[i]);
            assert!(i % 4 != 2 || bar[i] == 2.0, "a pixel that does not count");
        }
    }
}
