//! What is exported is read again as it was.

use glam::{DMat3, DVec3};
use render_core::camera::{Camera, Lens, Pose};
use scene_io::export::{MeshGrid, Ply, marching_cubes, write_colmap, write_mesh, write_transforms};
use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop, write_blender};
use scene_io::{
    Dialect, Frame, ImageSource, ImageStore, LayoutHint, LoadOptions, Point, Scene, Split, StoreOptions, load,
};
use std::path::Path;

fn options() -> TabletopOptions {
    TabletopOptions { width: 24, height: 18, train: 4, test: 2, rays: 2, ..TabletopOptions::default() }
}

fn same_pose(a: &Pose, b: &Pose) -> bool {
    a.r.abs_diff_eq(b.r, 1e-12) && a.c.abs_diff_eq(b.c, 1e-11)
}

fn same_camera(a: &Camera, b: &Camera) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs().max(1.0);
    (a.width, a.height, a.lens) == (b.width, b.height, b.lens)
        && near(a.fx, b.fx)
        && near(a.fy, b.fy)
        && near(a.cx, b.cx)
        && near(a.cy, b.cy)
        && same_pose(&a.pose, &b.pose)
}

/// Cameras with every lens that `transforms.json` has a name for, and pictures to go with them.
fn frames_of_all_lenses(folder: &Path) -> Vec<Frame> {
    let lenses = [
        Lens::PINHOLE,
        Lens::opencv5([0.01, -0.002, 0.001, -0.0005, 0.0001]),
        Lens::Perspective { k: [0.1, 0.02, 0.0, 0.05, 0.01, 0.0], p: [0.001, 0.0] },
        Lens::Fisheye { k: [0.01, 0.002, -0.001, 0.0003] },
    ];
    let scene = tabletop(&TabletopOptions { train: lenses.len(), test: 0, ..options() });
    let mut frames = Vec::new();
    for (mut frame, lens) in scene.frames.into_iter().zip(lenses) {
        frame.camera.lens = lens;
        frame.camera.fy *= 1.01;
        frame.camera.cx += 0.7;
        frame.camera.pose.c += DVec3::new(1234.5, -0.1, 1e-3);
        frame.name = format!("images/{}.png", frame.name.replace('/', "_"));
        let path = folder.join(&frame.name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::RgbaImage::new(frame.camera.width, frame.camera.height).save(&path).unwrap();
        frame.image = ImageSource::File(path);
        frames.push(frame);
    }
    frames
}

#[test]
fn tabletop_in_blender_form_is_read_back_bit_for_bit() {
    let scene = tabletop(&options());
    let folder = tempfile::tempdir().unwrap();
    write_blender(&scene, folder.path()).unwrap();
    let read = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((read.dialect, read.frames.len()), (Dialect::Blender, 6));
    assert_eq!((read.count(Split::Train), read.count(Split::Test)), (4, 2));
    let LayoutHint::Object { near, far } = read.layout else { panic!("{:?}", read.layout) };
    assert_eq!(LayoutHint::Object { near, far }, scene.layout);
    let store = ImageStore::new(&read.frames, StoreOptions::default()).unwrap();
    for (i, got) in read.frames.iter().enumerate() {
        let want = scene.frames.iter().find(|f| f.name == got.name).unwrap_or_else(|| panic!("{}", got.name));
        assert!(same_camera(&got.camera, &want.camera), "{}: {:?} {:?}", got.name, got.camera, want.camera);
        let ImageSource::Memory(picture) = &want.image else { panic!("not in memory") };
        assert_eq!(*store.get(i).unwrap(), **picture);
    }
}

#[test]
fn blender_form_refuses_what_it_cannot_say() {
    let folder = tempfile::tempdir().unwrap();
    let change = |change: fn(&mut Frame)| {
        let mut scene = tabletop(&options());
        change(&mut scene.frames[1]);
        write_blender(&scene, folder.path()).unwrap_err().to_string()
    };
    for (error, what) in [
        (change(|f| f.camera.cx += 1.0), "axis in the middle"),
        (change(|f| f.camera.lens = Lens::Fisheye { k: [0.0; 4] }), "no lens distortion"),
        (change(|f| (f.camera.fx, f.camera.fy) = (5.0, 5.0)), "one angle of view"),
        (change(|f| f.image = ImageSource::File("x.png".into())), "not in memory"),
    ] {
        assert!(error.contains(what) && error.contains("train/r_001"), "{error}");
    }
}

#[test]
fn transforms_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let frames = frames_of_all_lenses(folder.path());
    write_transforms(&folder.path().join("transforms.json"), &frames).unwrap();
    let read = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(read.frames.len(), frames.len());
    for want in &frames {
        let got = read.frames.iter().find(|f| f.name == want.name).unwrap_or_else(|| panic!("no {}", want.name));
        assert!(same_camera(&got.camera, &want.camera), "{:?} {:?}", got.camera, want.camera);
    }
}

#[test]
fn transforms_refuse_a_lens_without_a_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames_of_all_lenses(folder.path());
    frames[2].camera.lens = Lens::Fov { omega: 0.9 };
    let path = folder.path().join("transforms.json");
    let error = write_transforms(&path, &frames).unwrap_err().to_string();
    assert!(error.contains(&frames[2].name) && error.contains("Fov"), "{error}");
    assert!(!path.exists());
}

