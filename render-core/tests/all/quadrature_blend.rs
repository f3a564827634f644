//! The blend of a static and a dynamic part against its `f64` reference, its gradients against differences, and its properties.

use crate::rays::{self, any_tau, close, pattern};
use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::blend::{
    BlendSamples, BlendTrans, BlendValues, CompositeBlend, CompositeBlendBar, CompositeBlendGrads, composite_blend,
    composite_blend_backward, reference,
};
use render_core::quadrature::{Composite, LastInterval, Samples, Values, composite};
use std::ops::Range;
use testkit::gradient::{Tolerance, central_difference, compare, cotangent};

/// A batch of rays with three channels.
#[derive(Clone, Debug)]
struct Batch {
    offsets: Vec<u32>,
    /// Static, dynamic.
    tau: [Vec<f32>; 2],
    m: Vec<f32>,
    rgb: [Vec<f32>; 2],
    stride: [usize; 2],
    background: Vec<f32>,
}

/// What came out of it.
#[derive(Clone, Debug, PartialEq)]
struct Picture {
    colour: Vec<f32>,
    dynamic: Vec<f32>,
    trans_end: Vec<f32>,
    w: [Vec<f32>; 2],
    trans: Vec<f32>,
}

impl Picture {
    fn all(&self) -> impl Iterator<Item = &f32> {
        let per_ray = self.colour.iter().chain(&self.dynamic).chain(&self.trans_end);
        per_ray.chain(&self.w[0]).chain(&self.w[1]).chain(&self.trans)
    }
}

/// Gradients that come out.
#[derive(Clone, Debug, PartialEq)]
struct Grads {
    tau: [Vec<f32>; 2],
    m: Vec<f32>,
    values: [Vec<f32>; 2],
    background: Vec<f32>,
}

impl Grads {
    fn all(&self) -> impl Iterator<Item = &f32> {
        let samples = self.tau.iter().flatten().chain(&self.m);
        samples.chain(self.values.iter().flatten()).chain(&self.background)
    }
}

/// Gradients that go in.
#[derive(Clone, Debug)]
struct Bars {
    colour: Vec<f32>,
    dynamic: Vec<f32>,
    trans_end: Vec<f32>,
    w: [Vec<f32>; 2],
    trans: Vec<f32>,
}

impl Bars {
    fn new(b: &Batch, seed: u64) -> Self {
        let f = |n: usize, salt: u64| cotangent(n, seed ^ salt).iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let (n, rays) = (b.m.len(), b.rays());
        Self {
            colour: f(3 * rays, 1),
            dynamic: f(rays, 2),
            trans_end: f(rays, 3),
            w: [f(n, 4), f(n, 5)],
            trans: f(n, 6),
        }
    }

    fn all(&self) -> CompositeBlendBar<'_> {
        CompositeBlendBar {
            colour: &self.colour,
            dynamic: Some(&self.dynamic),
            trans_end: Some(&self.trans_end),
            w_s: Some(&self.w[0]),
            w_d: Some(&self.w[1]),
            trans: Some(&self.trans),
        }
    }
}

fn colour_only(colour: &[f32]) -> CompositeBlendBar<'_> {
    CompositeBlendBar { colour, dynamic: None, trans_end: None, w_s: None, w_d: None, trans: None }
}

impl Batch {
    /// Rays of the given lengths; `sample(i)` is `tau_s, tau_d, m` of sample `i`, everything else is a fixed pattern.
    fn new(lengths: &[usize], mut sample: impl FnMut(usize) -> [f32; 3]) -> Self {
        let offsets = rays::offsets(lengths);
        let n = offsets[lengths.len()] as usize;
        let stride = [n + 3, n + 1];
        let samples: Vec<[f32; 3]> = (0..n).map(&mut sample).collect();
        Self {
            tau: [0, 1].map(|k| samples.iter().map(|s| s[k]).collect()),
            m: samples.iter().map(|s| s[2]).collect(),
            rgb: [pattern(3 * stride[0], 37, 11), pattern(3 * stride[1], 53, 7)],
            background: pattern(3 * lengths.len(), 29, 5),
            offsets,
            stride,
        }
    }

