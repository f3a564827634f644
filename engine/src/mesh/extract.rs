//! The surface where the fused distance passes zero, in cells that photos saw and nowhere else.

use super::grid::{Block, Grid, SIDE};
use glam::DVec3;
use rayon::prelude::*;
use scene_io::export::{CELL_EDGES, Mesh, cell_patterns};
use std::collections::HashMap;

/// Samples of a block and the next ones along each axis.
const MORE: usize = SIDE + 1;

/// A cut edge: its lower sample, and along which axis.
type Edge = ([usize; 3], usize);

/// The open mesh of zero crossings; every sample of a cell must have been seen by `photos` photos.
pub(super) fn extract(grid: &Grid, photos: u8) -> Mesh {
    let patterns = cell_patterns();
    let found: Vec<Vec<[(Edge, DVec3); 3]>> =
        grid.blocks.par_iter().map(|block| of_block(grid, block, photos, &patterns)).collect();
    let mut mesh = Mesh::default();
    let mut known: HashMap<Edge, u32> = HashMap::new();
    for corners in found.into_iter().flatten() {
        let triangle = corners.map(|(edge, x)| {
            *known.entry(edge).or_insert_with(|| {
                mesh.vertices.push(x.to_array());
                (mesh.vertices.len() - 1) as u32
            })
        });
        mesh.triangles.push(triangle);
    }
    mesh
}

fn of_block(grid: &Grid, block: &Block, photos: u8, patterns: &[Vec<[usize; 3]>]) -> Vec<[(Edge, DVec3); 3]> {
    let values = with_next(grid, block, photos);
    let first = block.at.map(|n| n * SIDE);
    let mut out = Vec::new();
    for k in 0..SIDE {
        for j in 0..SIDE {
            for i in 0..SIDE {
                let sample = [first[0] + i, first[1] + j, first[2] + k];
                // Cells, not samples: the last sample of the box starts none.
                if (0..3).any(|a| sample[a] >= grid.lattice.cells[a]) {
                    continue;
                }
                let corner: [f32; 8] =
                    std::array::from_fn(|c| values[((k + (c >> 2)) * MORE + j + (c >> 1 & 1)) * MORE + i + (c & 1)]);
                if corner.iter().any(|v| v.is_nan()) {
                    continue;
                }
                let pattern = (0..8).fold(0, |bits, c| bits | usize::from(corner[c] < 0.0) << c);
                let vertex = |e: usize| {
                    let [a, b] = CELL_EDGES[e];
                    let at = [0, 1, 2].map(|axis| sample[axis] + (a >> axis & 1));
                    let (from, to) = (f64::from(corner[a]), f64::from(corner[b]));
                    let mut x = grid.lattice.at(at);
                    x[e / 4] += grid.lattice.cell * (from / (from - to));
                    ((at, e / 4), x)
                };
                out.extend(patterns[pattern].iter().map(|triangle| triangle.map(vertex)));
            }
        }
    }
    out
}

/// The distances of a block and of the samples next to it; NaN where too few photos saw it.
fn with_next(grid: &Grid, block: &Block, photos: u8) -> Vec<f32> {
    let mut values = vec![f32::NAN; MORE * MORE * MORE];
    for part in 0..8_usize {
        let step = [part & 1, part >> 1 & 1, part >> 2];
        let Some(&n) = grid.index.get(&[0, 1, 2].map(|a| block.at[a] + step[a])) else { continue };
        let from = &grid.blocks[n];
        let range = |a: usize| if step[a] == 1 { SIDE..MORE } else { 0..SIDE };
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let at = ((k % SIDE) * SIDE + j % SIDE) * SIDE + i % SIDE;
                    if from.weight[at] > 0.0 && from.photos[at] >= photos {
                        values[(k * MORE + j) * MORE + i] = from.distance[at];
                    }
                }
            }
        }
    }
    values
}
