//! Binary glTF 2.0: one file that browsers, Blender and engines open.
//!
//! Numbers are those of the mesh's frame. glTF has y up, so the node turns the frame's axis nearest to up to y: readers that
//! follow the node show the scene upright, readers of the bare numbers get the input's frame. Where `float` is too coarse for
//! the positions, they are from the middle of the mesh and the node moves them there.

use super::{Mesh, ply, write_atomically};
use crate::{ErrorKind, Problem, SceneError};
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};
use std::path::Path;

/// Types of numbers, and what a buffer is for.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// Write a mesh as GLB: positions, normals, colours (linear, as glTF wants them, 16 bit), 32-bit indices; shown without
/// light, as the colours hold that of the photos.
///
/// # Errors
/// As [`write_mesh`](super::write_mesh); a mesh of more than 4 GB, which the format cannot hold.
pub(super) fn write_glb(path: &Path, mesh: &Mesh, up: [f64; 3]) -> Result<(), SceneError> {
    ply::check_mesh(path, mesh)?;
    let centre = match ply::needs_double(&mesh.vertices) {
        true => mesh.vertices.iter().map(|v| DVec3::from(*v)).sum::<DVec3>() / mesh.vertices.len().max(1) as f64,
        false => DVec3::ZERO,
    };
    let Parts { json, binary } = parts(mesh, centre, up);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + if binary.is_empty() { 0 } else { 8 + binary.len() };
    let Ok(total) = u32::try_from(total) else {
        let problem = Problem::new(path, "takes more than 4 GB", "write a .ply, or fewer triangles");
        return Err(SceneError::new(ErrorKind::Value, problem));
    };
    write_atomically(path, |out| {
        out.write_all(b"glTF")?;
        out.write_all(&[2_u32.to_le_bytes(), total.to_le_bytes()].concat())?;
        out.write_all(&[(text.len() as u32).to_le_bytes(), *b"JSON"].concat())?;
        out.write_all(&text)?;
        if !binary.is_empty() {
            out.write_all(&[(binary.len() as u32).to_le_bytes(), *b"BIN\0"].concat())?;
            out.write_all(&binary)?;
        }
        Ok(())
    })
}

struct Parts {
    json: Value,
    binary: Vec<u8>,
}

fn parts(mesh: &Mesh, centre: DVec3, up: [f64; 3]) -> Parts {
    let asset = json!({ "version": "2.0", "generator": "wildfield" });
    if mesh.triangles.is_empty() {
        // A mesh without a triangle is none to glTF.
        let json = json!({ "asset": asset, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "name": "mesh" }] });
        return Parts { json, binary: Vec::new() };
    }
    let mut binary = Vec::new();
    let (mut views, mut accessors, mut attributes) = (Vec::new(), Vec::new(), serde_json::Map::new());
    let mut put = |bytes: &mut dyn FnMut(&mut Vec<u8>), target: u32, mut accessor: Value| {
        let start = binary.len();
        bytes(&mut binary);
        views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": binary.len() - start, "target": target }));
        // All rows are whole words: what comes next is aligned.
        accessor["bufferView"] = json!(views.len() - 1);
        accessors.push(accessor);
        accessors.len() - 1
    };
    let n = mesh.vertices.len();
    let positions: Vec<[f32; 3]> =
        mesh.vertices.iter().map(|v| (DVec3::from(*v) - centre).as_vec3().to_array()).collect();
    let ends = |pick: fn(f32, f32) -> f32, start: f32| {
        positions.iter().fold([start; 3], |m, p| [0, 1, 2].map(|k| pick(m[k], p[k])))
    };
    let (low, high) = (ends(f32::min, f32::INFINITY), ends(f32::max, f32::NEG_INFINITY));
    let words = |rows: &[[f32; 3]], out: &mut Vec<u8>| rows.iter().flatten().for_each(|x| out.extend(x.to_le_bytes()));
    let floats = |n: usize| json!({ "componentType": FLOAT, "count": n, "type": "VEC3" });
    let mut accessor = floats(n);
    (accessor["min"], accessor["max"]) = (json!(low), json!(high));
    attributes.insert("POSITION".into(), json!(put(&mut |out| words(&positions, out), VERTICES, accessor)));
    if !mesh.normals.is_empty() {
        // glTF wants unit normals, also of a vertex that has none.
        let unit = |n: &[f32; 3]| if n.iter().any(|x| *x != 0.0) { *n } else { [0.0, 0.0, 1.0] };
        let normals: Vec<[f32; 3]> = mesh.normals.iter().map(unit).collect();
        attributes.insert("NORMAL".into(), json!(put(&mut |out| words(&normals, out), VERTICES, floats(n))));
    }
    if !mesh.colours.is_empty() {
        let mut colours = |out: &mut Vec<u8>| {
            for colour in &mesh.colours {
                let row = colour.map(linear);
                [row[0], row[1], row[2], u16::MAX].iter().for_each(|x| out.extend(x.to_le_bytes()));
            }
        };
        let accessor = json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "count": n, "type": "VEC4" });
        attributes.insert("COLOR_0".into(), json!(put(&mut colours, VERTICES, accessor)));
    }
    let mut corners = |out: &mut Vec<u8>| mesh.triangles.iter().flatten().for_each(|i| out.extend(i.to_le_bytes()));
    let accessor = json!({ "componentType": UNSIGNED_INT, "count": mesh.triangles.len() * 3, "type": "SCALAR" });
    let indices = put(&mut corners, INDICES, accessor);
    let turn = upright(up.into());
    let mut node = json!({ "name": "mesh", "mesh": 0, "rotation": turn.to_array() });
    if centre != DVec3::ZERO {
        node["translation"] = json!((turn * centre).to_array());
    }
    let json = json!({
        "asset": asset,
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "extensions": { "KHR_materials_unlit": {} }
        }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    Parts { json, binary }
}

