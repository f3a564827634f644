//! Static masks from clues: every step against its definition, what the steps promise, awkward images.

use losses::LossError;
use losses::heuristics::points::{disc_radius, discs, min_track, segments_at, union};
use losses::heuristics::{
    Extent, Scratch, Segments, StaticMask, VoteScratch, close, combine, erode, fill_gaps, grow, residual_masks, smooth,
    vote,
};
use proptest::prelude::*;

/// The definitions, pixel by pixel.
mod naive {
    use super::Extent;

    /// `mask or [mean of the mirrored window >= 1/2]`.
    pub(crate) fn smooth(extent: Extent, side: usize, mask: &[u8]) -> Vec<u8> {
        let mirror = |i: isize, n: usize| {
            let last = n as isize - 1;
            let mut i = i;
            // One reflection after the other.
            while last > 0 && !(0..=last).contains(&i) {
                i = if i < 0 { -i } else { 2 * last - i };
            }
            if last == 0 { 0 } else { i as usize }
        };
        let half = (side / 2) as isize;
        each(extent, |y, x| {
            let mut sum = 0.0;
            for dy in -half..=half {
                for dx in -half..=half {
                    let (y, x) = (mirror(y as isize + dy, extent.height), mirror(x as isize + dx, extent.width));
                    sum += f64::from(mask[y * extent.width + x].min(1));
                }
            }
            mask[y * extent.width + x] != 0 || sum / (side * side) as f64 >= 0.5
        })
    }

    /// Static where no pixel of the window (within the image) is not.
    pub(crate) fn erode(extent: Extent, side: usize, mask: &[u8]) -> Vec<u8> {
        each(extent, |y, x| {
            let near = |a: usize, b: usize| a.abs_diff(b) <= side / 2;
            (0..extent.pixels())
                .filter(|i| near(i / extent.width, y) && near(i % extent.width, x))
                .all(|i| mask[i] != 0)
        })
    }

    /// Components of the pixels marked: every pixel takes the smallest index among its neighbours until none changes.
    pub(crate) fn components(extent: Extent, marked: &[bool]) -> Vec<Vec<usize>> {
        let mut id: Vec<usize> = (0..marked.len()).collect();
        loop {
            let before = id.clone();
            for i in (0..id.len()).filter(|&i| marked[i]) {
                for j in (0..id.len()).filter(|&j| marked[j]) {
                    let (a, b) = ((i / extent.width, i % extent.width), (j / extent.width, j % extent.width));
                    if a.0.abs_diff(b.0) <= 1 && a.1.abs_diff(b.1) <= 1 {
                        id[i] = id[i].min(id[j]);
                    }
                }
            }
            if id == before {
                break;
            }
        }
        let roots = (0..id.len()).filter(|&i| marked[i] && id[i] == i);
        roots.map(|root| (0..id.len()).filter(|&i| marked[i] && id[i] == root).collect()).collect()
    }

    /// Segments as lists of pixels.
    pub(crate) fn vote(pixels: usize, segments: &[Vec<usize>], mask: &[u8], share: f64) -> Vec<u8> {
        let mut out = vec![0; pixels];
        for segment in segments.iter().filter(|s| !s.is_empty()) {
            let kept = segment.iter().filter(|&&i| mask[i] != 0).count();
            if kept as f64 / segment.len() as f64 >= share {
                segment.iter().for_each(|&i| out[i] = 1);
            }
        }
        out
    }

    fn each(extent: Extent, f: impl Fn(usize, usize) -> bool) -> Vec<u8> {
        (0..extent.pixels()).map(|i| u8::from(f(i / extent.width, i % extent.width))).collect()
    }
}

fn any_extent() -> impl Strategy<Value = Extent> {
    (1_usize..13, 1_usize..13).prop_map(|(width, height)| Extent { width, height })
}

