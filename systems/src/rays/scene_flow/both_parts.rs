//! How much of what a ray shows is the moving part's, where both parts are rendered together.
//!
//! ```text
//! tau = m tau_m + (1 - m) tau_s      matter of both parts, as a picture has it; m the gate, the still part held
//! P = m tau_m / tau                  the moving part's share of a sample
//! D = sum_k w_k P_k                  that of a ray; w the weights of both parts together
//! ```
//!
//! `D` is the dynamicness of DynamicNeRF (Gao et al., 2021) and the map of dynamic weights of NSFF (Li et al., 2021, released code).

use super::chosen::Chosen;
use crate::buffers::sized;
use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};

/// What the moving part alone says of the moving samples of some rays, `[m]` each: densities and blend weights.
#[derive(Clone, Copy)]
pub(super) struct MovingMatter<'a> {
    pub(super) sigma: &'a [f32],
    pub(super) blend: &'a [f32],
}

impl MovingMatter<'_> {
    /// Optical depths of the moving part, of the still part, and of both, and the blend weight, of moving sample `k`.
    fn of(&self, rays: &Chosen, k: usize) -> [f64; 4] {
        let i = rays.at[k] as usize;
        // In f64 no product of two of these overflows; what is opaque stays a number.
        let moving = f64::from(self.sigma[k]) * f64::from(rays.dt[i]);
        let still = f64::from(rays.still[i]).min(f64::from(f32::MAX));
        let m = f64::from(self.blend[k]);
        [moving, still, m * moving + (1.0 - m) * still, m]
    }
}

/// Buffers of that.
#[derive(Default)]
pub(super) struct BothParts {
    /// `[n]`, optical depths of both parts, the moving part's shares, and weights.
    tau: Vec<f32>,
    share: Vec<f32>,
    w: Vec<f32>,
    opacity: Vec<f32>,
    trans_end: Vec<f32>,
    nothing: Vec<f32>,
    tau_bar: Vec<f32>,
    share_bar: Vec<f32>,
    /// `[m]`, gradients of raw log-densities and of gates of the moving samples.
    pub(super) raw_bar: Vec<f32>,
    pub(super) gate_bar: Vec<f32>,
}

impl BothParts {
    /// The moving part's share of each ray, written to `out` `[rays]`.
    pub(super) fn forward(&mut self, simd: Simd, rays: &Chosen, matter: MovingMatter<'_>, out: &mut Vec<f32>) {
        let ([n, m], count) = (rays.samples(), rays.len());
        self.tau.clone_from(&rays.tau);
        self.share.clear();
        self.share.resize(n, 0.0);
        for k in 0..m {
            let ([moving, _, tau, gate], i) = (matter.of(rays, k), rays.at[k] as usize);
            self.tau[i] = tau as f32;
            self.share[i] = if tau > 0.0 { (gate * moving / tau) as f32 } else { 0.0 };
        }
        out.clear();
        out.resize(count, 0.0);
        self.nothing.clear();
        self.nothing.resize(count, 0.0);
        let samples = Samples { offsets: &rays.offsets, tau: &self.tau, last: LastInterval::Finite };
        let into = Composite {
            colour: out,
            opacity: sized(&mut self.opacity, count),
            trans_end: sized(&mut self.trans_end, count),
            w: sized(&mut self.w, n),
        };
        composite(simd, samples, Values { data: &self.share, stride: n, channels: 1 }, &self.nothing, into);
    }

