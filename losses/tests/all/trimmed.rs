//! Trimmed, diffused and patch-voted weights: definition, what each step keeps, symmetries, edges of the rules.

use losses::LossError;
use losses::kernel::Kernel;
use losses::photometric;
use losses::trimmed::{Border, Compare, TrimmedMask, VoteOn, count_non_finite};
use proptest::prelude::*;

/// The definition, one pixel after the other, with counts instead of means.
fn naive(mask: &TrimmedMask, e: &[f32], threshold: f32) -> Vec<bool> {
    let p = mask.patch as isize;
    let reaches = |count: usize, of: usize, share: f32| {
        let (mean, share) = (count as f64 / of as f64, f64::from(share));
        if mask.compare == Compare::AtMost { mean >= share } else { mean > share }
    };
    let mut out = vec![];
    for e in e.chunks_exact(mask.patch * mask.patch) {
        let small = |e: f32| if mask.compare == Compare::AtMost { e <= threshold } else { e < threshold };
        let inlier: Vec<bool> = e.iter().map(|&e| e.is_finite() && small(e)).collect();
        let at =
            |y: isize, x: isize| ((0..p).contains(&y) && (0..p).contains(&x)).then(|| inlier[(y * p + x) as usize]);
        let diffused: Vec<bool> = (0..p * p)
            .map(|i| {
                let around: Vec<bool> =
                    (-1..2).flat_map(|dy| (-1..2).filter_map(move |dx| at(i / p + dy, i % p + dx))).collect();
                let of = if mask.border == Border::Valid { around.len() } else { 9 };
                inlier[i as usize] || reaches(around.iter().filter(|&&k| k).count(), of, mask.diffuse)
            })
            .collect();
        let voters = if mask.vote_on == VoteOn::Diffused { &diffused } else { &inlier };
        let kept = reaches(voters.iter().filter(|&&k| k).count(), voters.len(), mask.vote);
        let start = (mask.patch - mask.inner) / 2;
        let inner = start as isize..(start + mask.inner) as isize;
        out.extend(
            (0..p * p).map(|i| diffused[i as usize] || (kept && inner.contains(&(i / p)) && inner.contains(&(i % p)))),
        );
    }
    out
}

fn weights(mask: &TrimmedMask, e: &[f32], threshold: f32) -> Vec<f32> {
    let mut out = vec![f32::NAN; e.len()];
    mask.weights(e, threshold, &mut vec![], &mut out).unwrap();
    out
}

/// Threshold and weights of one batch.
fn run(mask: &TrimmedMask, e: &[f32]) -> Vec<f32> {
    weights(mask, e, mask.threshold(e, &mut vec![]))
}

/// No step after the first can add anything.
fn only_trim(mask: TrimmedMask) -> TrimmedMask {
    // Means above 1 are what `Below` asks for at 1; thresholds stay where they are, errors are compared strictly.
    mask.with_diffuse(1.0).with_vote(1.0).with_compare(Compare::Below)
}

fn any_mask() -> impl Strategy<Value = TrimmedMask> {
    let sides = prop_oneof![Just((16, 8)), Just((8, 8)), Just((5, 3)), Just((4, 1)), Just((1, 1)), Just((2, 0))];
    // Shares of 64: exact in either precision.
    (0_u8..=64, 0_u8..=64, 0_u8..=64, sides, any::<[bool; 3]>()).prop_map(|(q, d, v, (patch, inner), [a, b, c])| {
        TrimmedMask::default()
            .with_quantile(f32::from(q) / 64.0)
            .with_diffuse(f32::from(d) / 64.0)
            .with_vote(f32::from(v) / 64.0)
            .with_patch(patch)
            .with_inner(inner)
            .with_border(if a { Border::Valid } else { Border::Zero })
            .with_vote_on(if b { VoteOn::Diffused } else { VoteOn::Inliers })
            .with_compare(if c { Compare::AtMost } else { Compare::Below })
    })
}