/// An image's size, a mask (static are 1 and 255), and labels of a few segments with unassigned pixels.
fn any_case() -> impl Strategy<Value = (Extent, Vec<u8>, Vec<u16>)> {
    any_extent().prop_flat_map(|extent| {
        let mask = prop::collection::vec(prop_oneof![Just(0_u8), Just(0), Just(1), Just(255)], extent.pixels());
        let labels = prop::collection::vec(
            prop_oneof![3 => Just(0_u16), 1 => Just(7), 1 => Just(2), 1 => Just(65535)],
            extent.pixels(),
        );
        (Just(extent), mask, labels)
    })
}

/// Left and right exchanged.
fn mirrored<T: Copy>(extent: Extent, x: &[T]) -> Vec<T> {
    x.chunks_exact(extent.width).flat_map(|row| row.iter().rev().copied()).collect()
}

fn voted(extent: Extent, segments: Segments<'_>, mask: &[u8], share: f32) -> Vec<u8> {
    let mut out = vec![9; mask.len()];
    vote(extent, segments, mask, share, &mut VoteScratch::default(), &mut out).unwrap();
    out
}

fn within(a: &[u8], b: &[u8]) -> bool {
    a.iter().zip(b).all(|(&a, &b)| a == 0 || b != 0)
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn windows_match_definition((extent, mask, _) in any_case(), half in 0_usize..4) {
        let side = 2 * half + 1;
        let (mut scratch, mut out) = (vec![], vec![9; mask.len()]);
        smooth(extent, side, &mask, &mut scratch, &mut out).unwrap();
        prop_assert_eq!(&out, &naive::smooth(extent, side, &mask));
        prop_assert!(within(&mask, &out), "smoothing took something out");
        erode(extent, side, &mask, &mut scratch, &mut out).unwrap();
        prop_assert_eq!(&out, &naive::erode(extent, side, &mask));
        prop_assert!(within(&out, &mask), "erosion added something");
        fill_gaps(extent, &mask, &mut scratch, &mut out).unwrap();
        prop_assert_eq!(&out, &naive::smooth(extent, 5, &mask));
    }

    #[test]
    fn gaps_are_closed_by_their_definition((extent, mask, _) in any_case(), half in 0_usize..4) {
        let (mut out, inverse) = (vec![9; mask.len()], |m: &[u8]| m.iter().map(|&m| u8::from(m == 0)).collect::<Vec<_>>());
        close(extent, 2 * half + 1, &mask, &mut vec![], &mut out).unwrap();
        let wide = naive::erode(extent, 2 * half + 1, &mask);
        prop_assert_eq!(&out, &inverse(&naive::erode(extent, 2 * half + 1, &inverse(&wide))));
        prop_assert!(within(&out, &mask), "closing made something static");
        let mut twice = vec![9; mask.len()];
        close(extent, 2 * half + 1, &out, &mut vec![], &mut twice).unwrap();
        prop_assert_eq!(&out, &twice);
    }

    #[test]
    fn what_hangs_together_is_left_out_together(
        (extent, mask, _) in any_case(),
        seed in prop::collection::vec(prop_oneof![4 => 0.0_f32..1.0, 1 => Just(f32::NAN)], 144),
    ) {
        let n = extent.pixels();
        let (r, mut got) = (&seed[..n], mask.clone());
        grow(extent, r, 0.5, &mut got).unwrap();
        // The pieces of what errs or is left out that hold something left out; what is left out stays so.
        let marked: Vec<bool> = (0..n).map(|i| mask[i] == 0 || r[i] > 0.5).collect();
        for piece in naive::components(extent, &marked) {
            let out = piece.iter().any(|&i| mask[i] == 0);
            prop_assert!(piece.iter().all(|&i| (got[i] == 0) == out));
        }
        prop_assert!((0..n).all(|i| marked[i] || got[i] == mask[i]));
        // Nothing left out, or nothing errs: nothing grows.
        let mut all = vec![1; n];
        grow(extent, r, 0.5, &mut all).unwrap();
        prop_assert!(all.iter().all(|&m| m == 1));
        let mut same = mask.clone();
        grow(extent, r, f32::INFINITY, &mut same).unwrap();
        prop_assert_eq!(same, mask);
        prop_assert!(grow(extent, &[0.0; 0], 0.5, &mut all).is_err() || n == 0);
    }

    #[test]
    fn votes_match_definition((extent, mask, labels) in any_case(), share in 1_u8..=64) {
        let n = extent.pixels();
        let of = |label: u16| (0..n).filter(|&i| labels[i] == label).collect::<Vec<_>>();
        let unassigned: Vec<bool> = labels.iter().map(|&l| l == 0).collect();
        let mut segments = naive::components(extent, &unassigned);
        segments.extend([2, 7, 65535].map(of));
        let share = f32::from(share) / 64.0;
        let want = naive::vote(n, &segments, &mask, share.into());
        prop_assert_eq!(voted(extent, Segments::Labels(&labels), &mask, share), want.clone());
        // The same partition as masks.
        let stack: Vec<Vec<u8>> = [2, 7, 65535, 9].map(|l| labels.iter().map(|&x| u8::from(x == l)).collect()).to_vec();
        let stack: Vec<&[u8]> = stack.iter().map(Vec::as_slice).collect();
        prop_assert_eq!(voted(extent, Segments::Stack(&stack), &mask, share), want);
    }

    #[test]
    fn overlapping_segments_need_one_winner((extent, mask, labels) in any_case(), cut in 0_usize..12) {
        // Two half planes that overlap in a column, and an empty one.
        let left: Vec<u8> = (0..labels.len()).map(|i| u8::from(i % extent.width <= cut)).collect();
        let right: Vec<u8> = (0..labels.len()).map(|i| u8::from(i % extent.width >= cut)).collect();
        let empty = vec![0; labels.len()];
        let got = voted(extent, Segments::Stack(&[&left, &right, &empty]), &mask, 0.5);
        let pixels = |s: &[u8]| (0..s.len()).filter(|&i| s[i] != 0).collect::<Vec<_>>();
        prop_assert_eq!(got, naive::vote(labels.len(), &[pixels(&left), pixels(&right)], &mask, 0.5));
    }

    #[test]
    fn voting_twice_changes_nothing((extent, mask, labels) in any_case(), share in 1_u8..=64) {
        let share = f32::from(share) / 64.0;
        let once = voted(extent, Segments::Labels(&labels), &mask, share);
        prop_assert_eq!(voted(extent, Segments::Labels(&labels), &once, share), once);
    }

    #[test]
    fn shares_at_their_ends((extent, mask, labels) in any_case()) {
        let least = voted(extent, Segments::Labels(&labels), &mask, f32::MIN_POSITIVE);
        // Every segment that is touched is kept: all that is static before is after.
        prop_assert!(within(&mask, &least));
        let most = voted(extent, Segments::Labels(&labels), &mask, 1.0);
        // Only segments that are covered: nothing new.
        prop_assert!(within(&most, &mask));
        let pixels = voted(extent, Segments::Pixels, &mask, 0.5);
        prop_assert_eq!(pixels, mask.iter().map(|&m| m.min(1)).collect::<Vec<_>>());
    }

    #[test]
    fn errors_make_nested_masks(
        r in prop::collection::vec(prop_oneof![8 => 0.0_f32..1.0, 1 => Just(1e6_f32), 1 => Just(f32::NAN)], 1..200),
        quantile in 0_u8..=20,
    ) {
        let quantile = f32::from(quantile) / 20.0;
        let (mut h_cr, mut h_most) = (vec![9; r.len()], vec![9; r.len()]);
        residual_masks(&r, quantile, &mut vec![], &mut h_cr, &mut h_most).unwrap();
        prop_assert!(within(&h_cr, &h_most));
        let finite: Vec<f64> = r.iter().filter(|r| r.is_finite()).map(|&r| r.into()).collect();
        let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
        for (i, &r) in r.iter().enumerate() {
            let r = f64::from(r);
            if (r - mean).abs() > 1e-8 {
                prop_assert_eq!(h_cr[i] != 0, r < mean, "{} with mean {}", r, mean);
            }
            prop_assert!(h_most[i] == 0 || r.is_finite());
        }
        // The unit does not matter.
        let (mut other_cr, mut other_most) = (vec![9; r.len()], vec![9; r.len()]);
        let scaled: Vec<f32> = r.iter().map(|r| r * 2.0_f32.powi(-60)).collect();
        residual_masks(&scaled, quantile, &mut vec![], &mut other_cr, &mut other_most).unwrap();
        prop_assert!(other_cr == h_cr && other_most == h_most);
        // At least the share is kept, less what is not a number.
        let kept = h_most.iter().filter(|&&h| h != 0).count();
        let wanted = (f64::from(quantile) * (1.0 - 1e-6) * r.len() as f64).ceil() as usize;
        prop_assert!(kept >= wanted.min(finite.len()), "{kept} of {wanted}");
    }

    #[test]
    fn all_steps_commute_with_mirrors(
        (extent, h_sfm, labels) in any_case(),
        seed in prop::collection::vec(0.0_f32..1.0, 144),
    ) {
        let r = &seed[..extent.pixels()];
        let run = |h: &[u8], r: &[f32], labels: &[u16]| {
            let mut out = vec![9; h.len()];
            let (mask, mut scratch) = (StaticMask::default(), Scratch::default());
            mask.run(extent, h, r, Segments::Labels(labels), &mut scratch, &mut out).unwrap();
            out
        };
        let there = mirrored(extent, &run(&h_sfm, r, &labels));
        let flipped = run(&mirrored(extent, &h_sfm), &mirrored(extent, r), &mirrored(extent, &labels));
        prop_assert_eq!(flipped, there);
    }

    #[test]
    fn longer_tracks_can_only_shrink_what_is_static(
        tracks in prop::collection::vec((0.0_f32..40.0, 0.0_f32..30.0, 1_usize..60), 0..12),
        r in prop::collection::vec(0.0_f32..1.0, 40 * 30),
        low in 0.0_f32..1.0,
        more in 0.0_f32..1.0,
    ) {
        let extent = Extent { width: 40, height: 30 };
        let of = |t_sfm: f32| {
            let least = min_track(t_sfm.min(1.0), 60).unwrap();
            let points: Vec<[f32; 2]> =
                tracks.iter().filter(|(_, _, length)| *length >= least).map(|&(x, y, _)| [x, y]).collect();
            let (mut h_sfm, mut h_cr, mut h_most) = (vec![9; 1200], vec![9; 1200], vec![9; 1200]);
            discs(extent, &points, 3.0, &mut h_sfm).unwrap();
            residual_masks(&r, 0.95, &mut vec![], &mut h_cr, &mut h_most).unwrap();
            let mut out = vec![9; 1200];
            combine(&h_sfm, &h_cr, &h_most, &mut out).unwrap();
            for i in 0..1200 {
                assert_eq!(out[i] == 1, (h_sfm[i] == 1 || h_cr[i] == 1) && h_most[i] == 1);
            }
            out
        };
        prop_assert!(within(&of(low + more), &of(low)));
    }

    #[test]
    fn discs_match_definition(
        extent in any_extent(),
        points in prop::collection::vec([-3.0_f32..15.0, -3.0_f32..15.0], 0..4),
        radius in 0.0_f32..6.0,
    ) {
        let mut out = vec![9; extent.pixels()];
        discs(extent, &points, radius, &mut out).unwrap();
        let inside = |p: &&[f32; 2]| {
            (0.0..extent.width as f32).contains(&p[0]) && (0.0..extent.height as f32).contains(&p[1])
        };
        for (i, &got) in out.iter().enumerate() {
            let (y, x) = (i / extent.width, i % extent.width);
            let near = |p: &[f32; 2]| {
                let (dx, dy) = (x as f64 + 0.5 - f64::from(p[0]), y as f64 + 0.5 - f64::from(p[1]));
                (dx * dx + dy * dy).sqrt() <= f64::from(radius) || (p[0] as usize == x && p[1] as usize == y)
            };
            prop_assert_eq!(got == 1, points.iter().filter(inside).any(near), "pixel {} {}", x, y);
        }
    }
}

