//! The prior of SF-NeRF that keeps opacities smooth over the picture, and its gradient: a loss on the derivative of the opacity
//! `a(h)` with respect to the encoded place `gamma(p)`,
//!
//! ```text
//! lambda_sm sum_k 2^k |d alpha / d gamma_k(p)|_1
//! ```
//!
//! Its gradient is of second order. Let `d = a'(h) dh/dgamma`, and `s` the derivative of the prior with respect to `d`: signs,
//! times constants. Then the prior is `s d = a'(h) h'`, with `h'` the derivative of `h` along `s`, and its gradient is
//!
//! ```text
//! a'(h) grad h' + a''(h) h' grad h
//! ```
//!
//! The branch of the place and the joined layers are recorded on a tape: one backward pass gives `dh/dgamma`, one tangent along `s`
//! gives `h'`, and a backward pass through that its gradient. The second term is that of an ordinary backward pass from
//! `h_bar = a''(h) h'`, and left to it.
//!
//! Before, this was written by hand, layer by layer and pixel by pixel. On the tape 256 pixels take 1.2 ms instead of 16 (hash
//! grid) and 4.9 instead of 17 (published sizes), one thread; both agree to 1e-5 of the largest entry.

use super::filter::{Filter, FilterInput, fill_places};
use super::layer::opacity;
use field_core::tape::{Arena, Node, Tape, TapeError, layers};
use float_core::Simd;
use losses::concrete::BinaryConcrete;
use losses::smoothness::{smoothness, smoothness_backward};
use rayon::prelude::*;

/// Rows of an octave: sine and cosine of both coordinates.
const OCTAVE_ROWS: usize = 4;

/// Pixels of one task: fixed, so that sums do not depend on the number of threads.
const TASK: usize = 64;

/// A pixel of the prior: its index in the batch, and the noise of its opacity.
#[derive(Clone, Copy)]
pub(super) struct Pick {
    pub(super) index: usize,
    pub(super) noise: f32,
}

/// The prior, and its gradient but for an ordinary backward pass from `h_bar`.
#[derive(Default)]
pub(super) struct Smoothness {
    /// Mean over the pixels picked, times the weight.
    pub(super) value: f64,
    /// `a''(h) h'` of each pixel.
    pub(super) h_bar: Vec<f32>,
    /// `a'(h) grad h'` of the flat parameters: the branch of the place, then the joined layers.
    grad: Vec<f32>,
    params: Vec<f32>,
    tasks: Vec<Task>,
}

/// Buffers of a task.
#[derive(Default)]
struct Task {
    arena: Arena,
    x: Vec<f32>,
    beside: Vec<f32>,
    /// `a'(h)` and `a''(h)`, `[pixels]`.
    first: Vec<f32>,
    second: Vec<f32>,
    d: Vec<f32>,
    s: Vec<f32>,
    /// Gradients of the parameters by `h`, which are not wanted.
    of_h: Vec<f32>,
    grad: Vec<f32>,
    h_bar: Vec<f32>,
    value: f64,
}

impl Smoothness {
    /// Nothing is measured: no prior, no gradient.
    pub(super) fn clear(&mut self) {
        self.value = 0.0;
        self.h_bar.clear();
        self.grad.clear();
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let task = |t: &Task| t.arena.memory_bytes() + 4 * (t.x.capacity() + t.of_h.capacity() + t.grad.capacity());
        4 * (self.params.capacity() + self.grad.capacity()) + self.tasks.iter().map(task).sum::<usize>()
    }

    /// The prior on the pixels `picks` of [`Filter::forward`]: `weight` times the mean of
    /// `sum_k 2^k |d alpha / d gamma_k(p)|_1`.
    pub(super) fn measure<'a>(
        &mut self,
        filter: &Filter,
        simd: Simd,
        concrete: BinaryConcrete,
        weight: f64,
        picks: &[Pick],
        input_of: impl Fn(usize) -> FilterInput<'a> + Sync,
    ) {
        let each = weight / picks.len().max(1) as f64;
        self.params.clear();
        self.params.extend_from_slice(&filter.place.params);
        self.params.extend_from_slice(&filter.joined.params);
        let count = picks.len().div_ceil(TASK);
        if self.tasks.len() < count {
            self.tasks.resize_with(count, Task::default);
        }
        let params = &self.params;
        self.tasks[..count].par_iter_mut().zip(picks.par_chunks(TASK)).for_each(|(task, picks)| {
            let fits = "the layers of the filter";
            task.run(filter, params, simd, concrete, each, picks, &input_of).expect(fits);
        });
        self.clear();
        self.grad.resize(self.params.len(), 0.0);
        for task in &self.tasks[..count] {
            self.value += task.value;
            self.h_bar.extend_from_slice(&task.h_bar);
            self.grad.iter_mut().zip(&task.grad).for_each(|(sum, term)| *sum += term);
        }
    }

    /// Add the gradient of the parameters to those that [`Filter::backward`] left.
    pub(super) fn add_to(&self, filter: &mut Filter) {
        let mut terms = self.grad.iter();
        for net in [&mut filter.place, &mut filter.joined] {
            net.grad_mut().iter_mut().zip(&mut terms).for_each(|(grad, term)| *grad += term);
        }
    }
}

