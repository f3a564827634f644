//! Superpixels: they follow edges, are connected, and depend on nothing but the photo.

use losses::LossError;
use losses::heuristics::Extent;
use losses::heuristics::superpixels::{Superpixels, lab};
use proptest::prelude::*;

fn cut(extent: Extent, rgb: &[[f32; 3]], count: usize) -> (usize, Vec<u16>) {
    let mut labels = vec![7; rgb.len()];
    let found = Superpixels::default().with_count(count).run(extent, rgb, &mut labels).unwrap();
    (found, labels)
}

/// Pieces in the order of their first pixels, by flooding; panics where a label is in two of them.
fn check_connected(extent: Extent, labels: &[u16], count: usize) {
    let mut seen = vec![false; labels.len()];
    let mut next = 1;
    for first in 0..labels.len() {
        if seen[first] {
            continue;
        }
        assert_eq!(usize::from(labels[first]), next, "pixel {first}");
        next += 1;
        let mut stack = vec![first];
        while let Some(i) = stack.pop() {
            if seen[i] || labels[i] != labels[first] {
                continue;
            }
            seen[i] = true;
            let (x, y) = (i % extent.width, i / extent.width);
            if x > 0 {
                stack.push(i - 1);
            }
            if x + 1 < extent.width {
                stack.push(i + 1);
            }
            if y > 0 {
                stack.push(i - extent.width);
            }
            if y + 1 < extent.height {
                stack.push(i + extent.width);
            }
        }
    }
    assert_eq!(next - 1, count);
}

#[test]
fn known_colours_of_cielab() {
    // Published values of the primaries of sRGB under D65.
    for (srgb, want) in [
        ([1.0, 1.0, 1.0], [100.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([1.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
        ([0.0, 1.0, 0.0], [87.73, -86.18, 83.18]),
        ([0.0, 0.0, 1.0], [32.30, 79.19, -107.86]),
        ([0.5, 0.5, 0.5], [53.39, 0.0, 0.0]),
    ] {
        let got = lab(srgb);
        assert!(got.iter().zip(want).all(|(a, b): (&f32, f32)| (a - b).abs() < 0.02), "{srgb:?}: {got:?} {want:?}");
    }
}

#[test]
fn pieces_do_not_cross_a_strong_edge() {
    let extent = Extent { width: 61, height: 47 };
    // A disc on a background.
    let inside = |i: usize| {
        let (x, y) = ((i % 61) as f32 - 33.0, (i / 61) as f32 - 20.0);
        x * x + y * y < 144.0
    };
    let rgb: Vec<[f32; 3]> =
        (0..extent.pixels()).map(|i| if inside(i) { [0.9, 0.2, 0.1] } else { [0.1, 0.3, 0.5] }).collect();
    let (count, labels) = cut(extent, &rgb, 60);
    assert!((30..=90).contains(&count), "{count}");
    check_connected(extent, &labels, count);
    let mut sides = vec![[0_usize; 2]; count + 1];
    labels.iter().enumerate().for_each(|(i, &label)| sides[usize::from(label)][usize::from(inside(i))] += 1);
    let wrong: usize = sides.iter().map(|[a, b]| a.min(b)).sum();
    assert!(wrong * 100 < extent.pixels(), "{wrong} pixels on the wrong side");
}

#[test]
fn one_colour_is_cut_into_squares() {
    let extent = Extent { width: 40, height: 40 };
    let (count, labels) = cut(extent, &vec![[0.4; 3]; 1600], 16);
    assert_eq!(count, 16);
    check_connected(extent, &labels, count);
    let mut sizes = vec![0; 17];
    labels.iter().for_each(|&l| sizes[usize::from(l)] += 1);
    assert!(sizes[1..].iter().all(|size| (70..=140).contains(size)), "{sizes:?}");
}

#[test]
fn empty_tiny_and_broken_photos_are_legal() {
    assert_eq!(cut(Extent { width: 0, height: 5 }, &[], 10), (0, vec![]));
    assert_eq!(cut(Extent { width: 1, height: 1 }, &[[0.5; 3]], 10), (1, vec![1]));
    let (count, labels) = cut(Extent { width: 3, height: 2 }, &[[f32::NAN; 3]; 6], 2);
    check_connected(Extent { width: 3, height: 2 }, &labels, count);
    // As many pieces as pixels.
    let rgb: Vec<[f32; 3]> = (0..12).map(|i| [i as f32 / 12.0, 0.0, 0.0]).collect();
    let extent = Extent { width: 4, height: 3 };
    let (count, labels) = cut(extent, &rgb, 65535);
    check_connected(extent, &labels, count);
}

#[test]
fn parameters_outside_their_range_are_refused() {
    let (extent, rgb) = (Extent { width: 2, height: 1 }, [[0.0; 3]; 2]);
    let run = |s: Superpixels, n: usize| s.run(extent, &rgb, &mut vec![0; n]).unwrap_err();
    let good = Superpixels::default();
    assert!(matches!(run(good, 3), LossError::Shape { .. }));
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(run(good.with_compactness(bad), 2), LossError::Parameter { .. }));
    }
    for bad in [0, 65536] {
        assert!(matches!(run(good.with_count(bad), 2), LossError::Parameter { .. }));
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn pieces_of_any_photo_are_connected_and_cover_it(
        width in 1_usize..24, height in 1_usize..24, count in 1_usize..80, seed in prop::collection::vec(0_u8..=255, 576 * 3)
    ) {
        let extent = Extent { width, height };
        let rgb: Vec<[f32; 3]> =
            seed.chunks_exact(3).take(extent.pixels()).map(|c| [0, 1, 2].map(|k| f32::from(c[k]) / 255.0)).collect();
        let (found, labels) = cut(extent, &rgb, count);
        prop_assert!(labels.iter().all(|&l| (1..=found).contains(&usize::from(l))));
        check_connected(extent, &labels, found);
    }
}
