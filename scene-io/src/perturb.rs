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

use crate::priors::{BitMask, TruthMask};
use crate::random::random;
use crate::{Image, Scene, Split};
use std::sync::Arc;

/// Bars of an occluder.
const BARS: u32 = 10;

/// What is done to the training views of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Disturbance {
    /// Each view has colours of its own.
    Colour,
    /// Each view has something in front.
    Occluder,
    /// Both.
    Both,
}

impl Disturbance {
    /// Name on the command line: `c`, `o` or `co`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colour => "c",
            Self::Occluder => "o",
            Self::Both => "co",
        }
    }
}

impl std::str::FromStr for Disturbance {
    type Err = String;

    /// Accepts the names of [`Disturbance::name`].
    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Colour, Self::Occluder, Self::Both]
            .into_iter()
            .find(|d| d.name() == text)
            .ok_or_else(|| format!("`{text}` is not a perturbation: use c (colour), o (occluder) or co (both)"))
    }
}

/// What was done to one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Perturbation {
    /// The view's colours.
    pub colour: Option<ColourChange>,
    /// What is in front.
    pub bars: Option<Bars>,
}

/// `scale * v + offset` for each channel of display-referred colours in `[0, 1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourChange {
    /// Factors, 0.8 to 1.2.
    pub scale: [f64; 3],
    /// Summands, -0.2 to 0.2.
    pub offset: [f64; 3],
}

/// Ten upright bars side by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bars {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Size of the picture they were made for.
    pub picture: (u32, u32),
    /// Colours, from left to right.
    pub colours: [[u8; 3]; BARS as usize],
}

impl Bars {
    /// The bar a pixel of the picture lies in.
    #[must_use]
    pub fn at(&self, column: u32, row: u32) -> Option<usize> {
        let edge = |bar: u32| (u64::from(bar) * u64::from(self.picture.0) / (4 * u64::from(BARS))) as u32;
        let (x, y) = (column.checked_sub(self.left)?, row.checked_sub(self.top)?);
        let inside = x < edge(BARS) && y < self.picture.1 / 4;
        // Bars narrower than a pixel leave columns to their right neighbours.
        inside.then(|| (0..BARS).rev().find(|bar| edge(*bar) <= x).unwrap_or(0) as usize)
    }

    /// The pixels they hide.
    #[must_use]
    pub fn mask(&self) -> BitMask {
        BitMask::from_fn(self.picture.0, self.picture.1, |column, row| self.at(column, row).is_some())
    }
}

impl Perturbation {
    /// What happens to training view `view` of `width x height` pixels; nothing to the first one.
    ///
    /// # Panics
    /// In builds that check for overflow: when `view` is above 2^57.
    #[must_use]
    pub fn of(view: usize, width: u32, height: u32, what: Disturbance, seed: u64) -> Option<Self> {
        if view == 0 {
            return None;
        }
        let draw = |k: u64| random(seed, 64 * view as u64 + k);
        let start = |side: u32, k: u64| (f64::from(side) * (1.0 + draw(k)) / 4.0) as u32;
        let colour = ColourChange {
            scale: [0, 1, 2].map(|c| 0.8 + 0.4 * draw(c)),
            offset: [3, 4, 5].map(|c| -0.2 + 0.4 * draw(c)),
        };
        let mut colours = [[0; 3]; BARS as usize];
        for (k, value) in (16..).zip(colours.as_flattened_mut()) {
            *value = (256.0 * draw(k)) as u8;
        }
        let bars = Bars { left: start(width, 8), top: start(height, 9), picture: (width, height), colours };
        Some(Self {
            colour: (what != Disturbance::Occluder).then_some(colour),
            bars: (what != Disturbance::Colour).then_some(bars),
        })
    }

    /// Changes a picture of the size the perturbation was made for.
    pub(crate) fn apply(&self, image: &mut Image) {
        let channels = usize::from(image.channels);
        if let Some(ColourChange { scale, offset }) = self.colour {
            let changed = |c: usize| {
                let value = |v: usize| (scale[c] * (v as f64 / 255.0) + offset[c]).clamp(0.0, 1.0);
                std::array::from_fn::<u8, 256, _>(|v| (value(v) * 255.0 + 0.5) as u8)
            };
            let table = [changed(0), changed(1), changed(2)];
            for pixel in image.data.chunks_exact_mut(channels) {
                for (value, table) in pixel.iter_mut().zip(&table) {
                    *value = table[usize::from(*value)];
                }
            }
        }
        let Some(bars) = self.bars else { return };
        let width = image.width as usize;
        for (at, pixel) in image.data.chunks_exact_mut(channels).enumerate() {
            if let Some(bar) = bars.at((at % width) as u32, (at / width) as u32) {
                pixel[..3].copy_from_slice(&bars.colours[bar]);
                if let Some(alpha) = pixel.get_mut(3) {
                    *alpha = 255;
                }
            }
        }
    }

    /// Numbers that say all of it, for fingerprints.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        let mut numbers = vec![f64::from(u8::from(self.colour.is_some())), f64::from(u8::from(self.bars.is_some()))];
        if let Some(colour) = self.colour {
            numbers.extend(colour.scale.iter().chain(&colour.offset));
        }
        if let Some(bars) = self.bars {
            numbers.extend([bars.left, bars.top].map(f64::from));
            numbers.extend(bars.colours.as_flattened().iter().map(|v| f64::from(*v)));
        }
        numbers
    }
}

/// The scene with its training views disturbed, but for the first of them; truth masks show the occluders.
#[must_use]
pub fn perturb(mut scene: Scene, what: Disturbance, seed: u64) -> Scene {
    let training: Vec<usize> = scene.split(Split::Train).collect();
    for (view, index) in training.iter().enumerate() {
        let frame = &mut scene.frames[*index];
        let (width, height) = (frame.camera.width, frame.camera.height);
        let perturbation = Perturbation::of(view, width, height, what, seed);
        if what != Disturbance::Colour {
            frame.truth.transient = Some(TruthMask::Bars(perturbation.as_ref().and_then(|p| p.bars)));
        }
        frame.perturbation = perturbation.map(Arc::new);
    }
    scene.notes.push(format!(
        "{} of {} training views are perturbed ({}, seed {seed})",
        training.len().saturating_sub(1),
        training.len(),
        match what {
            Disturbance::Colour => "colours",
            Disturbance::Occluder => "occluders",
            Disturbance::Both => "colours and occluders",
        }
    ));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{TabletopOptions, tabletop};
    use crate::{Frame, ImageSource, ImageStore, StoreOptions};
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
        let scene = perturb(scene(), Disturbance::Occluder, 0);
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
        let (colour, both) = (perturb(scene(), Disturbance::Colour, 0), perturb(scene(), Disturbance::Both, 0));
        let occluder = perturb(scene(), Disturbance::Occluder, 0);
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
        let scene = perturb(scene(), Disturbance::Both, 0);
        for (small, full) in images(&scene, Some(20)).iter().zip(images(&scene, None)) {
            assert_eq!(**small, full.resized(20, 10));
        }
        let prints: Vec<String> = [Disturbance::Colour, Disturbance::Occluder, Disturbance::Both]
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
        let p = Perturbation::of(1, 400, 400, Disturbance::Both, 0).unwrap();
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
            let p = Perturbation::of(view, w, h, Disturbance::Both, seed).unwrap();
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
