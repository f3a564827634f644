//! A distance to the surface on a grid that exists near the surface only: blocks of 8 x 8 x 8 samples.
//!
//! Letters: `sdf` signed distance, world units, positive before the surface; `reach` the distance beyond which it is cut;
//! blocks and samples are counted from the box's smallest corner.

use super::depth::{DepthView, Place, known};
use crate::crop::CropBox;
use crate::halt::Halt;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Samples of a block along an axis.
pub(super) const SIDE: usize = 8;
/// Samples of a block.
pub(super) const VOLUME: usize = SIDE * SIDE * SIDE;
/// Cells that the distance is known to, before and behind the surface.
const REACH: f64 = 3.0;
/// Weight of a view that sees through a sample against one that shows a surface.
const FREE_WEIGHT: f32 = 0.5;
/// What a view between photos weighs.
const BETWEEN_WEIGHT: f32 = 0.3;

/// Where the samples lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lattice {
    /// Smallest corner of the box.
    pub(super) min: DVec3,
    /// Side of a cell, world units.
    pub(super) cell: f64,
    /// Cells along x, y, z: samples are one more.
    pub(super) cells: [usize; 3],
}

impl Lattice {
    pub(super) fn new(crop: &CropBox, cell: f64) -> Self {
        let size = DVec3::from(crop[1]) - DVec3::from(crop[0]);
        let cells = (size / cell).ceil().max(DVec3::ONE).to_array().map(|n| n as usize);
        Self { min: crop[0].into(), cell, cells }
    }

    /// Largest distance that is told from larger ones.
    pub(super) fn reach(&self) -> f64 {
        REACH * self.cell
    }

    pub(super) fn at(&self, sample: [usize; 3]) -> DVec3 {
        self.min + DVec3::from(sample.map(|n| n as f64)) * self.cell
    }

    /// Blocks along each axis.
    fn blocks(&self) -> [usize; 3] {
        self.cells.map(|n| n / SIDE + 1)
    }
}

/// One block.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// In blocks from the smallest corner.
    pub(super) at: [usize; 3],
    /// Mean of `sdf / reach`, `-1..=1`.
    pub(super) distance: Vec<f32>,
    /// Sum of weights.
    pub(super) weight: Vec<f32>,
    /// Photos that saw the sample.
    pub(super) photos: Vec<u8>,
}

/// The blocks that surfaces pass through.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub(super) lattice: Lattice,
    pub(super) blocks: Vec<Block>,
    /// Place of a block in `blocks`.
    pub(super) index: HashMap<[usize; 3], usize>,
}

