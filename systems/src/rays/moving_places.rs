//! Where in space something moves: in blocks that enough of the views that see them see in a tile of their photo that moves.
//!
//! What moves in a tile is not behind what the field at rest shows there, as that hides it; and it is not right before the camera, where
//! every view would have a place of its own for what it shows. Where motion masks say what moves the field learns nothing there, and shows
//! nothing that could hide it.

use super::driver::RaySystem;
use super::photo_tiles::side_of_tile;
use super::residuals::{PhotoTile, ToldBy};
use crate::fields::MovingCells;
use engine::data::Dataset;
use engine::render::plain_query;
use engine::system::{Query, System};
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::Prepared;
use render_core::ray::Ray;
use render_core::space_map::SpaceMap;

/// Share of the tiles below which nothing moves: what is left over then are highlights and mistakes.
const NOTHING: f64 = 1e-3;
/// A block moves where this share of the views that see it see something move there, and at least so many of them.
const OF_VIEWS: f32 = 0.06;
const VIEWS: u16 = 2;
/// The same where masks say so, which do not err by chance.
const OF_MASKS: f32 = 0.03;
const MASKS: u16 = 1;
/// Views that are asked at most, spread evenly.
const ASKED: usize = 64;
/// What moves is farther off than this share of the distance of what a view sees near by, nearer than all but [`NEAREST`] of its tiles,
/// and at most a little behind what is seen in its tile.
const BEFORE: f64 = 0.5;
const NEAREST: f64 = 0.05;
const BEHIND: f64 = 1.15;

/// What a view sees move.
struct Sight {
    camera: Prepared,
    /// Where the view sees from, and how far off it sees at least, world units.
    from: DVec3,
    begin: f64,
    /// Pixels along a side of a tile, tiles in a row.
    side: u32,
    columns: usize,
    /// Of each tile how far off is what is seen in it, and whether it moves; nothing is known of some.
    tiles: Vec<Option<(f64, bool)>>,
}

impl Sight {
    /// Whether something moves at a point; `None` where the view does not see it.
    fn moves(&self, x: DVec3) -> Option<bool> {
        let camera = self.camera.camera();
        let pixel = self.camera.project(x)?;
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0;
        let [x_at, y_at] = [pixel.x, pixel.y].map(|at| at as u32);
        if !inside || x_at >= camera.width || y_at >= camera.height {
            return None;
        }
        let (end, moves) = self.tiles[(y_at / self.side) as usize * self.columns + (x_at / self.side) as usize]?;
        (self.begin..end).contains(&(x - self.from).length()).then_some(moves)
    }
}

/// How many views see the points of a row of blocks, and how many of them see something move there.
fn votes(sights: &[Sight], map: &SpaceMap, row: usize) -> Vec<[u16; 2]> {
    let n = MovingCells::ROW;
    let mut x = vec![0.0; 3 * n];
    let mut u = x.clone();
    for i in 0..n {
        let middle = MovingCells::middle_of_block(row * n + i);
        (0..3).for_each(|a| u[a * n + i] = middle[a]);
    }
    map.world(&u, &mut x);
    let place = |i: usize| DVec3::new(f64::from(x[i]), f64::from(x[n + i]), f64::from(x[2 * n + i]));
    let vote = |i: usize| {
        let mut votes = [0, 0];
        for moves in sights.iter().filter_map(|sight| sight.moves(place(i))) {
            votes[0] += 1;
            votes[1] += u16::from(moves);
        }
        votes
    };
    (0..n).map(vote).collect()
}

impl RaySystem {
    /// What a view sees, of whose photo these tiles are known.
    fn sight(&self, data: &Dataset, view: usize, tiles: &[PhotoTile], by: ToldBy) -> Sight {
        let camera = data.view(view);
        let [width, height] = [camera.camera.width, camera.camera.height];
        let side = side_of_tile(&camera.camera);
        let columns = width.div_ceil(side) as usize;
        let mut known = vec![None; columns * height.div_ceil(side) as usize];
        let of_tile = |tile: &PhotoTile| {
            let [x, y] = [tile.middle[0].min(width - 1), tile.middle[1].min(height - 1)];
            let at = (y / side) as usize * columns + (x / side) as usize;
            Some((camera.ray(x, y)?, at, tile.moves))
        };
        let seen: Vec<(Ray, usize, bool)> = tiles.iter().filter_map(of_tile).collect();
        let query = Query { time: camera.time, ..plain_query([0.0; 3], 0.01) };
        let rays: Vec<Ray> = seen.iter().map(|(ray, ..)| *ray).collect();
        let depths = self.render(&rays, &query).median_depth;
        for ((_, at, moves), depth) in seen.iter().zip(&depths) {
            let is_hidden = !*moves || by == ToldBy::Residuals;
            // Nothing hides what is before nothing: infinity stays.
            known[*at] = Some((if is_hidden { BEHIND * f64::from(*depth) } else { f64::INFINITY }, *moves));
        }
        let mut near: Vec<f64> = depths.iter().copied().filter(|d| d.is_finite()).map(f64::from).collect();
        near.sort_by(f64::total_cmp);
        let near = near.get((NEAREST * near.len() as f64) as usize).filter(|_| by == ToldBy::Residuals);
        let begin = near.map_or(0.0, |near| BEFORE * near);
        Sight { camera: camera.camera.prepare(), from: camera.camera.pose.c, begin, side, columns, tiles: known }
    }

    /// Cells in which something moves, and the share of the tiles that do; no cells where that is next to nothing.
    pub(super) fn moving_places(&self, data: &Dataset, tiles: &[Vec<PhotoTile>], by: ToldBy) -> (MovingCells, f64) {
        let all: usize = tiles.iter().map(Vec::len).sum();
        let moving = tiles.iter().flatten().filter(|tile| tile.moves).count();
        let of_tiles = moving as f64 / all.max(1) as f64;
        let mut cells = MovingCells::none();
        if of_tiles < NOTHING {
            return (cells, of_tiles);
        }
        let every = tiles.len().div_ceil(ASKED);
        let asked = tiles.iter().enumerate().step_by(every);
        let sights: Vec<Sight> = asked.map(|(view, tiles)| self.sight(data, view, tiles, by)).collect();
        let map = self.space.map();
        let rows: Vec<Vec<[u16; 2]>> =
            (0..MovingCells::BLOCKS / MovingCells::ROW).into_par_iter().map(|row| votes(&sights, &map, row)).collect();
        let (share, least) = match by {
            ToldBy::Residuals => (OF_VIEWS, VIEWS.min(sights.len() as u16)),
            ToldBy::Masks => (OF_MASKS, MASKS),
        };
        for (block, [seen, moving]) in rows.into_iter().flatten().enumerate() {
            if moving >= least && f32::from(moving) >= share * f32::from(seen) {
                cells.mark_block(block);
            }
        }
        // A block is as large as a finger is thick, and tiles are of whole hands: what moves reaches beyond both.
        (cells.grown().grown(), of_tiles)
    }
}
