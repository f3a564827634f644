//! Fewer triangles where the surface is flat and of one colour: edges are collapsed, the least error first.
//!
//! Source: Garland and Heckbert, "Surface simplification using quadric error metrics", 1997; with colours, [`quadric`](super::quadric).
//! The order is that of errors, then of vertex numbers: the same mesh every time.

use super::quadric::{DIM, Point, Quadric, minus};
use super::topology::{borders, compact};
use crate::halt::Halt;
use glam::{DVec3, Vec3};
use losses::metrics::quantise_value;
use scene_io::export::Mesh;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Cells of distance that are as bad as a full step of colour.
const COLOUR: f64 = 2.0;
/// Borders are held by planes across the surface of this weight.
const WALL: f64 = 10.0;
/// A triangle may turn by no more than this cosine.
const TURN: f64 = 0.2;
/// Triangles with less than this ratio of area to the square of their longest side are refused, unless they were worse before.
const THIN: f64 = 0.02;

/// Collapse edges until at most `target` triangles are left, or none can go. `cell` is the length that errors are measured in;
/// `colours`, one a vertex, become the mesh's. More are left where `halt` is raised on the way.
pub(super) fn decimate(mesh: &mut Mesh, colours: &[Vec3], cell: f64, target: usize, halt: &Halt) {
    let mut work = Work::new(mesh, colours, cell);
    work.run(target, halt);
    work.write(mesh);
}

/// An edge in the heap: its error's bits, its vertices, and what they had gone through when it was put there.
type Entry = Reverse<(u64, u32, u32, u32, u32)>;

struct Work {
    origin: DVec3,
    cell: f64,
    points: Vec<Point>,
    quadrics: Vec<Quadric>,
    triangles: Vec<[u32; 3]>,
    alive: Vec<bool>,
    left: usize,
    around: Vec<Vec<u32>>,
    border: Vec<bool>,
    /// Collapses a vertex went through.
    age: Vec<u32>,
    heap: BinaryHeap<Entry>,
}

