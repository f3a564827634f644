//! Pixels drawn around tools, samples drawn around depths.

use proptest::prelude::*;
use render_core::error::RenderError;
use render_core::importance::{BLOCK, HiddenCounts, Sampler, importance};
use render_core::sample::{DepthCue, depth_cued};

/// Masks of a sequence: `frames` of `pixels` each, with frames that are all tool and frames without.
fn sequences() -> impl Strategy<Value = Vec<Vec<u8>>> {
    (1_usize..200).prop_flat_map(|pixels| {
        let one = prop::sample::select(vec![0_u8, 0, 1, 255]);
        let frame = prop_oneof![
            4 => prop::collection::vec(one, pixels),
            1 => Just(vec![0; pixels]),
            1 => Just(vec![255; pixels]),
        ];
        prop::collection::vec(frame, 1..6)
    })
}

fn count(masks: &[Vec<u8>]) -> HiddenCounts {
    let mut counts = HiddenCounts::new(masks[0].len());
    masks.iter().for_each(|mask| counts.add(mask).unwrap());
    counts
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn importance_is_zero_on_tools_and_follows_the_definition(masks in sequences()) {
        let boost = count(&masks).boost();
        let n = boost.len();
        let hidden: Vec<f64> = (0..n).map(|p| masks.iter().filter(|m| m[p] == 0).count() as f64).collect();
        let norm = hidden.iter().map(|k| k * k).sum::<f64>().sqrt();
        for mask in &masks {
            let mut v = vec![f32::NAN; n];
            importance(&boost, mask, &mut v).unwrap();
            for p in 0..n {
                let prior = if norm == 0.0 { 0.0 } else { hidden[p] / norm };
                let want = if mask[p] == 0 { 0.0 } else { 1.0 + prior };
                prop_assert!((f64::from(v[p]) - want).abs() < 1e-6, "{} {want}", v[p]);
                prop_assert!(mask[p] != 0 || v[p] == 0.0);
            }
        }
    }

    #[test]
    fn the_order_of_frames_does_not_matter(masks in sequences(), turn in 0_usize..6) {
        let mut other = masks.clone();
        other.rotate_left(turn % masks.len());
        prop_assert_eq!(count(&masks), count(&other));
        prop_assert_eq!(count(&masks).boost(), count(&other).boost());
    }

    #[test]
    fn hidden_pixels_are_never_drawn_and_shares_follow_the_running_sum(masks in sequences(), us in prop::collection::vec(0.0_f64..1.0, 20)) {
        let boost = count(&masks).boost();
        for mask in &masks {
            let sampler = Sampler::of_frame(&boost, mask).unwrap();
            let mut v = vec![0.0; boost.len()];
            importance(&boost, mask, &mut v).unwrap();
            let total: f64 = v.iter().map(|&v| f64::from(v)).sum();
            prop_assert_eq!(sampler.total(), total);
            let mut before = (0.0, 0);
            let mut us = us.clone();
            us.extend([0.0, 1.0_f64.next_down(), 1.0, -0.5, 7.0]);
            us.sort_by(f64::total_cmp);
            for u in us {
                let Some(p) = sampler.draw_pixel(u, &boost, mask) else {
                    prop_assert_eq!(total, 0.0);
                    continue;
                };
                prop_assert!(v[p] > 0.0, "pixel {p} under a tool was drawn");
                let below: f64 = v[..p].iter().map(|&v| f64::from(v)).sum();
                let target = (u * total).clamp(0.0, total);
                prop_assert!(below <= target + 1e-9 && target <= below + f64::from(v[p]) + 1e-9);
                prop_assert!(p >= before.1, "u {u} and {}", before.0);
                before = (u, p);
            }
        }
    }

    #[test]
    fn cued_samples_are_sorted_and_stay_on_the_ray(
        near in 0.0_f32..5.0,
        length in prop_oneof![Just(0.0_f32), 1e-6_f32..1e-3, 0.01_f32..100.0],
        depth in prop_oneof![
            Just(f32::NAN), Just(0.0_f32), Just(-1.0), Just(f32::INFINITY), Just(1e30), Just(1e-30), 0.0_f32..120.0
        ],
        sigma in prop_oneof![Just(0.0_f32), Just(1e-30), Just(1e30), Just(f32::NAN), 1e-4_f32..10.0],
        uniform_share in prop_oneof![Just(0.0_f32), Just(1.0), 0.0_f32..1.0],
        u in (0_usize..40).prop_flat_map(|n| prop::collection::vec(prop_oneof![Just(0.0_f32), Just(1.0_f32.next_down()), 0.0_f32..1.0], n)),
    ) {
        let far = near + length;
        let mut t = vec![f32::NAN; u.len()];
        depth_cued(near, far, depth, DepthCue { sigma, uniform_share }, &u, &mut t);
        prop_assert!(t.is_sorted() && t.iter().all(|t| (near..=far).contains(t)), "{t:?} in {near}..{far}");
    }
}

