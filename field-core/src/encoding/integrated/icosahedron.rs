//! Directions spread evenly over half of the sphere.

use alloc::vec::Vec;
use float_core::m64;

/// Squared distance below which two directions are one.
const SAME: f64 = 1e-4;

/// Unit vectors: the corners of an icosahedron whose edges are cut in `parts`, pushed out to the sphere, one of each
/// antipodal pair. `5 parts^2 + 1` of them: 6, 21, 46, …; `parts = 0` gives none.
///
/// `sum p p^T = (count / 3) I`, so that no direction of space is favoured. mip-NeRF 360 uses `parts = 2`.
///
/// # Panics
/// If there is no memory for `5 parts^2 + 1` vectors.
///
/// # Source
/// Barron et al., "Mip-NeRF 360", 2022, appendix, and its released code (`geopoly.generate_basis`).
#[must_use]
pub fn icosahedron(parts: usize) -> Vec<[f64; 3]> {
    let golden = 0.5 * (1.0 + m64::sqrt(5.0));
    let mut corners = Vec::with_capacity(12);
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        corners.extend([[0.0, a, b], [b, 0.0, a], [a, b, 0.0]]);
    }
    // Neighbours have the distance 2.
    let edge = |i: usize, j: usize| distance2(corners[i], corners[j]) < 4.5;
    let mut out: Vec<[f64; 3]> = Vec::with_capacity(5 * parts * parts + 1);
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if edge(i, j) && edge(j, k) && edge(i, k) {
                    tessellate([corners[i], corners[j], corners[k]], parts, &mut out);
                }
            }
        }
    }
    out
}

/// Add the points of a face that are not there yet, nor their antipodes.
fn tessellate(face: [[f64; 3]; 3], parts: usize, out: &mut Vec<[f64; 3]>) {
    if parts == 0 {
        return;
    }
    for u in 0..=parts {
        for v in 0..=parts - u {
            let weights = [u, v, parts - u - v].map(|w| w as f64);
            let sum: [f64; 3] = core::array::from_fn(|a| (0..3).map(|c| weights[c] * face[c][a]).sum());
            let length = m64::sqrt(sum.iter().map(|x| x * x).sum());
            let p = sum.map(|x| x / length);
            let known = out.iter().any(|&q| distance2(p, q) < SAME || distance2(p, q.map(|x| -x)) < SAME);
            if !known {
                out.push(p);
            }
        }
    }
}

fn distance2(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}
