//! A mesh to a picture: depth and colour at pixel centres.

use glam::{DVec3, Vec3};
use render_core::camera::Camera;
use scene_io::export::Mesh;

/// What a pinhole sees of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// Depth along the optical axis, world units, row by row; infinite where there is no triangle.
    pub z: Vec<f32>,
    /// sRGB, `0..=1`; black where there is no triangle, grey where the mesh has no colours.
    pub rgb: Vec<Vec3>,
}

/// Draw both sides of every triangle. Triangles that reach behind the camera are left out.
///
/// # Panics
/// If a triangle names a vertex that does not exist.
#[must_use]
pub fn draw(mesh: &Mesh, camera: &Camera) -> Drawn {
    let (w, h) = (camera.width as usize, camera.height as usize);
    let mut out = Drawn { z: vec![f32::INFINITY; w * h], rgb: vec![Vec3::ZERO; w * h] };
    let place = |v: u32| {
        let p = camera.pose.to_camera(DVec3::from(mesh.vertices[v as usize]));
        (p.z > 1e-9)
            .then(|| DVec3::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy, 1.0 / p.z))
    };
    let colour = |v: u32| match mesh.colours.get(v as usize) {
        Some(c) => Vec3::from(c.map(|c| f32::from(c) / 255.0)),
        None => Vec3::splat(0.7),
    };
    for triangle in &mesh.triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(place) else { continue };
        let area = (b - a).truncate().perp_dot((c - a).truncate());
        if area == 0.0 || !area.is_finite() {
            continue;
        }
        // Pixels whose centre may lie inside.
        let range = |low: f64, high: f64, side: usize| {
            let first = (low - 0.5).ceil().clamp(0.0, side as f64) as usize;
            first..((high - 0.5).floor() + 1.0).clamp(first as f64, side as f64) as usize
        };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for y in range(low.y, high.y, h) {
            for x in range(low.x, high.x, w) {
                let p = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let part = |q: DVec3, r: DVec3| (q.truncate() - p).perp_dot(r.truncate() - p) / area;
                let share = [part(b, c), part(c, a), part(a, b)];
                if share.iter().any(|s| *s < -1e-9) {
                    continue;
                }
                let near = share[0] * a.z + share[1] * b.z + share[2] * c.z;
                let z = (1.0 / near) as f32;
                let i = y * w + x;
                if z < out.z[i] {
                    out.z[i] = z;
                    let of = |k: usize, q: DVec3| colour(triangle[k]) * (share[k] * q.z / near) as f32;
                    out.rgb[i] = of(0, a) + of(1, b) + of(2, c);
                }
            }
        }
    }
    out
}