/// The quarter or half turn that brings the axis nearest to `up` to y; none where there is no up.
fn upright(up: DVec3) -> DQuat {
    let size = up.abs();
    let [x, y, z] = DVec3::AXES;
    let turn = if !up.is_finite() || size.max_element() == 0.0 || size.y >= size.max_element() {
        // About x, so that what is right stays right.
        if up.y < 0.0 { DMat3::from_cols(x, -y, -z) } else { DMat3::IDENTITY }
    } else if size.z >= size.x {
        if up.z > 0.0 { DMat3::from_cols(x, -z, y) } else { DMat3::from_cols(x, z, -y) }
    } else if up.x > 0.0 {
        DMat3::from_cols(y, -x, z)
    } else {
        DMat3::from_cols(-y, x, z)
    };
    DQuat::from_mat3(&turn)
}

/// A byte of sRGB as 16 bits of light.
fn linear(byte: u8) -> u16 {
    let x = f64::from(byte) / 255.0;
    let light = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    (light * f64::from(u16::MAX)).round() as u16
}

#[cfg(test)]
mod tests {
    use super::super::mesh_file::tests::cube;
    use super::super::write_mesh;
    use super::*;

    /// The JSON, the buffer, and a way to its numbers.
    fn read(mesh: &Mesh, up: [f64; 3]) -> (Value, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.glb");
        write_mesh(&path, mesh, up).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8), &bytes[16..20]), (&b"glTF"[..], 2, bytes.len(), &b"JSON"[..]));
        let end = 20 + word(12);
        let json = serde_json::from_slice(&bytes[20..end]).unwrap();
        if end == bytes.len() {
            return (json, Vec::new());
        }
        assert_eq!((&bytes[end + 4..end + 8], end % 4), (&b"BIN\0"[..], 0));
        assert_eq!(word(end), bytes.len() - end - 8);
        (json, bytes[end + 8..].to_vec())
    }

    fn view<'a>(json: &Value, binary: &'a [u8], accessor: usize) -> &'a [u8] {
        let view = &json["bufferViews"][json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize];
        let [start, len] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
        assert_eq!(start % 4, 0);
        &binary[start..start + len]
    }

    fn floats(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn a_unit_cube_goes_out_as_a_unit_cube() {
        let mesh = cube();
        let (json, binary) = read(&mesh, [0.0, 0.1, 0.9]);
        assert_eq!(json["buffers"][0]["byteLength"], binary.len());
        let primitive = &json["meshes"][0]["primitives"][0];
        let of = |name: &str| primitive["attributes"][name].as_u64().unwrap() as usize;
        let positions = floats(view(&json, &binary, of("POSITION")));
        let want: Vec<f32> = mesh.vertices.iter().flatten().map(|x| *x as f32).collect();
        assert_eq!(positions, want);
        let accessor = &json["accessors"][of("POSITION")];
        assert_eq!((&accessor["min"], &accessor["max"]), (&json!([0.0, 0.0, 0.0]), &json!([1.0, 1.0, 1.0])));
        assert_eq!(floats(view(&json, &binary, of("NORMAL"))), mesh.normals.concat());
        let indices = view(&json, &binary, primitive["indices"].as_u64().unwrap() as usize);
        let corners: Vec<u32> = indices.chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(corners, mesh.triangles.concat());
        let colours = view(&json, &binary, of("COLOR_0"));
        assert_eq!(colours[..8], [0, 0, 0, 0, 0, 0, 255, 255]);
        assert_eq!(colours[8 * 7..], [255; 8]);
    }

    #[test]
    fn the_node_turns_up_to_y_and_nothing_else() {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
            let turn = upright(axis + DVec3::new(0.1, -0.2, 0.15));
            assert!((turn * axis - DVec3::Y).length() < 1e-12, "{axis}");
            assert!((turn.length() - 1.0).abs() < 1e-12);
        }
        assert_eq!(upright(DVec3::ZERO), DQuat::IDENTITY);
        assert_eq!(upright(DVec3::NAN), DQuat::IDENTITY);
        // z up to y up as Blender does it: y goes backwards.
        assert!((upright(DVec3::Z) * DVec3::Y - DVec3::NEG_Z).length() < 1e-12);
    }

    #[test]
    fn far_from_the_origin_the_node_moves_the_mesh_there() {
        let mut mesh = cube();
        let far = DVec3::new(4.5e6, 1e3, 0.25);
        mesh.vertices.iter_mut().for_each(|v| *v = (DVec3::from(*v) + far).to_array());
        let (json, binary) = read(&mesh, [0.0, 0.0, 1.0]);
        let node = &json["nodes"][0];
        let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(node[key].clone()).unwrap() };
        let (turn, shift) = (numbers("rotation"), numbers("translation"));
        let turn = DQuat::from_xyzw(turn[0], turn[1], turn[2], turn[3]);
        let positions = floats(view(&json, &binary, 0));
        for (p, v) in positions.chunks_exact(3).zip(&mesh.vertices) {
            let p = DVec3::new(p[0].into(), p[1].into(), p[2].into());
            let world = turn.inverse() * (turn * p + DVec3::new(shift[0], shift[1], shift[2]));
            assert!((world - DVec3::from(*v)).length() < 1e-6, "{world} for {v:?}");
        }
    }

    #[test]
    fn nothing_is_a_file_without_a_mesh() {
        let (json, binary) = read(&Mesh::default(), [0.0; 3]);
        assert!(json["meshes"].is_null() && binary.is_empty());
        assert_eq!((linear(0), linear(255), linear(128)), (0, u16::MAX, 14146));
    }
}
