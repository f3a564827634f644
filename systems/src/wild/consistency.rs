//! What the encoder sees in a render should be the code the render was made with (Ha-NeRF, equation 5), and other codes
//! should give other pictures (mode seeking, as released).
//!
//! ```text
//! L = w_v mean |E(I_r) - a_k|  +  w_m / (mean |C - I_r| / mean |a - a_k| + 1e-5)
//! ```
//!
//! `I_r` is a lattice of a photo's pixels in the light `a_k` of another photo, `a` its own and `C` its own render: all but `I_r`
//! are constants, and the field brings the derivatives of `I_r` to its colour network alone.

use super::config::WildConfig;
use super::glance::{Glance, Kept, Picture};
use crate::data::{Patches, Shape};
use crate::method::{Codes, Relit, SecondLight};
use field_core::conv::Size;
use field_core::rng::Rng;
use losses::codes::{TwoModes, mode_seeking, mode_seeking_backward, view_consistency, view_consistency_backward};

/// Stream of the photos whose light is taken.
const OTHERS: u64 = 0x6f74_6865_7273;

/// What is said of shapes holds for every lattice.
const FITS: &str = "lattices are no smaller than the encoder needs";

/// The two terms.
pub(super) struct Consistency {
    view_weight: f64,
    mode_weight: f64,
    every: u64,
    seed: u64,
    lattice: usize,
}

impl Consistency {
    pub(super) fn new(config: &WildConfig, seed: u64) -> Self {
        // What is looked at now and then weighs the more.
        let weight = |w: f32| f64::from(w) * config.view_every as f64;
        Self {
            view_weight: weight(config.view_weight),
            mode_weight: weight(config.mode_weight),
            every: config.view_every,
            seed,
            lattice: config.lattice,
        }
    }

    /// In whose light a lattice is rendered in this step; `None` in steps without, and until two photos have been looked at.
    pub(super) fn second_light(&self, codes: Codes<'_>, step: u64) -> Option<SecondLight> {
        if self.view_weight + self.mode_weight == 0.0 || !step.is_multiple_of(self.every) {
            return None;
        }
        let seen: Vec<u32> = (0..codes.len()).filter(|&v| is_known(codes.of(v))).map(|v| v as u32).collect();
        let other = Rng::new(self.seed, OTHERS).substream(step).below_at(0, seen.len().max(1) as u32) as usize;
        let patches = Patches { shape: Shape::Lattice, side: self.lattice as u32 };
        (seen.len() > 1).then(|| SecondLight { patches, views: vec![seen[other]] })
    }

    /// The loss and the derivatives of the relit pixels; those of the encoder's parameters are added to `grad`.
    pub(super) fn judge(
        &self,
        (glance, params): (&Glance, &[f32]),
        codes: Codes<'_>,
        relit: &Relit<'_>,
        grad: &mut [f32],
    ) -> (f64, Vec<[f32; 3]>) {
        let (side, n) = (self.lattice, self.lattice * self.lattice);
        let (mut loss, mut bars) = (0.0, vec![[0.0; 3]; relit.other.len()]);
        let (mut kept, mut code) = (Kept::default(), Vec::new());
        let share = 1.0 / relit.light.views.len().max(1) as f64;
        for (p, &light) in relit.light.views.iter().enumerate() {
            let view = relit.batch.view[p * n];
            let [own, other] = [view, light].map(|v| codes.of(v as usize));
            if view == light || !is_known(own) || !is_known(other) {
                continue;
            }
            let span = p * n..(p + 1) * n;
            let (rgb, bars) = (&relit.other[span.clone()], &mut bars[span.clone()]);
            let x: Vec<f32> = (0..3 * n).map(|k| 2.0 * rgb[k % n][k / n] - 1.0).collect();
            let alpha: Vec<f32> =
                span.clone().map(|i| if relit.batch.weight[i] > 0.0 { relit.batch.alpha[i] } else { 0.0 }).collect();
            let picture = Picture { x: &x, alpha: &alpha, size: Size::one(side, side) };
            glance.forward(params, picture, &mut kept, &mut code);
            let (mut code_bar, mut x_bar) = (vec![0.0; code.len()], vec![0.0; x.len()]);
            let weight = self.view_weight * share;
            loss += weight * view_consistency(&code, other).expect(FITS);
            view_consistency_backward(&code, other, weight, &mut code_bar).expect(FITS);
            glance.backward(params, picture, &mut kept, &code_bar, grad, Some(&mut x_bar));
            x_bar.iter().enumerate().for_each(|(k, bar)| bars[k % n][k / n] += 2.0 * bar);

            let weight = self.mode_weight * share;
            let own_rgb = relit.own[span].as_flattened();
            let modes = TwoModes { own: own_rgb, other: rgb.as_flattened(), code_own: own, code_other: other };
            loss += weight * mode_seeking(modes).expect(FITS);
            mode_seeking_backward(modes, weight, bars.as_flattened_mut()).expect(FITS);
        }
        (loss, bars)
    }
}

/// Nobody has looked yet at a photo whose code is 0.
fn is_known(code: &[f32]) -> bool {
    code.iter().any(|&a| a != 0.0)
}
