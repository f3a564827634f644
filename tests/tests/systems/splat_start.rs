//! Clouds of Gaussians begin at the points of real reconstructions, in a frame whose extent is one, and go back to the scene's.

use glam::DVec3;
use scene_io::{LoadOptions, load};
use systems::views::cloud_frame::CloudFrame;
use systems::views::start::{Start, StartOptions};

#[test]
fn clouds_begin_at_the_points_of_real_reconstructions() {
    let options = StartOptions { degree: 3, max: 5000, random: 100, seed: 0 };
    for name in ["nerf_llff_data/fern", "nerd_in_the_wild/statue_of_liberty_40", "phototourism/sacre_coeur_10"] {
        let Some(dir) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), name, "splat_start") else {
            continue;
        };
        let scene = load(&dir, &LoadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        if scene.points.is_empty() {
            testkit::golden::skipped("splat_start", &format!("`{name}` has no points"));
            continue;
        }
        let cameras: Vec<DVec3> = scene.frames.iter().map(|f| f.camera.pose.c).collect();
        let (frame, note) = CloudFrame::around(&cameras, &[]);
        assert_eq!(note, None, "{name}");
        let start = Start::from_points(&scene.points, &frame, &options).unwrap();
        let (mut cloud, n) = (start.cloud, scene.points.len().min(5000));
        assert_eq!(cloud.len(), n, "{name}: {:?}", start.notes);
        let mut sizes: Vec<f32> = cloud.log_scale[..n].iter().map(|s| s.exp()).collect();
        assert!(sizes.iter().all(|s| (3.1e-4..=0.1001).contains(s)), "{name}");
        sizes.sort_unstable_by(f32::total_cmp);
        // Neither floor nor cap: typical sizes come from the neighbours.
        assert!((1e-3..0.0999).contains(&sizes[n / 2]), "{name}: {}", sizes[n / 2]);
        let size = sizes[n / 2];
        println!("{name}: {:?}; median size {size:.4} of the extent {:.3}", start.notes, frame.scale);

        frame.cloud_to_world(&mut cloud);
        let last = &scene.points[(n - 1) * scene.points.len() / n];
        let back = DVec3::new(cloud.mean[n - 1].into(), cloud.mean[2 * n - 1].into(), cloud.mean[3 * n - 1].into());
        let size = last.xyz.length().max(frame.scale);
        assert!(back.distance(last.xyz) < 1e-6 * size, "{name}: {back} {}", last.xyz);
    }
}
