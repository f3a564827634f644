//! What structure from motion made: COLMAP and LLFF.

use super::{counts, data, has_note, share_in_view};
use render_core::camera::Lens;
use scene_io::colmap::Model;
use scene_io::{
    Depth, Dialect, ImageStore, LayoutHint, LoadOptions, MaskPolarity, Masks, Scene, StoreOptions, check, load,
    refuse_blank_masks,
};

/// Every point a photo sees projects to where it sees it; lengths count the photos that see it.
fn tracks_hit_their_points(scene: &Scene, median_at_most: f64) {
    let mut seen = vec![0; scene.points.len()];
    let mut off = Vec::new();
    for frame in &scene.frames {
        let camera = frame.camera.prepare();
        let mut points: Vec<u32> = frame.tracks.iter().map(|t| t.point).collect();
        points.sort_unstable();
        points.dedup();
        points.iter().for_each(|p| seen[*p as usize] += 1);
        for track in &frame.tracks {
            let at = camera.project(scene.points[track.point as usize].xyz).unwrap();
            off.push((at - glam::DVec2::from(track.pixel.map(f64::from))).length());
        }
    }
    assert!(off.len() > 3 * scene.frames.len());
    off.sort_by(f64::total_cmp);
    let median = off[off.len() / 2];
    assert!(median < median_at_most, "half of the features are more than {median} px off");
    let tracks = scene.frames.iter().flat_map(|f| &f.tracks);
    for track in tracks {
        assert_eq!(track.length, seen[track.point as usize]);
        assert!(track.length >= 2);
    }
}

#[test]
fn fern_is_an_llff_scene() {
    let Some(path) = data("nerf_llff_data/fern") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Llff);
    assert_eq!(counts(&scene), [17, 0, 3, 0]);
    assert_eq!(scene.held_out_names(), ["image000.png", "image008.png", "image016.png"]);
    assert_eq!(scene.layout, LayoutHint::ForwardFacing);
    let camera = &scene.frames[0].camera;
    assert_eq!((camera.width, camera.height), (504, 378));
    assert!((camera.fx - 3_260.526_333 / 8.0).abs() < 1e-3 && camera.cx == 252.0 && camera.cy == 189.0);
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!(near > 1.0 && far > near);
    // The start points of the incomplete COLMAP model lie in the same world.
    assert!(scene.points.len() > 5000);
    let share = share_in_view(&scene);
    assert!(share > 0.6, "only {share} of the points are in view: wrong axes?");
    has_note(&scene, "start points from");
}

#[test]
fn statue_reads_the_same_as_colmap_and_llff() {
    let Some(path) = data("nerd_in_the_wild/statue_of_liberty_40") else { return };
    let colmap = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(colmap.dialect, Dialect::Colmap);
    assert_eq!(counts(&colmap), [35, 0, 5, 0]);
    has_note(&colmap, "`--format llff` reads that instead");
    has_note(&colmap, "40 of 40 frames have an ignore mask");
    refuse_blank_masks(&colmap.frames).unwrap();
    let inverted = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsIgnored);
    refuse_blank_masks(&load(&path, &inverted).unwrap().frames).unwrap();
    tracks_hit_their_points(&colmap, 3.0);
    let llff = load(&path, &LoadOptions::default().with_dialect(Dialect::Llff)).unwrap();
    assert_eq!(llff.dialect, Dialect::Llff);
    assert_eq!(counts(&llff), [35, 0, 5, 0]);
    for (a, b) in colmap.frames.iter().zip(&llff.frames) {
        assert_eq!(a.name, b.name);
        assert!((a.camera.pose.c - b.camera.pose.c).length() < 1e-10, "{}", a.name);
        let turned = a.camera.pose.r.transpose() * b.camera.pose.r - glam::DMat3::IDENTITY;
        assert!(turned.to_cols_array().iter().all(|x| x.abs() < 1e-10), "{}", a.name);
        // LLFF's own bounds are percentiles of the same points; how they round is theirs.
        let ([near, far], [llff_near, llff_far]) = (a.z_bounds.unwrap(), b.z_bounds.unwrap());
        assert!((near / llff_near - 1.0).abs() < 0.2, "{}: near {near} against {llff_near}", a.name);
        assert!((far / llff_far - 1.0).abs() < 0.2, "{}: far {far} against {llff_far}", a.name);
    }
    assert!(share_in_view(&colmap) > 0.5);

    let store = ImageStore::new(&colmap.frames, StoreOptions::default().with_longest_side(120)).unwrap();
    let image = store.get(0).unwrap();
    let used = image.mask.as_ref().unwrap().iter().filter(|v| **v == 255).count();
    let share = used as f64 / (image.width * image.height) as f64;
    assert!((0.02..0.9).contains(&share), "{share} of the pixels are used");
    let off = load(&path, &LoadOptions::default().with_masks(Masks::Off)).unwrap();
    assert!(off.frames.iter().all(|f| f.mask.is_none()));
    assert_ne!(off.fingerprint(), colmap.fingerprint());
    assert_eq!(colmap.fingerprint(), load(&path, &LoadOptions::default()).unwrap().fingerprint());
}

