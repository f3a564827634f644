//! Space that points of photos are seen through: a camera that sees a point sees nothing before it.
//!
//! Points that several photos show belong to the place, and the line from a camera to such a point is free. A cell that several of
//! these lines cross, none of them near its end, and that no point lies in or beside, is empty; and so is what lies in a picture
//! before all of its points: each camera has a near plane of its own. What one photo alone shows is explained as well by anything on
//! its rays, at any depth: it is not where other photos were taken. Without this, few photos are explained by a fog before each camera.

use crate::layout::nearest_depth;
use crate::space::Space;
use engine::data::Dataset;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Prepared};
use render_core::occupancy::OccupancyGrid;

/// Lines that make a cell free.
const LINES: u16 = 3;
/// Part of a line that counts: points are not that certain, and what they lie on has a thickness.
const CERTAIN: f32 = 0.9;
/// A place that one photo alone shows is where others were taken when one was taken nearer to it than this part of its distance from that
/// photo.
const BESIDE: f64 = 0.5;
/// Places checked along a cell's side.
const PER_CELL: f32 = 2.0;

/// What is free besides what points are seen through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AlsoFree {
    /// For a field: what lies in a picture before all of its points.
    BeforePoints,
    /// For a cloud: what one photo alone shows where others were taken. What has few features may well be nearer than a photo's points,
    /// and there Gaussians would not come again.
    WhereOthersStood,
}

/// What a plan says where points say what is free; `None` without points.
pub(crate) fn free_space_line(data: &Dataset, also: AlsoFree) -> Option<String> {
    let lines: usize = data.views().iter().filter(|v| v.level == 0).map(|v| v.points.len()).sum();
    let rest = match also {
        AlsoFree::BeforePoints => "what lies in a photo before all of its points",
        AlsoFree::WhereOthersStood => "what one photo alone shows where others were taken",
    };
    (lines > 0).then(|| {
        format!("free space: what lies before points is empty ({lines} lines from cameras to points), and {rest}")
    })
}

/// Which cells of the grid are free; all false without points.
pub(crate) fn free_cells(grid: &OccupancyGrid, space: &Space, data: &Dataset, also: AlsoFree) -> Vec<bool> {
    let mut lines = vec![0_u16; grid.cells()];
    let mut kept = vec![false; grid.cells()];
    let mut any = false;
    let mut nears = Vec::new();
    let mut photos = Vec::new();
    for view in data.views().iter().filter(|view| view.level == 0) {
        photos.extend((also == AlsoFree::WhereOthersStood).then(|| Photo::of(&view.camera)));
        let Some(o) = space.internal_point(view.camera.pose.c) else { continue };
        let depth = (also == AlsoFree::BeforePoints).then(|| nearest_depth(&view.camera, &view.points)).flatten();
        nears.extend(depth.map(|depth| Near {
            photo: Photo::of(&view.camera),
            axis: view.camera.optical_axis(),
            depth: f64::from(CERTAIN) * depth,
        }));
        for point in view.points.iter() {
            let Some(p) = space.internal_point(*point) else { continue };
            any = true;
            keep_around(grid, p, &mut kept);
            cross(grid, o, p, &mut lines);
        }
    }
    if !any {
        return kept;
    }
    let unseen = |id: u32| {
        let (corner, side) = grid.cell_box(id);
        let centre = space.world_point(corner.map(|c| c + 0.5 * side));
        let reach = (space.world_point(corner) - centre).length();
        nears.iter().any(|near| near.holds(centre, reach)) || is_where_others_stood(&photos, centre)
    };
    let mut free: Vec<bool> = (0..grid.cells() as u32)
        .into_par_iter()
        .map(|id| !kept[id as usize] && (lines[id as usize] >= LINES || unseen(id)))
        .collect();
    // A cell that is only met by long steps is free where the eight it consists of are.
    let resolution = grid.settings().resolution;
    for k in 1..grid.settings().cascades {
        let inner = resolution / 4..resolution - resolution / 4;
        for (z, y, x) in inner.clone().flat_map(|z| {
            let rows = inner.clone();
            rows.clone().flat_map(move |y| rows.clone().map(move |x| (z, y, x)))
        }) {
            let corner = [x, y, z].map(|c| 2 * (c - resolution / 4));
            let parts = (0..8_u32).map(|i| grid.cell(k - 1, [0, 1, 2].map(|a| corner[a] + (i >> a & 1))));
            free[grid.cell(k, [x, y, z]) as usize] = parts.into_iter().all(|part| free[part as usize]);
        }
    }
    free
}

