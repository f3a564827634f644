//! The joint quadrature of a static and a transient part as a tape operation.

use field_core::tape::{BackwardArgs, Bar, CustomOp, Demand, Shape, TapeError, View};
use float_core::Simd;
use render_core::quadrature::Values;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward,
};

/// Numbers of a ray: colour, uncertainty, weight and mean density of its transient samples.
pub(super) const PIXEL: usize = 6;

/// Inputs `[sigma_s [1 x n], rgb_s [3 x n], sigma_t [1 x n], rgb_t [3 x n], beta [1 x n]]`. Output, one block after the other:
/// colours `[rays][3]`, then `[rays]` each of `sum(w_t beta)`, `sum(w_t)` and the mean of `sigma_t` over the ray's samples.
/// `sum(w_t)` has no gradient.
pub(super) struct CompositeTwoOp<'a> {
    pub(super) simd: Simd,
    /// How an interval's opacity is divided.
    pub(super) mixture: Mixture,
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// `[n]`
    pub(super) dt: &'a [f32],
    /// `[rays][3]`
    pub(super) background: &'a [f32],
}

/// What the backward pass needs: optical depths and weights of both parts `[n]`, transmittances `[rays]`.
fn split(saved: &mut [f32], n: usize) -> ([&mut [f32]; 4], &mut [f32]) {
    let (tau_s, rest) = saved.split_at_mut(n);
    let (tau_t, rest) = rest.split_at_mut(n);
    let (w_s, rest) = rest.split_at_mut(n);
    let (w_t, trans_end) = rest.split_at_mut(n);
    ([tau_s, tau_t, w_s, w_t], trans_end)
}

impl CompositeTwoOp<'_> {
    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    fn spans(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.offsets.windows(2).map(|pair| pair[0] as usize..pair[1] as usize)
    }

    fn values<'v>(&'v self, inputs: &[View<'v>]) -> TwoValues<'v> {
        let colours = |view: View<'v>| Values { data: view.data, stride: self.dt.len(), channels: 3 };
        TwoValues {
            values_s: colours(inputs[1]),
            values_t: colours(inputs[3]),
            beta: inputs[4].data,
            background: self.background,
        }
    }
}

