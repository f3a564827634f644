//! Triangle meshes.

use glam::DVec3;

/// Triangles over shared vertices, world units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions.
    pub vertices: Vec<[f64; 3]>,
    /// Outward unit normals, one for each vertex or none at all.
    pub normals: Vec<[f32; 3]>,
    /// sRGB colours, one for each vertex or none at all.
    pub colours: Vec<[u8; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|i| DVec3::from(self.vertices[i as usize]))
    }

    /// Twice the area vector: along the outward normal, twice the triangle's area long.
    fn double_area(&self, triangle: [u32; 3]) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Surface area, square world units.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist. So do the other methods.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|t| 0.5 * self.double_area(*t).length()).sum()
    }

    /// Enclosed volume, cubic world units; negative if the mesh is inside out. Meaningless where it is not closed.
    ///
    /// # Panics
    /// As [`Mesh::area`].
    #[must_use]
    pub fn volume(&self) -> f64 {
        // Measured from a vertex, so that meshes far from the origin keep their digits.
        let Some(origin) = self.vertices.first().map(|v| DVec3::from(*v)) else { return 0.0 };
        let part = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(*t).map(|x| x - origin);
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.iter().map(part).sum()
    }

    /// How many edges lack their one partner of opposite direction: 0 for a closed, consistently oriented mesh.
    #[must_use]
    pub fn open_edges(&self) -> usize {
        let mut edges: Vec<(u32, u32)> =
            self.triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
        edges.sort_unstable();
        let count = |edge: (u32, u32)| edges.partition_point(|e| *e <= edge) - edges.partition_point(|e| *e < edge);
        edges.iter().filter(|(a, b)| count((*b, *a)) != count((*a, *b))).count()
    }

    /// Set the normals to the average of the triangles around each vertex, weighted by area. A vertex with none, or
    /// between opposite ones, gets zero.
    ///
    /// # Panics
    /// As [`Mesh::area`].
    pub fn smooth_normals(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.vertices.len()];
        for triangle in &self.triangles {
            let normal = self.double_area(*triangle);
            for i in triangle {
                sums[*i as usize] += normal;
            }
        }
        self.normals = sums.into_iter().map(|n| n.normalize_or_zero().as_vec3().to_array()).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Mesh {
        Mesh {
            vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn a_tetrahedron_has_its_area_and_volume() {
        let mut mesh = tetrahedron();
        assert!((mesh.area() - (1.5 + 0.75_f64.sqrt())).abs() < 1e-15);
        assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-15);
        mesh.vertices.iter_mut().for_each(|v| v[0] += 1e6);
        assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-9);
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!((mesh.volume() + 1.0 / 6.0).abs() < 1e-9);
    }

    #[test]
    fn holes_and_wrong_turns_are_open_edges() {
        let mut mesh = tetrahedron();
        assert_eq!(mesh.open_edges(), 0);
        mesh.triangles[3].swap(0, 1);
        assert_eq!(mesh.open_edges(), 6);
        mesh.triangles.pop();
        assert_eq!(mesh.open_edges(), 3);
        assert_eq!(Mesh::default().open_edges(), 0);
    }

    #[test]
    fn normals_point_outwards_and_lonely_vertices_have_none() {
        let mut mesh = tetrahedron();
        mesh.vertices.push([9.0; 3]);
        mesh.smooth_normals();
        let down = DVec3::from([-1.0; 3]).normalize().as_vec3();
        assert!((glam::Vec3::from(mesh.normals[0]) - down).length() < 1e-6);
        assert_eq!(mesh.normals[4], [0.0; 3]);
    }
}
