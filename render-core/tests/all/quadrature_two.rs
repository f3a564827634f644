//! Joint compositing of two parts against its `f64` reference, its gradients against differences, and its properties.

use crate::rays::{self, any_tau, close, pattern};
use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward, reference,
};
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use std::ops::Range;
use testkit::gradient::{Tolerance, central_difference, compare, cotangent};

/// A batch of rays with three channels.
#[derive(Clone, Debug)]
struct Batch {
    offsets: Vec<u32>,
    tau: [Vec<f32>; 2],
    rgb: [Vec<f32>; 2],
    stride: [usize; 2],
    beta: Vec<f32>,
    background: Vec<f32>,
}

/// What came out of it.
#[derive(Clone, Debug, PartialEq)]
struct Picture {
    colour: Vec<f32>,
    beta: Vec<f32>,
    transient: Vec<f32>,
    trans_end: Vec<f32>,
    w: [Vec<f32>; 2],
}

/// Gradients that come out.
#[derive(Clone, Debug, PartialEq)]
struct Grads {
    tau: [Vec<f32>; 2],
    values: [Vec<f32>; 2],
    beta: Vec<f32>,
    background: Vec<f32>,
}

/// Gradients that go in.
#[derive(Clone, Debug)]
struct Bars {
    colour: Vec<f32>,
    beta: Vec<f32>,
    transient: Vec<f32>,
    trans_end: Vec<f32>,
    w: [Vec<f32>; 2],
}

impl Bars {
    fn new(b: &Batch, seed: u64) -> Self {
        let f = |n: usize, salt: u64| cotangent(n, seed ^ salt).iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let (n, rays) = (b.beta.len(), b.rays());
        Self {
            colour: f(3 * rays, 1),
            beta: f(rays, 2),
            transient: f(rays, 3),
            trans_end: f(rays, 4),
            w: [f(n, 5), f(n, 6)],
        }
    }

    fn all(&self) -> CompositeTwoBar<'_> {
        CompositeTwoBar {
            colour: &self.colour,
            beta: Some(&self.beta),
            transient: Some(&self.transient),
            trans_end: Some(&self.trans_end),
            w_s: Some(&self.w[0]),
            w_t: Some(&self.w[1]),
        }
    }
}

fn colour_only(colour: &[f32]) -> CompositeTwoBar<'_> {
    CompositeTwoBar { colour, beta: None, transient: None, trans_end: None, w_s: None, w_t: None }
}

impl Batch {
    /// Rays of the given lengths; `tau(i)` are the optical depths of sample `i`, everything else is a fixed pattern.
    fn new(lengths: &[usize], mut tau: impl FnMut(usize) -> [f32; 2]) -> Self {
        let offsets = rays::offsets(lengths);
        let n = offsets[lengths.len()] as usize;
        let stride = [n + 3, n + 1];
        let depths: Vec<[f32; 2]> = (0..n).map(&mut tau).collect();
        Self {
            tau: [0, 1].map(|k| depths.iter().map(|tau| tau[k]).collect()),
            rgb: [pattern(3 * stride[0], 37, 11), pattern(3 * stride[1], 53, 7)],
            beta: pattern(n, 17, 3),
            background: pattern(3 * lengths.len(), 29, 5),
            offsets,
            stride,
        }
    }

    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    fn range(&self, r: usize) -> Range<usize> {
        rays::range(&self.offsets, r)
    }