    fn rays(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    fn range(&self, r: usize) -> Range<usize> {
        rays::range(&self.offsets, r)
    }

    fn samples(&self) -> BlendSamples<'_> {
        BlendSamples { offsets: &self.offsets, tau_s: &self.tau[0], tau_d: &self.tau[1], m: &self.m }
    }

    fn part(&self, k: usize) -> Values<'_> {
        Values { data: &self.rgb[k], stride: self.stride[k], channels: 3 }
    }

    fn values(&self) -> BlendValues<'_> {
        BlendValues { values_s: self.part(0), values_d: self.part(1), background: &self.background }
    }

    fn render(&self, simd: Simd) -> Picture {
        let (rays, n) = (self.rays(), self.m.len());
        let nan = |n: usize| vec![f32::NAN; n];
        let mut p = Picture {
            colour: nan(3 * rays),
            dynamic: nan(rays),
            trans_end: nan(rays),
            w: [nan(n), nan(n)],
            trans: nan(n),
        };
        let [w_s, w_d] = &mut p.w;
        let out = CompositeBlend {
            colour: &mut p.colour,
            dynamic: &mut p.dynamic,
            trans_end: &mut p.trans_end,
            w_s,
            w_d,
            trans: &mut p.trans,
        };
        composite_blend(simd, self.samples(), self.values(), out);
        p
    }

    fn backward(&self, simd: Simd, p: &Picture, bar: CompositeBlendBar<'_>) -> Grads {
        let nan = || vec![f32::NAN; self.m.len()];
        let mut g = Grads {
            tau: [nan(), nan()],
            m: nan(),
            values: self.stride.map(|stride| vec![0.0; 3 * stride]),
            background: vec![0.0; 3 * self.rays()],
        };
        let ([tau_s, tau_d], [values_s, values_d]) = (&mut g.tau, &mut g.values);
        let grads =
            CompositeBlendGrads { tau_s, tau_d, m: &mut g.m, values_s, values_d, background: Some(&mut g.background) };
        let forward = BlendTrans { trans: &p.trans, trans_end: &p.trans_end };
        composite_blend_backward(simd, self.samples(), self.values(), forward, bar, grads);
        g
    }

    /// The image of one part alone: colours and transmittances.
    fn alone(&self, simd: Simd, k: usize) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
        let (n, rays) = (self.m.len(), self.rays());
        let samples = Samples { offsets: &self.offsets, tau: &self.tau[k], last: LastInterval::Finite };
        let (mut colour, mut opacity, mut w, mut end) =
            (vec![0.0; 3 * rays], vec![0.0; rays], vec![0.0; n], vec![0.0; rays]);
        let out = Composite { colour: &mut colour, opacity: &mut opacity, w: &mut w, trans_end: &mut end };
        composite(simd, samples, self.part(k), &self.background, out);
        (colour, w, end)
    }

    /// `tau_s`, `tau_d`, `m` of one ray, in f64.
    fn ray(&self, r: usize) -> [Vec<f64>; 3] {
        [&self.tau[0], &self.tau[1], &self.m].map(|x| wide(&x[self.range(r)]))
    }

    /// Colours of one ray, in f64.
    fn colours(&self, r: usize, k: usize) -> Vec<[f64; 3]> {
        self.range(r).map(|i| std::array::from_fn(|c| self.rgb[k][c * self.stride[k] + i].into())).collect()
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x.into()).collect()
}

/// Shares: anything, and often the ends.
fn any_share() -> impl Strategy<Value = f32> {
    prop_oneof![5 => 0.0_f32..=1.0, 1 => Just(0.0), 1 => Just(1.0), 1 => Just(0.5), 1 => 1e-30_f32..1e-6]
}

/// Rays of 0 to 70 samples, and a longer one now and then.
fn any_batch() -> impl Strategy<Value = Batch> {
    prop::collection::vec(prop_oneof![8 => 0_usize..71, 1 => 100_usize..700], 0..10)
        .prop_flat_map(|lengths| {
            let n = lengths.iter().sum::<usize>();
            let sample = (any_tau(), any_tau(), any_share()).prop_map(|(s, d, m)| [s, d, m]);
            (Just(lengths), prop::collection::vec(sample, n))
        })
        .prop_map(|(lengths, samples)| Batch::new(&lengths, |i| samples[i]))
}

