//! PLY writers: binary, little-endian, with the property names that viewers look for.

use super::{Mesh, write_atomically};
use crate::{ErrorKind, Problem, SceneError};
use std::io::{self, Write};
use std::path::Path;

/// Coloured points, world units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions.
    pub positions: Vec<[f64; 3]>,
    /// sRGB colours, one for each point or none at all.
    pub colours: Vec<[u8; 3]>,
    /// Unit normals, one for each point or none at all.
    pub normals: Vec<[f32; 3]>,
    /// How sure the reconstruction is, in `[0, 1]`; one for each point or none at all.
    pub confidence: Vec<f32>,
}

/// The columns of a vertex.
struct Columns<'a> {
    positions: &'a [[f64; 3]],
    normals: &'a [[f32; 3]],
    colours: &'a [[u8; 3]],
    confidence: &'a [f32],
}

/// Write points as PLY: `x y z`, `nx ny nz`, `red green blue`, `confidence`, those that there are.
///
/// Coordinates are `float`, or `double` where 24 bits would move a point by more than a millionth of the cloud's extent
/// (places far from the origin, such as map coordinates).
///
/// # Errors
/// Columns of different lengths, a position that is not finite, a file that cannot be written.
pub fn write_points(path: &Path, points: &PointCloud) -> Result<(), SceneError> {
    let PointCloud { positions, colours, normals, confidence } = points;
    let columns = Columns { positions, normals, colours, confidence };
    columns.check(path)?;
    write_atomically(path, |out| {
        columns.header(out)?;
        out.write_all(b"end_header\n")?;
        columns.rows(out)
    })
}

/// Write a mesh as PLY: vertices as in [`write_points`], faces as `vertex_indices`.
///
/// # Errors
/// As [`write_points`], and for a triangle that names a vertex which does not exist.
pub(super) fn write_mesh_ply(path: &Path, mesh: &Mesh) -> Result<(), SceneError> {
    check_mesh(path, mesh)?;
    let columns = Columns::of(mesh);
    write_atomically(path, |out| {
        columns.header(out)?;
        write!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.triangles.len())?;
        columns.rows(out)?;
        for triangle in &mesh.triangles {
            let mut row = [3; 13];
            for (bytes, i) in row[1..].chunks_exact_mut(4).zip(triangle) {
                bytes.copy_from_slice(&i.to_le_bytes());
            }
            out.write_all(&row)?;
        }
        Ok(())
    })
}

/// Can the mesh be written, in any format?
///
/// # Errors
/// Columns of different lengths, a position that is not finite, a triangle that names a vertex which does not exist.
pub(super) fn check_mesh(path: &Path, mesh: &Mesh) -> Result<(), SceneError> {
    Columns::of(mesh).check(path)?;
    let last = mesh.vertices.len().min(i32::MAX as usize);
    match mesh.triangles.iter().position(|t| t.iter().any(|i| *i as usize >= last)) {
        Some(t) => Err(refuse(path, format!("triangle {t} names vertices {:?} of {last}", mesh.triangles[t]))),
        None => Ok(()),
    }
}

/// Is `float` too coarse for the positions?
pub(super) fn needs_double(positions: &[[f64; 3]]) -> bool {
    let (mut largest, mut extent) = (0.0_f64, 0.0_f64);
    for axis in 0..3 {
        let along = || positions.iter().map(|p| p[axis]);
        let (low, high) = along().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        extent = extent.max(high - low);
        largest = largest.max(high.abs()).max(low.abs());
    }
    // Half an ulp of `float`. A single point has no extent: its own size counts.
    let extent = if extent > 0.0 { extent } else { largest };
    !positions.is_empty() && (largest * 2_f64.powi(-25) > 1e-6 * extent || largest > f64::from(f32::MAX))
}

fn refuse(path: &Path, what: String) -> SceneError {
    SceneError::new(ErrorKind::Value, Problem::new(path, what, "this export cannot be written"))
}

