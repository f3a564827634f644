//! The quadrature against its `f64` reference, its gradient against differences, and the properties it must have.

use crate::rays::{self, any_tau, close, pattern};
use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, DepthBar, LastInterval, Samples, Values, Weights, WeightsBar, composite,
    composite_backward, depth_expected, depth_expected_backward, reference, weights, weights_backward,
};

const LASTS: [LastInterval; 2] = [LastInterval::Finite, LastInterval::Opaque];

/// A batch of rays with three channels.
#[derive(Clone, Debug)]
struct Batch {
    offsets: Vec<u32>,
    tau: Vec<f32>,
    rgb: Vec<f32>,
    stride: usize,
    background: Vec<f32>,
    last: LastInterval,
}

/// What came out of it.
#[derive(Clone, Debug, PartialEq)]
struct Picture {
    colour: Vec<f32>,
    opacity: Vec<f32>,
    w: Vec<f32>,
    trans_end: Vec<f32>,
}

impl Batch {
    /// Rays of the given lengths; `f(i)` is the optical depth of sample `i`, the colours are a fixed pattern.
    fn new(lengths: &[usize], mut tau: impl FnMut(usize) -> f32) -> Self {
        let offsets = rays::offsets(lengths);
        let n = offsets[lengths.len()] as usize;
        let stride = n + 3;
        Self {
            tau: (0..n).map(&mut tau).collect(),
            rgb: pattern(3 * stride, 37, 11),
            background: (0..3 * lengths.len()).map(|i| ((i * 29 + 5) % 97) as f32 / 96.0).collect(),
            offsets,
            stride,
            last: LastInterval::Finite,
        }
    }

    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    fn samples(&self) -> Samples<'_> {
        Samples { offsets: &self.offsets, tau: &self.tau, last: self.last }
    }

    fn values(&self) -> Values<'_> {
        Values { data: &self.rgb, stride: self.stride, channels: 3 }
    }

    fn range(&self, r: usize) -> std::ops::Range<usize> {
        self.offsets[r] as usize..self.offsets[r + 1] as usize
    }

    fn render(&self, simd: Simd) -> Picture {
        let (rays, n) = (self.rays(), self.tau.len());
        let mut p = Picture {
            colour: vec![f32::NAN; 3 * rays],
            opacity: vec![f32::NAN; rays],
            w: vec![f32::NAN; n],
            trans_end: vec![f32::NAN; rays],
        };
        let out =
            Composite { colour: &mut p.colour, opacity: &mut p.opacity, w: &mut p.w, trans_end: &mut p.trans_end };
        composite(simd, self.samples(), self.values(), &self.background, out);
        p
    }

    /// One ray, in f64.
    fn reference(&self, r: usize) -> (reference::Ray, [f64; 3]) {
        let tau: Vec<f64> = self.tau[self.range(r)].iter().map(|&x| x.into()).collect();
        let ray = reference::weights(&tau, self.last);
        let rgb: Vec<[f64; 3]> =
            self.range(r).map(|i| std::array::from_fn(|c| self.rgb[c * self.stride + i].into())).collect();
        let colour = reference::colour(&ray, &rgb, std::array::from_fn(|c| self.background[3 * r + c].into()));
        (ray, colour)
    }
}

/// Gradients that come in and go out.
struct Grads {
    tau: Vec<f32>,
    values: Vec<f32>,
    background: Vec<f32>,
}

fn backward(simd: Simd, b: &Batch, p: &Picture, bar: CompositeBar<'_>) -> Grads {
    let mut g = Grads {
        tau: vec![f32::NAN; b.tau.len()],
        values: vec![0.0; 3 * b.stride],
        background: vec![0.0; 3 * b.rays()],
    };
    let grads = CompositeGrads { tau: &mut g.tau, values: &mut g.values, background: Some(&mut g.background) };
    let forward = Weights { w: &p.w, trans_end: &p.trans_end };
    composite_backward(simd, b.samples(), b.values(), &b.background, forward, bar, grads);
    g
}

fn any_last() -> impl Strategy<Value = LastInterval> {
    prop_oneof![Just(LastInterval::Finite), Just(LastInterval::Opaque)]
}

