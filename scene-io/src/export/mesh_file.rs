//! A mesh to a file, in the format that its name ends in.

use super::{Mesh, glb, obj, ply};
use crate::{ErrorKind, Problem, SceneError};
use std::path::Path;

/// A format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary little-endian, vertices as in [`write_points`](super::write_points), faces as `vertex_indices`.
    Ply,
    /// Wavefront text: `v x y z r g b`, `vn`, `f a//a b//b c//c`.
    Obj,
    /// Binary glTF 2.0: one mesh on one node.
    Glb,
}

impl MeshFormat {
    /// The format of a file by what its name ends in.
    ///
    /// # Errors
    /// Names the file and the endings there are.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        let end = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match end.as_deref() {
            Some("ply") => Ok(Self::Ply),
            Some("obj") => Ok(Self::Obj),
            Some("glb") => Ok(Self::Glb),
            _ => {
                let what = "is not a mesh file by its name";
                let problem = Problem::new(path, what, "end it in .ply, .obj or .glb");
                Err(SceneError::new(ErrorKind::Value, problem))
            }
        }
    }
}

/// Write a mesh as PLY, OBJ or GLB, by what the name ends in. Positions are those of `mesh` in all of them, in `float` or
/// decimal digits; PLY takes `double` and GLB a node's translation where `float` is too coarse (see
/// [`write_points`](super::write_points)).
///
/// `up` is which way is up in the frame of `mesh`, about: glTF has y up, so the node of a GLB turns the axis nearest to `up`
/// to y. Its numbers stay those of the frame. The other formats have no up.
///
/// # Errors
/// Another ending; columns of different lengths; a position that is not finite; a triangle that names a vertex which does
/// not exist; a file that cannot be written.
pub fn write_mesh(path: &Path, mesh: &Mesh, up: [f64; 3]) -> Result<(), SceneError> {
    match MeshFormat::of(path)? {
        MeshFormat::Ply => ply::write_mesh_ply(path, mesh),
        MeshFormat::Obj => obj::write_obj(path, mesh),
        MeshFormat::Glb => glb::write_glb(path, mesh, up),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The cube from 0 to 1, coloured by corner.
    pub(in super::super) fn cube() -> Mesh {
        let corner = |c: usize| [c & 1, c >> 1 & 1, c >> 2].map(|x| x as f64);
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let mut mesh = Mesh {
            vertices: (0..8).map(corner).collect(),
            colours: (0..8).map(|c| corner(c).map(|x| (x * 255.0) as u8)).collect(),
            triangles: quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
            ..Mesh::default()
        };
        mesh.smooth_normals();
        assert!((mesh.volume() - 1.0).abs() < 1e-12);
        mesh
    }

    #[test]
    fn the_ending_says_which_format_and_others_are_refused() {
        assert_eq!(MeshFormat::of(Path::new("a/B.GLB")).unwrap(), MeshFormat::Glb);
        for name in ["x", "x.stl", "ply"] {
            let error = write_mesh(Path::new(name), &cube(), [0.0, 0.0, 1.0]).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(".ply, .obj or .glb"), "{error}");
        }
    }

    #[test]
    fn what_does_not_fit_together_is_refused_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["x.ply", "x.obj", "x.glb"] {
            let path = folder.path().join(name);
            let mut bad = cube();
            bad.triangles[3] = [0, 1, 8];
            let error = write_mesh(&path, &bad, [0.0; 3]).unwrap_err().to_string();
            assert!(error.contains("triangle 3 names vertices"), "{error}");
            let mut nan = cube();
            nan.vertices[2][1] = f64::NAN;
            assert!(write_mesh(&path, &nan, [0.0; 3]).is_err() && !path.exists());
            write_mesh(&path, &Mesh::default(), [0.0; 3]).unwrap();
        }
    }
}