    /// The way back of [`BothParts::forward`], from `bar` `[rays]`: [`BothParts::raw_bar`] and [`BothParts::gate_bar`] are written.
    pub(super) fn backward(&mut self, simd: Simd, rays: &Chosen, matter: MovingMatter<'_>, bar: &[f32]) {
        let ([n, m], count) = (rays.samples(), rays.len());
        self.raw_bar.clear();
        self.gate_bar.clear();
        let (tau_bar, share_bar) = (sized(&mut self.tau_bar, n), sized(&mut self.share_bar, n));
        composite_backward(
            simd,
            Samples { offsets: &rays.offsets, tau: &self.tau, last: LastInterval::Finite },
            Values { data: &self.share, stride: n, channels: 1 },
            &self.nothing,
            Weights { w: &self.w[..n], trans_end: &self.trans_end[..count] },
            CompositeBar { colour: bar, w: None, trans_end: None },
            CompositeGrads { tau: &mut *tau_bar, values: &mut *share_bar, background: None },
        );
        for k in 0..m {
            let ([moving, still, _, gate], i) = (matter.of(rays, k), rays.at[k] as usize);
            let [tau_bar, share_bar, p] = [tau_bar[i], share_bar[i], self.share[i]].map(f64::from);
            // P = sigmoid(ln(m / (1 - m)) + ln(tau_m / tau_s)): the gate and the raw log-density move it alike.
            let along = share_bar * p * (1.0 - p);
            self.raw_bar.push((along + tau_bar * gate * moving) as f32);
            self.gate_bar.push((along + tau_bar * gate * (1.0 - gate) * (moving - still)) as f32);
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats = [&self.tau, &self.share, &self.w, &self.tau_bar, &self.share_bar, &self.raw_bar, &self.gate_bar];
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;
    use testkit::gradient::{Tolerance, central_difference, compare};

    fn uniform(len: usize, stream: u64, low: f32, high: f32) -> Vec<f32> {
        let mut out = vec![0.0; len];
        Rng::new(13, stream).fill_uniform(0, &mut out);
        out.iter().map(|u| low + (high - low) * u).collect()
    }

    /// Three rays: three samples of which two move, none, and two which both move.
    fn rays() -> Chosen {
        Chosen {
            rays: vec![0, 1, 2],
            offsets: vec![0, 3, 3, 5],
            moving: vec![0, 2, 2, 4],
            at: vec![0, 2, 3, 4],
            dt: uniform(5, 1, 0.1, 0.5),
            tau: uniform(5, 2, 0.1, 0.9),
            still: uniform(5, 3, 0.1, 0.9),
            ..Chosen::default()
        }
    }

    /// The equations as they stand, of raw log-densities and gates.
    fn twin(rays: &Chosen, raw: &[f64], gate: &[f64]) -> Vec<f64> {
        let mut out = Vec::new();
        for ends in rays.offsets.windows(2) {
            let (mut trans, mut sum) = (1.0, 0.0);
            for i in ends[0]..ends[1] {
                let moves = rays.at.iter().position(|&at| at == i);
                let i = i as usize;
                let (tau, share) = match moves {
                    None => (f64::from(rays.tau[i]), 0.0),
                    Some(k) => {
                        let m = 1.0 / (1.0 + (-gate[k]).exp());
                        let of_moving = m * raw[k].exp() * f64::from(rays.dt[i]);
                        let tau = of_moving + (1.0 - m) * f64::from(rays.still[i]);
                        (tau, of_moving / tau)
                    }
                };
                sum += trans * (1.0 - (-tau).exp()) * share;
                trans *= (-tau).exp();
            }
            out.push(sum);
        }
        out
    }

    #[test]
    fn a_share_is_its_equations_and_so_is_its_gradient() {
        let rays = rays();
        let (raw, gate, bar) = (uniform(4, 4, -1.0, 2.0), uniform(4, 5, -2.0, 2.0), uniform(3, 6, -1.0, 1.0));
        let sigma: Vec<f32> = raw.iter().map(|raw| raw.exp()).collect();
        let blend: Vec<f32> = gate.iter().map(|gate| 1.0 / (1.0 + (-gate).exp())).collect();
        let matter = MovingMatter { sigma: &sigma, blend: &blend };
        let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
        for simd in Simd::available() {
            let (mut both, mut shares) = (BothParts::default(), vec![7.0; 9]);
            both.forward(simd, &rays, matter, &mut shares);
            compare("shares", &shares, &twin(&rays, &wide(&raw), &wide(&gate)), Tolerance::new(1e-5, 1e-6)).unwrap();
            assert_eq!(shares[1], 0.0, "a ray of no sample");
            both.backward(simd, &rays, matter, &bar);
            let dot = |shares: Vec<f64>| shares.iter().zip(&bar).map(|(y, b)| y * f64::from(*b)).sum::<f64>();
            let want = central_difference(&wide(&raw), |raw| dot(twin(&rays, raw, &wide(&gate))));
            compare("raw log-densities", &both.raw_bar, &want, Tolerance::SINGLE).unwrap();
            let want = central_difference(&wide(&gate), |gate| dot(twin(&rays, &wide(&raw), gate)));
            compare("gates", &both.gate_bar, &want, Tolerance::SINGLE).unwrap();
        }
    }

    #[test]
    fn closed_gates_show_nothing_that_moves_open_ones_nothing_else_and_extremes_stay_finite() {
        let mut rays = rays();
        rays.still.fill(0.3);
        let shares_of = |rays: &Chosen, sigma: [f32; 4], blend: [f32; 4]| {
            let (mut both, mut shares) = (BothParts::default(), Vec::new());
            let matter = MovingMatter { sigma: &sigma, blend: &blend };
            both.forward(Simd::best(), rays, matter, &mut shares);
            both.backward(Simd::best(), rays, matter, &[1.0, -1.0, 1.0]);
            let all = shares.iter().chain(&both.raw_bar).chain(&both.gate_bar);
            assert!(all.clone().all(|x| x.is_finite()), "{sigma:?}, {blend:?}: {all:?}");
            shares
        };
        assert_eq!(shares_of(&rays, [2.0; 4], [0.0; 4]), [0.0; 3]);
        let open = shares_of(&rays, [1e4; 4], [1.0; 4]);
        assert!(open[2] > 0.999 && open[2] <= 1.0 + 1e-6, "{open:?}");
        // Neither part has any matter.
        rays.still.fill(0.0);
        assert_eq!(shares_of(&rays, [0.0; 4], [0.5; 4]), [0.0; 3]);
        for still in [0.0, 1e-45, f32::MAX, f32::INFINITY] {
            rays.still.fill(still);
            for sigma in [0.0, 1e-45, 5e34, f32::MAX] {
                for blend in [0.0, 1e-30, 0.5, 1.0] {
                    shares_of(&rays, [sigma; 4], [blend; 4]);
                }
            }
        }
    }

    #[test]
    fn no_rays_have_no_share() {
        let none = Chosen { offsets: vec![0], moving: vec![0], ..Chosen::default() };
        let (mut both, mut shares) = (BothParts::default(), vec![1.0]);
        let matter = MovingMatter { sigma: &[], blend: &[] };
        both.forward(Simd::best(), &none, matter, &mut shares);
        both.backward(Simd::best(), &none, matter, &[]);
        assert!(shares.is_empty() && both.raw_bar.is_empty() && both.gate_bar.is_empty());
    }
}