/// Rays of 0 to 70 samples, and a longer one now and then.
fn any_batch() -> impl Strategy<Value = Batch> {
    let lengths = prop::collection::vec(prop_oneof![8 => 0_usize..71, 1 => 100_usize..700], 0..12);
    (lengths, any_last())
        .prop_flat_map(|(lengths, last)| {
            let n = lengths.iter().sum::<usize>();
            (Just(lengths), Just(last), prop::collection::vec(any_tau(), n))
        })
        .prop_map(|(lengths, last, tau)| Batch { last, ..Batch::new(&lengths, |i| tau[i]) })
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn composite_matches_the_reference_at_every_level(b in any_batch()) {
        for simd in Simd::available() {
            let p = b.render(simd);
            for r in 0..b.rays() {
                let (ray, colour) = b.reference(r);
                for (k, i) in b.range(r).enumerate() {
                    // f32 rounding of the depth: an ulp of `depth <= 87` where anything is left to see.
                    close(p.w[i], ray.w[k], 1e-30, 4e-6, format_args!("{simd:?} w[{i}]"));
                }
                close(p.trans_end[r], ray.trans[ray.w.len()], 1e-30, 6e-6, "trans_end");
                close(p.opacity[r], ray.opacity, 1e-30, 1e-6, "opacity");
                for (c, want) in colour.iter().enumerate() {
                    close(p.colour[3 * r + c], *want, 2e-6, 2e-6, "colour");
                }
            }
        }
    }

    #[test]
    fn transmittance_falls_and_weights_sum_to_one(b in any_batch()) {
        for simd in Simd::available() {
            let p = b.render(simd);
            for r in 0..b.rays() {
                let w = &p.w[b.range(r)];
                let n = w.len() as f64;
                prop_assert!(w.iter().all(|w| (0.0..=1.0).contains(w)));
                prop_assert!((0.0..=1.0).contains(&p.trans_end[r]) && (0.0..=1.0).contains(&p.opacity[r]));
                let sum: f64 = w.iter().map(|&w| f64::from(w)).sum::<f64>() + f64::from(p.trans_end[r]);
                prop_assert!((sum - 1.0).abs() <= 4.0 * (n + 1.0) * f64::from(f32::EPSILON), "sum {sum} of {n}");
                // What is left of the light after the first k samples, by a ray that ends there: it never rises, it falls where
                // there is anything to see, and a sample's weight is what it takes.
                let left = |k: usize| {
                    let start = b.offsets[r];
                    let first = Batch {
                        offsets: vec![start, start + k as u32],
                        background: b.background[3 * r..3 * r + 3].to_vec(),
                        last: LastInterval::Finite,
                        ..b.clone()
                    };
                    first.render(simd).trans_end[0]
                };
                let mut before = left(0);
                prop_assert_eq!(before, 1.0);
                for (k, (&w, &tau)) in w.iter().zip(&b.tau[b.range(r)]).enumerate() {
                    let is_end = k + 1 == b.range(r).len();
                    let after = if is_end { p.trans_end[r] } else { left(k + 1) };
                    // Rounding of the depth, as above: rays of other lengths may add it up in another order.
                    prop_assert!(after <= before * (1.0 + 1e-5), "{simd:?}: {before} rises to {after} behind sample {k}");
                    prop_assert!(after < before || tau < 1e-3 || before < 1e-30, "{simd:?}: {before} stays behind {tau}");
                    let taken = f64::from(before) - f64::from(after);
                    prop_assert!((taken - f64::from(w)).abs() <= 3e-5, "{simd:?}: {taken} taken, weight {w} of sample {k}");
                    before = after;
                }
            }
        }
    }

    #[test]
    fn a_ray_does_not_depend_on_its_place_in_the_batch(b in any_batch()) {
        let simd = Simd::best();
        let p = b.render(simd);
        let colour_bar: Vec<f32> = (0..3 * b.rays()).map(|i| (i % 7) as f32 - 3.0).collect();
        let g = backward(simd, &b, &p, CompositeBar { colour: &colour_bar, w: None, trans_end: None });
        for r in 0..b.rays() {
            // The same ray as the only one of a batch, over the same arrays.
            let alone = Batch {
                offsets: b.offsets[r..r + 2].to_vec(),
                background: b.background[3 * r..3 * r + 3].to_vec(),
                ..b.clone()
            };
            let q = alone.render(simd);
            prop_assert_eq!(&q.w[b.range(r)], &p.w[b.range(r)]);
            prop_assert_eq!(&q.colour[..], &p.colour[3 * r..3 * r + 3]);
            let h = backward(simd, &alone, &q, CompositeBar { colour: &colour_bar[3 * r..3 * r + 3], w: None, trans_end: None });
            prop_assert_eq!(&h.tau[b.range(r)], &g.tau[b.range(r)]);
        }
    }

    #[test]
    fn gradients_match_the_jacobian_of_the_reference(b in any_batch(), seed in any::<u32>()) {
        let noise = |i: usize, salt: u32| {
            let x = (i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed ^ salt.wrapping_mul(97)).wrapping_mul(0x9E37_79B9);
            (x >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        let (n, rays) = (b.tau.len(), b.rays());
        let colour_bar: Vec<f32> = (0..3 * rays).map(|i| noise(i, 1)).collect();
        let w_bar: Vec<f32> = (0..n).map(|i| noise(i, 2)).collect();
        let end_bar: Vec<f32> = (0..rays).map(|i| noise(i, 3)).collect();
        for simd in Simd::available() {
            let p = b.render(simd);
            let g = backward(simd, &b, &p, CompositeBar { colour: &colour_bar, w: Some(&w_bar), trans_end: Some(&end_bar) });
            for r in 0..rays {
                let range = b.range(r);
                let tau: Vec<f64> = b.tau[range.clone()].iter().map(|&x| x.into()).collect();
                let ray = reference::weights(&tau, b.last);
                let upstream: Vec<f64> = range.clone().map(|i| {
                    f64::from(w_bar[i]) + (0..3).map(|c| f64::from(colour_bar[3 * r + c]) * f64::from(b.rgb[c * b.stride + i])).sum::<f64>()
                }).collect();
                let mut trans_bar = vec![0.0; tau.len() + 1];
                trans_bar[tau.len()] = f64::from(end_bar[r])
                    + (0..3).map(|c| f64::from(colour_bar[3 * r + c]) * f64::from(b.background[3 * r + c])).sum::<f64>();
                let want = reference::tau_bar(&tau, b.last, &upstream, &trans_bar);
                for (k, i) in range.clone().enumerate() {
                    // Relative to what the terms are before they cancel: T times the largest upstream gradient. An optical depth is
                    // rounded to f32 before it is an exponent: half a unit in its last place is a part of T.
                    let depth = -ray.trans[k].max(1e-30).ln();
                    let part = 1e-5 + depth * f64::from(f32::EPSILON);
                    close(g.tau[i], want[k], part * ray.trans[k].max(1e-30), 1e-5, format_args!("{simd:?} tau_bar[{i}]"));
                    for c in 0..3 {
                        close(g.values[c * b.stride + i], ray.w[k] * f64::from(colour_bar[3 * r + c]), 1e-30, 1e-5, "values");
                    }
                }
                for c in 0..3 {
                    close(g.background[3 * r + c], ray.trans[tau.len()] * f64::from(colour_bar[3 * r + c]), 1e-30, 1e-5, "background");
                }
            }
        }
    }

    #[test]
    fn splitting_an_interval_changes_nothing(b in any_batch(), at in 0.0_f64..1.0, share in 0.0_f32..1.0) {
        prop_assume!(!b.tau.is_empty());
        let split = ((at * b.tau.len() as f64) as usize).min(b.tau.len() - 1);
        let mut c = b.clone();
        c.tau[split] = b.tau[split] * share;
        c.tau.insert(split + 1, b.tau[split] - c.tau[split]);
        c.rgb = (0..3).flat_map(|ch| {
            let mut v = b.rgb[ch * b.stride..(ch + 1) * b.stride].to_vec();
            v.insert(split + 1, v[split]);
            v
        }).collect();
        c.stride += 1;
        for o in &mut c.offsets {
            *o += u32::from(*o as usize > split);
        }
        let (p, q) = (b.render(Simd::best()), c.render(Simd::best()));
        for (i, (x, y)) in q.colour.iter().zip(&p.colour).enumerate() {
            close(*x, f64::from(*y), 3e-6, 0.0, format_args!("colour {i}"));
        }
        for (x, y) in q.trans_end.iter().zip(&p.trans_end) {
            close(*x, f64::from(*y), 1e-30, 2e-5, "trans_end");
        }
    }

    #[test]
    fn inserting_an_empty_interval_changes_nothing(b in any_batch(), at in 0.0_f64..1.0) {
        // Not behind the last one of a ray: in opaque mode that place is special.
        let Some(r) = (0..b.rays()).find(|&r| b.range(r).len() > 1) else { return Ok(()) };
        let range = b.range(r);
        let split = range.start + ((at * (range.len() - 1) as f64) as usize).min(range.len() - 1);
        let mut c = b.clone();
        c.tau.insert(split, 0.0);
        c.rgb = (0..3).flat_map(|ch| {
            let mut v = b.rgb[ch * b.stride..(ch + 1) * b.stride].to_vec();
            v.insert(split, 7.0);
            v
        }).collect();
        c.stride += 1;
        for o in &mut c.offsets[r + 1..] {
            *o += 1;
        }
        let (p, q) = (b.render(Simd::best()), c.render(Simd::best()));
        prop_assert_eq!(&q.trans_end, &p.trans_end);
        for (x, y) in q.colour.iter().zip(&p.colour) {
            close(*x, f64::from(*y), 2e-6, 0.0, "colour");
        }
        let mut w = q.w;
        prop_assert_eq!(w.remove(split), 0.0);
        prop_assert_eq!(w, p.w);
    }

    #[test]
    fn a_constant_colour_equal_to_the_background_is_kept(mut b in any_batch(), colour in 0.0_f32..1.0) {
        b.rgb.fill(colour);
        b.background.fill(colour);
        for x in b.render(Simd::best()).colour {
            close(x, f64::from(colour), 0.0, 3e-6, "colour");
        }
    }
}

#[test]
fn the_reference_jacobian_matches_central_differences() {
    for last in LASTS {
        let tau: Vec<f64> = (0..12).map(|i| 10_f64.powf(-6.0 + i as f64 * 0.6)).map(|x| x.min(30.0)).collect();
        let bar = |i: usize| ((i * 7 + 3) % 5) as f64 - 1.7;
        let loss = |tau: &[f64]| {
            let ray = reference::weights(tau, last);
            let w: f64 = ray.w.iter().enumerate().map(|(i, w)| w * bar(i)).sum();
            w + ray.trans.iter().enumerate().map(|(i, t)| t * bar(i + 40)).sum::<f64>()
        };
        let w_bar: Vec<f64> = (0..tau.len()).map(bar).collect();
        let trans_bar: Vec<f64> = (0..=tau.len()).map(|i| bar(i + 40)).collect();
        let grad = reference::tau_bar(&tau, last, &w_bar, &trans_bar);
        for k in 0..tau.len() {
            let h = 1e-6;
            let (mut up, mut down) = (tau.clone(), tau.clone());
            up[k] += h;
            down[k] -= h;
            let want = (loss(&up) - loss(&down)) / (2.0 * h);
            assert!((grad[k] - want).abs() <= 1e-7 * want.abs().max(1e-2), "{last:?} {k}: {} {want}", grad[k]);
        }
    }
}

#[test]
fn no_density_shows_the_background_and_an_opaque_first_interval_its_colour() {
    for simd in Simd::available() {
        let b = Batch::new(&[5, 40], |_| 0.0);
        let p = b.render(simd);
        assert_eq!(p.colour, b.background);
        assert_eq!((&p.opacity[..], &p.trans_end[..]), (&[0.0; 2][..], &[1.0; 2][..]));
        let g = backward(simd, &b, &p, CompositeBar { colour: &[1.0; 6], w: None, trans_end: None });
        assert!(g.values.iter().all(|&x| x == 0.0));
        for opaque in [1e3, f32::MAX, f32::INFINITY] {
            let b = Batch::new(&[30], |i| if i == 0 { opaque } else { 1.0 });
            let p = b.render(simd);
            assert_eq!(p.colour, [b.rgb[0], b.rgb[b.stride], b.rgb[2 * b.stride]]);
            // What lies behind is out of reach, exactly.
            let g = backward(simd, &b, &p, CompositeBar { colour: &[1.0; 3], w: None, trans_end: None });
            assert!(g.tau.iter().all(|&x| x == 0.0), "{:?}", g.tau);
            assert!((0..3).all(|c| g.values[c * b.stride + 1..][..29].iter().all(|&x| x == 0.0)));
        }
    }
}

#[test]
fn opacity_of_constant_density_does_not_depend_on_the_sample_count() {
    for depth in [1e-6_f32, 1e-3, 0.7, 5.0, 40.0] {
        for n in [1, 2, 16, 333, 1024] {
            let p = Batch::new(&[n], |_| depth / n as f32).render(Simd::best());
            close(p.opacity[0], -(-f64::from(depth)).exp_m1(), 0.0, 1e-6, format_args!("{depth} {n}"));
        }
    }
}

#[test]
fn empty_rays_and_empty_batches_show_the_background() {
    for simd in Simd::available() {
        for last in LASTS {
            let b = Batch { last, ..Batch::new(&[0, 0, 3, 0], |_| 0.5) };
            let p = b.render(simd);
            for r in [0, 1, 3] {
                assert_eq!(p.colour[3 * r..3 * r + 3], b.background[3 * r..3 * r + 3]);
                assert_eq!((p.opacity[r], p.trans_end[r]), (0.0, 1.0));
            }
            let none = Batch { last, ..Batch::new(&[], |_| 0.5) };
            let p = none.render(simd);
            assert!(p.colour.is_empty());
            backward(simd, &none, &p, CompositeBar { colour: &[], w: None, trans_end: None });
            weights(simd, Samples { offsets: &[], tau: &[], last }, &mut [], &mut []);
        }
    }
}

#[test]
fn extremes_stay_finite() {
    let extremes = [0.0, 1e-45, 1e-38, 1e-20, 1.0, 86.9, 87.1, 1e4, 3e38, f32::INFINITY];
    for simd in Simd::available() {
        for last in LASTS {
            let b = Batch { last, ..Batch::new(&[10, 10, 1, 37], |i| extremes[(i * 7) % 10]) };
            let p = b.render(simd);
            let g = backward(simd, &b, &p, CompositeBar { colour: &[1.0; 12], w: None, trans_end: None });
            for x in p.colour.iter().chain(&p.w).chain(&p.trans_end).chain(&p.opacity).chain(&g.tau) {
                assert!(x.is_finite(), "{p:?}");
            }
            for (i, &tau) in extremes.iter().enumerate() {
                let b = Batch { last: LastInterval::Finite, ..Batch::new(&[1], |_| tau) };
                let want = -(-f64::from(tau)).exp_m1();
                // Half of the smallest subnormal, and two ulps.
                close(b.render(simd).w[0], want, 0.7e-45, 2.4e-7, format_args!("extreme {i}"));
            }
        }
    }
}

#[test]
fn weights_backward_is_composite_backward_without_colours() {
    let b = Batch::new(&[20, 0, 65], |i| 0.03 * (i % 9) as f32);
    for simd in Simd::available() {
        let (mut w, mut end) = (vec![0.0; 85], vec![0.0; 3]);
        weights(simd, b.samples(), &mut w, &mut end);
        let p = b.render(simd);
        assert_eq!((&w, &end), (&p.w, &p.trans_end));
        let w_bar: Vec<f32> = (0..85).map(|i| (i % 4) as f32 - 1.0).collect();
        let mut tau_bar = vec![f32::NAN; 85];
        let forward = Weights { w: &w, trans_end: &end };
        weights_backward(
            simd,
            b.samples(),
            forward,
            WeightsBar { w: &w_bar, trans_end: Some(&[1.0, 2.0, 3.0]) },
            &mut tau_bar,
        );
        let bar = CompositeBar { colour: &[0.0; 9], w: Some(&w_bar), trans_end: Some(&[1.0, 2.0, 3.0]) };
        assert_eq!(tau_bar, backward(simd, &b, &p, bar).tau);
    }
}

#[test]
fn expected_depth_and_its_gradient() {
    let (offsets, t) = ([0, 3, 3, 5], [1.0, 2.0, 4.0, 1.0, 3.0]);
    let w = [0.1, 0.3, 0.2, 0.0, 0.0];
    let mut depth = [0.0; 3];
    depth_expected(&offsets, &w, &t, 9.0, &mut depth);
    close(depth[0], 1.5 / 0.6, 0.0, 1e-6, "depth");
    assert_eq!(depth[1..], [9.0, 9.0]);
    let (mut w_bar, mut t_bar) = ([0.0; 5], [0.0; 5]);
    let bar = DepthBar { w: &mut w_bar, t: Some(&mut t_bar) };
    depth_expected_backward(&offsets, &w, &t, &[2.0, 1.0, 1.0], bar);
    for i in 0..3 {
        close(w_bar[i], 2.0 * (f64::from(t[i]) - 2.5) / 0.6, 1e-6, 1e-6, "w_bar");
        close(t_bar[i], 2.0 * f64::from(w[i]) / 0.6, 1e-6, 1e-6, "t_bar");
    }
    assert_eq!((w_bar[3], t_bar[4]), (0.0, 0.0));
}
