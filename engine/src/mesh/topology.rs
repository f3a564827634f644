//! How triangles hang together: pieces, borders, and vertices where surfaces only touch.

use scene_io::export::Mesh;
use std::collections::HashMap;

/// The triangles around each vertex, one after another: those of vertex `v` are `items[first[v]..first[v + 1]]`.
pub(super) struct Around {
    first: Vec<u32>,
    items: Vec<u32>,
}

impl Around {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let mut first = vec![0_u32; mesh.vertices.len() + 1];
        for v in mesh.triangles.iter().flatten() {
            first[*v as usize + 1] += 1;
        }
        for v in 0..mesh.vertices.len() {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut items = vec![0; mesh.triangles.len() * 3];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            for v in triangle {
                items[next[*v as usize] as usize] = t as u32;
                next[*v as usize] += 1;
            }
        }
        Self { first, items }
    }

    pub(super) fn of(&self, v: usize) -> &[u32] {
        &self.items[self.first[v] as usize..self.first[v + 1] as usize]
    }
}

/// Edges that one triangle has and no other: from each vertex on a border, the next one. Triangles lie on the left.
pub(super) fn borders(mesh: &Mesh) -> Vec<[u32; 2]> {
    let mut edges: HashMap<[u32; 2], i32> = HashMap::with_capacity(mesh.triangles.len() * 2);
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let (key, turn) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
            *edges.entry(key).or_default() += turn;
        }
    }
    let mut open: Vec<[u32; 2]> = edges
        .into_iter()
        .filter(|(_, turn)| *turn != 0)
        .map(|([a, b], turn)| if turn > 0 { [a, b] } else { [b, a] })
        .collect();
    open.sort_unstable();
    open
}

/// The borders as closed loops, each in the direction of its triangles. A loop that cannot be followed is left out.
pub(super) fn loops(mesh: &Mesh) -> Vec<Vec<u32>> {
    let open = borders(mesh);
    let mut next: HashMap<u32, u32> = HashMap::with_capacity(open.len());
    for &[from, to] in &open {
        next.entry(from).or_insert(to);
    }
    let mut found = Vec::new();
    for &[start, _] in &open {
        let (mut line, mut at) = (Vec::new(), start);
        while let Some(to) = next.remove(&at) {
            line.push(at);
            at = to;
        }
        if line.len() >= 3 && at == start {
            found.push(line);
        }
    }
    found
}

/// Give each fan of triangles at a vertex a vertex of its own, so that surfaces that only touch there come apart.
pub(super) fn part_fans(mesh: &mut Mesh) {
    let around = Around::new(mesh);
    let mut group: Vec<u8> = Vec::new();
    for v in 0..around.first.len() - 1 {
        let of = around.of(v);
        if of.len() < 2 {
            continue;
        }
        group.clear();
        group.extend(0..of.len().min(255) as u8);
        let others = |t: u32| mesh.triangles[t as usize].map(|w| if w as usize == v { u32::MAX } else { w });
        // Triangles that share an edge at the vertex are one fan: few enough to compare each with each.
        for i in 0..group.len() {
            for j in 0..i {
                let (a, b) = (others(of[i]), others(of[j]));
                if group[i] != group[j] && a.iter().any(|w| *w != u32::MAX && b.contains(w)) {
                    let (from, to) = (group[i].max(group[j]), group[i].min(group[j]));
                    group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
                }
            }
        }
        let mut fans: Vec<u8> = group.clone();
        fans.sort_unstable();
        fans.dedup();
        for &fan in fans.iter().skip(1) {
            let copy = mesh.vertices.len() as u32;
            mesh.vertices.push(mesh.vertices[v]);
            for (i, _) in group.iter().enumerate().filter(|(_, g)| **g == fan) {
                for w in &mut mesh.triangles[of[i] as usize] {
                    if *w as usize == v {
                        *w = copy;
                    }
                }
            }
        }
    }
}

/// Keep pieces with at least `share` of the triangles of the largest one. Returns how many triangles were dropped.
pub(super) fn drop_small(mesh: &mut Mesh, share: f64) -> usize {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    let root = |parent: &mut Vec<u32>, mut v: u32| {
        while parent[v as usize] != v {
            let up = parent[parent[v as usize] as usize];
            parent[v as usize] = up;
            v = up;
        }
        v
    };
    for &[a, b, c] in &mesh.triangles {
        for other in [b, c] {
            let (x, y) = (root(&mut parent, a), root(&mut parent, other));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    let mut size = vec![0_usize; mesh.vertices.len()];
    let of: Vec<u32> = mesh.triangles.iter().map(|t| root(&mut parent, t[0])).collect();
    of.iter().for_each(|&r| size[r as usize] += 1);
    let least = (size.iter().copied().max().unwrap_or(0) as f64 * share).ceil() as usize;
    let before = mesh.triangles.len();
    let mut piece = of.into_iter();
    mesh.triangles.retain(|_| piece.next().is_some_and(|r| size[r as usize] >= least));
    compact(mesh);
    before - mesh.triangles.len()
}

/// Drop vertices that no triangle uses.
pub(super) fn compact(mesh: &mut Mesh) {
    const UNUSED: u32 = u32::MAX;
    let mut place = vec![UNUSED; mesh.vertices.len()];
    for v in mesh.triangles.iter().flatten() {
        place[*v as usize] = 0;
    }
    let mut n = 0;
    place.iter_mut().filter(|p| **p != UNUSED).for_each(|p| {
        *p = n;
        n += 1;
    });
    let used = |v: usize| place[v] != UNUSED;
    fn keep<T: Copy>(rows: &mut Vec<T>, used: impl Fn(usize) -> bool) {
        let mut at = 0..;
        rows.retain(|_| at.next().is_some_and(&used));
    }
    keep(&mut mesh.vertices, used);
    keep(&mut mesh.normals, used);
    keep(&mut mesh.colours, used);
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = place[*v as usize]);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares of two triangles, each with its own four vertices.
    fn squares() -> Mesh {
        let square = |x: f64| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 1.0, 0.0]];
        Mesh {
            vertices: [square(0.0), square(5.0)].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            ..Mesh::default()
        }
    }

    #[test]
    fn borders_go_around_in_the_direction_of_the_triangles() {
        assert_eq!(loops(&squares()), [[0, 1, 2, 3], [4, 5, 6, 7]]);
        assert!(loops(&Mesh::default()).is_empty());
    }

    #[test]
    fn small_pieces_go_and_their_vertices_with_them() {
        let mut mesh = squares();
        mesh.triangles.pop();
        mesh.colours = (0..8).map(|i| [i; 3]).collect();
        assert_eq!(drop_small(&mut mesh, 0.6), 1);
        assert_eq!((mesh.vertices.len(), mesh.triangles.len(), mesh.colours[3]), (4, 2, [3; 3]));
        let mut both = squares();
        assert_eq!(drop_small(&mut both, 0.6), 0);
        drop_small(&mut Mesh::default(), 0.5);
    }

    #[test]
    fn surfaces_that_touch_in_a_vertex_come_apart() {
        let mut mesh = squares();
        mesh.triangles[2][0] = 2;
        mesh.triangles[3][0] = 2;
        compact(&mut mesh);
        let n = mesh.vertices.len();
        part_fans(&mut mesh);
        assert_eq!(mesh.vertices.len(), n + 1);
        assert_eq!(loops(&mesh).len(), 2);
        let same = mesh.clone();
        part_fans(&mut mesh);
        assert_eq!(mesh, same);
    }
}
