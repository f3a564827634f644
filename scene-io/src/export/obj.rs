//! Wavefront OBJ: text that everything reads. Colours stand behind the positions, as MeshLab, Blender and others write them.

use super::{Mesh, ply, write_atomically};
use crate::SceneError;
use std::path::Path;

/// Write a mesh as OBJ. Positions keep all their digits; colours are sRGB in `0..=1`.
///
/// # Errors
/// As [`write_mesh`](super::write_mesh).
pub(super) fn write_obj(path: &Path, mesh: &Mesh) -> Result<(), SceneError> {
    ply::check_mesh(path, mesh)?;
    write_atomically(path, |out| {
        writeln!(out, "# {} vertices, {} triangles", mesh.vertices.len(), mesh.triangles.len())?;
        for (i, [x, y, z]) in mesh.vertices.iter().enumerate() {
            match mesh.colours.get(i) {
                Some(c) => {
                    let [r, g, b] = c.map(|c| f64::from(c) / 255.0);
                    writeln!(out, "v {x} {y} {z} {r:.5} {g:.5} {b:.5}")?;
                }
                None => writeln!(out, "v {x} {y} {z}")?,
            }
        }
        for [x, y, z] in &mesh.normals {
            writeln!(out, "vn {x} {y} {z}")?;
        }
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| i + 1);
            match mesh.normals.is_empty() {
                true => writeln!(out, "f {a} {b} {c}")?,
                false => writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?,
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::super::mesh_file::tests::cube;
    use super::super::write_mesh;

    #[test]
    fn a_unit_cube_goes_out_as_a_unit_cube() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.obj");
        let mut mesh = cube();
        // Far away, with digits that a float has not.
        mesh.vertices.iter_mut().for_each(|v| v[0] += 4.5e6 + 0.01);
        write_mesh(&path, &mesh, [0.0, 0.0, 1.0]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let rows = |key: &str| -> Vec<Vec<f64>> {
            let of = text.lines().filter_map(|l| l.strip_prefix(key));
            of.map(|l| l.split_whitespace().map(|w| w.split("//").next().unwrap().parse().unwrap()).collect()).collect()
        };
        let (v, n, f) = (rows("v "), rows("vn "), rows("f "));
        assert_eq!((v.len(), n.len(), f.len()), (8, 8, 12));
        for ((row, x), c) in v.iter().zip(&mesh.vertices).zip(&mesh.colours) {
            assert_eq!(row[..3], *x);
            assert_eq!(row[3..], c.map(|c| f64::from(c / 255)));
        }
        for (f, t) in f.iter().zip(&mesh.triangles) {
            assert_eq!(f[..], t.map(|i| f64::from(i) + 1.0));
        }
        mesh.normals.clear();
        mesh.colours.clear();
        write_mesh(&path, &mesh, [0.0, 0.0, 1.0]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().ends_with("f 5 6 8\nf 5 8 7\n"));
    }
}
