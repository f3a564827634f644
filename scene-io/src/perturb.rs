//! Clean scenes made wild: the perturbation study of NeRF in the Wild on synthetic scenes.
//!
//! Martin-Brualla et al., "NeRF in the Wild", 2021, section 4.1, with the constants of its open reimplementation
//! (nerf_pl), and random numbers of our own: view `n` of the training split draws numbers
//! `random(seed, 64 n + k)` in `[0, 1)`, SplitMix64 of seed and index.
//!
//! | draws `k` | what |
//! | --- | --- |
//! | 0, 1, 2 | scale of red, green, blue: `0.8 + 0.4 u` |
//! | 3, 4, 5 | offset of red, green, blue: `-0.2 + 0.4 u` |
//! | 8, 9 | left and top of the bars: the pixel that `(1 + u) / 4` of width and height fall into |
//! | 16 ..= 45 | red, green, blue of the ten bars: the whole part of `256 u` |
//!
//! Colours change first: each straight colour value becomes `scale * v + offset`, clipped to `[0, 1]` and rounded to 8 bits.
//! Then the bars, next to each other, each 1/40 of the width wide and 1/4 of the height tall (edges rounded down to whole
//! pixels), are pasted over the picture, opaque also where it is transparent. The first training view and all other splits
//! stay as they are. All this happens at the picture's native size, when it is decoded.

use crate::perturbation::{Perturbation, PerturbationKind};
use crate::priors::TruthMask;
use crate::{Scene, Split};
use std::sync::Arc;

