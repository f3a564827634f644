//! A photo in which points are searched: grey, small, at two levels, with its camera.

use crate::data::Dataset;
use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Prepared};
use scene_io::{Image, ImageStore, SceneError, StoreOptions};
use std::sync::Arc;

/// Training pictures of at least this share of the wanted side are good enough; smaller ones are read again.
const GOOD_ENOUGH: f64 = 0.7;
/// Fixed point: a grey level of 1 is so much.
const UNIT: f32 = 256.0;
/// Alpha from which a pixel is opaque.
const OPAQUE: u8 = 250;
/// Pixels to each side of a place that must be used and opaque, too.
const CLEAR: i64 = 3;

/// Grey values of one level, smoothed a little.
pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Rows top to bottom, `[0, 255]` times [`UNIT`].
    data: Vec<u16>,
}

/// A photo at working size.
pub(super) struct Photo {
    /// Full and half size.
    pub(super) levels: [Level; 2],
    image: Arc<Image>,
    /// Whether something of it is masked or transparent.
    partly: bool,
    prepared: Prepared,
    /// To the world's axes, and back.
    pub(super) to_camera: glam::DMat3,
}

impl Photo {
    /// View `i` of a dataset.
    pub(super) fn new(data: &Dataset, i: usize, longest_side: u32) -> Result<Self, SceneError> {
        let view = data.view(i);
        let (camera, native) = (view.camera, view.source.camera);
        let side = |c: &Camera| f64::from(c.width.max(c.height));
        let wanted = f64::from(longest_side).min(side(&native));
        let image = if side(&camera) < GOOD_ENOUGH * wanted {
            let options = StoreOptions::default().with_longest_side(longest_side).with_budget_bytes(0);
            ImageStore::new(std::slice::from_ref(view.source.as_ref()), options)?.get(0)?
        } else {
            let image = data.image(i)?;
            let shrink = wanted / side(&camera);
            let fit = |side: u32| ((f64::from(side) * shrink).round() as u32).max(1);
            if shrink < 1.0 { Arc::new(image.resized(fit(image.width), fit(image.height))) } else { image }
        };
        Ok(Self::of(&camera.resized(image.width, image.height), image))
    }

    /// An image and its camera, of one size.
    pub(super) fn of(camera: &Camera, image: Arc<Image>) -> Self {
        let full = Level::of(&image);
        let half = full.halved();
        let opaque = image.channels == 4 && image.data.chunks_exact(4).any(|p| p[3] < OPAQUE);
        let partly = opaque || image.mask.is_some();
        Self { levels: [full, half], image, partly, prepared: camera.prepare(), to_camera: camera.pose.r.transpose() }
    }

    pub(super) fn camera(&self) -> &Camera {
        self.prepared.camera()
    }

    /// Where the camera stands.
    pub(super) fn centre(&self) -> DVec3 {
        self.camera().pose.c
    }

    /// Pixels to a radian in the middle.
    pub(super) fn focal(&self) -> f64 {
        0.5 * (self.camera().fx + self.camera().fy)
    }

    /// Unit direction of a pixel in the world.
    pub(super) fn direction(&self, x: DVec2) -> Option<DVec3> {
        self.prepared.direction(x).map(|d| self.camera().pose.r * d)
    }

    /// Pixel of a world point, wherever it falls.
    pub(super) fn project(&self, x: DVec3) -> Option<DVec2> {
        self.prepared.project_from_camera(self.to_camera * (x - self.centre()))
    }

    /// Whether `x` is a pixel of the photo at least `margin` from its border.
    pub(super) fn holds(&self, x: DVec2, margin: f64) -> bool {
        let (w, h) = (f64::from(self.image.width), f64::from(self.image.height));
        x.x >= margin && x.y >= margin && x.x <= w - margin && x.y <= h - margin
    }

    /// Whether the pixel at `x`, which the photo holds, may be used and is opaque.
    pub(super) fn shows(&self, x: DVec2) -> bool {
        !self.partly || self.clear(x.x as i64, x.y as i64)
    }