impl Task {
    #[expect(clippy::too_many_arguments, reason = "what a task reads")]
    fn run<'a>(
        &mut self,
        filter: &Filter,
        params: &[f32],
        simd: Simd,
        concrete: BinaryConcrete,
        each: f64,
        picks: &[Pick],
        input_of: &(impl Fn(usize) -> FilterInput<'a> + Sync),
    ) -> Result<(), TapeError> {
        let Self { arena, x, beside, first, second, d, s, of_h, grad, h_bar, value } = self;
        let (n, rows, octaves) = (picks.len(), filter.encoding.out_rows(), filter.shape.octaves);
        x.resize(filter.place.mlp.inputs() * n, 0.0);
        fill_places(simd, &filter.encoding, 0..n, &|j: usize| input_of(picks[j].index), x);
        let mut tape = Tape::new(arena, params);
        let (octave_rows, codes) = x.split_at(rows * n);
        let gamma = tape.input(rows, n, octave_rows)?;
        let h = record(&mut tape, filter, gamma, codes, picks, beside)?;

        first.clear();
        second.clear();
        for (pick, &h) in picks.iter().zip(tape.value(h)?.data) {
            let [_, one, two] = opacity(concrete, h, pick.noise);
            first.push(one);
            second.push(two);
        }
        of_h.clear();
        of_h.resize(params.len(), 0.0);
        tape.backward(&[(h, &first[..])], of_h)?;
        d.clear();
        d.extend_from_slice(tape.gradient(gamma)?);

        let fits = "whole octaves";
        *value = each * n as f64 * smoothness(d, octaves, OCTAVE_ROWS).expect(fits);
        s.clear();
        s.resize(d.len(), 0.0);
        smoothness_backward(d, octaves, OCTAVE_ROWS, each * n as f64, s).expect(fits);

        let along = tape.constant(rows, n, s)?;
        let [h_dot] = tape.jvp([h], &[(gamma, along)])?;
        h_bar.clear();
        h_bar.extend(second.iter().zip(tape.value(h_dot)?.data).map(|(second, h_dot)| second * h_dot));
        grad.clear();
        grad.resize(params.len(), 0.0);
        tape.backward(&[(h_dot, &first[..])], grad)
    }
}

/// Record the raw opacities of some pixels.
fn record(
    tape: &mut Tape<'_>,
    filter: &Filter,
    gamma: Node,
    codes: &[f32],
    picks: &[Pick],
    beside: &mut Vec<f32>,
) -> Result<Node, TapeError> {
    let (n, inputs, width) = (picks.len(), filter.joined.mlp.inputs(), filter.shape.width);
    let codes = tape.constant(filter.shape.code, n, codes)?;
    let x = tape.concat(&[gamma, codes])?;
    let place = tape.param(0, filter.place.params.len(), 1)?;
    let mut hidden = layers(tape, &filter.place.mlp, x, place)?;
    if inputs > width {
        beside.clear();
        beside.resize((inputs - width) * n, 0.0);
        for (j, pick) in picks.iter().enumerate() {
            let of_pixel = &filter.hidden[pick.index * inputs..][width..inputs];
            of_pixel.iter().enumerate().for_each(|(k, &value)| beside[k * n + j] = value);
        }
        let beside = tape.constant(inputs - width, n, beside)?;
        hidden = tape.concat(&[hidden, beside])?;
    }
    let joined = tape.param(filter.place.params.len(), filter.joined.params.len(), 1)?;
    let raw = layers(tape, &filter.joined.mlp, hidden, joined)?;
    tape.slice(raw, 0..1)
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
            let mut prior = Smoothness::default();
            prior.measure(filter, simd, *concrete, weight, picks, input_of);
            let mut raw_bar = [[0.0; OUTPUTS]; N];
            picks.iter().zip(&prior.h_bar).for_each(|(pick, bar)| raw_bar[pick.index][0] = *bar);
            let mut code_bar = Vec::new();
            filter.backward(simd, &raw_bar, &mut code_bar);
            prior.add_to(filter);
            let features = filter.features.as_mut().map_or(Vec::new(), |net| net.grad_mut().to_vec());
            (prior.value, [filter.place.grad_mut().to_vec(), features, filter.joined.grad_mut().to_vec()], code_bar)
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