/// The scene with its training views perturbed, but for the first of them; truth masks show the occluders.
#[must_use]
pub fn perturb(mut scene: Scene, what: PerturbationKind, seed: u64) -> Scene {
    let training: Vec<usize> = scene.split(Split::Train).collect();
    for (view, index) in training.iter().enumerate() {
        let frame = &mut scene.frames[*index];
        let (width, height) = (frame.camera.width, frame.camera.height);
        let perturbation = Perturbation::of(view, width, height, what, seed);
        if what != PerturbationKind::Colour {
            frame.truth.transient = Some(TruthMask::Bars(perturbation.as_ref().and_then(|p| p.bars)));
        }
        frame.perturbation = perturbation.map(Arc::new);
    }
    scene.notes.push(format!(
        "{} of {} training views are perturbed ({}, seed {seed})",
        training.len().saturating_sub(1),
        training.len(),
        match what {
            PerturbationKind::Colour => "colours",
            PerturbationKind::Occluder => "occluders",
            PerturbationKind::Both => "colours and occluders",
        }
    ));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{TabletopOptions, tabletop};
    use crate::{Frame, Image, ImageSource, ImageStore, StoreOptions};
    use proptest::prelude::*;

    fn scene() -> Scene {
        tabletop(&TabletopOptions { width: 80, height: 40, train: 4, test: 2, rays: 1, ..TabletopOptions::default() })
    }

    fn native(frame: &Frame) -> &Image {
        match &frame.image {
            ImageSource::Memory(image) => image,
            ImageSource::File(path) => panic!("{} is a file", path.display()),
        }
    }

    fn images(scene: &Scene, longest_side: Option<u32>) -> Vec<Arc<Image>> {
        let store = ImageStore::new(&scene.frames, StoreOptions { longest_side, ..StoreOptions::default() }).unwrap();
        (0..store.len()).map(|i| store.get(i).unwrap()).collect()
    }

    #[test]
    fn occluders_are_exactly_where_the_truth_says_and_nothing_else_changes() {
        let scene = perturb(scene(), PerturbationKind::Occluder, 0);
        for (i, (frame, image)) in scene.frames.iter().zip(images(&scene, None)).enumerate() {
            if frame.split == Split::Test {
                assert!(frame.truth.transient.is_none() && frame.perturbation.is_none());
                assert_eq!(&*image, native(frame));
                continue;
            }
            let truth = frame.read_transient().unwrap().unwrap();
            assert_eq!(truth.count(), if i == 0 { 0 } else { 20 * 10 }, "a quarter of each side");
            for (column, row) in (0..40).flat_map(|y| (0..80).map(move |x| (x, y))) {
                let (now, before) = (image.pixel(column, row), native(frame).pixel(column, row));
                if truth.get(column, row) {
                    let bars = frame.perturbation.as_ref().unwrap().bars.unwrap();
                    let bar = ((column - bars.left) / 2) as usize;
                    assert_eq!((&now[..3], now[3]), (&bars.colours[bar][..], 255));
                } else {
                    assert_eq!(now, before);
                }
            }
        }
    }

    #[test]
    fn colours_change_as_written_and_both_is_one_after_the_other() {
        let (colour, both) =
            (perturb(scene(), PerturbationKind::Colour, 0), perturb(scene(), PerturbationKind::Both, 0));
        let occluder = perturb(scene(), PerturbationKind::Occluder, 0);
        let (a, b) = (images(&colour, None), images(&both, None));
        for i in 1..4 {
            let change = colour.frames[i].perturbation.as_ref().unwrap().colour.unwrap();
            assert!(colour.frames[i].truth.transient.is_none());
            let before = native(&colour.frames[i]);
            for (now, before) in a[i].data.chunks_exact(4).zip(before.data.chunks_exact(4)) {
                for c in 0..3 {
                    let want = (f64::from(before[c]) / 255.0 * change.scale[c] + change.offset[c]).clamp(0.0, 1.0);
                    assert!((f64::from(now[c]) / 255.0 - want).abs() <= 0.5 / 255.0 + 1e-12);
                }
                assert_eq!(now[3], before[3]);
            }
            assert_eq!(both.frames[i].perturbation.as_ref().unwrap().colour, Some(change));
            let bars = both.frames[i].perturbation.as_ref().unwrap().bars.unwrap();
            assert_eq!(occluder.frames[i].perturbation.as_ref().unwrap().bars, Some(bars));
            let mut pasted = Image::clone(&a[i]);
            Perturbation { colour: None, bars: Some(bars) }.apply(&mut pasted);
            assert_eq!(pasted, *b[i]);
        }
    }

    #[test]
    fn pictures_are_perturbed_before_they_are_scaled_and_fingerprints_differ() {
        let scene = perturb(scene(), PerturbationKind::Both, 0);
        for (small, full) in images(&scene, Some(20)).iter().zip(images(&scene, None)) {
            assert_eq!(**small, full.resized(20, 10));
        }
        let prints: Vec<String> = [PerturbationKind::Colour, PerturbationKind::Occluder, PerturbationKind::Both]
            .into_iter()
            .flat_map(|what| [0, 1].map(|seed| perturb(self::scene(), what, seed).fingerprint()))
            .chain([self::scene().fingerprint()])
            .collect();
        let different: std::collections::HashSet<_> = prints.iter().collect();
        assert_eq!(different.len(), prints.len());
    }

    /// The generator is fixed: other numbers would be another protocol.
    #[test]
    fn the_numbers_of_seed_0_never_change() {
        let p = Perturbation::of(1, 400, 400, PerturbationKind::Both, 0).unwrap();
        let (colour, bars) = (p.colour.unwrap(), p.bars.unwrap());
        assert_eq!((bars.left, bars.top, bars.colours[0]), GOLDEN_BARS);
        let close = colour.scale.iter().zip(GOLDEN_SCALE).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close, "{:?}", colour.scale);
        let close = colour.offset.iter().zip(GOLDEN_OFFSET).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close, "{:?}", colour.offset);
    }

    const GOLDEN_BARS: (u32, u32, [u8; 3]) = (136, 194, [150, 70, 61]);
    const GOLDEN_SCALE: [f64; 3] = [0.8663782, 0.9100425, 0.9034629];
    const GOLDEN_OFFSET: [f64; 3] = [0.0195930, -0.1203328, 0.0474623];

    proptest! {
        #![proptest_config(testkit::property::cases(128))]

        #[test]
        fn perturbations_stay_in_their_ranges(view in 1_usize..500, w in 1_u32..900, h in 1_u32..900, seed: u64) {
            let p = Perturbation::of(view, w, h, PerturbationKind::Both, seed).unwrap();
            let (colour, bars) = (p.colour.unwrap(), p.bars.unwrap());
            prop_assert!(colour.scale.iter().all(|s| (0.8..1.2).contains(s)));
            prop_assert!(colour.offset.iter().all(|b| (-0.2..0.2).contains(b)));
            prop_assert!((w / 4..=w / 2).contains(&bars.left) && (h / 4..=h / 2).contains(&bars.top));
            prop_assert_eq!(bars.mask().count(), u64::from(w / 4) * u64::from(h / 4));
            if let Some(bar) = bars.at(bars.left, bars.top).filter(|_| w >= 40) {
                prop_assert_eq!(bar, 0);
            }
        }
    }
}
