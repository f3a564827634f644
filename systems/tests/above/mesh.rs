//! Meshes out of exact pictures of the table top: where the surface is, and open only where nobody looked.

use engine::halt::Halt;
use engine::mesh::raster::draw as drawn;
use engine::mesh::{Fused, MeshOptions, depth_views, fuse, seen_box, seen_points};
use engine::render::{Rendered, plain_query};
use engine::system::Layers;
use glam::{DVec2, DVec3, Vec3};
use render_core::camera::Camera;
use render_core::ray::Ray;
use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop};

/// What a field that has learnt everything would render.
fn exact(truth: &Tabletop, camera: &Camera) -> Rendered {
    let pixels = (camera.width * camera.height) as usize;
    let mut layers = Layers::nothing(pixels, &plain_query([1.0; 3], 0.0));
    for i in 0..pixels {
        let at = DVec2::new((i as u32 % camera.width) as f64 + 0.5, (i as u32 / camera.width) as f64 + 0.5);
        if let Some(hit) = camera.ray(at).and_then(|ray| truth.trace(&ray)) {
            (layers.opacity[i], layers.median_depth[i]) = (1.0, hit.t as f32);
            layers.rgb[i] = hit.rgb.as_vec3().to_array();
        }
    }
    Rendered { width: camera.width, height: camera.height, layers }
}

/// Distance to the surface along a vertex's normal, at most `most`.
fn distance(truth: &Tabletop, x: DVec3, normal: DVec3, most: f64) -> f64 {
    let ray = Ray { o: x + normal * most, d: -normal };
    truth.trace(&ray).map_or(most, |hit| (hit.t - most).abs().min(most))
}

#[test]
fn the_table_top_becomes_a_mesh_where_it_is_and_open_only_underneath() {
    let options =
        TabletopOptions { width: 128, height: 128, train: 40, test: 0, rays: 1, ..TabletopOptions::default() };
    let truth = Tabletop::new(options.seed);
    let cameras: Vec<Camera> = tabletop(&options).frames.iter().map(|f| f.camera).collect();
    let draw = |camera: &Camera| Ok(exact(&truth, camera));
    let views = depth_views(&draw, &cameras, [1.0; 3], &mut |_, _| true).unwrap().unwrap();

    let [min, max] = seen_box(&views).unwrap();
    let bounds = truth.bounds();
    assert!((DVec3::from(min) - bounds.min).abs().max_element() < 0.2, "{min:?}");
    assert!((DVec3::from(max) - bounds.max).abs().max_element() < 0.2, "{max:?}");

    let triangles = 20_000;
    let Fused { mesh, cell, raw, coverage, .. } =
        fuse(&views, &MeshOptions { crop: None, resolution: None, triangles }, &Halt::NEVER).unwrap().unwrap();
    assert!(mesh.triangles.len() <= triangles && raw > triangles, "{} of {raw}", mesh.triangles.len());
    let share = coverage.share().unwrap();
    let most = 4.0 * cell;
    let mut far: Vec<f64> = mesh
        .vertices
        .iter()
        .zip(&mesh.normals)
        .map(|(v, n)| distance(&truth, DVec3::from(*v), Vec3::from(*n).as_dvec3(), most))
        .collect();
    let mean = far.iter().sum::<f64>() / far.len() as f64;
    far.sort_by(f64::total_cmp);
    println!("cell {cell:.4}, mean distance {mean:.4}, median {:.4}, covered {share:.4}", far[far.len() / 2]);
    assert!(mean < 0.6 * cell, "mean distance {mean} with cells of {cell}");
    // Three pixels of ten lie on an outline here.
    assert!(share > 0.97 && coverage.missed * 80 < coverage.pixels, "{coverage:?}");

    // From above, where all was seen, there is no hole, and colours are those of the scene.
    let (mut seen, mut holes, mut off) = (0, 0, 0.0);
    for camera in &cameras[..8] {
        let (picture, want) = (drawn(&mesh, camera), exact(&truth, camera));
        for i in (0..picture.z.len()).filter(|&i| want.layers.opacity[i] > 0.0) {
            seen += 1;
            if picture.z[i].is_infinite() {
                holes += 1;
            } else {
                off += f64::from((picture.rgb[i] - Vec3::from(want.layers.rgb[i])).abs().element_sum() / 3.0);
            }
        }
    }
    println!("{holes} of {seen} pixels see through, colours are off by {:.4}", off / f64::from(seen));
    assert!(holes * 50 < seen, "{holes} of {seen}");
    assert!(off / f64::from(seen) < 0.04, "{}", off / f64::from(seen));

    let cloud = seen_points(&views, &[min, max], 2000);
    assert_eq!(cloud.positions.len(), 2000);
    for (x, n) in cloud.positions.iter().zip(&cloud.normals) {
        let d = distance(&truth, DVec3::from(*x), Vec3::from(*n).as_dvec3(), 0.02);
        assert!(d < 0.015, "{x:?} {n:?}: {d}");
    }
}