/// A 60 x 40 picture: a wall with fine texture (errs as much as occluders do, has tracks), an occluder, calm ground.
struct Street {
    extent: Extent,
    truth: Vec<u8>,
    labels: Vec<u16>,
    r: Vec<f32>,
    points: Vec<[f32; 2]>,
}

fn street() -> Street {
    let extent = Extent { width: 60, height: 40 };
    let occluder = |x: usize, y: usize| (30..42).contains(&x) && (12..34).contains(&y);
    let mut out = Street { extent, truth: vec![], labels: vec![], r: vec![], points: vec![] };
    for (y, x) in (0..40).flat_map(|y| (0..60).map(move |x| (y, x))) {
        let noise = ((x * 31 + y * 17) % 11) as f32 / 11.0;
        let (label, r) = match (occluder(x, y), y < 10) {
            // Ragged: a sixth of the occluder looks like what is behind.
            (true, _) => (3, if (x + 2 * y) % 6 == 0 { 0.02 } else { 0.6 + 0.2 * noise }),
            // Texture.
            (_, true) => (1, 0.3 + 0.1 * noise),
            _ => (2, 0.02 * noise),
        };
        out.truth.push(u8::from(label != 3));
        out.labels.push(label);
        out.r.push(r);
        if label == 1 && x % 4 == 1 && y % 4 == 1 {
            out.points.push([x as f32 + 0.3, y as f32 + 0.8]);
        }
    }
    out
}