/// What a photo has in its picture.
struct Photo {
    camera: Prepared,
    size: [f64; 2],
    centre: DVec3,
}

impl Photo {
    fn of(camera: &Camera) -> Self {
        let size = [camera.width, camera.height].map(f64::from);
        Self { camera: camera.prepare(), size, centre: camera.pose.c }
    }

    fn shows(&self, x: DVec3) -> bool {
        let in_picture = |p: DVec2| p.x >= 0.0 && p.y >= 0.0 && p.x <= self.size[0] && p.y <= self.size[1];
        self.camera.project(x).is_some_and(in_picture)
    }
}

/// Whether one photo alone shows `x`, and others were taken near it.
fn is_where_others_stood(photos: &[Photo], x: DVec3) -> bool {
    let distances = || photos.iter().map(|photo| photo.centre.distance(x));
    let (nearest, furthest) = (distances().fold(f64::INFINITY, f64::min), distances().fold(0.0, f64::max));
    // Most places are far from all cameras: they need not be projected.
    if nearest >= BESIDE * furthest {
        return false;
    }
    let mut shown = photos.iter().filter(|photo| photo.shows(x));
    let (Some(only), None) = (shown.next(), shown.next()) else { return false };
    nearest < BESIDE * only.centre.distance(x)
}

/// A photo and the depth before which it shows nothing.
struct Near {
    photo: Photo,
    axis: DVec3,
    depth: f64,
}

impl Near {
    /// Whether a ball of radius `reach` about `x` lies before all that the camera shows, its centre in the picture or all of it
    /// at the camera.
    fn holds(&self, x: DVec3, reach: f64) -> bool {
        let way = x - self.photo.centre;
        let z = way.dot(self.axis);
        if z + reach >= self.depth || z < -reach {
            return false;
        }
        way.length() <= reach || (z > 0.0 && self.photo.shows(x))
    }
}

/// The finest cell that holds `p`, inside the grid.
fn cell_of(grid: &OccupancyGrid, p: [f32; 3]) -> (u32, [u32; 3]) {
    let furthest = p.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    let k = (0..grid.settings().cascades - 1).find(|k| furthest < (1_u32 << k) as f32);
    let k = k.unwrap_or(grid.settings().cascades - 1);
    let (side, half, last) = (grid.cell_side(k), (1_u32 << k) as f32, grid.settings().resolution - 1);
    (k, p.map(|x| (((x + half) / side).max(0.0) as u32).min(last)))
}

/// The cell of a point and those beside it stay.
fn keep_around(grid: &OccupancyGrid, p: [f32; 3], kept: &mut [bool]) {
    let (k, at) = cell_of(grid, p);
    let last = grid.settings().resolution - 1;
    for i in 0..27_u32 {
        let shift = [i % 3, i / 3 % 3, i / 9];
        let beside = [0, 1, 2].map(|a| (at[a] + shift[a]).saturating_sub(1).min(last));
        kept[grid.cell(k, beside) as usize] = true;
    }
}