/// Any number but NaN: bits from 0 to the largest.
fn any_finite() -> impl Strategy<Value = f32> {
    prop_oneof![3 => (0_u32..=f32::MAX.to_bits()).prop_map(f32::from_bits), 1 => any_tau()]
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn the_blend_matches_the_reference_at_every_level(b in any_batch()) {
        for simd in Simd::available() {
            let p = b.render(simd);
            for r in 0..b.rays() {
                let [s, d, m] = b.ray(r);
                let ray = reference::weights(&s, &d, &m);
                for (k, i) in b.range(r).enumerate() {
                    // A factor of the transmittance is off by an ulp or so of f32 where matter is thick.
                    let rel = 1e-6 + 2e-7 * k as f64;
                    close(p.w[0][i], ray.w_s[k], 1e-37, rel, format_args!("{simd:?} w_s[{i}]"));
                    close(p.w[1][i], ray.w_d[k], 1e-37, rel, format_args!("{simd:?} w_d[{i}]"));
                    close(p.trans[i], ray.trans[k], 1e-37, rel, format_args!("{simd:?} trans[{i}]"));
                }
                let rel = 1e-6 + 2e-7 * m.len() as f64;
                close(p.trans_end[r], ray.trans[m.len()], 1e-37, rel, "trans_end");
                close(p.dynamic[r], ray.dynamic, 1e-37, 4e-6, "dynamic");
                let background = std::array::from_fn(|c| b.background[3 * r + c].into());
                let colour = reference::colour(&ray, &b.colours(r, 0), &b.colours(r, 1), background);
                for (c, want) in colour.iter().enumerate() {
                    close(p.colour[3 * r + c], *want, 2e-6, 2e-6, "colour");
                }
            }
        }
    }

    #[test]
    fn the_transmittance_of_a_blend_never_rises_along_a_ray(b in any_batch()) {
        for simd in Simd::available() {
            let p = b.render(simd);
            for r in 0..b.rays() {
                let mut trans = p.trans[b.range(r)].to_vec();
                trans.push(p.trans_end[r]);
                // What an interval takes: the opacities of its parts, by their shares.
                let taken: Vec<f64> = b.range(r).map(|i| {
                    let (m, opacity) = (f64::from(b.m[i]), |k: usize| -(-f64::from(b.tau[k][i])).exp_m1());
                    -((1.0 - m * opacity(1)) * (1.0 - (1.0 - m) * opacity(0))).ln()
                }).collect();
                rays::check_transmittance(&trans, &taken, format_args!("{simd:?}, ray {r}"));
            }
        }
    }

    #[test]
    fn weights_sum_to_one_and_what_both_parts_cover(b in any_batch()) {
        let p = b.render(Simd::best());
        for r in 0..b.rays() {
            let (mut sum, mut want) = (0.0, 1.0);
            for i in b.range(r) {
                prop_assert!((0.0..=1.0).contains(&p.w[0][i]) && (0.0..=1.0).contains(&p.w[1][i]));
                prop_assert!((0.0..=1.0).contains(&p.trans[i]));
                sum += f64::from(p.w[0][i]) + f64::from(p.w[1][i]);
                let [a_s, a_d] = [0, 1].map(|k| -f64::from(-b.tau[k][i]).exp_m1());
                let m = f64::from(b.m[i]);
                want += f64::from(p.trans[i]) * m * (1.0 - m) * a_d * a_s;
            }
            let (end, room) = (f64::from(p.trans_end[r]), 4.0 * (b.range(r).len() + 1) as f64 * f64::from(f32::EPSILON));
            prop_assert!((sum + end - want).abs() <= room, "{sum} {end} {want}");
            prop_assert!(sum <= 4.0 / 3.0 * (1.0 - end) + room, "{sum} {end}");
        }
    }

    #[test]
    fn weights_sum_to_at_most_one_where_every_sample_is_of_one_part(mut b in any_batch()) {
        b.m.iter_mut().for_each(|m| *m = m.round());
        let p = b.render(Simd::best());
        for r in 0..b.rays() {
            let sum = b.range(r).map(|i| f64::from(p.w[0][i]) + f64::from(p.w[1][i])).sum::<f64>();
            let room = (b.range(r).len() + 1) as f64 * f64::from(f32::EPSILON);
            prop_assert!(sum <= 1.0 + room && (sum + f64::from(p.trans_end[r]) - 1.0).abs() <= 4.0 * room, "{sum}");
        }
    }

    #[test]
    fn a_share_of_one_is_the_dynamic_part_alone_and_of_none_the_static_one(mut b in any_batch(), seed in any::<u64>()) {
        for (m, part) in [(0.0, 0), (1.0, 1)] {
            b.m.fill(m);
            for simd in Simd::available() {
                let p = b.render(simd);
                let (colour, w, end) = b.alone(simd, part);
                for (got, want) in p.colour.iter().zip(&colour) {
                    close(*got, f64::from(*want), 4e-6, 4e-6, "colour");
                }
                for (got, want) in p.w[part].iter().zip(&w).chain(p.trans_end.iter().zip(&end)) {
                    // One sums optical depths, the other multiplies what passes.
                    close(*got, f64::from(*want), 2e-6, 1e-5, "weight");
                }
                prop_assert!(p.w[1 - part].iter().all(|&w| w == 0.0));
                if m == 0.0 {
                    prop_assert!(p.dynamic.iter().all(|&d| d == 0.0));
                }
                let g = b.backward(simd, &p, Bars::new(&b, seed).all());
                prop_assert!(g.tau[1 - part].iter().chain(&g.values[1 - part]).all(|&x| x == 0.0), "the other learns nothing");
            }
        }
    }

    #[test]
    fn the_two_parts_are_symmetric(b in any_batch()) {
        // Shares whose complement is a number of f32.
        let m: Vec<f32> = b.m.iter().map(|m| (m * 1024.0).round() / 1024.0).collect();
        let turned = Batch {
            tau: [b.tau[1].clone(), b.tau[0].clone()],
            m: m.iter().map(|m| 1.0 - m).collect(),
            rgb: [b.rgb[1].clone(), b.rgb[0].clone()],
            stride: [b.stride[1], b.stride[0]],
            ..b.clone()
        };
        let b = Batch { m, ..b };
        let (p, q) = (b.render(Simd::best()), turned.render(Simd::best()));
        prop_assert_eq!(&p.w[0], &q.w[1]);
        prop_assert_eq!(&p.w[1], &q.w[0]);
        prop_assert_eq!(&p.colour, &q.colour);
    }

    #[test]
    fn a_ray_does_not_depend_on_its_place_in_the_batch(b in any_batch(), seed in any::<u64>()) {
        let simd = Simd::best();
        let p = b.render(simd);
        let bars = Bars::new(&b, seed);
        let g = b.backward(simd, &p, bars.all());
        for r in 0..b.rays() {
            let alone = Batch {
                offsets: b.offsets[r..r + 2].to_vec(),
                background: b.background[3 * r..3 * r + 3].to_vec(),
                ..b.clone()
            };
            let own = Bars {
                colour: bars.colour[3 * r..3 * r + 3].to_vec(),
                dynamic: vec![bars.dynamic[r]],
                trans_end: vec![bars.trans_end[r]],
                ..bars.clone()
            };
            let q = alone.render(simd);
            let h = alone.backward(simd, &q, own.all());
            for k in 0..2 {
                prop_assert_eq!(&q.w[k][b.range(r)], &p.w[k][b.range(r)]);
                prop_assert_eq!(&h.tau[k][b.range(r)], &g.tau[k][b.range(r)]);
            }
            prop_assert_eq!(&q.colour[..], &p.colour[3 * r..3 * r + 3]);
            prop_assert_eq!(&h.m[b.range(r)], &g.m[b.range(r)]);
        }
    }

    #[test]
    fn gradients_match_those_of_the_reference(b in any_batch(), seed in any::<u64>()) {
        let bars = Bars::new(&b, seed);
        for simd in Simd::available() {
            let p = b.render(simd);
            let g = b.backward(simd, &p, bars.all());
            for r in 0..b.rays() {
                let (want, ray) = twin_gradient(&b, r, &bars);
                let colour_bar = &bars.colour[3 * r..][..3];
                for (k, i) in b.range(r).enumerate() {
                    // Relative to what the terms are before they cancel: T times the largest upstream gradient, of which
                    // up to as many as there are samples add up behind.
                    let abs = 4e-6 * ray.trans[k].max(1e-30) * 40.0;
                    close(g.tau[0][i], want.tau_s[k], abs, 1e-5, format_args!("{simd:?} tau_s_bar[{i}]"));
                    close(g.tau[1][i], want.tau_d[k], abs, 1e-5, format_args!("{simd:?} tau_d_bar[{i}]"));
                    close(g.m[i], want.m[k], abs, 1e-5, format_args!("{simd:?} m_bar[{i}]"));
                    for (c, &bar) in colour_bar.iter().enumerate() {
                        for (part, w) in [ray.w_s[k], ray.w_d[k]].into_iter().enumerate() {
                            let got = g.values[part][c * b.stride[part] + i];
                            close(got, w * f64::from(bar), 1e-30, 1e-4, "values");
                        }
                    }
                }
                for (c, &bar) in colour_bar.iter().enumerate() {
                    close(g.background[3 * r + c], ray.trans[b.range(r).len()] * f64::from(bar), 1e-30, 1e-4, "background");
                }
            }
        }
    }

    #[test]
    fn every_finite_input_stays_finite(samples in prop::collection::vec((any_finite(), any_finite(), any_share()), 0..40), seed in any::<u64>()) {
        let b = Batch::new(&[samples.len()], |i| [samples[i].0, samples[i].1, samples[i].2]);
        for simd in Simd::available() {
            let p = b.render(simd);
            prop_assert!(p.all().all(|x| x.is_finite()), "{p:?}");
            let g = b.backward(simd, &p, Bars::new(&b, seed).all());
            prop_assert!(g.all().all(|x| x.is_finite()), "{g:?}");
        }
    }
}

