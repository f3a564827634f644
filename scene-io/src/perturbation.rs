//! What is done to a photo of a clean scene to make it wild; [`perturb`](mod@crate::perturb) says how.

use crate::Image;
use crate::bit_mask::BitMask;
use crate::random::random;
use crate::size::Size;

/// Bars of an occluder.
const BARS: u32 = 10;

/// What is done to the training views of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PerturbationKind {
    /// Each view has colours of its own.
    Colour,
    /// Each view has something in front.
    Occluder,
    /// Both.
    Both,
}

impl PerturbationKind {
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

impl std::str::FromStr for PerturbationKind {
    type Err = String;

    /// Accepts the names of [`PerturbationKind::name`].
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
    pub picture: Size,
    /// Colours, from left to right.
    pub colours: [[u8; 3]; BARS as usize],
}

impl Bars {
    /// The bar a pixel of the picture lies in.
    #[must_use]
    pub fn at(&self, column: u32, row: u32) -> Option<usize> {
        let edge = |bar: u32| (u64::from(bar) * u64::from(self.picture.width) / (4 * u64::from(BARS))) as u32;
        let (x, y) = (column.checked_sub(self.left)?, row.checked_sub(self.top)?);
        let inside = x < edge(BARS) && y < self.picture.height / 4;
        // Bars narrower than a pixel leave columns to their right neighbours.
        inside.then(|| (0..BARS).rev().find(|bar| edge(*bar) <= x).unwrap_or(0) as usize)
    }

    /// The pixels they hide.
    #[must_use]
    pub fn mask(&self) -> BitMask {
        BitMask::from_fn(self.picture.width, self.picture.height, |column, row| self.at(column, row).is_some())
    }
}

impl Perturbation {
    /// What happens to training view `view` of `width x height` pixels; nothing to the first one.
    ///
    /// # Panics
    /// In builds that check for overflow: when `view` is above 2^57.
    #[must_use]
    pub fn of(view: usize, width: u32, height: u32, what: PerturbationKind, seed: u64) -> Option<Self> {
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
        let bars = Bars { left: start(width, 8), top: start(height, 9), picture: Size::new(width, height), colours };
        Some(Self {
            colour: (what != PerturbationKind::Occluder).then_some(colour),
            bars: (what != PerturbationKind::Colour).then_some(bars),
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
