//! The prior of SF-NeRF that keeps opacities smooth over the picture, and its gradient: a loss on the derivative of the opacity
//! `a(h)` with respect to the encoded place `gamma(p)`,
//!
//! ```text
//! lambda_sm sum_k 2^k |d alpha / d gamma_k(p)|_1
//! ```
//!
//! Its gradient needs the network twice. Let `s` be the derivative of the prior with respect to `d = a'(h) dh/dgamma`: signs,
//! times constants. Then the prior is `s d = a'(h) h'`, with `h'` the derivative of `h` along `s`: one more forward pass.
//! Between the kinks of a ReLU network everything is linear, so with `t_l` that pass's input of layer `l`, and
//! `g_l = dh/dz_l`
//!
//! ```text
//! gradient of W_l = a'(h) g_l t_l^T + a''(h) h' dh/dW_l
//! ```
//!
//! and biases, codes and features have the second term alone, which is that of an ordinary backward pass from
//! `h_bar = a''(h) h'`.

use super::filter::{Filter, FilterInput, fill_places};
use super::second_order::{Chain, Pass, Terms};
use float_core::Simd;
use losses::concrete::BinaryConcrete;
use rayon::prelude::*;

/// Pixels of one task: fixed, so that sums do not depend on the number of threads.
const TASK: usize = 32;

/// A pixel of the prior: its index in the batch, and the noise of its opacity.
#[derive(Clone, Copy)]
pub(super) struct Pick {
    pub(super) index: usize,
    pub(super) noise: f32,
}

/// The prior on the pixels `picks` of [`Filter::forward`]: `weight` times the mean of `sum_k 2^k |d alpha / d gamma_k(p)|_1`.
pub(super) fn smoothness<'a>(
    filter: &Filter,
    simd: Simd,
    concrete: BinaryConcrete,
    weight: f64,
    picks: &[Pick],
    input_of: impl Fn(usize) -> FilterInput<'a> + Sync,
) -> Terms {
    let chain = Chain::of(filter);
    let (inputs, each) = (filter.joined.mlp.inputs(), weight / picks.len().max(1) as f64);
    let parts: Vec<Terms> = picks
        .par_chunks(TASK)
        .map(|picks| {
            let mut out = Terms {
                place: vec![0.0; filter.place.params.len()],
                joined: vec![0.0; filter.joined.params.len()],
                ..Terms::default()
            };
            let mut pass = Pass::default();
            for pick in picks {
                let input = input_of(pick.index);
                let x = &mut pass.x[0];
                x.resize(filter.place.mlp.inputs(), 0.0);
                let one = |_| input;
                fill_places(simd, &filter.encoding, 0..1, &one, x);
                let beside = &filter.hidden[pick.index * inputs..][..inputs][filter.shape.width..];
                chain.add(&mut pass, beside, concrete, pick.noise, each, &mut out);
            }
            out
        })
        .collect();
    let mut out = Terms::default();
    for part in parts {
        out.value += part.value;
        out.h_bar.extend(part.h_bar);
        for (sum, part) in [(&mut out.place, part.place), (&mut out.joined, part.joined)] {
            sum.resize(part.len(), 0.0);
            sum.iter_mut().zip(part).for_each(|(sum, term)| *sum += term);
        }
    }
    out
}

