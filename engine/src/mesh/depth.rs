//! What a camera sees, as depth that can be fused: distances that are sure, how sure, and their colours.
//!
//! Cameras are pinholes here, whatever lens the photo had: a field or a cloud is rendered through any.

use crate::render::Rendered;
use crate::surface::{POINT_OPACITY, own_colour};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use render_core::camera::Camera;

/// A ray with less opacity hit nothing: all along it is free.
const FREE: f32 = 0.05;
/// Opacity above which a pixel counts where the mesh is compared with the pictures.
const SURE: f32 = 0.9;
/// Disparity may bend by this share from one pixel to the next; beyond is an edge between two surfaces.
const EDGE: f32 = 0.03;
/// What a pixel beside an edge weighs: which of the two surfaces its depth belongs to is not sure.
const EDGE_WEIGHT: f32 = 0.05;
/// Surfaces are seen no flatter than this cosine; flatter ones count as that.
const FLATTEST: f32 = 0.15;
/// Pixels to each side that a slope is measured over.
const SLOPE: i64 = 2;

/// Whose camera a picture was taken with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Of a photo: what it shows was seen.
    Photo,
    /// Between two photos: it helps, and does not count as a photo.
    Between,
}

/// Depth of one camera.
#[derive(Clone, Debug)]
pub struct DepthView {
    /// A pinhole.
    pub camera: Camera,
    /// Whose camera.
    pub place: Place,
    /// Depth along the optical axis, world units, row by row; 0 = not known, infinite = the ray is free all along.
    pub(super) z: Vec<f32>,
    /// Cosine between ray and surface times opacity, small beside edges; 0 where nothing is known.
    pub(super) weight: Vec<f32>,
    /// Cosine between ray and surface.
    pub(super) cosine: Vec<f32>,
    /// Of the surface, without the background.
    pub(super) rgb: Vec<[u8; 3]>,
    /// Opaque enough to be compared with.
    pub(super) sure: Vec<bool>,
}

impl DepthView {
    /// The depth of a picture that `camera`, a pinhole, took on `background`.
    ///
    /// # Panics
    /// If the picture is smaller than the camera's, or lacks a layer.
    #[must_use]
    pub fn new(camera: &Camera, place: Place, picture: &Rendered, background: [f32; 3]) -> Self {
        let (w, layers) = (camera.width as usize, &picture.layers);
        let z: Vec<f32> = (0..layers.opacity.len())
            .map(|i| {
                let (opacity, t) = (layers.opacity[i], layers.median_depth[i]);
                if opacity < FREE {
                    return f32::INFINITY;
                }
                let known = opacity >= POINT_OPACITY && t.is_finite() && t > 0.0;
                if known { t / longer(camera, i % w, i / w) } else { 0.0 }
            })
            .collect();
        let rgb = (0..z.len()).map(|i| own_colour(layers.rgb[i], layers.opacity[i].max(1e-3), background)).collect();
        let sure = (0..z.len()).map(|i| layers.opacity[i] > SURE && known(z[i])).collect();
        let mut view =
            Self { camera: *camera, place, weight: vec![0.0; z.len()], cosine: vec![1.0; z.len()], z, rgb, sure };
        let seen: Vec<(f32, f32)> = (0..view.z.len())
            .into_par_iter()
            .map(|i| match view.normal(i) {
                None => (0.0, 1.0),
                Some(normal) => {
                    let cosine = normal.dot(-view.towards(i)).clamp(FLATTEST, 1.0);
                    let edge = if view.at_edge(i) { EDGE_WEIGHT } else { 1.0 };
                    (cosine * edge * layers.opacity[i].min(1.0), cosine)
                }
            })
            .collect();
        (view.weight, view.cosine) = seen.into_iter().unzip();
        // A free ray beside a surface may touch it within its pixel.
        let touches = |i: &usize| {
            let around = (-1..=1).flat_map(|x| (-1..=1).map(move |y| [x, y]));
            around.into_iter().filter_map(|step| view.beside(*i, step)).any(|j| view.z[j].is_finite())
        };
        let free = |i: &usize| view.z[*i].is_infinite();
        let unsure: Vec<usize> = (0..view.z.len()).filter(free).filter(touches).collect();
        unsure.into_iter().for_each(|i| view.z[i] = 0.0);
        view
    }

