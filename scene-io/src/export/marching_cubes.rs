//! A mesh where a density crosses a level.

use super::Mesh;
use super::cells::{CORNERS, EDGES, patterns};
use crate::{ErrorKind, Problem, SceneError};
use std::path::Path;

/// The box that is searched for a surface, and into how many cells it is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshGrid {
    /// Smallest corner, world units.
    pub min: [f64; 3],
    /// Largest corner.
    pub max: [f64; 3],
    /// Cells along x, y, z, each at least 1.
    pub cells: [usize; 3],
}

impl MeshGrid {
    /// Nearly cubic cells, `longest` of them along the longest side.
    #[must_use]
    pub fn cubic(min: [f64; 3], max: [f64; 3], longest: usize) -> Self {
        let size: [f64; 3] = std::array::from_fn(|i| max[i] - min[i]);
        let largest = size.iter().fold(0.0, |m: f64, s| m.max(*s));
        let cells = size.map(|s| ((s / largest * longest as f64).round() as usize).max(1));
        Self { min, max, cells }
    }

    fn check(&self) -> Result<(), SceneError> {
        let wrong = |what: String| {
            let remedy = "give a box with min below max and at least one cell along each axis";
            Err(SceneError::new(ErrorKind::Value, Problem::new(Path::new("mesh grid"), what, remedy)))
        };
        for axis in 0..3 {
            let (low, high) = (self.min[axis], self.max[axis]);
            if !(low.is_finite() && high.is_finite() && low < high) {
                return wrong(format!("axis {axis} reaches from {low} to {high}"));
            }
            if self.cells[axis] == 0 {
                return wrong(format!("axis {axis} has no cells"));
            }
        }
        // A layer of samples and its edges are held in memory at a time.
        if (self.cells[0] + 1).checked_mul(self.cells[1] + 1).is_none_or(|n| n > 1 << 28) {
            return wrong(format!("a layer of {} x {} cells is too large", self.cells[0], self.cells[1]));
        }
        Ok(())
    }

    fn position(&self, axis: usize, i: usize) -> f64 {
        // Exact at both ends.
        let s = i as f64 / self.cells[axis] as f64;
        self.min[axis] * (1.0 - s) + self.max[axis] * s
    }
}

/// The surface where `density` falls through `level`, closed, welded, oriented outwards, with smooth normals.
///
/// Inside is where the density is above the level. The outermost samples count as empty, so that the mesh is closed also
/// where the density reaches out of the box; NaN counts as empty, too. Vertices are interpolated linearly along grid
/// edges and shared by all triangles around them. One layer of samples is asked for at a time, in a fixed order: memory
/// grows with the surface and one layer, not with the volume. Positions are in world units, and there are no colours yet.
///
/// # Shapes
/// * `density` writes one value for each point.
///
/// # Errors
/// A grid without volume or cells, a level that is not finite, or more vertices than `i32::MAX`, which PLY readers
/// expect to suffice.
///
/// # Source
/// Lorensen and Cline, "Marching cubes", 1987; see the module of the cell patterns for what differs.
pub fn marching_cubes(
    grid: &MeshGrid,
    level: f32,
    mut density: impl FnMut(&[[f64; 3]], &mut [f32]),
) -> Result<Mesh, SceneError> {
    grid.check()?;
    if !level.is_finite() {
        let problem = Problem::new(Path::new("mesh"), "the level is not finite", "give a density above 0");
        return Err(SceneError::new(ErrorKind::Value, problem.field("level").value(level)));
    }
    let patterns = patterns();
    let [nx, ny, nz] = grid.cells.map(|n| n + 1);
    let mut sweep = Sweep { grid, level, mesh: Mesh::default() };
    let mut points: Vec<[f64; 3]> = (0..ny)
        .flat_map(|j| (0..nx).map(move |i| (i, j)))
        .map(|(i, j)| [grid.position(0, i), grid.position(1, j), 0.0])
        .collect();
    let mut below = Layer::new(nx * ny);
    let mut above = Layer::new(nx * ny);
    for k in 0..nz {
        points.iter_mut().for_each(|p| p[2] = grid.position(2, k));
        above.values.fill(f32::NAN);
        density(&points, &mut above.values);
        for j in 0..ny {
            for i in 0..nx {
                let border = [i, j, k].iter().zip([nx, ny, nz]).any(|(i, n)| *i == 0 || *i == n - 1);
                let value = &mut above.values[j * nx + i];
                *value = sample(*value, level, border);
            }
        }
        sweep.flat_edges(&mut above, k);
        if k > 0 {
            sweep.upright_edges(&mut below, &above, k - 1);
            sweep.triangles(&below, &above, &patterns);
        }
        if i32::try_from(sweep.mesh.vertices.len()).is_err() {
            let problem = Problem::new(Path::new("mesh"), "has too many vertices", "choose fewer cells");
            return Err(SceneError::new(ErrorKind::Value, problem));
        }
        std::mem::swap(&mut below, &mut above);
    }
    let mut mesh = sweep.mesh;
    mesh.smooth_normals();
    Ok(mesh)
}