impl Terms {
    /// Add the terms of the parameters to the gradients that [`Filter::backward`] left.
    pub(super) fn add_to(&self, filter: &mut Filter) {
        for (net, terms) in [(&mut filter.place, &self.place), (&mut filter.joined, &self.joined)] {
            net.grad_mut().iter_mut().zip(terms).for_each(|(grad, term)| *grad += term);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::filter::{OUTPUTS, Shape};
    use super::super::twin::{self, Twin, assert_near, differences};
    use super::*;
    use field_core::rng::Rng;
    use proptest::prelude::*;
    use scene_io::Features;

    const N: usize = 9;
    const CODE: usize = 3;

    /// A filter with biases that are not 0, and what it sees of some pixels.
    struct Case {
        filter: Filter,
        places: Vec<[f32; 2]>,
        codes: Vec<f32>,
        features: Option<Features>,
        picks: Vec<Pick>,
        concrete: BinaryConcrete,
    }

    impl Case {
        fn new(channels: usize, seed: u64) -> Self {
            let rng = Rng::new(seed, 1);
            let uniform = |i: u64| 2.0 * rng.uniform_at(i) - 1.0;
            let shape = Shape { octaves: 3, width: 7, code: CODE, channels };
            let mut filter = Filter::new(shape, rng).unwrap();
            for net in
                [Some(&mut filter.place), filter.features.as_mut(), Some(&mut filter.joined)].into_iter().flatten()
            {
                let biases: Vec<_> = net.mlp.layers().iter().flat_map(|l| l.biases.clone()).collect();
                biases.into_iter().for_each(|at| net.params[at] = 0.3 * uniform(at as u64));
                net.pack();
            }
            let features = (channels > 0).then(|| Features {
                channels,
                width: 2,
                height: 3,
                data: (0..6 * channels).map(|i| uniform(1000 + i as u64)).collect(),
            });
            let places = (0..N as u64).map(|i| [2 * i, 2 * i + 1].map(|k| 0.5 + 0.5 * uniform(2000 + k))).collect();
            let codes = (0..N * CODE).map(|i| uniform(3000 + i as u64)).collect();
            let picks = [0, 2, 3, 7].map(|index| Pick { index, noise: 2.0 * uniform(4000 + index as u64) }).to_vec();
            Self { filter, places, codes, features, picks, concrete: BinaryConcrete { temperature: 0.7 } }
        }

        /// The prior, the gradient of the flat parameters and that of the codes.
        fn run(&mut self, weight: f64) -> (f64, [Vec<f32>; 3], Vec<f32>) {
            let Self { filter, places, codes, features, picks, concrete } = self;
            let input_of = |i: usize| FilterInput {
                place: places[i],
                code: &codes[CODE * i..][..CODE],
                features: features.as_ref(),
            };
            let simd = Simd::best();
            filter.forward(simd, N, input_of, |_, _| {});
            let terms = smoothness(filter, simd, *concrete, weight, picks, input_of);
            let mut raw_bar = [[0.0; OUTPUTS]; N];
            picks.iter().zip(&terms.h_bar).for_each(|(pick, bar)| raw_bar[pick.index][0] = *bar);
            let mut code_bar = Vec::new();
            filter.backward(simd, &raw_bar, &mut code_bar);
            terms.add_to(filter);
            let features = filter.features.as_mut().map_or(Vec::new(), |net| net.grad_mut().to_vec());
            (terms.value, [filter.place.grad_mut().to_vec(), features, filter.joined.grad_mut().to_vec()], code_bar)
        }

        fn twin(&self, twin: &Twin, weight: f64, codes: &[f64]) -> f64 {
            let one = |pick: &Pick| {
                let place = self.places[pick.index];
                let mut features = vec![0.0; self.features.as_ref().map_or(0, |f| f.channels)];
                if let Some(f) = &self.features {
                    f.sample(place[0].into(), place[1].into(), &mut features);
                }
                let features: Vec<f64> = features.into_iter().map(f64::from).collect();
                let (kappa, noise) = (f64::from(self.concrete.temperature), f64::from(pick.noise));
                twin.roughness(place.map(f64::from), &codes[CODE * pick.index..][..CODE], &features, kappa, noise)
            };
            weight * self.picks.iter().map(one).sum::<f64>() / self.picks.len() as f64
        }
    }

    #[test]
    fn double_backward_matches_central_differences() {
        for channels in [0, 4] {
            for seed in 0..4 {
                let mut case = Case::new(channels, seed);
                let weight = 0.3;
                let (value, grads, code_bar) = case.run(weight);
                let twin = Twin::of(&case.filter);
                let codes: Vec<f64> = case.codes.iter().map(|&c| f64::from(c)).collect();
                let want = case.twin(&twin, weight, &codes);
                assert!((value - want).abs() < 1e-5 * want, "{value} against {want}");
                for (net, got) in grads.iter().enumerate().filter(|(_, g)| !g.is_empty()) {
                    let want = differences(got.len(), |i, h| {
                        let mut moved = twin.clone();
                        moved.nets[net][i] += h;
                        case.twin(&moved, weight, &codes)
                    });
                    assert_near(&format!("network {net}, {channels} channels"), got, &want);
                }
                let want = differences(codes.len(), |i, h| {
                    let mut moved = codes.clone();
                    moved[i] += h;
                    case.twin(&twin, weight, &moved)
                });
                assert_near("codes", &code_bar, &want);
            }
        }
    }

    #[test]
    fn an_opacity_that_ignores_the_place_costs_nothing() {
        let mut case = Case::new(4, 5);
        let layer = case.filter.place.mlp.layers()[0].clone();
        // Octaves are the first 12 inputs of a row.
        for row in case.filter.place.params[layer.weights].chunks_exact_mut(layer.inputs) {
            row[..12].fill(0.0);
        }
        case.filter.place.pack();
        let (value, grads, code_bar) = case.run(1.0);
        assert_eq!(value, 0.0);
        assert!(grads.iter().flatten().chain(&code_bar).all(|&g| g == 0.0));
    }

    #[test]
    fn no_pixels_cost_nothing() {
        let mut case = Case::new(0, 6);
        case.picks.clear();
        let (value, grads, code_bar) = case.run(1.0);
        assert_eq!(value, 0.0);
        assert!(grads.iter().flatten().chain(&code_bar).all(|&g| g == 0.0));
    }

    proptest! {
        #![proptest_config(testkit::property::cases(16))]

        #[test]
        fn the_prior_bounds_the_derivative_over_the_picture(seed in 0_u64..1 << 32, channels in 0_usize..3) {
            let case = Case::new(channels, seed);
            let twin = Twin::of(&case.filter);
            let (kappa, step) = (f64::from(case.concrete.temperature), 1e-7);
            for pick in &case.picks {
                let code: Vec<f64> = case.codes[CODE * pick.index..][..CODE].iter().map(|&c| f64::from(c)).collect();
                // The features are held: the bound is for the branch of the place.
                let features = vec![0.4; channels];
                let place = case.places[pick.index].map(f64::from);
                let alpha = |place| twin::alpha(twin.raw(place, &code, &features, 0)[0][0], kappa, pick.noise.into());
                let derivative = |axis: usize| {
                    let moved = |by: f64| alpha([0, 1].map(|a| place[a] + if a == axis { by } else { 0.0 }));
                    ((moved(step) - moved(-step)) / (2.0 * step)).abs()
                };
                let cost = twin.roughness(place, &code, &features, kappa, pick.noise.into());
                prop_assert!(cost >= 0.0);
                prop_assert!(derivative(0) + derivative(1) <= std::f64::consts::PI * cost * (1.0 + 1e-6) + 1e-6);
            }
        }
    }
}