    /// Pixels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.z.len()
    }

    /// No pixel at all?
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.z.is_empty()
    }

    /// What pixel `i` shows, world units; `None` where its depth is not known.
    ///
    /// # Panics
    /// If there is no such pixel.
    #[must_use]
    pub fn point(&self, i: usize) -> Option<DVec3> {
        known(self.z[i]).then(|| {
            let [x, y] = self.plane(i);
            let z = f64::from(self.z[i]);
            self.camera.pose.to_world(DVec3::new(x * z, y * z, z))
        })
    }

    /// Is the pixel's depth that of one surface, not of the edge between two?
    ///
    /// # Panics
    /// If there is no such pixel.
    #[must_use]
    pub fn is_steady(&self, i: usize) -> bool {
        known(self.z[i]) && !self.at_edge(i)
    }

    /// Side of pixel `i` on the surface it shows, world units.
    pub(super) fn footprint(&self, i: usize) -> f64 {
        f64::from(self.z[i]) * 0.5 * (1.0 / self.camera.fx + 1.0 / self.camera.fy)
    }

    /// The pixel that shows a point, if any, and the point's depth.
    pub(super) fn pixel(&self, x: DVec3) -> Option<(usize, f32)> {
        let p = self.camera.pose.to_camera(x);
        if p.z <= 0.0 {
            return None;
        }
        let c = &self.camera;
        let (u, v) = (c.fx * p.x / p.z + c.cx, c.fy * p.y / p.z + c.cy);
        let inside = u >= 0.0 && v >= 0.0 && u < f64::from(c.width) && v < f64::from(c.height);
        inside.then(|| (v as usize * c.width as usize + u as usize, p.z as f32))
    }

    /// Does the view show a surface at `x`, no farther from it than `reach` along the optical axis?
    pub(super) fn shows(&self, x: DVec3, reach: f64) -> bool {
        self.pixel(x).is_some_and(|(i, z)| known(self.z[i]) && f64::from((self.z[i] - z).abs()) <= reach)
    }

    /// The normal of the surface in world axes, towards the camera; `None` where it is not known.
    pub(super) fn world_normal(&self, i: usize) -> Option<Vec3> {
        self.normal(i).map(|n| (self.camera.pose.r * n.as_dvec3()).as_vec3())
    }

    /// On the plane at depth 1.
    fn plane(&self, i: usize) -> [f64; 2] {
        let w = self.camera.width as usize;
        let c = &self.camera;
        [((i % w) as f64 + 0.5 - c.cx) / c.fx, ((i / w) as f64 + 0.5 - c.cy) / c.fy]
    }

    /// Unit direction of the ray in camera axes.
    fn towards(&self, i: usize) -> Vec3 {
        let [x, y] = self.plane(i).map(|a| a as f32);
        Vec3::new(x, y, 1.0).normalize()
    }

    /// The pixel at an offset to the right and down.
    fn beside(&self, i: usize, [right, down]: [i64; 2]) -> Option<usize> {
        let (w, h) = (i64::from(self.camera.width), i64::from(self.camera.height));
        let (x, y) = (i as i64 % w + right, i as i64 / w + down);
        ((0..w).contains(&x) && (0..h).contains(&y)).then_some((y * w + x) as usize)
    }

    fn disparity(&self, i: Option<usize>) -> Option<f32> {
        i.map(|i| self.z[i]).filter(|&z| known(z)).map(|z| 1.0 / z)
    }

    /// Disparity is linear along a plane: where it bends, one surface ends. Also where a neighbour shows nothing.
    fn at_edge(&self, i: usize) -> bool {
        let Some(own) = self.disparity(Some(i)) else { return true };
        [[1, 0], [0, 1]].into_iter().any(|step: [i64; 2]| {
            let sides = [step, step.map(|s| -s)].map(|s| self.beside(i, s));
            match sides.map(|side| self.disparity(side)) {
                [Some(a), Some(b)] => (a + b - 2.0 * own).abs() > EDGE * own,
                // The border of the picture is not an edge; what shows nothing is.
                missing => sides.iter().zip(missing).any(|(side, d)| side.is_some() && d.is_none()),
            }
        })
    }

    /// The normal in camera axes, towards the camera, from the slope of disparity.
    fn normal(&self, i: usize) -> Option<Vec3> {
        let own = self.disparity(Some(i))?;
        let slope = |step: [i64; 2], focal: f64| {
            // The widest stretch of one surface around the pixel, half of it where only that is there.
            let far = |sign: i64| {
                (1..=SLOPE).rev().find_map(|k| {
                    let at = self.disparity(self.beside(i, step.map(|s| s * sign * k)))?;
                    ((at - own).abs() < EDGE * own * k as f32 * 4.0).then_some((at, k * sign))
                })
            };
            match (far(1), far(-1)) {
                (Some((a, i)), Some((b, j))) => (a - b) / (i - j) as f32 * focal as f32,
                (Some((a, i)), None) | (None, Some((a, i))) => (a - own) / i as f32 * focal as f32,
                (None, None) => 0.0,
            }
        };
        let (dx, dy) = (slope([1, 0], self.camera.fx), slope([0, 1], self.camera.fy));
        let [x, y] = self.plane(i).map(|a| a as f32);
        let normal = -Vec3::new(dx, dy, own - x * dx - y * dy).normalize_or_zero();
        (normal != Vec3::ZERO).then_some(normal)
    }
}