/// A density as it is used: finite, and empty on the border.
fn sample(value: f32, level: f32, border: bool) -> f32 {
    // Below the level by as much as 0 is, for densities; the 1 is for fields whose level is 0.
    let empty = level - level.abs().max(1.0);
    match value {
        v if v.is_nan() => empty,
        v if border => v.min(empty),
        v => v,
    }
    .clamp(f32::MIN, f32::MAX)
}

/// No vertex on this edge.
const NONE: u32 = u32::MAX;

/// Samples of one layer, and the vertices on the edges that start there.
struct Layer {
    values: Vec<f32>,
    /// Along x, y and z (up to the next layer) from each sample.
    edges: [Vec<u32>; 3],
}

impl Layer {
    fn new(n: usize) -> Self {
        Self { values: vec![0.0; n], edges: std::array::from_fn(|_| vec![NONE; n]) }
    }
}

struct Sweep<'a> {
    grid: &'a MeshGrid,
    level: f32,
    mesh: Mesh,
}

impl Sweep<'_> {
    fn inside(&self, value: f32) -> bool {
        value > self.level
    }

    /// The vertex on the edge from sample `at` to the next one along `axis`, if the surface passes.
    fn vertex(&mut self, at: [usize; 3], axis: usize, from: f32, to: f32) -> u32 {
        if self.inside(from) == self.inside(to) {
            return NONE;
        }
        let (from, to, level) = (f64::from(from), f64::from(to), f64::from(self.level));
        let s = (level - from) / (to - from);
        let mut x: [f64; 3] = std::array::from_fn(|a| self.grid.position(a, at[a]));
        x[axis] += s * (self.grid.position(axis, at[axis] + 1) - x[axis]);
        self.mesh.vertices.push(x);
        (self.mesh.vertices.len() - 1) as u32
    }

    fn flat_edges(&mut self, layer: &mut Layer, k: usize) {
        let [nx, ny, _] = self.grid.cells.map(|n| n + 1);
        for j in 0..ny {
            for i in 0..nx {
                let n = j * nx + i;
                let here = layer.values[n];
                layer.edges[0][n] =
                    if i + 1 < nx { self.vertex([i, j, k], 0, here, layer.values[n + 1]) } else { NONE };
                layer.edges[1][n] =
                    if j + 1 < ny { self.vertex([i, j, k], 1, here, layer.values[n + nx]) } else { NONE };
            }
        }
    }

    fn upright_edges(&mut self, below: &mut Layer, above: &Layer, k: usize) {
        let nx = self.grid.cells[0] + 1;
        for n in 0..below.values.len() {
            below.edges[2][n] = self.vertex([n % nx, n / nx, k], 2, below.values[n], above.values[n]);
        }
    }

    fn triangles(&mut self, below: &Layer, above: &Layer, patterns: &[Vec<[usize; 3]>]) {
        let nx = self.grid.cells[0] + 1;
        for j in 0..self.grid.cells[1] {
            for i in 0..self.grid.cells[0] {
                let corner = |c: usize| {
                    let layer = if c >> 2 == 0 { below } else { above };
                    (layer, (j + (c >> 1 & 1)) * nx + i + (c & 1))
                };
                let mut pattern = 0;
                for c in 0..CORNERS {
                    let (layer, n) = corner(c);
                    pattern |= usize::from(self.inside(layer.values[n])) << c;
                }
                for triangle in &patterns[pattern] {
                    let ids = triangle.map(|e| {
                        let (layer, n) = corner(EDGES[e][0]);
                        // Edges 0..4 run along x, 4..8 along y, 8..12 along z.
                        layer.edges[e / 4][n]
                    });
                    self.mesh.triangles.push(ids);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn mesh(grid: &MeshGrid, level: f32, f: impl Fn(DVec3) -> f64) -> Mesh {
        let sample = |points: &[[f64; 3]], out: &mut [f32]| {
            for (out, p) in out.iter_mut().zip(points) {
                *out = f(DVec3::from(*p)) as f32;
            }
        };
        marching_cubes(grid, level, sample).unwrap()
    }

    #[test]
    fn a_sphere_is_watertight_with_the_right_area_and_volume() {
        let centre = DVec3::new(10.0, -3.0, 0.5);
        let grid = MeshGrid::cubic((centre - 1.3).to_array(), (centre + 1.3).to_array(), 48);
        let ball = mesh(&grid, 0.0, |p| 1.0 - (p - centre).length());
        assert_eq!(ball.open_edges(), 0);
        // A polyhedron inscribed to second order: (h / r)^2 / 8 of curvature, h = 0.054.
        assert!((ball.area() / (4.0 * PI) - 1.0).abs() < 2e-3, "area {}", ball.area());
        assert!((ball.volume() / (4.0 / 3.0 * PI) - 1.0).abs() < 2e-3, "volume {}", ball.volume());
        for (v, n) in ball.vertices.iter().zip(&ball.normals) {
            let from_centre = DVec3::from(*v) - centre;
            assert!((from_centre.length() - 1.0).abs() < 1e-3);
            assert!(glam::Vec3::from(*n).as_dvec3().dot(from_centre) > 0.98);
        }
        // Every vertex is used: nothing is left over from welding.
        let mut used = vec![false; ball.vertices.len()];
        ball.triangles.iter().flatten().for_each(|i| used[*i as usize] = true);
        assert!(used.iter().all(|u| *u));
        // Euler's formula for a sphere: vertices - edges + faces = 2, with 3/2 edges for each face.
        assert_eq!(ball.vertices.len() as i64 - (ball.triangles.len() / 2) as i64, 2);
    }

    #[test]
    fn a_unit_cube_comes_out_as_a_unit_cube() {
        let grid = MeshGrid::cubic([-0.53; 3], [1.51; 3], 60);
        let cube = mesh(&grid, 0.0, |p| 0.5 - (p - 0.5).abs().max_element());
        assert_eq!(cube.open_edges(), 0);
        for axis in 0..3 {
            let (low, high) =
                cube.vertices.iter().fold((9.0_f64, -9.0_f64), |(l, h), v| (l.min(v[axis]), h.max(v[axis])));
            // The distance to a face is linear: its plane is met exactly, up to the rounding of the samples to f32.
            assert!(low.abs() < 1e-6 && (high - 1.0).abs() < 1e-6, "axis {axis}: {low} to {high}");
        }
        // Edges and corners are cut by up to a cell of 0.034: twelve edges of area, second order in volume.
        assert!(
            (cube.area() - 6.0).abs() < 0.25 && (cube.volume() - 1.0).abs() < 0.01,
            "{} {}",
            cube.area(),
            cube.volume()
        );
    }

    #[test]
    fn a_density_that_fills_the_box_is_closed_at_its_border() {
        let grid = MeshGrid { min: [0.0; 3], max: [1.0, 2.0, 3.0], cells: [10, 10, 10] };
        let block = mesh(&grid, 5.0, |_| 10.0);
        assert_eq!(block.open_edges(), 0);
        // Half way between 0 on the border and 10 one cell inside: 0.9 of each side, less the cut along the twelve edges
        // (a triangle of half a cell each way: 0.027 for each direction).
        let want = 6.0 * 0.9_f64.powi(3) - 3.0 * 0.027;
        assert!((block.volume() - want).abs() < 0.01, "{} for {want}", block.volume());
    }

    #[test]
    fn nothing_and_extreme_values_are_legal() {
        let grid = MeshGrid::cubic([0.0; 3], [1.0; 3], 5);
        assert_eq!(mesh(&grid, 1.0, |_| 0.0), Mesh::default());
        assert_eq!(mesh(&grid, 1.0, |_| f64::NAN), Mesh::default());
        let spots = mesh(&grid, 1.0, |p| match (p * 5.0).dot(DVec3::ONE).round() as i64 % 4 {
            0 => f64::INFINITY,
            1 => f64::NAN,
            2 => f64::NEG_INFINITY,
            _ => 1e30,
        });
        assert!(spots.open_edges() == 0 && !spots.triangles.is_empty());
        assert!(spots.vertices.iter().flatten().all(|x| x.is_finite()));
        let one = MeshGrid { cells: [1; 3], ..grid };
        assert_eq!(mesh(&one, 1.0, |_| 9.0), Mesh::default());
    }

    #[test]
    fn impossible_grids_are_refused() {
        let good = MeshGrid::cubic([0.0; 3], [1.0; 3], 5);
        for (bad, what) in [
            (MeshGrid { max: [1.0, 0.0, 1.0], ..good }, "axis 1 reaches from 0 to 0"),
            (MeshGrid { min: [f64::NAN; 3], ..good }, "axis 0 reaches from NaN"),
            (MeshGrid { cells: [1, 1, 0], ..good }, "axis 2 has no cells"),
            (MeshGrid { cells: [1 << 20, 1 << 20, 1], ..good }, "too large"),
        ] {
            let error = marching_cubes(&bad, 1.0, |_, _| ()).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
        assert!(marching_cubes(&good, f32::NAN, |_, _| ()).unwrap_err().to_string().contains("level"));
    }

    #[test]
    fn cells_are_nearly_cubic() {
        assert_eq!(MeshGrid::cubic([0.0; 3], [4.0, 2.0, 0.01], 64).cells, [64, 32, 1]);
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        /// Noise has every pattern of corners in every neighbourhood, all ambiguous ones among them.
        #[test]
        fn noise_is_watertight(values in proptest::collection::vec(0.0..2.0_f32, 7 * 7 * 7)) {
            let grid = MeshGrid { min: [0.0; 3], max: [6.0; 3], cells: [6; 3] };
            let sample = |points: &[[f64; 3]], out: &mut [f32]| {
                for (out, p) in out.iter_mut().zip(points) {
                    *out = values[p[0].round() as usize + 7 * (p[1].round() as usize + 7 * p[2].round() as usize)];
                }
            };
            let mesh = marching_cubes(&grid, 1.0, sample).unwrap();
            prop_assert_eq!(mesh.open_edges(), 0);
            prop_assert!(mesh.triangles.is_empty() || mesh.volume() > 0.0);
        }
    }
}