/// Errors: few distinct ones (ties), ordinary ones, blobs, and what is not a number.
fn any_errors(n: usize) -> impl Strategy<Value = Vec<f32>> {
    let one = prop_oneof![
        4 => 0.0_f32..1.0,
        2 => (0_u8..4).prop_map(|k| f32::from(k) / 4.0),
        1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(0.0), Just(1e-40), Just(f32::MAX)],
    ];
    prop::collection::vec(one, n)
}

/// Every patch mirrored, in columns or in rows.
fn flipped(x: &[f32], p: usize, rows: bool) -> Vec<f32> {
    let of = |i: usize| {
        let (patch, y, x) = (i / (p * p), i / p % p, i % p);
        let (y, x) = if rows { (p - 1 - y, x) } else { (y, p - 1 - x) };
        patch * p * p + y * p + x
    };
    (0..x.len()).map(|i| x[of(i)]).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn weights_match_definition(mask in any_mask(), e in any_errors(3 * 256)) {
        let area = mask.patch * mask.patch;
        let e = &e[..e.len() / area * area];
        let threshold = mask.threshold(e, &mut vec![]);
        let got = weights(&mask, e, threshold);
        let want: Vec<f32> = naive(&mask, e, threshold).iter().map(|&k| f32::from(u8::from(k))).collect();
        prop_assert_eq!(got, want);
    }

    #[test]
    fn each_step_keeps_what_the_one_before_kept(mask in any_mask(), e in any_errors(2 * 256)) {
        let area = mask.patch * mask.patch;
        let e = &e[..e.len() / area * area];
        let mask = mask.with_compare(Compare::Below);
        let threshold = mask.threshold(e, &mut vec![]);
        let inlier = weights(&only_trim(mask), e, threshold);
        let diffused = weights(&mask.with_vote(1.0), e, threshold);
        let voted = weights(&mask, e, threshold);
        for i in 0..e.len() {
            prop_assert_eq!(inlier[i] == 1.0, e[i].is_finite() && e[i] < threshold);
            prop_assert!(inlier[i] <= diffused[i] && diffused[i] <= voted[i], "ray {}", i);
        }
        // Outside the inner block the vote has no say.
        let start = (mask.patch - mask.inner) / 2;
        let inside = |i: usize| (start..start + mask.inner).contains(&i);
        for i in (0..e.len()).filter(|i| !(inside(i / mask.patch % mask.patch) && inside(i % mask.patch))) {
            prop_assert_eq!(diffused[i], voted[i]);
        }
    }

    #[test]
    fn half_of_the_rays_learn(e in prop::collection::vec(0.0_f32..1.0, 512)) {
        let mask = TrimmedMask::default().with_vote(1.0);
        prop_assert!(run(&mask, &e).iter().sum::<f32>() >= 256.0);
        // By trimming alone already: the lower median and all below it.
        let threshold = mask.threshold(&e, &mut vec![]);
        prop_assert!(e.iter().filter(|&&e| e <= threshold).count() >= 256);
        prop_assert!(e.contains(&threshold));
    }

    #[test]
    fn mirrored_patches_give_mirrored_weights(mask in any_mask(), e in any_errors(2 * 256), rows in any::<bool>()) {
        // An inner block of the other parity has no middle.
        prop_assume!((mask.patch - mask.inner) % 2 == 0);
        let area = mask.patch * mask.patch;
        let e = &e[..e.len() / area * area];
        prop_assert_eq!(run(&mask, &flipped(e, mask.patch, rows)), flipped(&run(&mask, e), mask.patch, rows));
    }

    #[test]
    fn scale_does_not_matter(k in prop::collection::vec(1_u16..1024, 256), power in -60_i32..60) {
        let mask = TrimmedMask::default();
        let e: Vec<f32> = k.iter().map(|&k| f32::from(k) / 1024.0).collect();
        let scaled: Vec<f32> = e.iter().map(|e| e * 2.0_f32.powi(power)).collect();
        prop_assert_eq!(run(&mask, &scaled), run(&mask, &e));
        // Nor does it matter whether errors or their squares (exact here) are compared.
        let squared: Vec<f32> = e.iter().map(|e| e * e).collect();
        prop_assert_eq!(run(&mask, &squared), run(&mask, &e));
    }

    #[test]
    fn patches_are_independent_but_for_the_threshold(e in prop::collection::vec(0.0_f32..1.0, 3 * 256), tau in 0.0_f32..1.0) {
        let mask = TrimmedMask::default();
        let singly: Vec<f32> = e.chunks_exact(256).flat_map(|e| weights(&mask, e, tau)).collect();
        prop_assert_eq!(weights(&mask, &e, tau), singly);
    }
}