#[test]
fn sacre_coeur_has_a_camera_a_photograph() {
    let Some(path) = data("phototourism/sacre_coeur_10") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Colmap);
    assert_eq!(counts(&scene), [8, 0, 2, 0]);
    assert_eq!(scene.points.len(), 1516);
    let share = share_in_view(&scene);
    assert!(share > 0.4, "only {share} of the points are in view");
    tracks_hit_their_points(&scene, 1.0);
    let report = check(&path, &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train(), "{report}");
    assert!(report.sizes.len() > 1 && report.problems.is_empty(), "{report}");
}

#[test]
fn binary_and_text_models_agree() {
    let Some(path) = data("colmap_models/statue_of_liberty_bin_and_txt/sparse/0") else { return };
    let binary = Model::read(&path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        std::fs::copy(path.join(name), folder.path().join(name)).unwrap();
    }
    let text = Model::read(folder.path()).unwrap();
    assert_eq!((binary.images.len(), binary.points.len()), (40, 1816));
    assert_eq!((text.images.len(), text.points.len()), (40, 1816));
    assert_eq!(binary.cameras.len(), text.cameras.len());
    for (id, a) in &binary.cameras {
        let b = &text.cameras[id];
        assert_eq!((a.width, a.height), (b.width, b.height));
        // The text of this version of COLMAP has six digits in cameras and poses, all of them in points.
        assert!((a.fx - b.fx).abs() < 1e-5 * a.fx && (a.cx - b.cx).abs() < 1e-3);
        let (Lens::Perspective { k: a, .. }, Lens::Perspective { k: b, .. }) = (a.lens, b.lens) else {
            panic!("SIMPLE_RADIAL is a perspective lens");
        };
        assert!(a[0] < -0.68 && (a[0] - b[0]).abs() < 1e-6);
    }
    for (a, b) in binary.images.iter().zip(&text.images) {
        assert_eq!((a.id, &a.name, a.camera_id, &a.point_ids), (b.id, &b.name, b.camera_id, &b.point_ids));
        assert!((a.pose.c - b.pose.c).length() < 1e-5 * a.pose.c.length().max(1.0));
    }
    for (id, a) in &binary.points {
        let b = text.points[id];
        assert!((a.xyz - b.xyz).length() < 1e-9 * a.xyz.length().max(1.0) && a.rgb == b.rgb);
    }
}

#[test]
fn colmap_cameras_are_scaled_to_larger_photographs() {
    let (Some(model), Some(images)) = (data("instant_ngp/fox_colmap"), data("instant_ngp/fox/images")) else { return };
    let options = LoadOptions::default().with_images(images);
    let scene = load(&model, &options).unwrap();
    assert_eq!(counts(&scene), [43, 0, 7, 0]);
    assert_eq!((scene.frames[0].camera.width, scene.frames[0].camera.height), (1080, 1920));
    has_note(&scene, "cameras scaled to the images (540x960 listed, 1080x1920 found)");
    has_note(&scene, "found under another extension than listed");
    let error = load(&model, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds no folder of images"), "{error}");

    // The reconstruction was made with the poses of the other file: the same cameras, at another size.
    let Some(fox135) = data("benchmarks/fox135") else { return };
    let other = load(&fox135, &LoadOptions::default()).unwrap();
    // The matrices of that file are orthonormal to 1.2e-6 only, and COLMAP made quaternions of them.
    for (a, b) in scene.frames.iter().zip(&other.frames) {
        assert!((a.camera.pose.c - b.camera.pose.c).length() < 1e-5, "{} {}", a.name, b.name);
        let off = a.camera.optical_axis().angle_between(b.camera.optical_axis());
        assert!(off < 1e-5, "{}: {off} rad", a.name);
        assert!((a.camera.fx / 8.0 - b.camera.fx).abs() < 1e-6 && (a.camera.cx / 8.0 - b.camera.cx).abs() < 1e-6);
    }
}
