//! View consistency (Ha-NeRF, equation 5): the encoder should find in a render the code that it was rendered with; and mode
//! seeking (as released): other codes should give other pictures.
//!
//! ```text
//! L = w_v mean |E(I_r) - a_k|  +  w_m / (mean |C - I_r| / mean |a - a_k| + 1e-5)
//! ```
//!
//! `I_r` is a lattice of a photo's pixels rendered with the code `a_k` of another photo, `a` the photo's own code and `C` the
//! render with it: all but `I_r` are constants, and the field brings the derivatives of `I_r` to its colour network alone.

use super::config::ConsistencyConfig;
use super::photo_network::{ForwardMemory, PhotoNetwork, Picture};
use crate::photo_model::{Codes, RenderedTwice, SecondRender};
use engine::data::{Patches, Shape};
use field_core::conv::Size;
use field_core::rng::Rng;
use losses::codes::{TwoModes, mode_seeking, mode_seeking_backward, view_consistency, view_consistency_backward};

/// Stream of the photos whose codes are taken.
const OTHERS: u64 = 0x6f74_6865_7273;

/// Lattices have the size that the encoder needs: settings are checked before.
const FITS: &str = "the lattice is at least as large as the encoder needs";

/// The two terms.
pub(super) struct Consistency {
    view_weight: f64,
    mode_weight: f64,
    every: u64,
    seed: u64,
    lattice: usize,
}

impl Consistency {
    /// With lattices of `lattice` pixels a side.
    pub(super) fn new(settings: &ConsistencyConfig, lattice: usize, seed: u64) -> Self {
        // In one step of `view_every`, with `view_every` times the weight.
        let weight = |w: f32| f64::from(w) * settings.view_every as f64;
        Self {
            view_weight: weight(settings.view_weight),
            mode_weight: weight(settings.mode_weight),
            every: settings.view_every,
            seed,
            lattice,
        }
    }

    /// The photo with whose code a lattice is rendered in this step; `None` in steps without, and until two photos have been
    /// encoded.
    pub(super) fn second_render(&self, codes: Codes<'_>, step: u64) -> Option<SecondRender> {
        if self.view_weight + self.mode_weight == 0.0 || !step.is_multiple_of(self.every) {
            return None;
        }
        let seen: Vec<u32> = (0..codes.len()).filter(|&v| is_known(codes.of(v))).map(|v| v as u32).collect();
        let other = Rng::new(self.seed, OTHERS).substream(step).below_at(0, seen.len().max(1) as u32) as usize;
        let patches = Patches { shape: Shape::Lattice, side: self.lattice as u32 };
        (seen.len() > 1).then(|| SecondRender { patches, views: vec![seen[other]] })
    }

    /// The loss and its derivatives with respect to the second render; those of the encoder's parameters are added to `grad`.
    pub(super) fn judge(
        &self,
        network: &PhotoNetwork,
        params: &[f32],
        codes: Codes<'_>,
        rendered: &RenderedTwice<'_>,
        grad: &mut [f32],
    ) -> (f64, Vec<[f32; 3]>) {
        let (side, n) = (self.lattice, self.lattice * self.lattice);
        let (mut loss, mut bars) = (0.0, vec![[0.0; 3]; rendered.other.len()]);
        let (mut memory, mut code) = (ForwardMemory::default(), Vec::new());
        let share = 1.0 / rendered.request.views.len().max(1) as f64;
        for (p, &other_view) in rendered.request.views.iter().enumerate() {
            let view = rendered.batch.view[p * n];
            let [own, other] = [view, other_view].map(|v| codes.of(v as usize));
            if view == other_view || !is_known(own) || !is_known(other) {
                continue;
            }
            let span = p * n..(p + 1) * n;
            let (rgb, bars) = (&rendered.other[span.clone()], &mut bars[span.clone()]);
            let x: Vec<f32> = (0..3 * n).map(|k| 2.0 * rgb[k % n][k / n] - 1.0).collect();
            let alpha: Vec<f32> = span
                .clone()
                .map(|i| if rendered.batch.weight[i] > 0.0 { rendered.batch.alpha[i] } else { 0.0 })
                .collect();
            let picture = Picture { x: &x, alpha: &alpha, size: Size::one(side, side) };
            network.forward(params, picture, &mut memory, &mut code);
            let (mut code_bar, mut x_bar) = (vec![0.0; code.len()], vec![0.0; x.len()]);
            let weight = self.view_weight * share;
            loss += weight * view_consistency(&code, other).expect(FITS);
            view_consistency_backward(&code, other, weight, &mut code_bar).expect(FITS);
            network.backward(params, picture, &mut memory, &code_bar, grad, Some(&mut x_bar));
            x_bar.iter().enumerate().for_each(|(k, bar)| bars[k % n][k / n] += 2.0 * bar);

            let weight = self.mode_weight * share;
            let own_rgb = rendered.own[span].as_flattened();
            let modes = TwoModes { own: own_rgb, other: rgb.as_flattened(), code_own: own, code_other: other };
            loss += weight * mode_seeking(modes).expect(FITS);
            mode_seeking_backward(modes, weight, bars.as_flattened_mut()).expect(FITS);
        }
        (loss, bars)
    }
}

