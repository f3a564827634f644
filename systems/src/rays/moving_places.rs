//! Where in space something moves: in blocks that enough of the views that see them see in a tile of their photo that moves.
//!
//! A tile is a line of sight. What moves on it is not behind what the field at rest shows there, as that hides it; and it is not right
//! before the camera, where every view would have a place of its own for what it shows.

use super::driver::RaySystem;
use super::movers::Found;
use super::residuals::PhotoTile;
use crate::fields::MovingCells;
use crate::space::{Space, SpaceKind};
use engine::data::Dataset;
use engine::halt::Halt;
use engine::system::{Appearance, LayerRequest, Query, System};
use float_core::Simd;
use rayon::prelude::*;
use render_core::ray::Ray;

/// Share of the tiles below which nothing moves: what is left over then are highlights and mistakes.
const NOTHING: f64 = 1e-3;
/// A block moves where this share of the views that see it see something move there, and at least so many of them.
const OF_VIEWS: f32 = 0.1;
const VIEWS: u16 = 3;
/// Tiles that are looked along at most: of views spread evenly.
const LOOKED_ALONG: usize = 1 << 16;
/// Places along an axis of the unit cube that a line of sight goes through, one after the other.
const STEPS: f32 = 128.0;
/// A line of sight begins at this share of the distance of what a view sees near by, nearer than all but [`NEAREST`] of its tiles, and
/// ends a little behind what is seen on it.
const BEFORE: f64 = 0.5;
const NEAREST: f64 = 0.05;
const BEHIND: f64 = 1.15;

/// A line of sight from `begin` to `end`, world units.
struct Sight {
    ray: Ray,
    moves: bool,
    begin: f64,
    end: f64,
}

/// Blocks that lines of sight of a view go through, and those of them on which the view sees something move; each once.
fn seen_blocks(space: &Space, sights: &[Sight]) -> (Vec<u32>, Vec<u32>) {
    let (mut seen, mut moving) = (Vec::new(), Vec::new());
    let simd = Simd::best();
    // Half a side of the unit cube in internal units where space is not contracted.
    let scale = if space.kind() == SpaceKind::Contracted { 4.0 / STEPS } else { 2.0 / STEPS };
    let (mut p, mut x) = ([0.0; 3], [0.0; 3]);
    for sight in sights {
        let ray = space.internal_ray(&sight.ray);
        let mut t = ray.start;
        while t < ray.end {
            let far_off = space.world_distance(&sight.ray, t);
            if far_off > sight.end {
                break;
            }
            p.copy_from_slice(&ray.at(t));
            if far_off >= sight.begin {
                space.grid_positions(simd, &p, &mut x);
                let block = MovingCells::block(x) as u32;
                if seen.last() != Some(&block) {
                    seen.push(block);
                    if sight.moves {
                        moving.push(block);
                    }
                }
            }
            // The contraction shortens what is far by the square of its distance.
            let far = p.iter().fold(1.0, |far: f32, p| far.max(p.abs()));
            t += if space.kind() == SpaceKind::Contracted { scale * far * far } else { scale };
        }
    }
    for blocks in [&mut seen, &mut moving] {
        blocks.sort_unstable();
        blocks.dedup();
    }
    (seen, moving)
}

impl RaySystem {
    /// The lines of sight through the tiles of a view.
    fn sights(&self, data: &Dataset, view: usize, tiles: &[PhotoTile]) -> Vec<Sight> {
        let camera = data.view(view);
        let [right, bottom] = [camera.camera.width - 1, camera.camera.height - 1];
        let sight = |tile: &PhotoTile| {
            let ray = camera.ray(tile.middle[0].min(right), tile.middle[1].min(bottom))?;
            Some(Sight { ray, moves: tile.moves, begin: 0.0, end: f64::INFINITY })
        };
        let mut sights: Vec<Sight> = tiles.iter().filter_map(sight).collect();
        let query = Query {
            background: [0.0; 3],
            layers: LayerRequest::default(),
            error_budget: 0.01,
            appearance: Appearance::Mean,
            time: camera.time,
            halt: Halt::NEVER,
        };
        let rays: Vec<Ray> = sights.iter().map(|sight| sight.ray).collect();
        let depths = self.render(&rays, &query).median_depth;
        let mut near: Vec<f64> = depths.iter().copied().filter(|d| d.is_finite()).map(f64::from).collect();
        near.sort_by(f64::total_cmp);
        let begin = near.get((NEAREST * near.len() as f64) as usize).map_or(0.0, |near| BEFORE * near);
        for (sight, depth) in sights.iter_mut().zip(depths) {
            // Nothing hides what is before nothing: infinity stays.
            (sight.begin, sight.end) = (begin, BEHIND * f64::from(depth));
        }
        sights
    }

    /// Cells in which something moves, and what was found; no cells where that is next to nothing.
    pub(super) fn moving_places(&self, data: &Dataset, tiles: &[Vec<PhotoTile>]) -> (MovingCells, Found) {
        let all: usize = tiles.iter().map(Vec::len).sum();
        let moving = tiles.iter().flatten().filter(|tile| tile.moves).count();
        let share = moving as f64 / all.max(1) as f64;
        let mut cells = MovingCells::none();
        if share < NOTHING {
            return (cells, Found { tiles: share, cells: 0.0 });
        }
        let every = all.div_ceil(LOOKED_ALONG);
        let sights: Vec<Vec<Sight>> =
            tiles.iter().enumerate().step_by(every).map(|(view, tiles)| self.sights(data, view, tiles)).collect();
        let views: Vec<(Vec<u32>, Vec<u32>)> =
            sights.par_iter().map(|sights| seen_blocks(&self.space, sights)).collect();
        let mut votes = vec![[0_u16; 2]; MovingCells::BLOCKS];
        for (seen, moving) in &views {
            for (kind, blocks) in [seen, moving].into_iter().enumerate() {
                for &block in blocks {
                    let votes = &mut votes[block as usize][kind];
                    *votes = votes.saturating_add(1);
                }
            }
        }
        let least = VIEWS.min(views.len() as u16);
        for (block, [seen, moving]) in votes.into_iter().enumerate() {
            if moving >= least && f32::from(moving) >= OF_VIEWS * f32::from(seen) {
                cells.mark_block(block);
            }
        }
        let cells = cells.grown();
        let found = Found { tiles: share, cells: cells.count() as f64 / MovingCells::ALL as f64 };
        (cells, found)
    }
}
