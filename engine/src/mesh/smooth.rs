//! Noise out of a surface without shrinking it.
//!
//! Source: Taubin, "A signal processing approach to fair surface design", 1995: a step towards the neighbours' mean, then a
//! slightly longer one away from it.

use super::topology::{Around, borders};
use glam::DVec3;
use rayon::prelude::*;
use scene_io::export::Mesh;

/// The two steps; their pass band begins at `1 / TOWARDS + 1 / AWAY = 0.1`.
const TOWARDS: f64 = 0.5;
const AWAY: f64 = -0.5 / 0.95;

/// `rounds` rounds over all vertices. Those on a border follow the border alone.
pub(super) fn smooth(mesh: &mut Mesh, rounds: usize) {
    let neighbours = Neighbours::new(mesh);
    for _ in 0..rounds {
        neighbours.step(mesh, TOWARDS);
        neighbours.step(mesh, AWAY);
    }
}

/// Bring the vertices from `first` on to their neighbours' mean, `rounds` times: a skin over what others hold.
pub(super) fn relax(mesh: &mut Mesh, first: usize, rounds: usize) {
    if first >= mesh.vertices.len() {
        return;
    }
    let neighbours = Neighbours::new(mesh);
    for _ in 0..rounds {
        for v in first..mesh.vertices.len() {
            mesh.vertices[v] = neighbours.mean(mesh, v).unwrap_or(mesh.vertices[v].into()).to_array();
        }
    }
}

pub(super) struct Neighbours {
    first: Vec<u32>,
    items: Vec<u32>,
}

impl Neighbours {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let around = Around::new(mesh);
        let mut border: Vec<[u32; 2]> = borders(mesh).into_iter().flat_map(|[a, b]| [[a, b], [b, a]]).collect();
        border.sort_unstable();
        let (mut first, mut items, mut some) = (vec![0], Vec::with_capacity(mesh.triangles.len() * 3), Vec::new());
        let mut at = 0;
        for v in 0..mesh.vertices.len() {
            some.clear();
            while border.get(at).is_some_and(|[from, _]| *from as usize == v) {
                some.push(border[at][1]);
                at += 1;
            }
            if some.is_empty() {
                some.extend(around.of(v).iter().flat_map(|t| mesh.triangles[*t as usize]).filter(|w| *w as usize != v));
            }
            some.sort_unstable();
            some.dedup();
            items.extend_from_slice(&some);
            first.push(items.len() as u32);
        }
        Self { first, items }
    }

    pub(super) fn of(&self, v: usize) -> &[u32] {
        &self.items[self.first[v] as usize..self.first[v + 1] as usize]
    }

    fn mean(&self, mesh: &Mesh, v: usize) -> Option<DVec3> {
        let of = self.of(v);
        let sum: DVec3 = of.iter().map(|w| DVec3::from(mesh.vertices[*w as usize])).sum();
        (!of.is_empty()).then(|| sum / of.len() as f64)
    }

    fn step(&self, mesh: &mut Mesh, share: f64) {
        let moved = |v: usize| {
            let x = DVec3::from(mesh.vertices[v]);
            self.mean(mesh, v).map_or(x, |mean| x + (mean - x) * share).to_array()
        };
        mesh.vertices = (0..mesh.vertices.len()).into_par_iter().map(moved).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::export::{MeshGrid, marching_cubes};

    #[test]
    fn a_rough_ball_becomes_smooth_and_keeps_its_size() {
        let grid = MeshGrid::cubic([-1.3; 3], [1.3; 3], 40);
        let mut ball = marching_cubes(&grid, 0.0, |points, out| {
            points.iter().zip(out).for_each(|(p, out)| *out = 1.0 - DVec3::from(*p).length() as f32);
        })
        .unwrap();
        let mut state = 1_u64;
        for x in ball.vertices.iter_mut().flatten() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *x += ((state >> 40) as f64 / (1 << 24) as f64 - 0.5) * 0.04;
        }
        let rough = |mesh: &Mesh| {
            let far = mesh.vertices.iter().map(|v| (DVec3::from(*v).length() - 1.0).powi(2)).sum::<f64>();
            (far / mesh.vertices.len() as f64).sqrt()
        };
        let (before, volume) = (rough(&ball), ball.volume());
        smooth(&mut ball, 8);
        assert!(rough(&ball) < 0.5 * before, "{} of {before}", rough(&ball));
        assert!((ball.volume() / volume - 1.0).abs() < 0.01, "{} of {volume}", ball.volume());
    }
}
