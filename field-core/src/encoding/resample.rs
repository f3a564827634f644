//! A grid of features at another resolution: both lattices span the unit box, first vertex on first.

use alloc::vec;
use alloc::vec::Vec;

/// Vertices along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Axis {
    /// All of them.
    pub(crate) vertices: usize,
    /// Cells of the unit interval. Vertices may lie beyond.
    pub(crate) cells: usize,
}

/// Vertices along x, y, z of features `[z][y][x][features]`.
pub(crate) type Box3 = [Axis; 3];

/// Where vertex `j` of one axis lies on another: the vertex below, the one above, and the share of the latter.
fn locate(j: usize, from: Axis, to: Axis) -> (usize, usize, f32) {
    let (cells, per) = (from.cells as u64, (to.cells as u64).max(1));
    // In integers: vertices that coincide are found exactly.
    let at = j as u64 * cells;
    let (cell, rest) = ((at / per) as usize, at % per);
    let last = from.vertices - 1;
    if cell >= last {
        return (last, last, 0.0);
    }
    if rest == 0 { (cell, cell, 0.0) } else { (cell, cell + 1, (rest as f64 / per as f64) as f32) }
}

/// `a` exactly where both are the same, or the share is 0.
fn blend(a: f32, b: f32, share: f32) -> f32 {
    if share == 0.0 { a } else { a + share * (b - a) }
}

/// The trilinear blend of `table` at the vertices of `to`; constant beyond the last vertex of `from`.
pub(crate) fn resample(from: Box3, to: Box3, features: usize, table: &[f32]) -> Vec<f32> {
    let [wide, high, _] = from.map(|axis| axis.vertices);
    let row = wide * features;
    let source = |z: usize, y: usize| &table[(z * high + y) * row..][..row];
    let columns: Vec<_> = (0..to[0].vertices).map(|x| locate(x, from[0], to[0])).collect();
    let mut out = Vec::with_capacity(to.iter().map(|axis| axis.vertices).product::<usize>() * features);
    let mut blended = vec![0.0; row];
    for z in 0..to[2].vertices {
        let (z0, z1, fz) = locate(z, from[2], to[2]);
        for y in 0..to[1].vertices {
            let (y0, y1, fy) = locate(y, from[1], to[1]);
            let (near, far) = ([source(z0, y0), source(z0, y1)], [source(z1, y0), source(z1, y1)]);
            for (i, b) in blended.iter_mut().enumerate() {
                *b = blend(blend(near[0][i], near[1][i], fy), blend(far[0][i], far[1][i], fy), fz);
            }
            for &(x0, x1, fx) in &columns {
                let ends = (&blended[x0 * features..][..features], &blended[x1 * features..][..features]);
                out.extend(ends.0.iter().zip(ends.1).map(|(&a, &b)| blend(a, b, fx)));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Axis, locate, resample};
    use alloc::vec::Vec;

    #[test]
    fn vertices_are_found_where_they_coincide() {
        let axis = |vertices, cells| Axis { vertices, cells };
        assert_eq!(locate(4, axis(4, 3), axis(7, 6)), (2, 2, 0.0));
        assert_eq!(locate(5, axis(4, 3), axis(7, 6)), (2, 3, 0.5));
        assert_eq!(locate(6, axis(4, 3), axis(7, 6)), (3, 3, 0.0));
        // Beyond the box: between vertices that exist, and past the last.
        assert_eq!(locate(3, axis(5, 3), axis(5, 2)), (4, 4, 0.0));
        assert_eq!(locate(3, axis(6, 3), axis(5, 2)), (4, 5, 0.5));
        assert_eq!(locate(9, axis(5, 3), axis(10, 2)), (4, 4, 0.0));
        // A single vertex.
        assert_eq!(locate(3, axis(1, 0), axis(4, 3)), (0, 0, 0.0));
        assert_eq!(locate(0, axis(4, 3), axis(1, 0)), (0, 0, 0.0));
    }

    #[test]
    fn linear_functions_stay_what_they_are() {
        let of = |n: [usize; 3]| n.map(|n| Axis { vertices: n, cells: n - 1 });
        let (from, to) = ([3, 5, 2], [4, 9, 3]);
        let value = |n: [usize; 3], x: usize, y: usize, z: usize| {
            let unit = |i: usize, n: usize| i as f32 / (n - 1) as f32;
            [unit(x, n[0]) + 10.0 * unit(y, n[1]) - 4.0 * unit(z, n[2]), 7.0]
        };
        let table = |n: [usize; 3]| -> Vec<f32> {
            let all = (0..n[2]).flat_map(move |z| (0..n[1]).flat_map(move |y| (0..n[0]).map(move |x| (x, y, z))));
            all.flat_map(|(x, y, z)| value(n, x, y, z)).collect()
        };
        let got = resample(of(from), of(to), 2, &table(from));
        let want = table(to);
        assert_eq!(got.len(), want.len());
        for (g, w) in got.iter().zip(&want) {
            assert!((g - w).abs() < 2e-6, "{g} {w}");
        }
    }
}