/// Gradients of one ray by the reference, and its weights.
fn twin_gradient(b: &Batch, r: usize, bars: &Bars) -> (reference::SamplesBar, reference::Ray) {
    let [s, d, m] = b.ray(r);
    let colour_bar = wide(&bars.colour[3 * r..][..3]);
    let through = |colour: &[f64; 3]| colour.iter().zip(&colour_bar).map(|(c, b)| c * b).sum::<f64>();
    let upstream = [0, 1].map(|k| -> Vec<f64> {
        let colours = b.colours(r, k);
        b.range(r).zip(&colours).map(|(i, colour)| f64::from(bars.w[k][i]) + through(colour)).collect()
    });
    let mut trans = wide(&bars.trans[b.range(r)]);
    let background = std::array::from_fn(|c| f64::from(b.background[3 * r + c]));
    trans.push(f64::from(bars.trans_end[r]) + through(&background));
    let [w_s, w_d] = &upstream;
    let bar = reference::RayBar { w_s, w_d, trans: &trans, dynamic: bars.dynamic[r].into() };
    (reference::weights_backward(&s, &d, &m, bar), reference::weights(&s, &d, &m))
}

#[test]
fn the_gradients_of_the_reference_match_central_differences() {
    let n = 12;
    // From thin to thick, and back; the steps of the differences stay positive.
    let mut x: Vec<f64> = (0..2 * n).map(|i| 10_f64.powf(-4.0 + (i * 5 % (2 * n)) as f64 * 0.2).min(3.0)).collect();
    x.extend((0..n).map(|i| [0.01, 0.3, 0.5, 0.77, 0.99][i % 5]));
    let bars = cotangent(3 * n + 2, 9);
    let bar = reference::RayBar {
        w_s: &bars[..n],
        w_d: &bars[n..2 * n],
        trans: &bars[2 * n..3 * n + 1],
        dynamic: bars[3 * n + 1],
    };
    let loss = |x: &[f64]| {
        let ray = reference::weights(&x[..n], &x[n..2 * n], &x[2 * n..]);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(&ray.w_s, bar.w_s) + dot(&ray.w_d, bar.w_d) + dot(&ray.trans, bar.trans) + ray.dynamic * bar.dynamic
    };
    let got = reference::weights_backward(&x[..n], &x[n..2 * n], &x[2 * n..], bar);
    let want = central_difference(&x, loss);
    compare("reference", &[got.tau_s, got.tau_d, got.m].concat(), &want, Tolerance::TWIN).unwrap();
}