    fn samples(&self) -> TwoSamples<'_> {
        TwoSamples { offsets: &self.offsets, tau_s: &self.tau[0], tau_t: &self.tau[1] }
    }

    fn part(&self, k: usize) -> Values<'_> {
        Values { data: &self.rgb[k], stride: self.stride[k], channels: 3 }
    }

    fn values(&self) -> TwoValues<'_> {
        TwoValues { values_s: self.part(0), values_t: self.part(1), beta: &self.beta, background: &self.background }
    }

    fn render(&self, simd: Simd, mixture: Mixture) -> Picture {
        let (rays, n) = (self.rays(), self.beta.len());
        let nan = |n: usize| vec![f32::NAN; n];
        let mut p = Picture {
            colour: nan(3 * rays),
            beta: nan(rays),
            transient: nan(rays),
            trans_end: nan(rays),
            w: [nan(n), nan(n)],
        };
        let [w_s, w_t] = &mut p.w;
        let out = CompositeTwo {
            colour: &mut p.colour,
            beta: &mut p.beta,
            transient: &mut p.transient,
            trans_end: &mut p.trans_end,
            w_s,
            w_t,
        };
        composite_two(simd, self.samples(), mixture, self.values(), out);
        p
    }

    fn backward(&self, simd: Simd, mixture: Mixture, p: &Picture, bar: CompositeTwoBar<'_>) -> Grads {
        let n = self.beta.len();
        let mut g = Grads {
            tau: [vec![f32::NAN; n], vec![f32::NAN; n]],
            values: self.stride.map(|stride| vec![0.0; 3 * stride]),
            beta: vec![f32::NAN; n],
            background: vec![0.0; 3 * self.rays()],
        };
        let ([tau_s, tau_t], [values_s, values_t]) = (&mut g.tau, &mut g.values);
        let grads = CompositeTwoGrads {
            tau_s,
            tau_t,
            values_s,
            values_t,
            beta: &mut g.beta,
            background: Some(&mut g.background),
        };
        let forward = WeightsTwo { w_s: &p.w[0], w_t: &p.w[1], trans_end: &p.trans_end };
        composite_two_backward(simd, self.samples(), mixture, self.values(), forward, bar, grads);
        g
    }

    /// Optical depths of one ray, in f64.
    fn depths(&self, r: usize) -> [Vec<f64>; 2] {
        [0, 1].map(|k| self.tau[k][self.range(r)].iter().map(|&x| x.into()).collect())
    }

    /// Colours of one ray, in f64.
    fn colours(&self, r: usize, k: usize) -> Vec<[f64; 3]> {
        self.range(r).map(|i| std::array::from_fn(|c| self.rgb[k][c * self.stride[k] + i].into())).collect()
    }

    fn reference(&self, mixture: Mixture, r: usize) -> (reference::Ray, reference::Pixel<3>) {
        let [s, t] = self.depths(r);
        let ray = reference::weights(mixture, &s, &t);
        let beta: Vec<f64> = self.beta[self.range(r)].iter().map(|&x| x.into()).collect();
        let background = std::array::from_fn(|c| self.background[3 * r + c].into());
        let pixel = reference::pixel(&ray, &self.colours(r, 0), &self.colours(r, 1), &beta, background);
        (ray, pixel)
    }
}

/// Rays of 0 to 70 samples, and a longer one now and then.
fn any_batch() -> impl Strategy<Value = Batch> {
    prop::collection::vec(prop_oneof![8 => 0_usize..71, 1 => 100_usize..700], 0..10)
        .prop_flat_map(|lengths| {
            let n = lengths.iter().sum::<usize>();
            (Just(lengths), prop::collection::vec([any_tau(), any_tau()], n))
        })
        .prop_map(|(lengths, tau)| Batch::new(&lengths, |i| tau[i]))
}

