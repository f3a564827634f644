//! The compositor against the functions it calls: the same bits, whatever was rendered before.

use crate::rays::{self, any_tau, pattern};
use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, Compositor, DepthBar, LastInterval, PixelsBar, RaySamples, Samples,
    Values, Weights, composite, composite_backward, depth_expected, depth_expected_backward,
};

const BACKGROUND: [f32; 3] = [0.25, 0.5, 1.0];
const FAR: f32 = 100.0;

/// Samples of rays of any lengths, with a few at the end that belong to no ray.
#[derive(Clone, Debug)]
struct Batch {
    offsets: Vec<u32>,
    t: Vec<f32>,
    tau: Vec<f32>,
    rgb: Vec<f32>,
}

impl Batch {
    fn samples(&self) -> RaySamples<'_> {
        RaySamples { offsets: &self.offsets, t: &self.t, tau: &self.tau, rgb: &self.rgb }
    }

    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }
}

fn any_batch() -> impl Strategy<Value = Batch> {
    prop::collection::vec(0_usize..80, 0..9).prop_flat_map(|lengths| {
        let n = lengths.iter().sum::<usize>() + 2;
        prop::collection::vec(any_tau(), n).prop_map(move |tau| Batch {
            offsets: rays::offsets(&lengths),
            t: (0..n).map(|i| 1.0 + 0.125 * i as f32).collect(),
            rgb: pattern(3 * n, 37, 11),
            tau,
        })
    })
}

/// What the raw functions give: outputs, then gradients.
#[derive(Debug, Default, PartialEq)]
struct All {
    rgb: Vec<f32>,
    opacity: Vec<f32>,
    depth: Vec<f32>,
    trans_end: Vec<f32>,
    w: Vec<f32>,
    tau_bar: Vec<f32>,
    rgb_bar: Vec<f32>,
    t_bar: Vec<f32>,
}

fn raw(simd: Simd, last: LastInterval, b: &Batch, bar: PixelsBar<'_>) -> All {
    let (n, rays) = (b.tau.len(), b.rays());
    let background: Vec<f32> = (0..3 * rays).map(|i| BACKGROUND[i % 3]).collect();
    let samples = Samples { offsets: &b.offsets, tau: &b.tau, last };
    let values = Values { data: &b.rgb, stride: n, channels: 3 };
    let mut a = All {
        rgb: vec![0.0; 3 * rays],
        opacity: vec![0.0; rays],
        depth: vec![0.0; rays],
        trans_end: vec![0.0; rays],
        w: vec![0.0; n],
        tau_bar: vec![0.0; n],
        rgb_bar: vec![0.0; 3 * n],
        t_bar: vec![0.0; n],
    };
    let out = Composite { colour: &mut a.rgb, opacity: &mut a.opacity, w: &mut a.w, trans_end: &mut a.trans_end };
    composite(simd, samples, values, &background, out);
    depth_expected(&b.offsets, &a.w, &b.t, FAR, &mut a.depth);

    let mut w_bar = bar.w.map_or(vec![0.0; n], <[f32]>::to_vec);
    if let Some(depth) = bar.depth {
        let to = DepthBar { w: &mut w_bar, t: Some(&mut a.t_bar) };
        depth_expected_backward(&b.offsets, &a.w, &b.t, depth, to);
    }
    let end_bar: Option<Vec<f32>> = bar.opacity.map(|x| x.iter().map(|x| -x).collect());
    let no_bar = vec![0.0; 3 * rays];
    let raw_bar = CompositeBar {
        colour: bar.rgb.unwrap_or(&no_bar),
        w: (bar.w.is_some() || bar.depth.is_some()).then_some(&w_bar),
        trans_end: end_bar.as_deref(),
    };
    let grads = CompositeGrads { tau: &mut a.tau_bar, values: &mut a.rgb_bar, background: None };
    composite_backward(
        simd,
        samples,
        values,
        &background,
        Weights { w: &a.w, trans_end: &a.trans_end },
        raw_bar,
        grads,
    );
    a
}

fn through(compositor: &mut Compositor, b: &Batch, bar: PixelsBar<'_>) -> All {
    let pixels = compositor.render(b.samples());
    let mut a = All {
        rgb: pixels.rgb().to_vec(),
        opacity: pixels.opacity().to_vec(),
        depth: pixels.depth().to_vec(),
        trans_end: pixels.trans_end().to_vec(),
        w: pixels.weights().to_vec(),
        ..All::default()
    };
    let grads = pixels.backward(bar);
    (a.tau_bar, a.rgb_bar, a.t_bar) = (grads.tau().to_vec(), grads.rgb().to_vec(), grads.t().to_vec());
    a
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn the_compositor_gives_the_bits_of_the_raw_functions(batches in prop::collection::vec(any_batch(), 1..4)) {
        for simd in Simd::available() {
            for last in [LastInterval::Finite, LastInterval::Opaque] {
                let mut compositor =
                    Compositor::new(simd).with_background(BACKGROUND).with_last_interval(last).with_far(FAR);
                // One after the other: nothing of a batch is left for the next.
                for b in &batches {
                    let (rays, n) = (b.rays(), b.tau.len());
                    let (rgb, opacity, depth, w) =
                        (pattern(3 * rays, 13, 7), pattern(rays, 17, 3), pattern(rays, 19, 5), pattern(n, 23, 1));
                    let bars = [
                        PixelsBar::of_rgb(&rgb),
                        PixelsBar::of_rgb(&rgb).with_opacity(&opacity).with_depth(&depth).with_weights(&w),
                        PixelsBar::default().with_depth(&depth),
                        PixelsBar::default(),
                    ];
                    for bar in bars {
                        prop_assert_eq!(through(&mut compositor, b, bar), raw(simd, last, b, bar));
                    }
                }
            }
        }
    }
}

#[test]
fn no_rays_are_legal_and_wrong_lengths_are_named() {
    let mut compositor = Compositor::new(Simd::best());
    for offsets in [&[][..], &[0]] {
        let pixels = compositor.render(RaySamples { offsets, t: &[], tau: &[], rgb: &[] });
        assert!(pixels.rgb().is_empty() && pixels.depth().is_empty());
        assert!(pixels.backward(PixelsBar::default()).tau().is_empty());
    }
    let refused = |samples: RaySamples<'_>, bar: Option<&[f32]>| {
        let run = std::panic::AssertUnwindSafe(|| {
            let mut compositor = Compositor::new(Simd::best());
            let pixels = compositor.render(samples);
            let _ = pixels.backward(bar.map_or(PixelsBar::default(), PixelsBar::of_rgb));
        });
        let cause = std::panic::catch_unwind(run).expect_err("it is refused");
        cause.downcast_ref::<String>().cloned().unwrap_or_default()
    };
    let good = RaySamples { offsets: &[0, 1], t: &[1.0], tau: &[1.0], rgb: &[0.5; 3] };
    assert!(refused(RaySamples { t: &[], ..good }, None).contains("t and tau differ"));
    assert!(refused(RaySamples { rgb: &[0.5; 2], ..good }, None).contains("three channels"));
    assert!(refused(RaySamples { offsets: &[0, 2], ..good }, None).contains("past the 1 samples"));
    assert!(refused(good, Some(&[1.0])).contains("one value a ray and channel"));
}
