//! The instrument: a shaft from beside the picture, a wrist, two jaws. In the camera's own axes, mm.

use crate::random::random;
use crate::synthetic::shape::{Placed, Shape};
use crate::synthetic::surface::to_srgb;
use glam::{DMat3, DVec2, DVec3};
use render_core::ray::Ray;
use std::f64::consts::TAU;

/// What the tool does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TissueTool {
    /// It moves to and fro across the picture.
    #[default]
    Sweeping,
    /// There is none, and no mask says otherwise.
    Absent,
    /// As `Sweeping`, and at time 1/2 it covers the whole picture.
    OnceEverywhere,
    /// It covers every picture.
    Everywhere,
}

/// Where the instrument comes in: always beside the picture.
const ENTRY: DVec3 = DVec3::new(46.0, 40.0, 40.0);
/// The wrist hovers this far before the tissue, mm.
const HOVER: f64 = 9.0;

/// The tool at a time.
#[derive(Clone, Debug)]
pub(super) struct Tool {
    parts: Vec<(Placed, DVec3)>,
}

/// Where the wrist is across the picture, mm, at a time.
pub(super) fn wrist(seed: u64, time: f64) -> DVec2 {
    let phase = |i: u64| TAU * random(seed, 71_000 + i);
    DVec2::new(2.0 + 20.0 * (TAU * 1.3 * time + phase(0)).sin(), 1.0 + 14.0 * (TAU * 0.9 * time + phase(1)).sin())
}

impl Tool {
    /// No tool.
    pub(super) fn absent() -> Self {
        Self { parts: Vec::new() }
    }

    /// The tool with its wrist before a point of the tissue.
    pub(super) fn before(tissue: DVec3, time: f64) -> Self {
        let tip = tissue - DVec3::Z * HOVER;
        let z = (tip - ENTRY).normalize();
        let x = z.cross(DVec3::Y).normalize();
        // Turned about its own axis over time.
        let roll = TAU * 0.8 * time;
        let r = DMat3::from_cols(x, z.cross(x), z) * DMat3::from_rotation_z(roll);
        let half = 0.5 * (tip - ENTRY).length();
        let mut parts = vec![
            (
                Placed { shape: Shape::Cylinder { radius: 3.4, half_height: half }, r, c: ENTRY + z * half },
                DVec3::new(0.30, 0.31, 0.34),
            ),
            (Placed { shape: Shape::Sphere { radius: 3.8 }, r, c: tip }, DVec3::new(0.52, 0.53, 0.55)),
        ];
        let open = 0.30 + 0.22 * (TAU * 3.0 * time).sin();
        for side in [-1.0, 1.0] {
            let jaw = r * DMat3::from_rotation_y(side * open);
            let shape = Shape::Block { half: DVec3::new(1.0, 1.7, 4.6) };
            parts.push((Placed { shape, r: jaw, c: tip + jaw.z_axis * 6.0 }, DVec3::new(0.62, 0.63, 0.62)));
        }
        Self { parts }
    }

    /// Something in front of the whole picture.
    pub(super) fn everywhere() -> Self {
        let shape = Shape::Block { half: DVec3::new(40.0, 40.0, 1.0) };
        Self { parts: vec![(Placed { shape, r: DMat3::IDENTITY, c: DVec3::Z * 20.0 }, DVec3::new(0.3, 0.31, 0.34))] }
    }

    /// Distance to the tool and its colour there.
    pub(super) fn hit(&self, ray: &Ray) -> Option<(f64, DVec3)> {
        let hits =
            self.parts.iter().filter_map(|(placed, colour)| placed.hit(ray, 0.0).map(|hit| (hit, placed, colour)));
        let ((t, _, local), placed, colour) = hits.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        // Painted light and rings along the axis; the rings of the shaft are counted from its end.
        let end = if let Shape::Cylinder { half_height, .. } = placed.shape { local.z - half_height } else { local.z };
        let ring = 0.5 + 0.5 * (4.0 * (0.9 * end).sin()).tanh();
        let light = 0.7 + 0.3 * (local.truncate().normalize_or_zero().dot(DVec2::new(0.6, -0.8)));
        Some((t, to_srgb(*colour * light * (0.75 + 0.35 * ring))))
    }
}