impl Work {
    fn new(mesh: &Mesh, colours: &[Vec3], cell: f64) -> Self {
        let n = mesh.vertices.len();
        let origin = mesh.vertices.first().map_or(DVec3::ZERO, |v| DVec3::from(*v));
        let point = |v: usize| {
            let x = (DVec3::from(mesh.vertices[v]) - origin) / cell;
            let c = colours.get(v).copied().unwrap_or(Vec3::ZERO).as_dvec3() * COLOUR;
            [x.x, x.y, x.z, c.x, c.y, c.z]
        };
        let points: Vec<Point> = (0..n).map(point).collect();
        let mut quadrics = vec![Quadric::ZERO; n];
        let mut around = vec![Vec::new(); n];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let corners = triangle.map(|v| &points[v as usize]);
            let plane = Quadric::plane(corners, area(corners) / 3.0);
            for &v in triangle {
                quadrics[v as usize].add(&plane);
                around[v as usize].push(t as u32);
            }
        }
        let mut border = vec![false; n];
        let mut work = Self {
            origin,
            cell,
            points,
            quadrics,
            alive: vec![true; mesh.triangles.len()],
            left: mesh.triangles.len(),
            triangles: mesh.triangles.clone(),
            around,
            border: Vec::new(),
            age: vec![0; n],
            heap: BinaryHeap::new(),
        };
        for [a, b] in borders(mesh) {
            border[a as usize] = true;
            border[b as usize] = true;
            work.hold(a, b);
        }
        work.border = border;
        work.push_all();
        work
    }

    /// A plane through a border's edge, across its triangle.
    fn hold(&mut self, a: u32, b: u32) {
        let Some(&t) = self.around[a as usize].iter().find(|t| self.triangles[**t as usize].contains(&b)) else {
            return;
        };
        let normal = normal(self.triangles[t as usize].map(|v| &self.points[v as usize]));
        let edge = place(&self.points[b as usize]) - place(&self.points[a as usize]);
        let wall = Quadric::wall(
            &self.points[a as usize],
            edge.cross(normal).normalize_or_zero().to_array(),
            WALL * edge.length_squared(),
        );
        self.quadrics[a as usize].add(&wall);
        self.quadrics[b as usize].add(&wall);
    }

    /// Where the two may meet, and what that costs, the least first.
    fn offers(&self, a: u32, b: u32) -> Vec<(f64, Point)> {
        let (p, q) = (&self.points[a as usize], &self.points[b as usize]);
        let mut sum = self.quadrics[a as usize];
        sum.add(&self.quadrics[b as usize]);
        let middle: Point = std::array::from_fn(|k| 0.5 * (p[k] + q[k]));
        let length = (place(p) - place(q)).length();
        // Vertices of a border stay on it.
        let places = match (self.border[a as usize], self.border[b as usize]) {
            (true, false) => vec![*p],
            (false, true) => vec![*q],
            _ => {
                let mut places = vec![middle, *p, *q];
                if let Some(mut least) = sum.least(&middle) {
                    least[3..].iter_mut().for_each(|c| *c = c.clamp(0.0, COLOUR));
                    if (place(&least) - place(&middle)).length() < length {
                        places.push(least);
                    }
                }
                places
            }
        };
        // Of edges that cost nothing the short ones go first.
        let short = 1e-6 * length * length;
        let mut offers: Vec<(f64, Point)> = places.into_iter().map(|x| (sum.error(&x) + short, x)).collect();
        offers.sort_by(|x, y| x.0.total_cmp(&y.0));
        offers
    }

    fn push(&mut self, a: u32, b: u32) {
        let (a, b) = (a.min(b), a.max(b));
        let error = self.offers(a, b)[0].0;
        if error.is_finite() {
            // Bits of numbers above 0 are in the order of the numbers.
            self.heap.push(Reverse((error.to_bits(), a, b, self.age[a as usize], self.age[b as usize])));
        }
    }

    fn run(&mut self, target: usize, halt: &Halt) {
        while self.left > target {
            let before = self.left;
            self.empty_heap(target, halt);
            // What could not go may go now that other things have moved.
            if self.left <= target || self.left == before || halt.raised() {
                return;
            }
            self.push_all();
        }
    }

    fn push_all(&mut self) {
        let alive = self.triangles.iter().zip(&self.alive).filter(|(_, alive)| **alive);
        let sides = alive.flat_map(|(&[a, b, c], _)| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        edges.into_iter().for_each(|[a, b]| self.push(a, b));
    }

    fn empty_heap(&mut self, target: usize, halt: &Halt) {
        while self.left > target && !halt.raised() {
            let Some(Reverse((_, a, b, age_a, age_b))) = self.heap.pop() else { return };
            if self.age[a as usize] != age_a || self.age[b as usize] != age_b || !self.stays_a_surface(a, b) {
                continue;
            }
            let offers = self.offers(a, b);
            // Another place will do if it is about as good.
            let most = 4.0 * offers[0].0 + 1e-3;
            let good = offers.iter().find(|(error, x)| *error <= most && self.keeps_sides(a, b, x));
            if let Some(&(_, x)) = good {
                self.collapse(a, b, x);
            }
        }
    }

    fn neighbours(&self, v: u32) -> Vec<u32> {
        let of = self.around[v as usize].iter().flat_map(|t| self.triangles[*t as usize]);
        let mut all: Vec<u32> = of.filter(|w| *w != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Does the surface stay a surface where the two become one?
    fn stays_a_surface(&self, a: u32, b: u32) -> bool {
        let shared = self.around[a as usize].iter().filter(|t| self.triangles[**t as usize].contains(&b)).count();
        // Two borders may not meet across the surface.
        if shared == 0 || shared > 2 || (shared == 2 && self.border[a as usize] && self.border[b as usize]) {
            return false;
        }
        let (of_a, of_b) = (self.neighbours(a), self.neighbours(b));
        of_a.iter().filter(|v| of_b.binary_search(v).is_ok()).count() == shared
    }

    /// Does no triangle turn over, or become a needle, where the two meet at `x`?
    fn keeps_sides(&self, a: u32, b: u32, x: &Point) -> bool {
        [(a, b), (b, a)].into_iter().all(|(v, other)| {
            self.around[v as usize].iter().all(|&t| {
                let triangle = self.triangles[t as usize];
                if triangle.contains(&other) {
                    return true;
                }
                let before = triangle.map(|w| &self.points[w as usize]);
                let after = triangle.map(|w| if w == v { x } else { &self.points[w as usize] });
                let (m, n) = (normal(before), normal(after));
                let (round, was) = (roundness(after), roundness(before));
                m.dot(n) > TURN * m.length() * n.length() && (round > THIN || round > was)
            })
        })
    }

    /// `b` goes into `a`, which moves to `x`.
    fn collapse(&mut self, a: u32, b: u32, x: Point) {
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize].add(&quadric);
        self.points[a as usize] = x;
        self.border[a as usize] |= self.border[b as usize];
        for t in std::mem::take(&mut self.around[b as usize]) {
            let triangle = &mut self.triangles[t as usize];
            if triangle.contains(&a) {
                let gone = *triangle;
                self.alive[t as usize] = false;
                self.left -= 1;
                for v in gone {
                    self.around[v as usize].retain(|other| *other != t);
                }
            } else {
                triangle.iter_mut().filter(|v| **v == b).for_each(|v| *v = a);
                self.around[a as usize].push(t);
            }
        }
        self.age[b as usize] = u32::MAX;
        self.age[a as usize] += 1;
        for v in self.neighbours(a) {
            self.push(a, v);
        }
    }

    fn write(self, mesh: &mut Mesh) {
        let world = |p: &Point| (place(p) * self.cell + self.origin).to_array();
        mesh.vertices = self.points.iter().map(world).collect();
        mesh.colours = self.points.iter().map(|p| [3, 4, 5].map(|k| quantise_value((p[k] / COLOUR) as f32))).collect();
        let mut alive = self.alive.iter();
        mesh.triangles = self.triangles.into_iter().filter(|_| alive.next() == Some(&true)).collect();
        mesh.normals.clear();
        compact(mesh);
    }
}

fn place(p: &Point) -> DVec3 {
    DVec3::new(p[0], p[1], p[2])
}

fn area([p, q, r]: [&Point; 3]) -> f64 {
    0.5 * normal([p, q, r]).length()
}

fn normal([p, q, r]: [&Point; 3]) -> DVec3 {
    (place(q) - place(p)).cross(place(r) - place(p))
}

/// Area over the square of the longest side: 0.43 for equal sides.
fn roundness(t: [&Point; 3]) -> f64 {
    let side = |a: &Point, b: &Point| place(&minus(a, b)).length_squared();
    let longest = side(t[0], t[1]).max(side(t[1], t[2])).max(side(t[2], t[0]));
    if longest > 0.0 { area(t) / longest } else { 0.0 }
}

const _: () = assert!(DIM == 6);

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::export::{MeshGrid, marching_cubes};

    fn ball(cells: usize) -> Mesh {
        let grid = MeshGrid::cubic([-1.3; 3], [1.3; 3], cells);
        marching_cubes(&grid, 0.0, |points, out| {
            points.iter().zip(out).for_each(|(p, out)| *out = 1.0 - DVec3::from(*p).length() as f32);
        })
        .unwrap()
    }

    #[test]
    fn a_ball_of_few_triangles_is_still_closed_and_round() {
        let mut mesh = ball(48);
        let (volume, before) = (mesh.volume(), mesh.triangles.len());
        let grey = vec![Vec3::splat(0.5); mesh.vertices.len()];
        decimate(&mut mesh, &grey, 2.6 / 48.0, 800, &Halt::NEVER);
        let left = mesh.triangles.len();
        assert!(before > 5000 && (780..=800).contains(&left), "{left} of {before}");
        assert_eq!(mesh.open_edges(), 0);
        assert!((mesh.volume() / volume - 1.0).abs() < 0.01, "{} of {volume}", mesh.volume());
        for v in &mesh.vertices {
            assert!((DVec3::from(*v).length() - 1.0).abs() < 0.01);
        }
        let mut again = ball(48);
        decimate(&mut again, &grey, 2.6 / 48.0, 800, &Halt::NEVER);
        assert_eq!(again, mesh);
    }

    /// A flat square of one colour needs two triangles; where it is painted it keeps more.
    #[test]
    fn triangles_stay_where_colours_change() {
        let n = 24_u32;
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let mut mesh = Mesh::default();
        for j in 0..=n {
            mesh.vertices.extend((0..=n).map(|i| [f64::from(i), f64::from(j), 0.0]));
        }
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        let dark = |v: &[f64; 3]| v[0] < 8.5 && v[1] < 8.5;
        let colours: Vec<Vec3> = mesh.vertices.iter().map(|v| if dark(v) { Vec3::ZERO } else { Vec3::ONE }).collect();
        decimate(&mut mesh, &colours, 1.0, 120, &Halt::NEVER);
        assert!(mesh.triangles.len() <= 120);
        assert!((mesh.area() - f64::from(n * n)).abs() < 1e-6, "the border holds: {}", mesh.area());
        for (v, c) in mesh.vertices.iter().zip(&mesh.colours) {
            let far = (v[0] - 8.5).max(v[1] - 8.5);
            assert!(far.abs() < 1.0 || (far < 0.0) == (c[0] < 128), "{v:?} {c:?}");
        }
        let near = mesh.vertices.iter().filter(|v| (v[0] - 8.5).max(v[1] - 8.5).abs() < 2.0).count();
        assert!(near >= 6, "{near} of {}", mesh.vertices.len());
    }

    #[test]
    fn nothing_and_unreachable_targets_are_legal() {
        let mut none = Mesh::default();
        decimate(&mut none, &[], 1.0, 0, &Halt::NEVER);
        assert_eq!(none, Mesh::default());
        let mut small = ball(8);
        let grey = vec![Vec3::ZERO; small.vertices.len()];
        decimate(&mut small, &grey, 0.3, 0, &Halt::NEVER);
        assert!(!small.triangles.is_empty() && small.open_edges() == 0);
    }
}