#[test]
fn an_occluder_before_a_textured_wall_is_found() {
    let Street { extent, truth, labels, r, points } = street();
    let mut h_sfm = vec![0; r.len()];
    segments_at(extent, &labels, &points, &mut h_sfm).unwrap();
    assert!(h_sfm.iter().zip(&labels).all(|(&h, &l)| h == u8::from(l == 1)));
    let run = |h_sfm: &[u8], segments: Segments<'_>| {
        let (mask, mut out) = (StaticMask::default().with_erode(1), vec![9; r.len()]);
        mask.run(extent, h_sfm, &r, segments, &mut Scratch::default(), &mut out).unwrap();
        out
    };
    // Tracks and errors together, by segment: exactly the occluder.
    assert!(run(&h_sfm, Segments::Labels(&labels)) == truth);
    // Discs where there are no segments for points do as well here.
    let mut by_discs = vec![0; r.len()];
    discs(extent, &points, 3.0, &mut by_discs).unwrap();
    assert!(run(&by_discs, Segments::Labels(&labels)) == truth);
    // Without tracks the wall goes with the occluder; without segments some of the occluder stays.
    let without = run(&vec![0; r.len()], Segments::Labels(&labels));
    assert!((0..600).all(|i| without[i] == 0));
    let ragged = run(&h_sfm, Segments::Pixels);
    assert!(!within(&ragged, &truth) && within(&truth, &ragged));
    // Erosion keeps a distance of two pixels.
    let mut careful = vec![9; r.len()];
    StaticMask::default()
        .run(extent, &h_sfm, &r, Segments::Labels(&labels), &mut Scratch::default(), &mut careful)
        .unwrap();
    assert!(careful == naive::erode(extent, 5, &truth));
}