    /// The same of all pixels about it.
    pub(super) fn shows_around(&self, column: usize, row: usize) -> bool {
        let (x, y) = (column as i64, row as i64);
        !self.partly || (y - CLEAR..=y + CLEAR).all(|v| (x - CLEAR..=x + CLEAR).all(|u| self.clear(u, v)))
    }

    fn clear(&self, x: i64, y: i64) -> bool {
        let (w, h) = (i64::from(self.image.width), i64::from(self.image.height));
        if x < 0 || y < 0 || x >= w || y >= h {
            return false;
        }
        let (x, y) = (x as u32, y as u32);
        self.image.is_used(x, y) && self.image.pixel(x, y).get(3).is_none_or(|alpha| *alpha >= OPAQUE)
    }

    /// Colour of the pixel at `x`, which the photo holds.
    pub(super) fn colour(&self, x: DVec2) -> [u8; 3] {
        let at = |v: f64, size: u32| (v.max(0.0) as u32).min(size - 1);
        let p = self.image.pixel(at(x.x, self.image.width), at(x.y, self.image.height));
        [p[0], p[1], p[2]]
    }
}

impl Level {
    pub(super) fn of(image: &Image) -> Self {
        let grey = |p: &[u8]| {
            let luma = 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]);
            // Around an object there is an even grey.
            let alpha = p.get(3).map_or(1.0, |a| f32::from(*a) / 255.0);
            UNIT * (alpha * luma + (1.0 - alpha) * 128.0)
        };
        let values = image.data.chunks_exact(usize::from(image.channels)).map(grey).collect();
        Self::smoothed(image.width as usize, image.height as usize, values)
    }

    /// `1 2 1` along both axes, borders repeated.
    fn smoothed(width: usize, height: usize, values: Vec<f32>) -> Self {
        let mut rows = vec![0.0_f32; values.len()];
        for (from, to) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
            for (x, to) in to.iter_mut().enumerate() {
                *to = 0.25 * (from[x.saturating_sub(1)] + 2.0 * from[x] + from[(x + 1).min(width - 1)]);
            }
        }
        let mut data = vec![0_u16; values.len()];
        for y in 0..height {
            let row = |y: usize| &rows[y * width..][..width];
            let (above, here, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1)));
            for x in 0..width {
                data[y * width + x] = (0.25 * (above[x] + 2.0 * here[x] + below[x]) + 0.5) as u16;
            }
        }
        Self { width, height, data }
    }

    /// Half the size, rounded up: means of four, smoothed again.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let at = |x: usize, y: usize| f32::from(self.data[y.min(self.height - 1) * self.width + x.min(self.width - 1)]);
        let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
        let values = (0..height).flat_map(|y| (0..width).map(move |x| mean(2 * x, 2 * y))).collect();
        Self::smoothed(width, height, values)
    }

    /// Grey level of a pixel, `[0, 255]`.
    pub(super) fn grey(&self, x: usize, y: usize) -> f32 {
        f32::from(self.data[y * self.width + x]) / UNIT
    }

    /// Whether a square of half side `reach` about `(x, y)`, in pixels of this level with centres at whole numbers, lies inside.
    pub(super) fn surrounds(&self, x: f32, y: f32, reach: f32) -> bool {
        x >= reach && y >= reach && x + reach < (self.width - 1) as f32 && y + reach < (self.height - 1) as f32
    }

    /// Between the four pixels about `(x, y)`, centres at whole numbers, in units of 1 / [`UNIT`]: a place that is surrounded,
    /// up to rounding.
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> f32 {
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (u, v) = (x - i as f32, y - j as f32);
        let upper = &self.data[j * self.width + i..][..2];
        let lower = &self.data[(j + 1) * self.width + i..][..2];
        let between = |p: &[u16]| f32::from(p[0]) + u * (f32::from(p[1]) - f32::from(p[0]));
        let (a, b) = (between(upper), between(lower));
        a + v * (b - a)
    }
}