/// A patch of small errors.
fn calm() -> Vec<f32> {
    (0..256).map(|i| 0.01 + 1e-5 * i as f32).collect()
}

#[test]
fn all_inliers_are_all_kept() {
    let mask = TrimmedMask::default();
    assert!(weights(&mask, &calm(), 1.0).iter().all(|&w| w == 1.0));
    // Equal errors, zero or not: at the threshold, and kept. As released, all are lost.
    for e in [0.0, 0.25] {
        assert!(run(&mask, &[e; 512]).iter().all(|&w| w == 1.0));
        assert!(run(&mask.with_compare(Compare::Below), &[e; 512]).iter().all(|&w| w == 0.0));
    }
}

#[test]
fn a_lone_outlier_among_inliers_is_recovered() {
    let mask = TrimmedMask::default().with_vote(1.0).with_compare(Compare::Below);
    for at in [0, 5, 15, 16 * 7 + 8, 255] {
        let mut e = calm();
        e[at] = 9.0;
        assert_eq!(weights(&mask, &e, 1.0)[at], 1.0, "pixel {at}");
        // Padded with outliers, a corner (3 of 9) has no way back; an edge has one, with all five.
        let padded = weights(&mask.with_border(Border::Zero), &e, 1.0);
        let corner = [0, 15, 255].contains(&at);
        assert_eq!(padded[at], if corner { 0.0 } else { 1.0 }, "pixel {at}, padded");
    }
}

#[test]
fn a_solid_outlier_stays_out() {
    let mask = TrimmedMask::default();
    // A patch that is all outlier, among three that are not.
    let mut e: Vec<f32> = (0..4).flat_map(|_| calm()).collect();
    e[256..512].fill(7.0);
    let tau = 0.5;
    let w = weights(&mask, &e, tau);
    assert!(w[256..512].iter().all(|&w| w == 0.0));
    assert!(w[..256].iter().chain(&w[512..]).all(|&w| w == 1.0));
    // A block of 10 x 10 leaves 61 % of its patch and would be voted back in: not by 12 x 12 (44 %).
    for (side, back) in [(10, true), (12, false)] {
        let mut e = calm();
        (0..side * side).for_each(|i| e[(2 + i / side) * 16 + 2 + i % side] = 7.0);
        let centre = weights(&mask, &e, tau)[8 * 16 + 7];
        assert_eq!(centre == 1.0, back, "{side}");
    }
}

#[test]
fn a_vote_at_its_threshold_counts() {
    // 15 of 25 are 0.6: as a number of f32 that is a little more than three fifths.
    let mask = TrimmedMask::default().with_diffuse(1.0).with_patch(5).with_inner(5);
    let e: Vec<f32> = (0..25).map(|i| if i < 15 { 0.1 } else { 0.9 }).collect();
    assert!(weights(&mask, &e, 0.5).iter().all(|&w| w == 1.0));
    let below = mask.with_compare(Compare::Below);
    assert_eq!(weights(&below, &e, 0.5).iter().sum::<f32>(), 15.0);
    // Ten columns of inliers with 15 holes: 0.57 of the patch, 0.63 once the holes are filled.
    let small = |x: usize, y: usize| x < 10 && !(x % 3 == 1 && y % 3 == 1);
    let e: Vec<f32> = (0..256).map(|i| if small(i % 16, i / 16) { 0.1 } else { 0.9 }).collect();
    let by_inliers = TrimmedMask::default().with_vote_on(VoteOn::Inliers);
    let [diffused, inliers] = [TrimmedMask::default(), by_inliers].map(|m| weights(&m, &e, 0.5)[8 * 16 + 11]);
    assert_eq!((diffused, inliers), (1.0, 0.0));
}