fn any_mixture() -> impl Strategy<Value = Mixture> {
    prop_oneof![Just(Mixture::Paper), Just(Mixture::Proportional)]
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn composite_two_matches_the_reference_at_every_level(b in any_batch(), mixture in any_mixture()) {
        for simd in Simd::available() {
            let p = b.render(simd, mixture);
            for r in 0..b.rays() {
                let (ray, pixel) = b.reference(mixture, r);
                for (k, i) in b.range(r).enumerate() {
                    // f32 rounding of the depth: an ulp of `depth <= 87` where anything is left to see.
                    close(p.w[0][i], ray.w_s[k], 1e-30, 4e-6, format_args!("{simd:?} w_s[{i}]"));
                    close(p.w[1][i], ray.w_t[k], 1e-30, 4e-6, format_args!("{simd:?} w_t[{i}]"));
                }
                close(p.trans_end[r], ray.trans[ray.w_s.len()], 1e-30, 6e-6, "trans_end");
                close(p.beta[r], pixel.beta, 1e-30, 4e-6, "beta");
                close(p.transient[r], pixel.transient, 1e-30, 4e-6, "transient");
                for (c, want) in pixel.colour.iter().enumerate() {
                    close(p.colour[3 * r + c], *want, 2e-6, 2e-6, "colour");
                }
            }
        }
    }

    #[test]
    fn the_joint_transmittance_never_rises_along_a_ray(
        tau in prop::collection::vec((any_tau(), any_tau()), 0..60),
        mixture in any_mixture(),
    ) {
        let (offsets, places) = rays::beginnings(tau.len());
        let lengths: Vec<usize> = (0..=tau.len()).collect();
        let b = Batch::new(&lengths, |i| [tau[places[i]].0, tau[places[i]].1]);
        prop_assert_eq!(&b.offsets, &offsets);
        let taken: Vec<f64> = tau.iter().map(|&(s, t)| f64::from(s) + f64::from(t)).collect();
        for simd in Simd::available() {
            let trans = b.render(simd, mixture).trans_end;
            rays::check_transmittance(&trans, &taken, format_args!("{simd:?} {mixture:?}"));
        }
    }

    #[test]
    fn weights_sum_to_one_or_to_the_overlap_more(b in any_batch(), mixture in any_mixture()) {
        let p = b.render(Simd::best(), mixture);
        for r in 0..b.rays() {
            let (mut sum, mut want, mut depth) = (f64::from(p.trans_end[r]), 1.0, 0.0_f64);
            for i in b.range(r) {
                prop_assert!((0.0..=1.0).contains(&p.w[0][i]) && (0.0..=1.0).contains(&p.w[1][i]));
                sum += f64::from(p.w[0][i]) + f64::from(p.w[1][i]);
                let [s, t] = [0, 1].map(|k| f64::from(b.tau[k][i]));
                if mixture == Mixture::Paper {
                    want += (-depth).exp() * (-s).exp_m1() * (-t).exp_m1();
                }
                depth += s + t;
            }
            prop_assert!((sum - want).abs() <= 4.0 * (b.range(r).len() + 1) as f64 * f64::from(f32::EPSILON), "{sum} {want}");
        }
    }

    #[test]
    fn without_a_transient_part_it_is_composite_bit_for_bit(mut b in any_batch(), mixture in any_mixture(), seed in any::<u64>()) {
        b.tau[1].fill(0.0);
        for simd in Simd::available() {
            let p = b.render(simd, mixture);
            let samples = Samples { offsets: &b.offsets, tau: &b.tau[0], last: LastInterval::Finite };
            let (n, rays) = (b.beta.len(), b.rays());
            let (mut colour, mut opacity, mut w, mut trans_end) = (vec![0.0; 3 * rays], vec![0.0; rays], vec![0.0; n], vec![0.0; rays]);
            let out = Composite { colour: &mut colour, opacity: &mut opacity, w: &mut w, trans_end: &mut trans_end };
            composite(simd, samples, b.part(0), &b.background, out);
            prop_assert_eq!(&p.colour, &colour);
            prop_assert_eq!(&p.w[0], &w);
            prop_assert_eq!(&p.trans_end, &trans_end);
            prop_assert!(p.beta.iter().chain(&p.transient).chain(&p.w[1]).all(|&x| x == 0.0));

            let bars = Bars::new(&b, seed);
            let g = b.backward(simd, mixture, &p, colour_only(&bars.colour));
            let (mut tau, mut values) = (vec![0.0; n], vec![0.0; 3 * b.stride[0]]);
            let bar = CompositeBar { colour: &bars.colour, w: None, trans_end: None };
            let grads = CompositeGrads { tau: &mut tau, values: &mut values, background: None };
            composite_backward(simd, samples, b.part(0), &b.background, Weights { w: &w, trans_end: &trans_end }, bar, grads);
            prop_assert_eq!(&g.values[0], &values);
            for (i, (got, want)) in g.tau[0].iter().zip(&tau).enumerate() {
                close(*got, f64::from(*want), 4e-6, 4e-6, format_args!("{simd:?} tau_bar[{i}]"));
            }
        }
    }

    #[test]
    fn the_two_parts_are_symmetric(b in any_batch(), mixture in any_mixture()) {
        let turned = Batch {
            tau: [b.tau[1].clone(), b.tau[0].clone()],
            rgb: [b.rgb[1].clone(), b.rgb[0].clone()],
            stride: [b.stride[1], b.stride[0]],
            ..b.clone()
        };
        let (p, q) = (b.render(Simd::best(), mixture), turned.render(Simd::best(), mixture));
        prop_assert_eq!(&p.w[0], &q.w[1]);
        prop_assert_eq!(&p.w[1], &q.w[0]);
        prop_assert_eq!(&p.colour, &q.colour);
    }

    #[test]
    fn a_ray_does_not_depend_on_its_place_in_the_batch(b in any_batch(), mixture in any_mixture(), seed in any::<u64>()) {
        let simd = Simd::best();
        let p = b.render(simd, mixture);
        let bars = Bars::new(&b, seed);
        let g = b.backward(simd, mixture, &p, bars.all());
        for r in 0..b.rays() {
            let alone = Batch {
                offsets: b.offsets[r..r + 2].to_vec(),
                background: b.background[3 * r..3 * r + 3].to_vec(),
                ..b.clone()
            };
            let own = Bars {
                colour: bars.colour[3 * r..3 * r + 3].to_vec(),
                beta: vec![bars.beta[r]],
                transient: vec![bars.transient[r]],
                trans_end: vec![bars.trans_end[r]],
                w: bars.w.clone(),
            };
            let q = alone.render(simd, mixture);
            let h = alone.backward(simd, mixture, &q, own.all());
            for k in 0..2 {
                prop_assert_eq!(&q.w[k][b.range(r)], &p.w[k][b.range(r)]);
                prop_assert_eq!(&h.tau[k][b.range(r)], &g.tau[k][b.range(r)]);
            }
            prop_assert_eq!(&q.colour[..], &p.colour[3 * r..3 * r + 3]);
            prop_assert_eq!(&h.beta[b.range(r)], &g.beta[b.range(r)]);
        }
    }

    #[test]
    fn gradients_match_the_jacobian_of_the_reference(b in any_batch(), mixture in any_mixture(), seed in any::<u64>()) {
        let bars = Bars::new(&b, seed);
        for simd in Simd::available() {
            let p = b.render(simd, mixture);
            let g = b.backward(simd, mixture, &p, bars.all());
            for r in 0..b.rays() {
                let (want, ray) = twin_gradient(&b, mixture, r, &bars);
                let n = ray.w_s.len();
                let colour_bar = &bars.colour[3 * r..][..3];
                for (k, i) in b.range(r).enumerate() {
                    for part in 0..2 {
                        // Relative to what the terms are before they cancel: T times the largest upstream gradient.
                        close(g.tau[part][i], want[part][k], 4e-6 * ray.trans[k].max(1e-30) * 12.0, 1e-5, format_args!("{simd:?} {part} tau_bar[{i}]"));
                        let w = [&ray.w_s, &ray.w_t][part][k];
                        for (c, &bar) in colour_bar.iter().enumerate() {
                            close(g.values[part][c * b.stride[part] + i], w * f64::from(bar), 1e-30, 1e-5, "values");
                        }
                    }
                    close(g.beta[i], ray.w_t[k] * f64::from(bars.beta[r]), 1e-30, 1e-5, "beta");
                }
                for (c, &bar) in colour_bar.iter().enumerate() {
                    close(g.background[3 * r + c], ray.trans[n] * f64::from(bar), 1e-30, 1e-5, "background");
                }
            }
        }
    }

    #[test]
    fn splitting_an_interval_changes_nothing_where_opacity_is_divided(b in any_batch(), at in 0.0_f64..1.0, share in 0.0_f32..1.0) {
        prop_assume!(!b.beta.is_empty());
        let split = ((at * b.beta.len() as f64) as usize).min(b.beta.len() - 1);
        let mut c = b.clone();
        for k in 0..2 {
            c.tau[k][split] = b.tau[k][split] * share;
            c.tau[k].insert(split + 1, b.tau[k][split] - c.tau[k][split]);
            c.rgb[k] = (0..3).flat_map(|ch| {
                let mut v = b.rgb[k][ch * b.stride[k]..(ch + 1) * b.stride[k]].to_vec();
                v.insert(split + 1, v[split]);
                v
            }).collect();
            c.stride[k] += 1;
        }
        c.beta.insert(split + 1, b.beta[split]);
        for o in &mut c.offsets {
            *o += u32::from(*o as usize > split);
        }
        let (p, q) = (b.render(Simd::best(), Mixture::Proportional), c.render(Simd::best(), Mixture::Proportional));
        for (x, y) in q.colour.iter().zip(&p.colour).chain(q.beta.iter().zip(&p.beta)).chain(q.transient.iter().zip(&p.transient)) {
            close(*x, f64::from(*y), 5e-6, 0.0, "pixel");
        }
    }
}

