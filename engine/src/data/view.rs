//! A photo as a camera: rays through its pixels.

use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Prepared, RayTable};
use render_core::ray::Ray;
use scene_io::Frame;
use std::sync::Arc;

/// One view of a [`Dataset`](super::Dataset).
#[derive(Clone, Debug)]
pub struct View {
    /// Index into [`Scene::frames`](scene_io::Scene::frames).
    pub frame: usize,
    /// The frame itself, for truth and priors that are read when asked for.
    pub source: Arc<Frame>,
    /// Name of the frame.
    pub name: String,
    /// When it was taken, `0..=1`; 0 where the dataset does not say.
    pub time: f64,
    /// Camera at training resolution.
    pub camera: Camera,
    /// Points that it shows, world units: its features that were found again in other photos; an estimate where the dataset has
    /// points and does not say who saw them.
    pub points: Arc<[DVec3]>,
    /// How often the frame was halved: the view is `1 / 2^level` of the training resolution.
    pub level: u32,
    /// Directions of a lens with distortion, shared by views with equal intrinsics.
    pub(super) table: Option<Arc<RayTable>>,
    /// The same lens, for what the table does not hold.
    pub(super) prepared: Option<Prepared>,
}

impl View {
    /// Ray through the centre of pixel `(x, y)`, or `None` where the lens has no preimage.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    pub fn ray(&self, x: u32, y: u32) -> Option<Ray> {
        let camera = &self.camera;
        assert!(x < camera.width && y < camera.height, "pixel ({x}, {y}) of a {}x{} view", camera.width, camera.height);
        match &self.table {
            Some(table) => table.ray(&camera.pose, x, y),
            None => {
                let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let d = DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
                Some(Ray { o: camera.pose.c, d: (camera.pose.r * d).normalize() })
            }
        }
    }

    /// Ray through a point of pixel `(x, y)`, `offset` from its centre in pixels, `-1/2 ..= 1/2`; `None` where the lens has
    /// no preimage. Directions of a lens with distortion are interpolated between those of pixel centres.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    pub fn ray_within(&self, x: u32, y: u32, offset: [f64; 2]) -> Option<Ray> {
        let camera = &self.camera;
        let Some(table) = &self.table else {
            assert!(x < camera.width && y < camera.height, "pixel ({x}, {y}) of a view");
            let (x, y) = (f64::from(x) + 0.5 + offset[0], f64::from(y) + 0.5 + offset[1]);
            let d = DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
            return Some(Ray { o: camera.pose.c, d: (camera.pose.r * d).normalize() });
        };
        let centre = table.ray(&camera.pose, x, y)?;
        let mut d = centre.d;
        for (axis, last) in [camera.width - 1, camera.height - 1].into_iter().enumerate() {
            let at = [x, y][axis];
            let neighbour = if offset[axis] < 0.0 { at.checked_sub(1) } else { (at < last).then_some(at + 1) };
            // At the border, and beside pixels without a ray, the neighbour on the other side does.
            let (next, way) = match neighbour {
                Some(next) => (next, offset[axis].abs()),
                None if last == 0 => continue,
                None => (if at == 0 { 1 } else { at - 1 }, -offset[axis].abs()),
            };
            let (nx, ny) = if axis == 0 { (next, y) } else { (x, next) };
            if let Some(other) = table.ray(&camera.pose, nx, ny) {
                d += (other.d - centre.d) * way;
            }
        }
        Some(Ray { o: centre.o, d: d.normalize() })
    }

    /// Radius of the cone of pixel `(x, y)` at distance 1, for unit directions; see [`Prepared::cone_radius`]. `None` where
    /// the lens has no preimage.
    pub fn cone_radius(&self, x: u32, y: u32) -> Option<f64> {
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        match &self.prepared {
            Some(prepared) => prepared.cone_radius(at),
            None => {
                let Camera { fx, fy, cx, cy, .. } = self.camera;
                let v = DVec3::new((at.x - cx) / fx, (at.y - cy) / fy, 1.0);
                Some(0.5 * (1.0 / fx + 1.0 / fy) / v.length() * (2.0 / 12.0_f64.sqrt()))
            }
        }
    }

    /// Area of a pixel, in pixels of the training resolution.
    pub fn pixel_area(&self) -> f32 {
        4.0_f32.powi(self.level as i32)
    }

    /// Rays of all pixels of the rows `rows`, row by row; `None` where the lens has no preimage.
    ///
    /// # Panics
    /// The iterator does where a row lies outside the image.
    pub fn rays(&self, rows: std::ops::Range<u32>) -> impl Iterator<Item = Option<Ray>> + '_ {
        rows.flat_map(move |y| (0..self.camera.width).map(move |x| self.ray(x, y)))
    }
}