#[test]
fn equal_errors_are_all_static() {
    // Sums of equal numbers round: 0.1 ten thousand times.
    for value in [0.0_f32, 0.1, 1.0 / 3.0, 0.7] {
        let r = vec![value; 10_000];
        let (mut h_cr, mut h_most) = (vec![9; r.len()], vec![9; r.len()]);
        residual_masks(&r, 0.95, &mut vec![], &mut h_cr, &mut h_most).unwrap();
        assert!(h_cr.iter().chain(&h_most).all(|&h| h == 1), "{value}");
    }
}

#[test]
fn a_mean_above_the_quantile_does_not_lose_what_is_below_it() {
    // One huge error: the mean is above all others.
    let mut r = vec![0.1_f32; 100];
    (0..10).for_each(|i| r[i] = 0.2);
    r[50] = 1e4;
    let (mut h_cr, mut h_most) = (vec![9; 100], vec![9; 100]);
    residual_masks(&r, 0.5, &mut vec![], &mut h_cr, &mut h_most).unwrap();
    assert!((0..100).all(|i| h_cr[i] == u8::from(i != 50) && h_most[i] == h_cr[i]));
}

#[test]
fn tracks_need_two_photos() {
    let of = |t, n| min_track(t, n).unwrap();
    assert_eq!([of(0.2, 200), of(0.2, 5), of(0.01, 20), of(0.0, 500), of(0.2, 12), of(1.0, 7)], [40, 2, 2, 2, 3, 7]);
    assert!(min_track(f32::NAN, 5).is_err() && min_track(1.5, 5).is_err());
    assert_eq!(disc_radius(Extent { width: 800, height: 400 }), 4.0);
}