/// Gradients of one ray by the reference, and its weights.
fn twin_gradient(b: &Batch, mixture: Mixture, r: usize, bars: &Bars) -> ([Vec<f64>; 2], reference::Ray) {
    let [s, t] = b.depths(r);
    let ray = reference::weights(mixture, &s, &t);
    let colour_bar: Vec<f64> = bars.colour[3 * r..][..3].iter().map(|&x| x.into()).collect();
    let through = |colour: &[f64; 3]| colour.iter().zip(&colour_bar).map(|(c, b)| c * b).sum::<f64>();
    let upstream = [0, 1].map(|k| -> Vec<f64> {
        let colours = b.colours(r, k);
        let entry = |(j, i): (usize, usize)| {
            let own = f64::from(bars.w[k][i]) + through(&colours[j]);
            if k == 0 {
                return own;
            }
            own + f64::from(bars.transient[r]) + f64::from(bars.beta[r]) * f64::from(b.beta[i])
        };
        b.range(r).enumerate().map(entry).collect()
    });
    let mut trans_bar = vec![0.0; s.len() + 1];
    let background = std::array::from_fn(|c| f64::from(b.background[3 * r + c]));
    trans_bar[s.len()] = f64::from(bars.trans_end[r]) + through(&background);
    (reference::tau_bar(mixture, &s, &t, [&upstream[0], &upstream[1]], &trans_bar), ray)
}

