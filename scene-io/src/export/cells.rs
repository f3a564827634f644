//! How the surface cuts a cell of marching cubes, for each of the 256 patterns of inside and outside corners.
//!
//! The patterns are worked out instead of tabulated. On each face of the cube the cut edges are joined in pairs, so that
//! every run of inside corners is cut off by its own line. What a face looks like depends on the four values at its
//! corners alone, so the two cells that share it agree and the surface has no holes, also in the ambiguous patterns with
//! two inside corners across a face's diagonal. The lines of the six faces close to loops, which are cut to triangles.
//!
//! The idea of the patterns: Lorensen and Cline, "Marching cubes", 1987; of joining by face: the same authors' critics,
//! first Dürst, "Additional reference to marching cubes", 1988.

/// Corner `c` lies at `(c & 1, c >> 1 & 1, c >> 2)`.
pub(super) const CORNERS: usize = 8;

/// Edges of a cell as pairs of corners, the lower one first: four along x, four along y, four along z. Corner `c` lies at
/// `(c & 1, c >> 1 & 1, c >> 2)`.
pub const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// The corners of each face, counter-clockwise seen from outside the cube.
const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Triangles of each of the 256 patterns, as indices into [`EDGES`], counter-clockwise seen from outside. Bit `c` of a pattern
/// is set if corner `c` is inside. Cells that share a face agree on it.
#[must_use]
pub fn patterns() -> Vec<Vec<[usize; 3]>> {
    (0..256).map(triangles).collect()
}

fn edge_between(a: usize, b: usize) -> usize {
    let wanted = [a.min(b), a.max(b)];
    EDGES.iter().position(|e| *e == wanted).unwrap_or_else(|| unreachable!("corners {a} and {b} share no edge"))
}

fn triangles(pattern: usize) -> Vec<[usize; 3]> {
    let inside = |corner: usize| pattern >> corner & 1 == 1;
    // From each cut edge, the next one of its loop. Seen from outside the cube the inside lies on the
    // right of the way.
    let mut next = [None; 12];
    for face in FACES {
        for i in 0..4 {
            let (before, first) = (face[i], face[(i + 1) % 4]);
            if inside(before) || !inside(first) {
                continue;
            }
            // A run of inside corners starts at `first`: find where it ends.
            let run = (1..4).take_while(|k| inside(face[(i + k) % 4])).count();
            let (last, after) = (face[(i + run) % 4], face[(i + run + 1) % 4]);
            next[edge_between(before, first)] = Some(edge_between(last, after));
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let mut corners = Vec::new();
        let mut at = start;
        while let Some(following) = next[at].take() {
            corners.push(at);
            at = following;
        }
        for i in 2..corners.len() {
            out.push([corners[0], corners[i - 1], corners[i]]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::collections::HashMap;

    fn corner(c: usize) -> DVec3 {
        DVec3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64)
    }

    fn middle(edge: usize) -> DVec3 {
        0.5 * (corner(EDGES[edge][0]) + corner(EDGES[edge][1]))
    }

    #[test]
    fn faces_are_counter_clockwise_and_cover_the_cube() {
        for face in FACES {
            let [a, b, c, d] = face.map(corner);
            let normal = (b - a).cross(c - b);
            let outward = 0.25 * (a + b + c + d) - DVec3::splat(0.5);
            assert!((normal - outward * 2.0).length() < 1e-12, "{face:?}");
        }
    }

    #[test]
    fn exactly_the_cut_edges_are_used() {
        for (pattern, triangles) in patterns().iter().enumerate() {
            for (e, [a, b]) in EDGES.iter().enumerate() {
                let cut = (pattern >> a & 1) != (pattern >> b & 1);
                assert_eq!(triangles.iter().flatten().any(|t| *t == e), cut, "pattern {pattern:08b}, edge {e}");
            }
        }
    }

    /// Inside a cell every line is passed once each way, except on the cell's faces.
    #[test]
    fn triangles_of_a_cell_fit_together() {
        for (pattern, triangles) in patterns().iter().enumerate() {
            let mut lines: HashMap<(usize, usize), i32> = HashMap::new();
            for [a, b, c] in triangles {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *lines.entry((*from, *to)).or_default() += 1;
                    *lines.entry((*to, *from)).or_default() -= 1;
                }
            }
            for ((a, b), surplus) in lines {
                let (p, q) = (middle(a), middle(b));
                let on_a_face = (0..3).any(|i| p[i] == q[i] && p[i] != 0.5);
                assert!(surplus == 0 || on_a_face, "pattern {pattern:08b}: {a} -> {b}");
            }
        }
    }

    #[test]
    fn one_corner_is_cut_off_with_the_normal_away_from_it() {
        for c in 0..CORNERS {
            let one = triangles(1 << c);
            let all_but_one = triangles(255 ^ (1 << c));
            for (found, side) in [(one, 1.0), (all_but_one, -1.0)] {
                assert_eq!(found.len(), 1);
                let [p, q, r] = found[0].map(middle);
                let normal = (q - p).cross(r - p);
                assert!(side * normal.dot(p - corner(c)) > 0.0, "corner {c}");
            }
        }
    }

    #[test]
    fn empty_and_full_cells_have_no_surface() {
        assert!(triangles(0).is_empty() && triangles(255).is_empty());
    }

    /// Inside corners across a diagonal are kept apart, outside ones are joined: a checkerboard cell is four corners.
    #[test]
    fn ambiguous_patterns_cut_off_each_inside_corner() {
        assert_eq!(triangles(0b0000_1001).len(), 2);
        assert_eq!(triangles(0b0110_1001).len(), 4);
    }
}
