//! A small stage with things that turn, travel, swing, breathe, bend and twist, filmed by one camera.
//!
//! Each picture has a pose and a time of its own: monocular, as D-NeRF's data. Things stand on a round stage under no sky
//! (pictures are RGBA). A crate travels along a circle and turns; an arm swings from shoulder and elbow; a ball becomes
//! flatter and higher; a bar bends and twists; the stage, a block, a post and a ring stay. Nothing touches, opens or joins:
//! there is no change of topology.
//!
//! Motion takes each **material point** `q` of a thing to the world, `x = r(t) warp(q, t) + c(t)`, and its inverse is known
//! in closed form. So rays are intersected exactly (polynomials up to degree 4), and a surface point of one snapshot can be
//! followed to any other. Colour belongs to the material: light is painted on (it turns with the thing) and there are no
//! shadows and no gloss, so a point looks the same at all times and from all sides.

mod body;
mod stage;
mod truth;
mod views;
mod write;

pub use body::{Form, Placement, Warp};
pub use stage::OrbitMotion;
pub use truth::{FlowMap, Sight, SnapshotTruth};
pub use views::{OrbitCamera, OrbitOptions, OrbitView, orbit, orbit_views};
pub use write::write_orbit;

use crate::bit_mask::BitMask;
use crate::synthetic::surface::to_byte;
use crate::{Bounds, Image};
use body::Posed;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;
use stage::Thing;

/// The stage and how everything on it moves: z is up, the ground lies at `z = 0` and is a disc of radius 1.05.
#[derive(Clone, Debug)]
pub struct Orbit {
    things: Vec<Thing>,
}

/// The stage at one time.
#[derive(Clone, Debug)]
pub struct Snapshot {
    time: f64,
    things: Vec<(Posed, Thing)>,
}

/// Where a ray first meets the stage.
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

impl Orbit {
    /// The stage of a seed.
    #[must_use]
    pub fn new(seed: u64, motion: OrbitMotion) -> Self {
        Self { things: stage::things(seed, motion) }
    }

    /// A box that holds everything at all times.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(-1.06, -1.06, -0.09), max: DVec3::new(1.06, 1.06, 1.02) }
    }

    /// The stage at a time, usually in `[0, 1]`.
    #[must_use]
    pub fn at(&self, time: f64) -> Snapshot {
        Snapshot {
            time,
            things: self.things.iter().map(|thing| (Posed::new(thing.form, thing.at(time)), *thing)).collect(),
        }
    }
}

impl Snapshot {
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
        self.things[thing].0.placement
    }

    /// Where a ray first meets a surface.
    #[must_use]
    pub fn trace(&self, ray: &Ray) -> Option<SnapshotHit> {
        let hits = self.things.iter().enumerate();
        let (hit, thing) = hits
            .filter_map(|(i, (posed, _))| posed.hit(ray, 0.0).map(|hit| (hit, i)))
            .min_by(|a, b| a.0.t.total_cmp(&b.0.t))?;
        let Thing { pattern, .. } = &self.things[thing].1;
        Some(SnapshotHit {
            t: hit.t,
            x: ray.at(hit.t),
            normal: hit.normal,
            rgb: pattern.rgb(hit.q, hit.rest_normal),
            thing,
            material: hit.q,
            moves: self.things[thing].1.moves(),
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

#[cfg(test)]
mod tests;