#[test]
fn points_that_are_nowhere_do_not_count() {
    let extent = Extent { width: 4, height: 3 };
    let nowhere = [[f32::NAN, 1.0], [-0.1, 1.0], [4.0, 1.0], [1.0, 3.0], [f32::INFINITY, 0.0]];
    let (labels, mut out) = ([0, 5, 5, 65535, 0, 0, 0, 0, 0, 0, 0, 1], vec![9; 12]);
    discs(extent, &nowhere, 2.0, &mut out).unwrap();
    assert_eq!(out, [0; 12]);
    segments_at(extent, &labels, &nowhere, &mut out).unwrap();
    assert_eq!(out, [0; 12]);
    // Unassigned is not a segment; the last label there can be is one.
    segments_at(extent, &labels, &[[0.5, 0.5], [3.9, 0.0], [1.0, 0.9]], &mut out).unwrap();
    assert_eq!(out, [0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0]);
    union(extent, &[&[0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 9]], &mut out).unwrap();
    assert_eq!(out, [1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    union(extent, &[], &mut out).unwrap();
    assert_eq!(out, [0; 12]);
}

#[test]
fn empty_images_and_wrong_arguments() {
    let none = Extent { width: 0, height: 0 };
    let (mask, mut scratch) = (StaticMask::default(), Scratch::default());
    mask.run(none, &[], &[], Segments::Labels(&[]), &mut scratch, &mut []).unwrap();
    mask.run(none, &[], &[], Segments::Stack(&[]), &mut scratch, &mut []).unwrap();
    let extent = Extent { width: 2, height: 2 };
    let mut out = [9; 4];
    let short = mask.run(extent, &[1; 4], &[0.0; 4], Segments::Labels(&[1; 3]), &mut scratch, &mut out);
    assert_eq!(short, Err(LossError::Shape { what: "labels", want: 4, got: 3 }));
    let short = mask.run(extent, &[1; 4], &[0.0; 4], Segments::Stack(&[&[1; 5]]), &mut scratch, &mut out);
    assert_eq!(short, Err(LossError::Shape { what: "segment", want: 4, got: 5 }));
    let bad = [
        mask.with_share(0.0),
        mask.with_share(f32::NAN),
        mask.with_quantile(1.1),
        mask.with_smooth(4),
        mask.with_erode(0),
    ];
    for mask in bad {
        let result = mask.run(extent, &[1; 4], &[0.0; 4], Segments::Pixels, &mut scratch, &mut out);
        assert!(matches!(result, Err(LossError::Parameter { .. })), "{mask:?}");
    }
    assert!(discs(extent, &[], f32::NAN, &mut out).is_err());
}
