//! Tissue and tool at a time, and what rays from the camera meet of them.

use super::super::surface::to_byte;
use super::sheet::{Sheet, SheetSnapshot};
use super::tool::{self, TissueTool, Tool};
use crate::Image;
use crate::bit_mask::BitMask;
use crate::priors::{FollowedPoint, SceneFlow};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;

/// Tissue and tool at all times.
#[derive(Clone, Copy, Debug)]
pub struct Tissue {
    sheet: Sheet,
    seed: u64,
    tool: TissueTool,
}

/// Tissue and tool at one time.
#[derive(Clone, Debug)]
pub struct TissueSnapshot {
    sheet: Sheet,
    now: SheetSnapshot,
    pub(super) tool: Tool,
}

/// What a ray through the camera's centre meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TissueHit {
    /// Distance along the ray, mm.
    pub t: f64,
    /// The point, world axes.
    pub x: DVec3,
    /// Depth along the optical axis, mm.
    pub z: f64,
    /// What the eye sees, display-referred sRGB in `[0, 1]`.
    pub rgb: DVec3,
    /// The material point of the tissue, mm; `None` on the tool.
    pub material: Option<DVec2>,
}

/// OpenGL's axes at the camera to the camera's own (CV), and back.
pub(super) fn flip(v: DVec3) -> DVec3 {
    v * DVec3::new(1.0, -1.0, -1.0)
}

impl Tissue {
    /// The tissue of a seed.
    #[must_use]
    pub fn new(seed: u64, tool: TissueTool) -> Self {
        Self { sheet: Sheet::new(seed), seed, tool }
    }

    /// Tissue and tool at a time in `[0, 1]`.
    #[must_use]
    pub fn at(&self, time: f64) -> TissueSnapshot {
        let now = self.sheet.at(time);
        let tool = match self.tool {
            TissueTool::Absent => Tool::absent(),
            TissueTool::Everywhere => Tool::everywhere(),
            TissueTool::OnceEverywhere if (time - 0.5).abs() < 1e-9 => Tool::everywhere(),
            TissueTool::Sweeping | TissueTool::OnceEverywhere => {
                let across = tool::wrist(self.seed, time);
                Tool::before(now.place(now.material(across)), time)
            }
        };
        TissueSnapshot { sheet: self.sheet, now, tool }
    }
}

impl TissueSnapshot {
    /// What a ray from the origin meets first. Rays that do not look at the tissue meet its edge somewhere far out.
    ///
    /// # Panics
    /// If the ray does not start at the origin, where the camera is, or looks backwards.
    #[must_use]
    pub fn trace(&self, ray: &Ray) -> TissueHit {
        self.before(ray, self.trace_tissue(ray))
    }

    /// The tool where it is before what a ray meets of the tissue.
    pub(super) fn before(&self, ray: &Ray, tissue: TissueHit) -> TissueHit {
        match self.tool.hit(&Ray { o: DVec3::ZERO, d: flip(ray.d) }) {
            Some((t, rgb)) if t < tissue.t => TissueHit { t, x: ray.at(t), z: -ray.d.z * t, rgb, material: None },
            _ => tissue,
        }
    }

    /// The tissue a ray from the origin meets, whatever the tool hides.
    ///
    /// # Panics
    /// As [`TissueSnapshot::trace`].
    #[must_use]
    pub fn trace_tissue(&self, ray: &Ray) -> TissueHit {
        assert!(ray.o == DVec3::ZERO && ray.d.z < 0.0, "tissue is seen from the origin, looking along -z: {ray:?}");
        let d = flip(ray.d);
        let slope = d.truncate() / d.z;
        let z = self.now.meet(slope);
        let material = self.now.material(slope * z);
        let t = z / d.z;
        TissueHit { t, x: ray.at(t), z, rgb: self.sheet.rgb(material), material: Some(material) }
    }

    /// Where a material point of the tissue is, world axes.
    #[must_use]
    pub fn place(&self, material: DVec2) -> DVec3 {
        flip(self.now.place(material))
    }

    /// The material point of the tissue before or behind a place, world axes: the inverse of [`TissueSnapshot::place`] on the tissue.
    #[must_use]
    pub fn material(&self, x: DVec3) -> DVec2 {
        self.now.material(flip(x).truncate())
    }

    /// Exact scene flow of what rays met of the tissue at another time, to this one, which is `time`.
    pub(super) fn followed(&self, hits: &[TissueHit], time: f64) -> SceneFlow {
        let follow = |hit: &TissueHit| {
            let way = self.place(hit.material?) - hit.x;
            Some(FollowedPoint { x: hit.x.to_array(), way: way.to_array(), moves: true })
        };
        SceneFlow::of(time, hits.iter().filter_map(follow))
    }

    /// Where a camera at the origin shows a material point, pixels, if it is in the picture and no tool in front.
    #[must_use]
    pub fn find(&self, material: DVec2, camera: &Camera) -> Option<DVec2> {
        let x = self.place(material);
        let pixel = camera.project(x)?;
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        if !(0.0..w).contains(&pixel.x) || !(0.0..h).contains(&pixel.y) {
            return None;
        }
        let tool = self.tool.hit(&Ray { o: DVec3::ZERO, d: flip(x).normalize() });
        tool.is_none_or(|(t, _)| t > x.length()).then_some(pixel)
    }

    /// The picture with the tool, the picture without, and the pixels of which any ray met the tool: RGB, each pixel the
    /// average of `rays * rays` rays on a regular grid.
    ///
    /// # Panics
    /// If `rays` is 0, or the camera does not stand at the origin looking along -z.
    #[must_use]
    pub fn render(&self, camera: &Camera, rays: u32) -> (Image, Image, BitMask) {
        assert!(rays > 0, "a pixel needs at least one ray");
        let prepared = camera.prepare();
        let step = 1.0 / f64::from(rays);
        let (width, height) = (camera.width, camera.height);
        let pixel = |column: u32, row: u32| {
            let (mut seen, mut without, mut tool) = (DVec3::ZERO, DVec3::ZERO, false);
            for (a, b) in (0..rays).flat_map(|b| (0..rays).map(move |a| (a, b))) {
                let inside = DVec2::new(f64::from(a) + 0.5, f64::from(b) + 0.5) * step;
                let Some(ray) = prepared.ray(DVec2::new(f64::from(column), f64::from(row)) + inside) else { continue };
                let tissue = self.trace_tissue(&ray);
                let first = self.before(&ray, tissue);
                without += tissue.rgb;
                seen += first.rgb;
                tool |= first.material.is_none();
            }
            let bytes = |sum: DVec3| (sum * (step * step)).to_array().map(to_byte);
            (bytes(seen), bytes(without), tool)
        };
        let rows: Vec<Vec<_>> =
            (0..height).into_par_iter().map(|row| (0..width).map(|column| pixel(column, row)).collect()).collect();
        let image = |data: Vec<u8>| Image { width, height, channels: 3, data, mask: None };
        let seen = image(rows.iter().flatten().flat_map(|p| p.0).collect());
        let without = image(rows.iter().flatten().flat_map(|p| p.1).collect());
        (seen, without, BitMask::from_fn(width, height, |column, row| rows[row as usize][column as usize].2))
    }
}
