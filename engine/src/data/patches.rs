//! Random training pixels: in patches, whose neighbours are neighbours in the photo.

use super::batch::Drawn;
use super::{Batch, Dataset};
use field_core::rng::Rng;
use scene_io::{Image, SceneError};

/// Streams of random numbers: places of patches.
const PATCHES: u64 = 0x7061_7463_6865;

/// Smallest part of a photo that a lattice spans, along each side (Ha-NeRF).
const SMALLEST_SPAN: f32 = 0.5;

/// What a patch looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A square of neighbouring pixels (RobustNeRF).
    Window,
    /// As many pixels, evenly spread over half of the photo's sides or more: a thumbnail of a crop (Ha-NeRF).
    Lattice,
}

/// How a batch is made of patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patches {
    /// Form.
    pub shape: Shape,
    /// Pixels along a side.
    pub side: u32,
}

impl Patches {
    /// Pixels of a patch.
    ///
    /// # Panics
    /// In builds that check for overflow: when there are more than a `u32` counts.
    #[must_use]
    pub fn pixels(self) -> usize {
        (self.side * self.side) as usize
    }

    /// Column or row of the `i`-th pixel of a patch in a photo `size` wide: `u` uniform numbers for the span (shared by both
    /// axes) and the place.
    ///
    /// A window lies wholly inside where the photo is large enough, and repeats the last pixel otherwise.
    ///
    /// # Panics
    /// If `size` is 0.
    #[must_use]
    pub fn place(self, i: u32, size: u32, [span, offset]: [f32; 2]) -> u32 {
        match self.shape {
            Shape::Window => {
                let places = size.saturating_sub(self.side) + 1;
                (((offset * places as f32) as u32).min(places - 1) + i).min(size - 1)
            }
            Shape::Lattice => {
                let k = SMALLEST_SPAN + (1.0 - SMALLEST_SPAN) * span;
                let at = i as f32 / (self.side.max(2) - 1) as f32 * (1.0 - 1.0 / size as f32) * k + offset * (1.0 - k);
                // The product may round up to the size.
                ((at * size as f32) as u32).min(size - 1)
            }
        }
    }
}

impl Dataset {
    /// Fill `batch` with the `count` patches of step `step`, each of one view, row by row: `[count][side][side]`. A function
    /// of `seed`, `step` and `count` alone. Pixels that a mask ignores, or that the lens has no ray for, have weight 0.
    ///
    /// # Errors
    /// [`SceneError`] when an image cannot be read.
    ///
    /// # Panics
    /// As [`Patches::pixels`].
    pub fn draw_patches(
        &self,
        seed: u64,
        step: u64,
        count: usize,
        patches: Patches,
        batch: &mut Batch,
    ) -> Result<(), SceneError> {
        if self.is_empty() {
            batch.resize(0);
            return Ok(());
        }
        batch.resize(count * patches.pixels());
        self.ready(seed, step, batch)?;
        let rng = Rng::new(seed, PATCHES).substream(step);
        let (side, pixels) = (u64::from(patches.side), patches.pixels() as u64);
        batch.fill(|i, pool| {
            let (patch, within) = (i / pixels, i % pixels);
            let (v, image) = self.view_at(rng.u64_at(2 * patch), pool);
            let [span, x, y, _] = rng.uniform4_at(2 * patch + 1);
            let x = patches.place((within % side) as u32, image.width, [span, x]);
            let y = patches.place((within / side) as u32, image.height, [span, y]);
            self.pixel(v, image, x, y)
        });
        Ok(())
    }

    /// Fill `batch` with view `v`, row by row: for each square of `stride` pixels a side its mean, with the ray through its
    /// middle. Pixels beyond the last whole squares are left out, unless there is none. Returns columns and rows.
    ///
    /// # Errors
    /// [`SceneError`] when the image cannot be read.
    ///
    /// # Panics
    /// When there is no such view.
    pub fn whole_view(&self, v: usize, stride: u32, batch: &mut Batch) -> Result<[usize; 2], SceneError> {
        let image = self.image(v)?;
        let stride = stride.clamp(1, image.width.min(image.height).max(1));
        let (width, height) = (image.width / stride, image.height / stride);
        batch.resize((width * height) as usize);
        batch.fill(|i, _| {
            let (x, y) = ((i % u64::from(width)) as u32 * stride, (i / u64::from(width)) as u32 * stride);
            if stride == 1 {
                return self.pixel(v, &image, x, y);
            }
            self.square(v, &image, [x, y], stride)
        });
        Ok([width as usize, height as usize])
    }

    /// The mean of the pixels that count of a square.
    fn square(&self, v: usize, image: &Image, [x0, y0]: [u32; 2], stride: u32) -> Drawn {
        let mut out = self.pixel(v, image, x0 + stride / 2, y0 + stride / 2);
        let (mut rgb, mut alpha, mut weight) = ([0.0; 3], 0.0, 0.0);
        for y in y0..y0 + stride {
            for x in x0..x0 + stride {
                let p = self.pixel(v, image, x, y);
                let a = p.weight * p.alpha;
                rgb.iter_mut().zip(p.rgb).for_each(|(sum, c)| *sum += a * c);
                alpha += a;
                weight += p.weight;
            }
        }
        if weight > 0.0 && out.weight > 0.0 {
            out.rgb = rgb.map(|c| if alpha > 0.0 { c / alpha } else { 0.0 });
            out.alpha = alpha / weight;
        } else {
            out.weight = 0.0;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places along one axis for many random numbers, the largest below 1 among them.
    fn rows(patches: Patches, size: u32) -> impl Iterator<Item = Vec<u32>> {
        let u = [0.0, 0.25, 0.5, 0.999, 1.0 - f32::EPSILON / 2.0];
        let pairs = u.into_iter().flat_map(move |a| u.into_iter().map(move |b| [a, b]));
        pairs.map(move |u| (0..patches.side).map(|i| patches.place(i, size, u)).collect())
    }

    #[test]
    fn every_pixel_lies_in_the_photo_and_patches_never_go_back() {
        for shape in [Shape::Window, Shape::Lattice] {
            for size in [1, 2, 3, 15, 16, 17, 31, 5000, 65535] {
                for row in rows(Patches { shape, side: 16 }, size) {
                    assert!(row.iter().all(|&x| x < size), "{shape:?} of {size}: {row:?}");
                    assert!(row.is_sorted(), "{shape:?} of {size}: {row:?}");
                }
            }
        }
    }

    #[test]
    fn windows_are_neighbours_and_reach_both_ends() {
        let patches = Patches { shape: Shape::Window, side: 16 };
        let all: Vec<Vec<u32>> = rows(patches, 40).collect();
        assert!(all.iter().all(|row| row.windows(2).all(|w| w[1] == w[0] + 1)));
        assert!(all.iter().any(|row| row[0] == 0) && all.iter().any(|row| row[15] == 39));
    }

    #[test]
    fn lattices_span_half_of_the_photo_or_more() {
        let patches = Patches { shape: Shape::Lattice, side: 32 };
        for row in rows(patches, 640) {
            assert!(row[31] - row[0] >= 318, "{row:?}");
        }
    }
}