/// Is it the depth of a surface?
pub(super) fn known(z: f32) -> bool {
    z > 0.0 && z.is_finite()
}

/// How much longer the ray of a pixel is than its depth.
fn longer(camera: &Camera, x: usize, y: usize) -> f32 {
    let (x, y) = ((x as f64 + 0.5 - camera.cx) / camera.fx, (y as f64 + 0.5 - camera.cy) / camera.fy);
    (x * x + y * y + 1.0).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::super::tests::{seen, sphere};
    use super::*;

    #[test]
    fn normals_of_a_sphere_point_out_of_it_and_points_lie_on_it() {
        let view = seen(&sphere(0.7), DVec3::new(0.0, -3.0, 0.0), 64);
        let mut steady = 0;
        for i in (0..view.len()).filter(|&i| view.is_steady(i)) {
            let x = view.point(i).unwrap();
            assert!((x.length() - 0.7).abs() < 1e-3);
            let normal = view.world_normal(i).unwrap().as_dvec3();
            assert!(normal.dot(x.normalize()) > 0.9, "{normal} at {x}");
            assert!(view.weight[i] > EDGE_WEIGHT);
            steady += 1;
        }
        assert!(steady > 300, "{steady}");
        // Rays that pass by are free; the rim of the sphere is an edge.
        assert!(view.z[0].is_infinite() && view.weight[0] == 0.0);
        let rim = (0..view.len()).filter(|&i| known(view.z[i]) && !view.is_steady(i)).count();
        assert!(rim > 40, "{rim}");
    }

    #[test]
    fn a_point_is_shown_by_the_pixel_it_came_from() {
        let view = seen(&sphere(1.0), DVec3::new(2.0, -3.0, 1.0), 48);
        let i = 24 * 48 + 24;
        let x = view.point(i).unwrap();
        let (at, z) = view.pixel(x).unwrap();
        assert_eq!(at, i);
        assert!((z - view.z[i]).abs() < 1e-5 && view.shows(x, 1e-3) && !view.shows(x * 0.5, 0.1));
    }
}