#[test]
fn extreme_optical_depths_stay_finite_and_opaque_ones_hide_what_is_behind() {
    let values = [0.0, 1e-45, 1e-38, 1e-20, 1e-7, 1.0, 87.0, 1e10, 1e30, f32::MAX, f32::INFINITY];
    for simd in Simd::available() {
        for (&s, &d) in values.iter().flat_map(|s| values.iter().map(move |d| (s, d))) {
            for m in [0.0, 1e-45, 1e-20, 0.5, 1.0 - f32::EPSILON, 1.0] {
                let b = Batch::new(&[3, 1], |i| if i == 1 { [0.5, 0.25, 0.25] } else { [s, d, m] });
                let p = b.render(simd);
                let g = b.backward(simd, &p, Bars::new(&b, 5).all());
                assert!(p.all().chain(g.all()).all(|x| x.is_finite()), "{s} {d} {m}: {p:?} {g:?}");
                if (s > 1e9 && m == 0.0) || (d > 1e9 && m == 1.0) {
                    assert_eq!((p.w[0][1], p.w[1][1], p.trans_end[0]), (0.0, 0.0, 0.0), "{s} {d} {m}");
                }
            }
        }
    }
}

#[test]
fn two_opaque_parts_that_share_evenly_sum_to_four_thirds() {
    let b = Batch::new(&[40], |_| [f32::INFINITY, f32::INFINITY, 0.5]);
    let p = b.render(Simd::best());
    assert_eq!(p.trans[..4], [1.0, 0.25, 0.0625, 0.015625]);
    let sum = p.w.iter().flatten().map(|&w| f64::from(w)).sum::<f64>();
    assert!((sum - 4.0 / 3.0).abs() < 1e-6, "{sum}");
}