/// The blocks within reach of a surface that a view shows, sorted; `None` if there are more than `most`.
pub(super) fn near_surface(views: &[DepthView], lattice: &Lattice, most: usize) -> Option<Vec<[usize; 3]>> {
    let side = lattice.cell * SIDE as f64;
    let limits = lattice.blocks();
    let of_view = |view: &DepthView| {
        let mut found: Vec<[usize; 3]> = Vec::new();
        let mut last = [[usize::MAX; 3]; 3];
        for i in (0..view.len()).filter(|&i| view.weight[i] > 0.0) {
            let Some(x) = view.point(i) else { continue };
            let way = (x - view.camera.pose.c).normalize_or_zero() * lattice.reach();
            for (k, step) in [-1.0, 0.0, 1.0].into_iter().enumerate() {
                let place = (x + way * step - lattice.min) / side;
                if place.cmplt(DVec3::ZERO).any() || !place.is_finite() {
                    continue;
                }
                let at = place.to_array().map(|p| p as usize);
                if at != last[k] && (0..3).all(|a| at[a] < limits[a]) {
                    last[k] = at;
                    found.push(at);
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    };
    let mut all = Vec::new();
    for some in views.chunks(16) {
        let found: Vec<_> = some.par_iter().map(of_view).collect();
        all.extend(found.into_iter().flatten());
        all.sort_unstable();
        all.dedup();
        if all.len() > most {
            return None;
        }
    }
    Some(all)
}

/// What a view needs to be asked quickly.
struct Ready<'a> {
    view: &'a DepthView,
    f: [f32; 2],
    c: [f32; 2],
    size: [i32; 2],
    photo: bool,
}

impl Grid {
    /// Fuse what `views` show into `blocks`; into some of them where `halt` is raised on the way.
    pub(super) fn fuse(views: &[DepthView], lattice: Lattice, blocks: &[[usize; 3]], halt: &Halt) -> Self {
        let ready: Vec<Ready<'_>> = views
            .iter()
            .map(|view| Ready {
                view,
                f: [view.camera.fx as f32, view.camera.fy as f32],
                c: [view.camera.cx as f32, view.camera.cy as f32],
                size: [view.camera.width as i32, view.camera.height as i32],
                photo: view.place == Place::Photo,
            })
            .collect();
        let of_block = |&at: &[usize; 3]| (!halt.raised()).then(|| fused(&ready, &lattice, at));
        let blocks: Vec<Block> = blocks.par_iter().filter_map(of_block).collect();
        let index = blocks.iter().enumerate().map(|(i, block)| (block.at, i)).collect();
        Self { lattice, blocks, index }
    }
}

fn fused(views: &[Ready<'_>], lattice: &Lattice, at: [usize; 3]) -> Block {
    let mut sum = vec![0.0_f32; VOLUME];
    let mut weight = vec![0.0_f32; VOLUME];
    let mut photos = vec![0_u8; VOLUME];
    let corner = lattice.at(at.map(|n| n * SIDE));
    let half = 0.5 * lattice.cell * SIDE as f64;
    for ready in views {
        let pose = &ready.view.camera.pose;
        if !ready.may_show(pose.to_camera(corner + half), half * 3.0_f64.sqrt()) {
            continue;
        }
        let start = pose.to_camera(corner).as_vec3();
        let steps = pose.r.transpose() * lattice.cell;
        let [right, down, deep] = [steps.x_axis, steps.y_axis, steps.z_axis].map(|v| v.as_vec3());
        for k in 0..SIDE {
            for j in 0..SIDE {
                let row = start + deep * k as f32 + down * j as f32;
                for i in 0..SIDE {
                    let n = (k * SIDE + j) * SIDE + i;
                    let Some((value, w)) = ready.ask(row + right * i as f32, lattice) else { continue };
                    sum[n] += value * w;
                    weight[n] += w;
                    photos[n] = photos[n].saturating_add(u8::from(ready.photo));
                }
            }
        }
    }
    sum.iter_mut().zip(&weight).filter(|(_, w)| **w > 0.0).for_each(|(sum, w)| *sum /= w);
    Block { at, distance: sum, weight, photos }
}

impl Ready<'_> {
    /// Can a ball of radius `r` around `p`, camera axes, be in the picture?
    fn may_show(&self, p: DVec3, r: f64) -> bool {
        if p.z < -r {
            return false;
        }
        let z = p.z.max(1e-12);
        let [w, h] = self.size.map(f64::from);
        let far = |p: f64, f: f32, c: f32, side: f64| {
            // The ball's side nearest to the picture, on planes through the camera: generous by the slope of the ray.
            let (low, high) = (-f64::from(c) / f64::from(f), (side - f64::from(c)) / f64::from(f));
            p < low * z - r * (1.0 + low.abs()) || p > high * z + r * (1.0 + high.abs())
        };
        !(far(p.x, self.f[0], self.c[0], w) || far(p.y, self.f[1], self.c[1], h))
    }

    /// What the view says of a sample at `p`, camera axes: distance over reach, and weight.
    fn ask(&self, p: Vec3, lattice: &Lattice) -> Option<(f32, f32)> {
        if p.z <= 0.0 {
            return None;
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        let (u, v) = (self.f[0] * x + self.c[0], self.f[1] * y + self.c[1]);
        let [w, h] = self.size;
        if !(u >= 0.0 && v >= 0.0 && u < w as f32 && v < h as f32) {
            return None;
        }
        let view = self.view;
        let i = v as usize * w as usize + u as usize;
        let mut z = view.z[i];
        let between = if self.photo { 1.0 } else { BETWEEN_WEIGHT };
        if z == f32::INFINITY {
            return Some((1.0, FREE_WEIGHT * between));
        }
        let own = view.weight[i];
        if own <= 0.0 {
            return None;
        }
        // Between four pixels of one surface the depth is interpolated.
        let (a, b) = ((u - 0.5).max(0.0), (v - 0.5).max(0.0));
        let (i0, j0) = ((a as usize).min(w as usize - 1), (b as usize).min(h as usize - 1));
        if i0 + 1 < w as usize && j0 + 1 < h as usize {
            let first = j0 * w as usize + i0;
            let corners = [first, first + 1, first + w as usize, first + w as usize + 1].map(|n| view.z[n]);
            let (low, high) = corners.iter().fold((f32::MAX, 0.0_f32), |(l, h), &c| (l.min(c), h.max(c)));
            if known(low) && high < low * 1.05 {
                let (s, t) = (a - i0 as f32, b - j0 as f32);
                let rows = [corners[0] + s * (corners[1] - corners[0]), corners[2] + s * (corners[3] - corners[2])];
                z = rows[0] + t * (rows[1] - rows[0]);
            }
        }
        let (reach, cell) = (lattice.reach() as f32, lattice.cell as f32);
        let sdf = (z - p.z) * (x * x + y * y + 1.0).sqrt() * view.cosine[i];
        if sdf < -reach {
            return None;
        }
        if sdf > reach {
            return Some((1.0, FREE_WEIGHT * own * between));
        }
        // Behind the surface less and less is known: what is there may belong to another one.
        let behind = if sdf < -cell { (reach + sdf) / (reach - cell) } else { 1.0 };
        Some((sdf / reach, own * between * behind.max(1e-3)))
    }
}