#[test]
fn the_reference_jacobian_matches_central_differences() {
    for mixture in Mixture::ALL {
        let n = 12;
        // From thin to thick, and back; the steps of the differences stay positive.
        let tau: Vec<f64> = (0..2 * n).map(|i| 10_f64.powf(-4.0 + (i * 5 % (2 * n)) as f64 * 0.2).min(3.0)).collect();
        let bars = cotangent(3 * n + 1, 9);
        let (w_s_bar, rest) = bars.split_at(n);
        let (w_t_bar, trans_bar) = rest.split_at(n);
        let loss = |tau: &[f64]| {
            let ray = reference::weights(mixture, &tau[..n], &tau[n..]);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            dot(&ray.w_s, w_s_bar) + dot(&ray.w_t, w_t_bar) + dot(&ray.trans, trans_bar)
        };
        let got = reference::tau_bar(mixture, &tau[..n], &tau[n..], [w_s_bar, w_t_bar], trans_bar).concat();
        let want = central_difference(&tau, loss);
        compare("reference", &got, &want, Tolerance::TWIN).unwrap();
    }
}

#[test]
fn the_published_form_tends_to_the_divided_one_with_finer_intervals() {
    let render = |pieces: usize, mixture| {
        let mut b = Batch::new(&[4 * pieces], |i| {
            let tau = [0.3, 0.9, 0.0, 1.2][i / pieces] / pieces as f32;
            [tau, 0.5 * tau]
        });
        for k in 0..2 {
            let stride = b.stride[k];
            for c in 0..3 {
                for i in 0..4 * pieces {
                    b.rgb[k][c * stride + i] = ((i / pieces + c + k) % 3) as f32 * 0.4;
                }
            }
        }
        b.background = vec![0.1, 0.2, 0.3];
        b.render(Simd::best(), mixture).colour
    };
    let exact = render(1, Mixture::Proportional);
    let error = |pieces: usize| {
        let got = render(pieces, Mixture::Paper);
        got.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    // First order in the length of the intervals.
    let (coarse, fine) = (error(4), error(64));
    assert!(coarse > 1e-2 && fine < coarse / 14.0 && fine > coarse / 18.0, "{coarse} {fine}");
}

#[test]
fn extreme_optical_depths_stay_finite() {
    let values = [0.0, 1e-45, 1e-38, 1e-20, 1e-7, 1.0, 87.0, 1e10, 1e37, f32::MAX, f32::INFINITY];
    for simd in Simd::available() {
        for mixture in Mixture::ALL {
            for &s in &values {
                for &t in &values {
                    let b = Batch::new(&[3, 1], |i| if i == 1 { [0.5, 0.25] } else { [s, t] });
                    let p = b.render(simd, mixture);
                    let g = b.backward(simd, mixture, &p, Bars::new(&b, 5).all());
                    let all =
                        [&p.colour, &p.beta, &p.transient, &p.trans_end, &p.w[0], &p.w[1], &g.beta, &g.background];
                    let grads = g.tau.iter().chain(&g.values);
                    assert!(
                        all.into_iter().chain(grads).flatten().all(|x| x.is_finite()),
                        "{mixture:?} {s} {t}: {p:?} {g:?}"
                    );
                    if s > 1e30 || t > 1e30 {
                        // Nothing behind an opaque interval is seen, exactly.
                        assert_eq!((p.w[0][1], p.w[1][1], p.trans_end[0]), (0.0, 0.0, 0.0), "{mixture:?} {s} {t}");
                    }
                }
            }
        }
    }
}

#[test]
fn two_opaque_parts_are_counted_twice_as_published_and_divided_otherwise() {
    let b = Batch::new(&[1], |_| [f32::INFINITY; 2]);
    let p = b.render(Simd::best(), Mixture::Paper);
    assert_eq!((p.w[0][0], p.w[1][0]), (1.0, 1.0));
    let p = b.render(Simd::best(), Mixture::Proportional);
    assert_eq!((p.w[0][0], p.w[1][0]), (0.5, 0.5));
    // Where only one is opaque it takes all: infinity counts as 1e37 there.
    let p = Batch::new(&[1], |_| [3.0, f32::INFINITY]).render(Simd::best(), Mixture::Proportional);
    assert_eq!((p.w[1][0], p.transient[0]), (1.0, 1.0));
    assert!(p.w[0][0] < 1e-36);
}

#[test]
fn gradients_are_written_and_only_the_background_is_added() {
    let b = Batch::new(&[20, 0, 33], |i| [(i % 5) as f32 * 0.2, (i % 3) as f32 * 0.1]);
    for mixture in Mixture::ALL {
        let p = b.render(Simd::best(), mixture);
        let bars = Bars::new(&b, 11);
        let g = b.backward(Simd::best(), mixture, &p, bars.all());
        assert!(g.tau.iter().flatten().chain(&g.beta).all(|x| x.is_finite()), "started from NaN");
        // Without a loss on the uncertainty its gradient is written as 0.
        let h = b.backward(Simd::best(), mixture, &p, colour_only(&bars.colour));
        assert!(h.beta.iter().all(|&x| x == 0.0));
        assert_eq!(g.background[3..6], bars.colour[3..6], "an empty ray shows the background");
    }
}

#[test]
fn empty_rays_and_empty_batches_show_the_background() {
    for mixture in Mixture::ALL {
        let b = Batch::new(&[0, 0], |_| [1.0; 2]);
        let p = b.render(Simd::best(), mixture);
        assert_eq!((&p.colour, &p.trans_end[..], &p.beta[..]), (&b.background, &[1.0; 2][..], &[0.0; 2][..]));
        let b = Batch::new(&[], |_| [1.0; 2]);
        let p = b.render(Simd::best(), mixture);
        assert!(p.colour.is_empty());
        b.backward(Simd::best(), mixture, &p, Bars::new(&b, 1).all());
    }
    // No offsets at all are legal, too: no rays.
    let b = Batch { offsets: vec![], ..Batch::new(&[], |_| [0.0; 2]) };
    let mut none: [Vec<f32>; 6] = Default::default();
    let [colour, beta, transient, trans_end, w_s, w_t] = &mut none;
    let out = CompositeTwo { colour, beta, transient, trans_end, w_s, w_t };
    composite_two(Simd::best(), b.samples(), Mixture::Paper, b.values(), out);
}

#[test]
#[should_panic(expected = "tau_t and tau_s differ in length")]
fn lengths_are_checked() {
    let mut b = Batch::new(&[4], |_| [0.5; 2]);
    b.tau[1].pop();
    b.render(Simd::best(), Mixture::Paper);
}