#[test]
fn colmap_text_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames_of_all_lenses(folder.path());
    for frame in &mut frames {
        // COLMAP's names are relative to the images' folder.
        frame.name = frame.name.trim_start_matches("images/").to_owned();
    }
    let points: Vec<Point> =
        (0..9).map(|i| Point { xyz: DVec3::new(0.1, f64::from(i), -1e-7), rgb: [i as u8, 0, 255] }).collect();
    write_colmap(&folder.path().join("sparse/0"), &frames, &points).unwrap();
    let read = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((read.dialect, read.frames.len()), (Dialect::Colmap, frames.len()));
    for want in &frames {
        let got =
            read.frames.iter().find(|f| f.name.ends_with(&want.name)).unwrap_or_else(|| panic!("no {}", want.name));
        assert!(same_camera(&got.camera, &want.camera), "{:?} {:?}", got.camera, want.camera);
    }
    let mut back = read.points;
    back.sort_by(|a, b| a.xyz.y.total_cmp(&b.xyz.y));
    assert_eq!(back, points);
}

#[test]
fn colmap_text_shares_cameras_and_refuses_blanks() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = tabletop(&options());
    write_colmap(folder.path(), &scene.frames, &[]).unwrap();
    let cameras = std::fs::read_to_string(folder.path().join("cameras.txt")).unwrap();
    assert_eq!(cameras.lines().filter(|l| !l.starts_with('#')).count(), 1);
    scene.frames[3].name = "my photo.png".into();
    let error = write_colmap(folder.path(), &scene.frames, &[]).unwrap_err().to_string();
    assert!(error.contains("my photo.png"), "{error}");
}

#[test]
fn a_mesh_of_the_tabletop_lies_on_its_surfaces_and_is_read_back() {
    let table = Tabletop::new(0);
    let bounds = table.bounds();
    let margin = DVec3::splat(0.05);
    let grid = MeshGrid::cubic((bounds.min - margin).to_array(), (bounds.max + margin).to_array(), 64);
    let cell = (2.0 + 0.1) / 64.0;
    let solid = |points: &[[f64; 3]], out: &mut [f32]| {
        for (out, p) in out.iter_mut().zip(points) {
            *out = if table.contains(DVec3::from(*p)) { 20.0 } else { 0.0 };
        }
    };
    let mut mesh = marching_cubes(&grid, 10.0, solid).unwrap();
    assert_eq!(mesh.open_edges(), 0);
    // Vertices of a solid lie half way between a sample inside and one outside.
    for v in &mesh.vertices {
        let v = DVec3::from(*v);
        let around = (0..6).map(|i| v + DVec3::AXES[i / 2] * if i % 2 == 0 { 0.51 * cell } else { -0.51 * cell });
        let inside = around.filter(|p| table.contains(*p)).count();
        assert!((1..6).contains(&inside), "{v}: {inside} of 6 neighbours inside");
    }
    mesh.colours = vec![[10, 20, 30]; mesh.vertices.len()];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    write_mesh(&path, &mesh, [0.0; 3]).unwrap();
    let ply = Ply::read(&path).unwrap();
    assert_eq!(ply.element("vertex").unwrap().count, mesh.vertices.len());
    assert_eq!(ply.element("face").unwrap().count, mesh.triangles.len());
    assert_eq!(ply.element("vertex").unwrap().scalars("blue").unwrap()[0], 30.0);
}

/// The picture of a camera in CV axes shows things where the camera says they are: not mirrored, not shifted.
#[test]
fn the_tabletop_is_seen_where_the_camera_projects_it() {
    let table = Tabletop::new(0);
    let scene: Scene = tabletop(&TabletopOptions { width: 120, height: 90, ..options() });
    let camera = scene.frames[0].camera;
    let truth = table.truth(&camera);
    let mut seen = 0;
    for row in 0..90_u32 {
        for column in 0..120_u32 {
            let t = truth.distance[(row * 120 + column) as usize];
            if !t.is_finite() {
                continue;
            }
            let ray = camera.ray((f64::from(column) + 0.5, f64::from(row) + 0.5).into()).unwrap();
            let pixel = camera.project(ray.at(t)).unwrap();
            assert!((pixel.x - f64::from(column) - 0.5).abs() < 1e-6 && (pixel.y - f64::from(row) - 0.5).abs() < 1e-6);
            seen += 1;
        }
    }
    assert!(seen > 1000);
    // A camera above the middle, image up along world y: +x is on the right.
    let down = Pose { r: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z), c: DVec3::new(0.0, 0.0, 4.0) };
    let above = Camera::pinhole(64, 64, 60.0, 60.0, 32.0, 32.0, down);
    let block = above.project(DVec3::new(0.45, 0.38, 0.56)).unwrap();
    assert!(block.x > 32.0 && block.y < 32.0);
    let hit = table.trace(&above.ray(block).unwrap()).unwrap();
    assert!((hit.t - above.ray(block).unwrap().o.distance(DVec3::new(0.45, 0.38, 0.56))).abs() < 1e-9);
}