#[test]
fn what_is_no_number_is_an_outlier() {
    let mask = TrimmedMask::default();
    let mut e: Vec<f32> = (0..2).flat_map(|_| calm()).collect();
    e[..256].fill(f32::NAN);
    e[1] = -f32::NAN;
    e[2] = f32::INFINITY;
    assert_eq!(count_non_finite(&e), 256);
    // They rank last: the lower median is the largest of the others.
    let threshold = mask.threshold(&e, &mut vec![]);
    assert_eq!(threshold, e[511]);
    let w = weights(&mask, &e, threshold);
    assert!(w[..256].iter().all(|&w| w == 0.0) && w[256..].iter().all(|&w| w == 1.0));
    // More than half: everything that is a number is an inlier, nothing else.
    e[256..300].fill(f32::NAN);
    let threshold = mask.threshold(&e, &mut vec![]);
    assert_eq!(threshold, f32::INFINITY);
    let w = weights(&only_trim(mask), &e, threshold);
    assert!(w.iter().zip(&e).all(|(&w, e)| (w == 1.0) == e.is_finite()));
    // All of it: nothing learns, and the loss is 0, not 0/0.
    let w = run(&mask, &[f32::NAN; 256]);
    assert!(w.iter().all(|&w| w == 0.0));
    let (p, t) = (vec![[0.5; 3]; 256], vec![[0.1; 3]; 256]);
    assert_eq!(photometric::mean(Kernel::Squared, &p, &t, Some(&w)), Ok(0.0));
}

#[test]
fn memory_is_kept() {
    let mask = TrimmedMask::default();
    let e: Vec<f32> = (0..64).flat_map(|_| calm()).collect();
    let (mut scratch, mut out) = (vec![], vec![0.0; e.len()]);
    let mut both = || {
        let threshold = mask.threshold(&e, &mut scratch);
        mask.weights(&e, threshold, &mut scratch, &mut out).unwrap();
        (scratch.as_ptr(), scratch.capacity())
    };
    let warm = both();
    assert_eq!(both(), warm);
}

#[test]
fn empty_batches_and_wrong_arguments() {
    let mask = TrimmedMask::default();
    assert_eq!(mask.threshold(&[], &mut vec![]), f32::INFINITY);
    assert!(weights(&mask, &[], 1.0).is_empty());
    let call = |mask: TrimmedMask, n: usize, m: usize| mask.weights(&vec![0.0; n], 1.0, &mut vec![], &mut vec![0.0; m]);
    assert_eq!(call(mask, 300, 300), Err(LossError::Shape { what: "residuals", want: 512, got: 300 }));
    assert_eq!(call(mask, 256, 255), Err(LossError::Shape { what: "out", want: 256, got: 255 }));
    let bad = [
        mask.with_quantile(1.5),
        mask.with_diffuse(f32::NAN),
        mask.with_vote(-0.1),
        mask.with_patch(0),
        mask.with_inner(17),
        // Its square wraps to 0 in 64 bits.
        mask.with_patch(1 << (usize::BITS / 2)),
        mask.with_patch(usize::MAX),
    ];
    for mask in bad {
        assert!(matches!(call(mask, 256, 256), Err(LossError::Parameter { .. })), "{mask:?}");
    }
    assert_eq!(call(mask.with_patch(1 << (usize::BITS / 2 - 1)), 0, 0), Ok(()));
    let error = bad[4].check().unwrap_err();
    assert_eq!(error.to_string(), "`inner` of the trimmed mask is 17, expected at most `patch`");
}
