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
use crate::method::{Codes, Relit, SecondLight};
use engine::data::{Patches, Shape};
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wild::{AppearanceKind, FieldKind, OccluderKind};
    use engine::data::Batch;
    use field_core::conv::{Encoder, EncoderConfig};
    use glam::DVec3;
    use render_core::ray::Ray;

    const SIDE: usize = 5;
    const N: usize = SIDE * SIDE;

    fn config(view_weight: f32, mode_weight: f32) -> WildConfig {
        let config = WildConfig::new(FieldKind::Ngp, AppearanceKind::Encoder, OccluderKind::None);
        WildConfig { view_weight, mode_weight, view_every: 2, lattice: SIDE, ..config }
    }

    fn glance() -> (Glance, Vec<f32>) {
        let encoder = Encoder::new(EncoderConfig::new(3, vec![3, 4], 2)).unwrap();
        let glance = Glance::new(encoder, &[-3.0, 0.0, 3.0]);
        let mut params = vec![0.0; glance.param_count()];
        glance.init(Rng::new(5, 6), &mut params);
        params.iter_mut().rev().take(18).enumerate().for_each(|(i, w)| *w = 0.1 * (i as f32 % 5.0) - 0.2);
        (glance, params)
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

    fn second(views: &[u32]) -> SecondLight {
        SecondLight { patches: Patches { shape: Shape::Lattice, side: SIDE as u32 }, views: views.to_vec() }
    }

    const CODES: Codes<'_> = Codes { dims: 2, rows: &[0.5, -0.4, 1.2, 0.9, -0.7, 0.1] };

    #[test]
    fn both_terms_have_the_derivatives_of_differences() {
        let (glance, params) = glance();
        let (batch, [own, other]) = lattices();
        let light = second(&[2, 0]);
        // The second is so small because the pictures differ: at 1 it would be near 3.
        for (weights, mode) in [([0.3, 0.0], false), ([0.0, 0.3], true)] {
            let consistency = Consistency::new(&config(weights[0], weights[1]), 1);
            let judge = |params: &[f32], other: &[[f32; 3]], grad: &mut [f32]| {
                let relit = Relit { light: &light, batch: &batch, own: &own, other };
                consistency.judge((&glance, params), CODES, &relit, grad)
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
                    let slope = (at(h) - at(-h)) / f64::from(2.0 * h);
                    // The terms have kinks, where a pixel is what it was or a code is met.
                    let off = (slope - f64::from(bars[i][c])).abs();
                    assert!(off < 2e-3, "{weights:?}, pixel {i}, {c}: {slope} {}", bars[i][c]);
                }
            }
            for k in (0..params.len()).step_by(17) {
                let mut at = |by: f32| {
                    let mut params = params.clone();
                    params[k] += by;
                    judge(&params, &other, &mut nothing).0
                };
                let slope = (at(h) - at(-h)) / f64::from(2.0 * h);
                let off = (slope - f64::from(grad[k])).abs();
                assert!(off < 2e-3, "{weights:?}, parameter {k}: {slope} {}", grad[k]);
            }
            // The encoder has no part in the second term.
            assert_eq!(mode, grad.iter().all(|g| *g == 0.0));
        }
    }

    #[test]
    fn nothing_is_rendered_until_another_photo_has_been_seen_nor_where_it_weighs_nothing() {
        let on = Consistency::new(&config(1e-3, 0.0), 1);
        let of = |rows: &'static [f32], step| on.second_light(Codes { dims: 2, rows }, step).map(|light| light.views);
        assert_eq!(of(&[], 0), None);
        assert_eq!(of(&[0.5, 0.1], 0), None, "one photo");
        assert_eq!(of(&[0.5, 0.1, 0.0, 0.0], 0), None, "nobody has looked at the second");
        assert_eq!(of(CODES.rows, 1), None, "not its turn");
        let lights: Vec<u32> = (0..40).flat_map(|k| of(CODES.rows, 2 * k).unwrap()).collect();
        assert!((0..3).all(|view| lights.contains(&view)), "{lights:?}");
        let off = Consistency::new(&config(0.0, 0.0), 1);
        assert_eq!(off.second_light(CODES, 0), None);
    }

    #[test]
    fn a_lattice_in_its_own_light_and_photos_nobody_has_seen_say_nothing() {
        let (glance, params) = glance();
        let (batch, [own, other]) = lattices();
        let consistency = Consistency::new(&config(0.3, 0.3), 1);
        let unseen = Codes { dims: 2, rows: &[0.0, 0.0, 1.2, 0.9, 0.0, 0.0] };
        for (codes, views) in [(CODES, [0, 1]), (unseen, [1, 2])] {
            let light = second(&views);
            let relit = Relit { light: &light, batch: &batch, own: &own, other: &other };
            let mut grad = vec![0.0; params.len()];
            let (loss, bars) = consistency.judge((&glance, &params), codes, &relit, &mut grad);
            assert!(loss == 0.0 && grad.iter().all(|g| *g == 0.0) && bars.iter().all(|b| *b == [0.0; 3]));
        }
    }
}