impl<'a> Columns<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        Self { positions: &mesh.vertices, normals: &mesh.normals, colours: &mesh.colours, confidence: &[] }
    }

    fn check(&self, path: &Path) -> Result<(), SceneError> {
        let n = self.positions.len();
        let columns =
            [("normals", self.normals.len()), ("colours", self.colours.len()), ("confidence", self.confidence.len())];
        for (name, len) in columns {
            if len != 0 && len != n {
                return Err(refuse(path, format!("{len} {name} for {n} vertices")));
            }
        }
        match self.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            Some(i) => Err(refuse(path, format!("vertex {i} lies at {:?}", self.positions[i]))),
            None => Ok(()),
        }
    }

    fn header(&self, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", self.positions.len())?;
        let real = if needs_double(self.positions) { "double" } else { "float" };
        let mut list =
            |kind: &str, names: &[&str]| names.iter().try_for_each(|name| writeln!(out, "property {kind} {name}"));
        list(real, &["x", "y", "z"])?;
        if !self.normals.is_empty() {
            list("float", &["nx", "ny", "nz"])?;
        }
        if !self.colours.is_empty() {
            list("uchar", &["red", "green", "blue"])?;
        }
        if !self.confidence.is_empty() {
            list("float", &["confidence"])?;
        }
        Ok(())
    }

    fn rows(&self, out: &mut dyn Write) -> io::Result<()> {
        let double = needs_double(self.positions);
        let mut row = Vec::with_capacity(48);
        for (i, position) in self.positions.iter().enumerate() {
            row.clear();
            for x in position {
                if double {
                    row.extend(x.to_le_bytes());
                } else {
                    row.extend((*x as f32).to_le_bytes());
                }
            }
            row.extend(self.normals.get(i).into_iter().flatten().flat_map(|x| x.to_le_bytes()));
            row.extend(self.colours.get(i).into_iter().flatten());
            row.extend(self.confidence.get(i).into_iter().flat_map(|x| x.to_le_bytes()));
            out.write_all(&row)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Column, Ply};
    use super::*;
    use proptest::prelude::*;

    fn cloud(n: usize) -> PointCloud {
        PointCloud {
            positions: (0..n).map(|i| [i as f64, 0.5 - i as f64, 0.25]).collect(),
            colours: (0..n).map(|i| [i as u8, 255, 7]).collect(),
            normals: vec![[0.0, 0.6, -0.8]; n],
            confidence: (0..n).map(|i| i as f32 / 8.0).collect(),
        }
    }

    fn written(write: impl FnOnce(&Path) -> Result<(), SceneError>) -> Ply {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.ply");
        write(&path).unwrap();
        Ply::read(&path).unwrap()
    }

    #[test]
    fn points_come_back() {
        let points = cloud(5);
        let ply = written(|path| write_points(path, &points));
        let vertex = ply.element("vertex").unwrap();
        for i in 0..5 {
            let row = |names: [&str; 3]| names.map(|name| vertex.scalars(name).unwrap()[i]);
            assert_eq!(row(["x", "y", "z"]), points.positions[i]);
            assert_eq!(row(["nx", "ny", "nz"]), points.normals[i].map(f64::from));
            assert_eq!(row(["red", "green", "blue"]), points.colours[i].map(f64::from));
            assert_eq!(vertex.scalars("confidence").unwrap()[i], f64::from(points.confidence[i]));
        }
        assert_eq!(ply.elements.len(), 1);
    }

    #[test]
    fn columns_that_are_not_there_are_not_written() {
        let points = PointCloud { positions: vec![[1.0, 2.0, 3.0]], ..PointCloud::default() };
        let ply = written(|path| write_points(path, &points));
        let names: Vec<&str> = ply.elements[0].columns.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["x", "y", "z"]);
        let empty = written(|path| write_points(path, &PointCloud::default()));
        assert_eq!(empty.element("vertex").unwrap().count, 0);
    }

    #[test]
    fn our_own_reader_of_start_points_reads_what_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.ply");
        write_points(&path, &cloud(4)).unwrap();
        let points = crate::ply::read_points(&path).unwrap();
        assert_eq!((points.len(), points[3].rgb, points[3].xyz.to_array()), (4, [3, 255, 7], [3.0, -2.5, 0.25]));
    }

    #[test]
    fn meshes_come_back() {
        let mesh = Mesh {
            vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            normals: vec![[0.0, 0.0, 1.0]; 4],
            colours: vec![[1, 2, 3]; 4],
            triangles: vec![[0, 2, 1], [0, 1, 3]],
        };
        let ply = written(|path| write_mesh_ply(path, &mesh));
        let faces = ply.element("face").unwrap();
        let Some(Column::List(lists)) = faces.column("vertex_indices") else { panic!("no list of indices") };
        assert_eq!(lists, &[vec![0.0, 2.0, 1.0], vec![0.0, 1.0, 3.0]]);
        assert_eq!(ply.element("vertex").unwrap().scalars("green").unwrap(), [2.0; 4]);
    }

    #[test]
    fn far_from_the_origin_positions_are_double() {
        let far = |step: f64| PointCloud {
            positions: (0..10).map(|i| [4.5e6 + step * f64::from(i), 0.0, 0.0]).collect(),
            ..PointCloud::default()
        };
        let near = written(|path| write_points(path, &far(1e6)));
        let x = near.element("vertex").unwrap().scalars("x").unwrap();
        assert_eq!(x[3], f64::from((4.5e6 + 3e6) as f32));
        let fine = written(|path| write_points(path, &far(0.01)));
        let x = fine.element("vertex").unwrap().scalars("x").unwrap();
        assert_eq!(x[3], 4.5e6 + 0.01 * 3.0);
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let path = Path::new("never-written.ply");
        let short = PointCloud { colours: vec![[0; 3]], ..cloud(3) };
        assert!(write_points(path, &short).unwrap_err().to_string().contains("1 colours for 3 vertices"));
        let mut nan = cloud(3);
        nan.positions[1][2] = f64::NAN;
        assert!(write_points(path, &nan).unwrap_err().to_string().contains("vertex 1 lies at"));
        let mesh = Mesh { vertices: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 2], [0, 1, 3]], ..Mesh::default() };
        assert!(
            write_mesh_ply(path, &mesh).unwrap_err().to_string().contains("triangle 1 names vertices [0, 1, 3] of 3")
        );
        assert!(!path.exists());
    }

    proptest! {
        #![proptest_config(testkit::property::cases(32))]

        #[test]
        fn positions_keep_a_millionth_of_the_extent(
            positions in proptest::collection::vec([-1e6..1e6, -1.0..1.0, 1e3..1.001e3_f64], 2..20)
        ) {
            let points = PointCloud { positions: positions.clone(), ..PointCloud::default() };
            let ply = written(|path| write_points(path, &points));
            let vertex = ply.element("vertex").unwrap();
            let extent = positions.iter().flat_map(|p| positions.iter().map(|q| (p[0] - q[0]).abs())).fold(0.0, f64::max);
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                for (got, want) in vertex.scalars(name).unwrap().iter().zip(&positions) {
                    prop_assert!((got - want[axis]).abs() <= 1e-6 * extent.max(2.0));
                }
            }
        }
    }
}