impl CustomOp for CompositeTwoOp<'_> {
    fn name(&self) -> &'static str {
        "composite two"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        let n = self.dt.len();
        if inputs != [1, 3, 1, 3, 1].map(|rows| Shape::new(rows, n)) {
            let reason = "takes a density and three colours a sample and part, and an uncertainty";
            return Err(TapeError::Custom { op: self.name(), reason });
        }
        Ok(Shape::new(PIXEL, self.rays()))
    }

    fn saved_len(&self, _inputs: &[Shape]) -> usize {
        4 * self.dt.len() + self.rays()
    }

    fn scratch_len(&self, _inputs: &[Shape]) -> usize {
        9 * self.dt.len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        let (n, rays) = (self.dt.len(), self.rays());
        let ([tau_s, tau_t, w_s, w_t], trans_end) = split(saved, n);
        for (tau, sigma) in [(&mut *tau_s, inputs[0].data), (&mut *tau_t, inputs[2].data)] {
            for ((tau, sigma), dt) in tau.iter_mut().zip(sigma).zip(self.dt) {
                *tau = sigma * dt;
            }
        }
        let (colour, rest) = out.split_at_mut(3 * rays);
        let (beta, rest) = rest.split_at_mut(rays);
        let (transient, mean) = rest.split_at_mut(rays);
        for (mean, span) in mean.iter_mut().zip(self.spans()) {
            let count = span.len().max(1) as f32;
            *mean = inputs[2].data[span].iter().sum::<f32>() / count;
        }
        let samples = TwoSamples { offsets: self.offsets, tau_s, tau_t };
        let result = CompositeTwo { colour, beta, transient, trans_end, w_s, w_t };
        composite_two(self.simd, samples, self.mixture, self.values(inputs), result);
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, saved, out_bar, .. } = args;
        let (n, rays) = (self.dt.len(), self.rays());
        let part = |i: usize| &saved[i * n..(i + 1) * n];
        let samples = TwoSamples { offsets: self.offsets, tau_s: part(0), tau_t: part(1) };
        let weights = WeightsTwo { w_s: part(2), w_t: part(3), trans_end: &saved[4 * n..4 * n + rays] };
        let bar = CompositeTwoBar {
            colour: &out_bar[..3 * rays],
            beta: Some(&out_bar[3 * rays..4 * rays]),
            transient: None,
            trans_end: None,
            w_s: None,
            w_t: None,
        };
        let (tau_s, rest) = scratch.split_at_mut(n);
        let (tau_t, rest) = rest.split_at_mut(n);
        let (values_s, rest) = rest.split_at_mut(3 * n);
        let (values_t, beta) = rest.split_at_mut(3 * n);
        let beta = &mut beta[..n];
        let grads = CompositeTwoGrads {
            tau_s: &mut *tau_s,
            tau_t: &mut *tau_t,
            values_s: &mut *values_s,
            values_t: &mut *values_t,
            beta: &mut *beta,
            background: None,
        };
        composite_two_backward(self.simd, samples, self.mixture, self.values(inputs), weights, bar, grads);
        for tau in [&mut *tau_s, &mut *tau_t] {
            // d tau / d sigma
            tau.iter_mut().zip(self.dt).for_each(|(bar, dt)| *bar *= dt);
        }
        for (bar, span) in out_bar[5 * rays..].iter().zip(self.spans()) {
            let each = bar / span.len().max(1) as f32;
            tau_t[span].iter_mut().for_each(|bar| *bar += each);
        }
        for (bar, grad) in bars.iter_mut().zip([tau_s, values_s, tau_t, values_t, beta]) {
            if bar.demand == Demand::Wanted {
                bar.data.iter_mut().zip(grad).for_each(|(bar, grad)| *bar += *grad);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::composite::CompositeOp;
    use super::*;
    use field_core::tape::{Arena, Tape};

    const N: usize = 5;
    const OFFSETS: [u32; 4] = [0, 3, 3, 5];
    const DT: [f32; N] = [0.2, 0.3, 0.1, 0.4, 0.5];
    const BACKGROUND: [f32; 9] = [0.2, 0.9, 0.4, 0.5, 0.6, 0.7, 1.0, 0.1, 0.3];

    /// Densities, colours and uncertainties of all samples.
    fn inputs() -> [Vec<f32>; 5] {
        let row = |rows: usize, phase: f32| (0..rows * N).map(|i| 1.1 + (phase + 2.3 * i as f32).sin()).collect();
        [row(1, 0.1), row(3, 1.0), row(1, 2.0), row(3, 3.0), row(1, 4.0)]
    }

    /// The output, its sum with one weight a number, and the gradient of that sum.
    fn run(mixture: Mixture, inputs: &[Vec<f32>; 5]) -> (Vec<f32>, f64, Vec<Vec<f32>>) {
        let op = CompositeTwoOp { simd: Simd::best(), mixture, offsets: &OFFSETS, dt: &DT, background: &BACKGROUND };
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &[]);
        let nodes: Vec<_> = inputs.iter().map(|x| tape.input(x.len() / N, N, x).unwrap()).collect();
        let out = tape.custom(&op, &nodes).unwrap();
        let values = tape.value(out).unwrap().data.to_vec();
        let mut bar: Vec<f32> = (0..values.len()).map(|i| (0.7 * i as f32).cos()).collect();
        // The weight of the transient samples has no gradient.
        bar[12..15].fill(0.0);
        let sum = values.iter().zip(&bar).map(|(v, b)| f64::from(*v) * f64::from(*b)).sum();
        tape.backward(&[(out, &bar)], &mut []).unwrap();
        (values, sum, nodes.iter().map(|&node| tape.gradient(node).unwrap().to_vec()).collect())
    }

    #[test]
    fn gradients_match_differences_of_the_output() {
        for mixture in Mixture::ALL {
            let (_, _, bars) = run(mixture, &inputs());
            for (which, bars) in bars.iter().enumerate() {
                for (i, &bar) in bars.iter().enumerate() {
                    const H: f32 = 1.0 / 256.0;
                    let [up, down] = [H, -H].map(|h| {
                        let mut inputs = inputs();
                        inputs[which][i] += h;
                        run(mixture, &inputs).1
                    });
                    let difference = (up - down) / (2.0 * f64::from(H));
                    assert!(
                        (difference - f64::from(bar)).abs() < 2e-4,
                        "{mixture:?}, input {which}, {i}: {bar}, {difference}"
                    );
                }
            }
        }
    }

    #[test]
    fn without_transient_density_it_is_the_plain_quadrature() {
        let mut inputs = inputs();
        inputs[2].fill(0.0);
        let op = CompositeOp { simd: Simd::best(), offsets: &OFFSETS, dt: &DT, background: &BACKGROUND };
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &[]);
        let nodes = [0, 1].map(|i| tape.constant(inputs[i].len() / N, N, &inputs[i]).unwrap());
        let plain = tape.custom(&op, &nodes).unwrap();
        for mixture in Mixture::ALL {
            let (values, ..) = run(mixture, &inputs);
            assert_eq!(&values[..9], tape.value(plain).unwrap().data);
            assert_eq!(values[9..], [0.0; 9]);
        }
    }

    #[test]
    fn densities_are_averaged_over_the_samples_of_a_ray() {
        let inputs = inputs();
        let (values, ..) = run(Mixture::Paper, &inputs);
        let sigma = &inputs[2];
        let want = [(sigma[0] + sigma[1] + sigma[2]) / 3.0, 0.0, (sigma[3] + sigma[4]) / 2.0];
        assert_eq!(values[15..], want);
        assert_eq!(&values[3..6], &BACKGROUND[3..6], "a ray without samples");
    }
}
