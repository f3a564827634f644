//! Interlevel loss: against its definition, gradients, what it allows, edges.

use losses::interlevel::{self, EPS, Levels, Scratch};
use losses::{Edges, LossError, RayIntervals, Reduction};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair};
use testkit::strategies::any_histogram;

type Histogram = (Vec<f32>, Vec<f32>);

/// The definition: every pair of intervals is asked whether it touches.
fn naive_bound(s: &[f32], s_hat: &[f32], w_hat: &[f64], i: usize) -> f64 {
    let touches = |j: usize| s_hat[j + 1] > s[i] && s_hat[j] <= s[i + 1];
    (0..w_hat.len()).filter(|&j| touches(j)).map(|j| w_hat[j]).sum()
}

fn naive(s: &[f32], w: &[f32], s_hat: &[f32], w_hat: &[f64]) -> f64 {
    let each = |i: usize| {
        let w = f64::from(w[i]);
        (w - naive_bound(s, s_hat, w_hat, i)).max(0.0).powi(2) / (w + EPS)
    };
    (0..w.len()).map(each).sum()
}

fn naive_backward(s: &[f32], w: &[f32], s_hat: &[f32], w_hat: &[f64], loss_bar: f64, bar: &mut [f64]) {
    for i in 0..w.len() {
        let wi = f64::from(w[i]);
        let g = -2.0 * (wi - naive_bound(s, s_hat, w_hat, i)).max(0.0) / (wi + EPS);
        for j in 0..w_hat.len() {
            if s_hat[j + 1] > s[i] && s_hat[j] <= s[i + 1] {
                bar[j] += loss_bar * g;
            }
        }
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

/// Two histograms of one ray, without gaps, and what to do with them.
fn with_levels<T>(fine: &Histogram, proposal: &Histogram, f: impl FnOnce(Levels<'_>) -> T) -> T {
    let (offsets, p_offsets) = ([0, fine.1.len() as u32], [0, proposal.1.len() as u32]);
    f(Levels {
        fine: RayIntervals { offsets: &offsets, edges: Edges::Joined(&fine.0) },
        w: &fine.1,
        proposal: RayIntervals { offsets: &p_offsets, edges: Edges::Joined(&proposal.0) },
        w_proposal: &proposal.1,
    })
}

fn loss(fine: &Histogram, proposal: &Histogram) -> f64 {
    with_levels(fine, proposal, |l| interlevel::interlevel(l, Reduction::Sum, &mut Scratch::default()).unwrap())
}

/// Edges to `[0, 1]`, so that the two histograms of a ray lie on each other, and some edges coincide.
fn normalised(mut h: Histogram) -> Histogram {
    let (first, last) = (h.0[0], h.0[h.0.len() - 1]);
    let span = (last - first).max(f32::MIN_POSITIVE);
    h.0.iter_mut().for_each(|s| *s = ((*s - first) / span * 64.0).round() / 64.0);
    h
}

/// Weights as a quadrature makes them: an empty interval has none.
fn emptied(mut h: Histogram) -> Histogram {
    for (w, s) in h.1.iter_mut().zip(h.0.windows(2)) {
        *w = if s[1] > s[0] { *w } else { 0.0 };
    }
    h
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn linear_time_matches_definition(fine in any_histogram(1..33), proposal in any_histogram(1..65)) {
        for (fine, proposal) in [(normalised(fine.clone()), normalised(proposal.clone())), (fine, proposal)] {
            let want = naive(&fine.0, &fine.1, &proposal.0, &wide(&proposal.1));
            let got = loss(&fine, &proposal);
            prop_assert!((got - want).abs() <= 1e-11 * want.max(1.0), "{got} {want}");
            prop_assert!(got >= 0.0);
        }
    }

    #[test]
    fn gradient_matches_twin_and_differences(
        fine in any_histogram(1..17), proposal in any_histogram(1..33), loss_bar in -2.0_f32..2.0) {
        let (fine, mut proposal) = (normalised(fine), normalised(proposal));
        // Away from the corner where the bound is just met: there the second derivative jumps. Halving keeps most of the
        // intervals on the steep side.
        proposal.1.iter_mut().for_each(|w| *w *= 0.5);
        let p = &proposal.0;
        let near_corner = (0..fine.1.len()).any(|i| {
            let gap = f64::from(fine.1[i]) - naive_bound(&fine.0, p, &wide(&proposal.1), i);
            gap.abs() < 1e-4 || (fine.1[i] > 0.0 && fine.1[i] < 1e-3)
        });
        prop_assume!(!near_corner);
        let with = |w: &[f32], f: &mut dyn FnMut(Levels<'_>)| {
            with_levels(&fine, &(p.clone(), w.to_vec()), f);
        };
        check_f32_pair(
            &proposal.1,
            &[loss_bar],
            (
                |w: &[f32], out: &mut [f32]| with(w, &mut |l| {
                    out[0] = interlevel::interlevel(l, Reduction::Sum, &mut Scratch::default()).unwrap() as f32;
                }),
                |w: &[f32], bar: &[f32], w_bar: &mut [f32]| with(w, &mut |l| {
                    let scratch = &mut Scratch::default();
                    interlevel::interlevel_backward(l, Reduction::Sum, bar[0].into(), w_bar, scratch).unwrap();
                }),
            ),
            (
                |w: &[f64], out: &mut [f64]| out[0] = naive(&fine.0, &fine.1, p, w),
                |w: &[f64], bar: &[f64], w_bar: &mut [f64]| {
                    naive_backward(&fine.0, &fine.1, p, w, bar[0], w_bar);
                },
            ),
            PairTolerances {
                values: Tolerance::new(1e-6, 1e-12),
                twin: Tolerance::new(1e-6, 1e-8),
                gradients: Tolerance::new(1e-5, 1e-8),
            },
        ).unwrap();
    }

    #[test]
    fn identical_histograms_cost_nothing(h in any_histogram(1..65)) {
        let h = emptied(h);
        // Prefix sums differ from a single weight by rounding of f64.
        prop_assert!(loss(&h, &h) <= 1e-24);
    }

    #[test]
    fn a_proposal_with_more_weight_everywhere_costs_nothing(h in any_histogram(1..65), more in 0.0_f32..1.0) {
        let h = emptied(h);
        let above = (h.0.clone(), h.1.iter().map(|w| w + more).collect());
        prop_assert!(loss(&h, &above) <= 1e-24);
    }

    #[test]
    fn merging_proposal_intervals_never_costs_more(
        fine in any_histogram(1..33), proposal in any_histogram(2..33), at in 0_usize..32) {
        let (fine, proposal) = (normalised(fine), normalised(proposal));
        let at = at % (proposal.1.len() - 1);
        let mut merged = proposal.clone();
        merged.0.remove(at + 1);
        merged.1[at] += merged.1.remove(at + 1);
        let (before, after) = (loss(&fine, &proposal), loss(&fine, &merged));
        // The merged weight is rounded, so each bound is by up to eps of itself: a term `(w - bound)^2 / w` by twice its root times
        // `eps sqrt(w)`, all of them by twice the root of the loss times eps, as weights sum to one.
        let rounding = 2.0 * f64::from(f32::EPSILON) * before.sqrt();
        prop_assert!(after <= before * (1.0 + 1e-6) + rounding + 1e-12, "{before} {after}");
    }

    #[test]
    fn a_batch_is_its_rays(rays in prop::collection::vec((any_histogram(0..9), any_histogram(0..17)), 0..6)) {
        let mut batch = [(vec![0_u32], vec![], vec![]), (vec![0_u32], vec![], vec![])];
        for (a, b) in &rays {
            for (level, h) in batch.iter_mut().zip([a, b]) {
                level.1.extend_from_slice(&h.0);
                level.2.extend_from_slice(&h.1);
                level.0.push(level.2.len() as u32);
            }
        }
        let [(offsets, s, w), (p_offsets, p_s, p_w)] = &batch;
        let levels = Levels {
            fine: RayIntervals { offsets, edges: Edges::Joined(s) },
            w,
            proposal: RayIntervals { offsets: p_offsets, edges: Edges::Joined(p_s) },
            w_proposal: p_w,
        };
        let scratch = &mut Scratch::default();
        let want: f64 = rays.iter().map(|(a, b)| loss(a, b)).sum();
        let close = |got: f64, want: f64| (got - want).abs() <= 1e-12 * want;
        prop_assert!(close(interlevel::interlevel(levels, Reduction::Sum, scratch).unwrap(), want));
        let mean = interlevel::interlevel(levels, Reduction::PerInterval, scratch).unwrap();
        prop_assert!(close(mean, want / w.len().max(1) as f64));
        let mut got = vec![0.0; p_w.len()];
        interlevel::interlevel_backward(levels, Reduction::Sum, 1.5, &mut got, scratch).unwrap();
        let mut at = 0;
        for (a, b) in &rays {
            let mut one = vec![0.0; b.1.len()];
            with_levels(a, b, |l| interlevel::interlevel_backward(l, Reduction::Sum, 1.5, &mut one, scratch)).unwrap();
            prop_assert_eq!(&got[at..at + one.len()], &one[..]);
            at += one.len();
        }
    }
}

#[test]
fn touching_is_decided_at_coinciding_edges() {
    // The one that begins where the interval ends counts, the one that ends where it begins does not.
    let fine = (vec![0.25, 0.5], vec![1.0]);
    let proposal = (vec![0.0, 0.25, 0.5, 0.75, 1.0], vec![0.1, 0.2, 0.4, 0.8]);
    let mut bound = [0.0];
    with_levels(&fine, &proposal, |l| interlevel::bounds(l, &mut bound, &mut Scratch::default())).unwrap();
    assert!((bound[0] - 0.6).abs() < 1e-7, "{bound:?}");
}

#[test]
fn gradient_pulls_weight_to_where_it_is_missing() {
    let fine = (vec![0.0, 0.25, 0.75, 1.0], vec![0.0, 0.9, 0.0]);
    let proposal = (vec![0.0, 0.2, 0.5, 0.8, 1.0], vec![0.25; 4]);
    let mut bar = [0.0; 4];
    let scratch = &mut Scratch::default();
    with_levels(&fine, &proposal, |l| {
        interlevel::interlevel_backward(l, Reduction::PerInterval, 1.0, &mut bar, scratch)
    })
    .unwrap();
    assert_eq!((bar[0], bar[3]), (0.0, 0.0));
    assert!(bar[1] < 0.0 && bar[1] == bar[2], "{bar:?}");
}

#[test]
fn empty_input_costs_nothing() {
    let none = Levels {
        fine: RayIntervals { offsets: &[], edges: Edges::Joined(&[]) },
        w: &[],
        proposal: RayIntervals { offsets: &[], edges: Edges::Joined(&[]) },
        w_proposal: &[],
    };
    assert_eq!(interlevel::interlevel(none, Reduction::PerInterval, &mut Scratch::default()), Ok(0.0));
    // A proposal without intervals allows nothing.
    let fine = (vec![0.0, 1.0], vec![0.5]);
    assert!((loss(&fine, &(vec![0.0], vec![])) - 0.5).abs() < 1e-6);
}

#[test]
fn extreme_weights_stay_finite() {
    for scale in [0.0_f32, 1e-38, 1e-12, 1e12, 1e30] {
        let fine = (vec![0.0, 0.5, 1.0], vec![scale, 0.5 * scale]);
        let proposal = (vec![0.0, 0.3, 1.0], vec![0.1 * scale, 1e-30]);
        let mut bar = [0.0; 2];
        let scratch = &mut Scratch::default();
        let got = loss(&fine, &proposal);
        with_levels(&fine, &proposal, |l| interlevel::interlevel_backward(l, Reduction::Sum, 1.0, &mut bar, scratch))
            .unwrap();
        assert!(got.is_finite() && bar.iter().all(|b| b.is_finite()), "{scale}: {got} {bar:?}");
    }
}

#[test]
fn arguments_that_do_not_fit_are_named() {
    let one = RayIntervals { offsets: &[0, 1], edges: Edges::Joined(&[0.0, 1.0]) };
    let two = RayIntervals { offsets: &[0, 0, 1], edges: Edges::Joined(&[0.0, 0.0, 1.0]) };
    let levels = Levels { fine: one, w: &[0.5], proposal: two, w_proposal: &[0.5] };
    let error = interlevel::interlevel(levels, Reduction::Sum, &mut Scratch::default());
    assert_eq!(error, Err(LossError::Shape { what: "proposal", want: 1, got: 2 }));
}
