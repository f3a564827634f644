//! Depth maps: by extension, in the dialect's unit, with holes.

use super::*;

#[test]
fn depth_files_are_read_by_extension_in_the_dialects_unit() {
    let dataset = Dataset::ngp(4);
    for (i, name) in ["0.npy", "1.png", "2.exr", "3.npy"].into_iter().enumerate() {
        let image = format!("\"file_path\": \"./images/{i:03}.png\",");
        dataset.edit("transforms.json", &image, &format!("{image} \"depth_file_path\": \"depth/{name}\","));
    }
    dataset.edit("transforms.json", "\"aabb_scale\": 1", "\"camera_model\": \"OPENCV\"");
    dataset.write("depth/0.npy", npy(&[6, 8], &[2.5; 48]));
    image::ImageBuffer::from_pixel(8, 6, image::Luma([2500_u16])).save(dataset.file("depth/1.png")).unwrap();
    image::Rgb32FImage::from_pixel(8, 6, image::Rgb([2.5, 0.0, 0.0])).save(dataset.file("depth/2.exr")).unwrap();
    dataset.write("depth/3.npy", npy(&[3, 4], &[2.5; 12]));
    let scene = plain(&dataset);
    for frame in &scene.frames {
        let map = frame.read_depth().unwrap().unwrap();
        assert_eq!(map.range(), Some([2.5, 2.5]), "{}", frame.name);
        assert_eq!(map.resized(8, 6).holes(), 0);
    }
    warns(&dataset, "the depth is the same everywhere in images/000.png, images/001.png");
    dataset.edit("transforms.json", "\"fl_x\"", "\"applied_scale\": 2.0, \"depth_unit_scale_factor\": 0.01, \"fl_x\"");
    let scene = plain(&dataset);
    let depths: Vec<f32> = scene.frames.iter().map(|f| f.read_depth().unwrap().unwrap().z[0]).collect();
    assert_eq!(depths, [5.0, 50.0, 5.0, 5.0]);

    dataset.write("depth/0.npy", npy(&[8, 6], &[2.5; 48]));
    dataset.write("depth/1.png", "no png");
    dataset.write("depth/3.npy", npy(&[12], &[2.5; 12]));
    dataset.remove("depth/2.exr");
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let errors: Vec<String> =
        report.problems.iter().filter(|p| p.severity == Severity::Error).map(ToString::to_string).collect();
    assert_eq!(errors.len(), 4, "{report}");
    let whats = [
        "the depth map is 6x8 and its photo 8x6",
        "1.png",
        "cannot read the file",
        "`shape` = [12]: is not a depth map",
    ];
    for (i, (error, what)) in errors.iter().zip(whats).enumerate() {
        assert!(error.contains(what) && error.contains(&format!("frame `images/{i:03}.png`")), "{error}");
    }
}

#[test]
fn maps_full_of_holes_are_told() {
    let dataset = Dataset::endonerf(3);
    dataset.grey("depth/frame-000001.depth.png", (16, 12), |_, _| 0);
    warns(&dataset, "no depth is known anywhere in frame-000001.color.png");
    for i in [0, 2] {
        dataset.grey(&format!("depth/frame-{i:06}.depth.png"), (16, 12), |x, _| if x < 8 { 40 } else { 0 });
    }
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let depth = report.depth.unwrap();
    assert_eq!((depth.maps, depth.range), (3, Some([40.0, 40.0])));
    assert!((depth.holes - 2.0 / 3.0).abs() < 1e-12);
    assert!(report.to_string().contains("66.7 % of the pixels not known"), "{report}");
}

#[test]
fn distances_along_rays_become_depths() {
    let dataset = Dataset::nerfies();
    let scene = plain(&dataset);
    let mut frame = scene.frames[0].clone();
    frame.depth = Some(DepthSource {
        meaning: DepthMeaning::Distance,
        ..DepthSource::file(dataset.write("d.npy", npy(&[6, 8], &[2.0; 48])))
    });
    let map = frame.read_depth().unwrap().unwrap();
    for (i, z) in map.z.iter().enumerate() {
        let pixel = glam::DVec2::new((i % 8) as f64 + 0.5, (i / 8) as f64 + 0.5);
        let point = frame.camera.ray(pixel).map(|ray| ray.o + ray.d * 2.0).unwrap();
        assert!((f64::from(*z) - frame.camera.pose.to_camera(point).z).abs() < 1e-6);
    }
}