/// A photo that has not been encoded yet has the code 0.
fn is_known(code: &[f32]) -> bool {
    code.iter().any(|&a| a != 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::data::Batch;
    use field_core::conv::{Encoder, EncoderConfig};
    use glam::DVec3;
    use render_core::ray::Ray;

    const SIDE: usize = 5;
    const N: usize = SIDE * SIDE;

    fn consistency(view_weight: f32, mode_weight: f32) -> Consistency {
        Consistency::new(&ConsistencyConfig { view_weight, mode_weight, view_every: 2 }, SIDE, 1)
    }

    fn network() -> (PhotoNetwork, Vec<f32>) {
        let encoder = Encoder::new(EncoderConfig::new(3, vec![3, 4], 2)).unwrap();
        let network = PhotoNetwork::new(encoder, &[-3.0, 0.0, 3.0]);
        let mut params = vec![0.0; network.param_count()];
        network.init(Rng::new(5, 6), &mut params);
        params.iter_mut().rev().take(18).enumerate().for_each(|(i, w)| *w = 0.1 * (i as f32 % 5.0) - 0.2);
        (network, params)
    }

    /// Two lattices, of views 0 and 1, and colours.
    fn lattices() -> (Batch, [Vec<[f32; 3]>; 2]) {
        let rays = vec![Ray { o: DVec3::ZERO, d: DVec3::Z }; 2 * N];
        let mut batch = Batch::of_rays(&rays, &vec![[0.0; 3]; 2 * N]);
        batch.view[N..].fill(1);
        let rng = Rng::new(8, 9);
        let rgb =
            |k: usize| (0..2 * N).map(|i| [0, 1, 2].map(|c| rng.uniform_at((6 * i + 2 * c + k) as u64))).collect();
        (batch, [rgb(0), rgb(1)])
    }

    fn second(views: &[u32]) -> SecondRender {
        SecondRender { patches: Patches { shape: Shape::Lattice, side: SIDE as u32 }, views: views.to_vec() }
    }

    const CODES: Codes<'_> = Codes { dims: 2, rows: &[0.5, -0.4, 1.2, 0.9, -0.7, 0.1] };

    #[test]
    fn both_terms_have_the_derivatives_of_differences() {
        let (network, params) = network();
        let (batch, [own, other]) = lattices();
        let request = second(&[2, 0]);
        // The second is so small because the pictures differ: at 1 it would be near 3.
        for (weights, mode) in [([0.3, 0.0], false), ([0.0, 0.3], true)] {
            let consistency = consistency(weights[0], weights[1]);
            let judge = |params: &[f32], other: &[[f32; 3]], grad: &mut [f32]| {
                let rendered = RenderedTwice { request: &request, batch: &batch, own: &own, other };
                consistency.judge(&network, params, CODES, &rendered, grad)
            };
            let mut grad = vec![0.0; params.len()];
            let (loss, bars) = judge(&params, &other, &mut grad);
            assert!(loss > 0.0);
            let mut nothing = vec![0.0; params.len()];
            let h = 1e-3_f32;
            for i in 0..2 * N {
                for c in 0..3 {
                    let mut at = |by: f32| {
                        let mut other = other.clone();
                        other[i][c] += by;
                        judge(&params, &other, &mut nothing).0
                    };
                    let derivative = (at(h) - at(-h)) / f64::from(2.0 * h);
                    // The terms have kinks, where a pixel is what it was or a code is met.
                    let off = (derivative - f64::from(bars[i][c])).abs();
                    assert!(off < 2e-3, "{weights:?}, pixel {i}, {c}: {derivative} {}", bars[i][c]);
                }
            }
            for k in (0..params.len()).step_by(17) {
                let mut at = |by: f32| {
                    let mut params = params.clone();
                    params[k] += by;
                    judge(&params, &other, &mut nothing).0
                };
                let derivative = (at(h) - at(-h)) / f64::from(2.0 * h);
                let off = (derivative - f64::from(grad[k])).abs();
                assert!(off < 2e-3, "{weights:?}, parameter {k}: {derivative} {}", grad[k]);
            }
            // The encoder has no part in the second term.
            assert_eq!(mode, grad.iter().all(|g| *g == 0.0));
        }
    }

    #[test]
    fn nothing_is_rendered_until_two_photos_have_been_encoded_nor_where_it_weighs_nothing() {
        let on = consistency(1e-3, 0.0);
        let of =
            |rows: &'static [f32], step| on.second_render(Codes { dims: 2, rows }, step).map(|request| request.views);
        assert_eq!(of(&[], 0), None);
        assert_eq!(of(&[0.5, 0.1], 0), None, "one photo");
        assert_eq!(of(&[0.5, 0.1, 0.0, 0.0], 0), None, "the second has not been encoded");
        assert_eq!(of(CODES.rows, 1), None, "not its turn");
        let views: Vec<u32> = (0..40).flat_map(|k| of(CODES.rows, 2 * k).unwrap()).collect();
        assert!((0..3).all(|view| views.contains(&view)), "{views:?}");
        let off = consistency(0.0, 0.0);
        assert_eq!(off.second_render(CODES, 0), None);
    }

    #[test]
    fn a_lattice_with_its_own_code_and_photos_not_encoded_yet_give_no_gradient() {
        let (network, params) = network();
        let (batch, [own, other]) = lattices();
        let consistency = consistency(0.3, 0.3);
        let unseen = Codes { dims: 2, rows: &[0.0, 0.0, 1.2, 0.9, 0.0, 0.0] };
        for (codes, views) in [(CODES, [0, 1]), (unseen, [1, 2])] {
            let request = second(&views);
            let rendered = RenderedTwice { request: &request, batch: &batch, own: &own, other: &other };
            let mut grad = vec![0.0; params.len()];
            let (loss, bars) = consistency.judge(&network, &params, codes, &rendered, &mut grad);
            assert!(loss == 0.0 && grad.iter().all(|g| *g == 0.0) && bars.iter().all(|b| *b == [0.0; 3]));
        }
    }
}