#[test]
fn thin_matter_keeps_its_digits_over_a_million_samples() {
    let n = 1 << 20;
    let b = Batch::new(&[n], |_| [1e-6, 1e-6, 0.5]);
    let p = b.render(Simd::best());
    let want = (-(n as f64) * f64::from(1e-6_f32)).exp();
    close(p.trans_end[0], want, 0.0, 1e-6, "trans_end");
}

#[test]
fn gradients_are_written_and_only_the_background_is_added() {
    let b = Batch::new(&[20, 0, 133], |i| [(i % 5) as f32 * 0.2, (i % 3) as f32 * 0.1, (i % 7) as f32 / 6.0]);
    let p = b.render(Simd::best());
    let bars = Bars::new(&b, 11);
    let g = b.backward(Simd::best(), &p, bars.all());
    assert!(g.tau.iter().flatten().chain(&g.m).all(|x| x.is_finite()), "started from NaN");
    let h = b.backward(Simd::best(), &p, colour_only(&bars.colour));
    assert!(h.all().all(|x| x.is_finite()) && h.background == g.background);
    assert_eq!(g.background[3..6], bars.colour[3..6], "an empty ray shows the background");
}

#[test]
fn empty_rays_and_empty_batches_show_the_background() {
    let b = Batch::new(&[0, 0], |_| [1.0; 3]);
    let p = b.render(Simd::best());
    assert_eq!((&p.colour, &p.trans_end[..], &p.dynamic[..]), (&b.background, &[1.0; 2][..], &[0.0; 2][..]));
    b.backward(Simd::best(), &p, Bars::new(&b, 1).all());
    // No offsets at all are legal, too: no rays.
    for offsets in [vec![0], vec![]] {
        let b = Batch { offsets, ..Batch::new(&[], |_| [0.0; 3]) };
        let p = b.render(Simd::best());
        assert!(p.colour.is_empty());
        b.backward(Simd::best(), &p, Bars::new(&b, 1).all());
    }
}

#[test]
#[should_panic(expected = "m and tau_s differ in length")]
fn lengths_are_checked() {
    let mut b = Batch::new(&[4], |_| [0.5; 3]);
    b.m.pop();
    b.render(Simd::best());
}