/// Count the line from `o` to `p` in the cells it crosses.
fn cross(grid: &OccupancyGrid, o: [f32; 3], p: [f32; 3], lines: &mut [u16]) {
    let way = [0, 1, 2].map(|a| p[a] - o[a]);
    let length = way.iter().map(|x| x * x).sum::<f32>().sqrt();
    let (mut t, mut previous) = (0.0, None);
    while t < CERTAIN * length {
        let at = [0, 1, 2].map(|a| o[a] + t / length * way[a]);
        let (k, x) = cell_of(grid, at);
        if previous.replace((k, x)) != Some((k, x)) {
            let count = &mut lines[grid.cell(k, x) as usize];
            *count = count.saturating_add(1);
        }
        let next = t + grid.cell_side(k) / PER_CELL;
        // A line so long that a cell is less than rounding has no cells to count.
        if next <= t {
            return;
        }
        t = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::occupancy::GridSettings;

    fn grid() -> OccupancyGrid {
        OccupancyGrid::new(
            GridSettings::DEFAULT.with_resolution(16).with_cascades(2).with_decay(0.9).with_threshold(0.1),
        )
        .unwrap()
    }

    #[test]
    fn cells_found_are_those_that_hold_the_point() {
        let grid = grid();
        for p in [[0.0; 3], [0.99, -0.99, 0.3], [1.0, 0.0, 0.0], [-1.99, 1.3, 0.1], [2.0, -2.0, 2.0]] {
            let (k, x) = cell_of(&grid, p);
            let (corner, side) = grid.cell_box(grid.cell(k, x));
            for a in 0..3 {
                assert!(corner[a] <= p[a] && p[a] <= corner[a] + side, "{p:?} in {corner:?} + {side}");
            }
            assert_eq!(k == 0, p.iter().all(|x| x.abs() < 1.0), "the finest that does");
        }
    }

    #[test]
    fn a_line_crosses_each_cell_once_and_not_its_end() {
        let grid = grid();
        let mut lines = vec![0; grid.cells()];
        cross(&grid, [-1.9, 0.03, 0.03], [0.9, 0.03, 0.03], &mut lines);
        assert_eq!(lines.iter().max(), Some(&1));
        let at = |p| {
            let (k, x) = cell_of(&grid, p);
            lines[grid.cell(k, x) as usize]
        };
        for x in [-1.9, -1.2, -0.8, 0.0, 0.5] {
            assert_eq!(at([x, 0.03, 0.03]), 1, "{x}");
        }
        assert_eq!([at([0.9, 0.03, 0.03]), at([0.0, 0.3, 0.0])], [0, 0]);
        // A point at the camera is not a line.
        cross(&grid, [0.5; 3], [0.5; 3], &mut lines);
    }

    #[test]
    fn each_camera_has_a_near_plane_of_its_own() {
        use render_core::pose::Pose;
        let pose = Pose { r: glam::DMat3::IDENTITY, c: DVec3::new(0.0, 0.0, -1.0) };
        let camera = Camera::pinhole(40, 40, 40.0, 40.0, 20.0, 20.0, pose);
        let near = Near { photo: Photo::of(&camera), axis: camera.optical_axis(), depth: 1.0 };
        for (x, reach, holds) in [
            (DVec3::new(0.0, 0.0, -0.5), 0.1, true),
            (DVec3::new(0.0, 0.0, -0.5), 0.6, false),
            (DVec3::new(0.0, 0.0, 0.1), 0.1, false),
            (DVec3::new(0.4, 0.0, -0.5), 0.1, false),
            (DVec3::new(0.05, 0.0, -1.0), 0.1, true),
            (DVec3::new(0.5, 0.0, -1.0), 0.1, false),
            (DVec3::new(0.0, 0.0, -1.5), 0.1, false),
        ] {
            assert_eq!(near.holds(x, reach), holds, "{x} {reach}");
        }
    }

    #[test]
    fn what_one_photo_shows_is_not_where_others_were_taken() {
        use render_core::pose::Pose;
        let at = |z: f64, turned: bool| {
            let r = if turned { glam::DMat3::from_rotation_y(std::f64::consts::PI) } else { glam::DMat3::IDENTITY };
            let pose = Pose { r, c: DVec3::new(0.0, 0.0, z) };
            Photo::of(&Camera::pinhole(40, 40, 40.0, 40.0, 20.0, 20.0, pose))
        };
        // The first looks over the shoulder of the second, which looks away from it.
        let [far, near] = [at(-4.0, false), at(1.0, false)];
        let photos = [far, near];
        for (z, stood) in [(0.5, true), (-0.6, true), (-0.7, false), (-3.0, false), (1.5, false), (-5.0, false)] {
            assert_eq!(is_where_others_stood(&photos, DVec3::new(0.0, 0.0, z)), stood, "{z}");
        }
        let two_look = [at(-4.0, false), at(-4.5, false), at(1.0, false)];
        assert!(!is_where_others_stood(&two_look, DVec3::new(0.0, 0.0, 0.5)), "two photos show it");
        let none_looks = [at(-4.0, true), at(1.0, false)];
        assert!(!is_where_others_stood(&none_looks, DVec3::new(0.0, 0.0, 0.5)), "nothing is known of it");
        for few in [&photos[..0], &photos[..1]] {
            assert!(!is_where_others_stood(few, DVec3::new(0.0, 0.0, 0.5)));
        }
        assert!(!is_where_others_stood(&photos, DVec3::NAN));
    }

    #[test]
    fn what_lies_beside_a_point_stays() {
        let grid = grid();
        let mut kept = vec![false; grid.cells()];
        keep_around(&grid, [0.01, 0.01, 0.01], &mut kept);
        assert_eq!(kept.iter().filter(|k| **k).count(), 27);
        keep_around(&grid, [-2.0; 3], &mut kept);
        assert_eq!(kept.iter().filter(|k| **k).count(), 27 + 8, "a corner of the outer cube");
    }
}
