//! Files that hold something else.

use super::*;
use scene_io::export::{Mesh, PointCloud, write_mesh, write_points};

fn exported(write: impl FnOnce(&Path) -> Result<(), SceneError>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.ply");
    write(&path).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn points_and_meshes_are_named() {
    let points = PointCloud { positions: vec![[0.0; 3]; 3], colours: vec![[1, 2, 3]; 3], ..PointCloud::default() };
    refused(parse("a.ply", &exported(|p| write_points(p, &points))), &["holds points, not splats", "`f_dc_0`"]);
    let mesh = Mesh { vertices: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    refused(parse("a.ply", &exported(|p| write_mesh(p, &mesh, [0.0; 3]))), &["holds a mesh, not splats"]);
    let chunks = b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\n\
                   property uint packed_position\nend_header\n0123456789";
    refused(parse("a.ply", chunks), &["a.ply:3", "`chunk`", "uncompressed"]);
    let packed =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uint packed_position\nend_header\n0123";
    refused(parse("a.ply", packed), &["compressed form"]);
    let none = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float a\nend_header\n1\n";
    refused(parse("a.ply", none), &["holds no splats"]);
}

#[test]
fn other_files_are_refused_by_what_they_are_not() {
    for other in [&b"\x89PNG\r\n\x1a\n"[..], b"{}", b"", b"solid x", b"pl"] {
        refused(parse("a.ply", other), &["a.ply", "not a PLY file"]);
        refused(parse("a.spz", other), &["not an SPZ file"]);
        refused(parse("a.png", other), &["a.png", "is neither PLY nor SPZ"]);
    }
    refused(parse("a.splat", b"{}"), &["2 bytes are not a multiple of 32"]);
}

#[test]
fn what_is_inside_counts_more_than_the_name() {
    let cloud = trained::small();
    for (inside, name) in [("a.ply", "a.spz"), ("a.spz", "a.ply"), ("a.ply", "a.splat"), ("a.spz", "noname")] {
        let file = parse(name, &encode(inside, &cloud).0).unwrap();
        assert_eq!(file.cloud.len(), cloud.len());
        has_note(&file.notes, "whatever its name says");
    }
}
