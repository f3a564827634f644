//! Things that move, at one time: where rays meet them, what a camera sees of them, and where their points are at other times.
//!
//! Motion takes each **material point** `q` of a thing to the world, `x = r(t) warp(q, t) + c(t)`, and its inverse is known
//! in closed form. So rays are intersected exactly (polynomials up to degree 4), and a surface point of one snapshot can be
//! followed to any other. Colour belongs to the material: light is painted on (it turns with the thing) and there are no
//! shadows and no gloss, so a point looks the same at all times and from all sides.

pub(super) mod body;
pub(super) mod film;
pub(super) mod pattern;
#[cfg(test)]
pub(in crate::synthetic) mod testing;
mod truth;
pub(super) mod write;

pub use body::{Form, Placement, Warp};
pub use film::SnapshotView;
pub use truth::{FlowMap, Sight, SnapshotTruth};

use crate::Image;
use crate::bit_mask::BitMask;
use crate::synthetic::surface::to_byte;
use body::Posed;
use glam::{DVec2, DVec3};
use pattern::Pattern;
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;

/// A plane that cuts a thing through the origin of its axes: its points lie at right angles to its normal. Of all other surface
/// points of a thing with an inside the product of the two is of the order of its size.
const CUT: f64 = 1e-9;

/// Things at one time.
#[derive(Clone, Debug)]
pub struct Snapshot {
    time: f64,
    pub(super) things: Vec<PosedThing>,
}

/// A thing as a snapshot holds it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PosedThing {
    /// The form, where it is.
    pub(super) posed: Posed,
    /// What it is painted with.
    pub(super) pattern: Pattern,
    /// What those of its planes are painted with that go through the origin of its axes; `None`: as the rest.
    pub(super) inside: Option<Pattern>,
    /// Whether it moves at some time.
    pub(super) moves: bool,
}

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotHit {
    /// Distance along the ray, world units.
    pub t: f64,
    /// The point.
    pub x: DVec3,
    /// Outward unit normal.
    pub normal: DVec3,
    /// What the eye sees, display-referred sRGB in `[0, 1]`: a property of the material.
    pub rgb: DVec3,
    /// Index of the thing that was hit.
    pub thing: usize,
    /// The material point of the thing: where `x` lies in its own axes at rest.
    pub material: DVec3,
    /// Whether the thing moves at some time.
    pub moves: bool,
}

impl Snapshot {
    pub(super) fn new(time: f64, things: Vec<PosedThing>) -> Self {
        Self { time, things }
    }

    /// When it is.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Number of things; what moves and what does not.
    #[must_use]
    pub fn things(&self) -> usize {
        self.things.len()
    }

    /// Where a thing is.
    ///
    /// # Panics
    /// If there is no such thing.
    #[must_use]
    pub fn placement(&self, thing: usize) -> Placement {
        self.things[thing].posed.placement
    }

    /// Where a ray first meets a surface.
    #[must_use]
    pub fn trace(&self, ray: &Ray) -> Option<SnapshotHit> {
        let hits = self.things.iter().enumerate();
        let (hit, thing) = hits
            .filter_map(|(i, thing)| thing.posed.hit(ray, 0.0).map(|hit| (hit, i)))
            .min_by(|a, b| a.0.t.total_cmp(&b.0.t))?;
        let PosedThing { pattern, inside, moves, .. } = &self.things[thing];
        let pattern = inside.as_ref().filter(|_| hit.q.dot(hit.rest_normal).abs() < CUT).unwrap_or(pattern);
        Some(SnapshotHit {
            t: hit.t,
            x: ray.at(hit.t),
            normal: hit.normal,
            rgb: pattern.rgb(hit.q, hit.rest_normal),
            thing,
            material: hit.q,
            moves: *moves,
        })
    }

    /// The picture of a camera and the pixels of which any ray met something that moves at some time.
    ///
    /// RGBA with straight alpha, each pixel the average of `rays * rays` rays on a regular grid, of display-referred
    /// premultiplied values.
    ///
    /// # Panics
    /// If `rays` is 0.
    #[must_use]
    pub fn render(&self, camera: &Camera, rays: u32) -> (Image, BitMask) {
        assert!(rays > 0, "a pixel needs at least one ray");
        let prepared = camera.prepare();
        let step = 1.0 / f64::from(rays);
        let pixel = |column: u32, row: u32| {
            let (mut sum, mut covered, mut moves) = (DVec3::ZERO, 0_u32, false);
            for (a, b) in (0..rays).flat_map(|b| (0..rays).map(move |a| (a, b))) {
                let inside = DVec2::new(f64::from(a) + 0.5, f64::from(b) + 0.5) * step;
                let ray = prepared.ray(DVec2::new(f64::from(column), f64::from(row)) + inside);
                if let Some(hit) = ray.and_then(|ray| self.trace(&ray)) {
                    sum += hit.rgb;
                    covered += 1;
                    moves |= hit.moves;
                }
            }
            let rgb = if covered > 0 { sum / f64::from(covered) } else { DVec3::ZERO };
            ([rgb.x, rgb.y, rgb.z, f64::from(covered) * step * step].map(to_byte), moves)
        };
        let (width, height) = (camera.width, camera.height);
        let rows: Vec<Vec<([u8; 4], bool)>> =
            (0..height).into_par_iter().map(|row| (0..width).map(|column| pixel(column, row)).collect()).collect();
        let data = rows.iter().flatten().flat_map(|(rgba, _)| *rgba).collect();
        let moving = BitMask::from_fn(width, height, |column, row| rows[row as usize][column as usize].1);
        (Image { width, height, channels: 4, data, mask: None }, moving)
    }
}