#[test]
fn pixels_are_drawn_as_often_as_they_count() {
    // 3 blocks and a rest; weights 0..4 in turn.
    let n = 3 * BLOCK + 7;
    let weight = |i: usize| (i % 5) as f32;
    let sampler = Sampler::new(n, weight).unwrap();
    let draws = 200_000;
    let mut counts = vec![0_u32; n];
    for i in 0..draws {
        counts[sampler.draw((f64::from(i) + 0.5) / f64::from(draws), weight).unwrap()] += 1;
    }
    for (i, &count) in counts.iter().enumerate() {
        let want = f64::from(weight(i)) / sampler.total() * f64::from(draws);
        // Equally spaced shares: each step of the running sum is met to one draw.
        assert!((f64::from(count) - want).abs() <= 1.0, "pixel {i}: {count} of {want}");
    }
}

#[test]
fn nothing_to_draw_and_wrong_sizes() {
    assert_eq!(Sampler::new(0, |_| 1.0).unwrap().draw(0.3, |_| 1.0), None);
    let tool_everywhere = Sampler::of_frame(&[1.5; 9], &[0; 9]).unwrap();
    assert_eq!((tool_everywhere.total(), tool_everywhere.draw_pixel(0.5, &[1.5; 9], &[0; 9])), (0.0, None));
    assert!(HiddenCounts::new(0).boost().is_empty());
    let shape = |what, want, got| RenderError::Shape { what, want, got };
    assert_eq!(HiddenCounts::new(4).add(&[1; 3]), Err(shape("mask", 4, 3)));
    assert_eq!(importance(&[1.0; 4], &[1; 5], &mut [0.0; 4]), Err(shape("mask", 4, 5)));
    assert_eq!(importance(&[1.0; 4], &[1; 4], &mut [0.0; 5]), Err(shape("out", 4, 5)));
    for bad in [f32::NAN, -1.0, f32::INFINITY] {
        let got = Sampler::new(3, |i| if i == 2 { bad } else { 1.0 });
        assert_eq!(got, Err(RenderError::NonFinite { what: "weight", index: 2 }));
    }
}

/// Many stratified samples of one ray.
fn many(depth: f32, cue: DepthCue) -> Vec<f32> {
    let u = vec![0.5; 40_000];
    let mut t = vec![0.0; u.len()];
    depth_cued(1.0, 3.0, depth, cue, &u, &mut t);
    t
}

#[test]
fn cued_samples_are_centred_at_the_depth_with_their_spread() {
    let t = many(1.8, DepthCue { sigma: 0.1, uniform_share: 0.0 });
    let mean = t.iter().map(|&t| f64::from(t)).sum::<f64>() / t.len() as f64;
    let variance = t.iter().map(|&t| (f64::from(t) - mean).powi(2)).sum::<f64>() / t.len() as f64;
    // Equally spaced shares: both to a few per mille of the spread, for a distribution whose tails the ends don't reach.
    assert!((mean - 1.8).abs() < 1e-5, "{mean}");
    assert!((variance.sqrt() - 0.1).abs() < 1e-4, "{}", variance.sqrt());
    let within = |k: f32| t.iter().filter(|t| (*t - 1.8).abs() < k * 0.1).count() as f64 / t.len() as f64;
    assert!((within(1.0) - 0.682_689).abs() < 1e-3 && (within(2.0) - 0.954_5).abs() < 1e-3);
}

#[test]
fn the_uniform_share_is_that_share_of_the_samples() {
    let t = many(1.8, DepthCue { sigma: 0.01, uniform_share: 0.1 });
    let far_off = t.iter().filter(|t| (*t - 1.8).abs() > 0.1).count() as f64 / t.len() as f64;
    // A tenth, of which a tenth lies within 0.1 of the depth.
    assert!((far_off - 0.09).abs() < 1e-3, "{far_off}");
    assert_eq!(t[0], 1.000_25);
    // Without a measurement all are spread evenly.
    for depth in [0.0, -2.0, f32::NAN, f32::INFINITY] {
        let t = many(depth, DepthCue { sigma: 0.01, uniform_share: 0.1 });
        for (i, t) in t.iter().enumerate().step_by(997) {
            assert!((f64::from(*t) - (1.0 + 2.0 * (i as f64 + 0.5) / 40_000.0)).abs() < 1e-6);
        }
    }
}

#[test]
fn a_depth_at_or_past_an_end_is_cut_off_there() {
    for (depth, end) in [(3.0, 3.0_f32), (50.0, 3.0), (0.2, 1.0)] {
        let t = many(depth, DepthCue { sigma: 0.1, uniform_share: 0.0 });
        let one_sigma = t.iter().filter(|t| (*t - end).abs() < 0.1).count() as f64 / t.len() as f64;
        assert!((one_sigma - 0.682_689).abs() < 1e-3, "{depth}: {one_sigma}");
    }
}
