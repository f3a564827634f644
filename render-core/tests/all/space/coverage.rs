//! Which points photos saw.

use glam::DVec3;
use render_core::camera::{Camera, Pose};
use render_core::coverage::{DepthMap, Observer, Target, seen_by};

/// A camera at `eye` that looks along `+x`, 90 degrees wide and high.
fn camera(eye: DVec3) -> Camera {
    let pose = Pose::look_at(eye, eye + DVec3::X, DVec3::Z).unwrap();
    Camera::pinhole(8, 8, 4.0, 4.0, 4.0, 4.0, pose)
}

/// A wall at a distance along every ray.
fn wall(distance: f32) -> DepthMap {
    DepthMap { width: 4, height: 4, distance: vec![distance; 16], disparity_tolerance: 1e-3 }
}

#[test]
fn a_photo_saw_what_lies_before_it_within_its_picture() {
    let photo = Observer::new(&camera(DVec3::ZERO), None);
    for (point, want) in [
        (DVec3::new(5.0, 0.0, 0.0), true),
        (DVec3::new(5.0, 4.9, -4.9), true),
        (DVec3::new(5.0, 5.1, 0.0), false),
        (DVec3::new(-5.0, 0.0, 0.0), false),
        (DVec3::new(0.0, 0.0, 0.0), false),
        (DVec3::NAN, false),
    ] {
        assert_eq!(photo.saw(point), want, "{point}");
    }
    assert!(photo.faced(DVec3::X) && !photo.faced(DVec3::NEG_X) && !photo.faced(DVec3::Y));
}

#[test]
fn what_is_behind_a_surface_was_not_seen() {
    let photo = Observer::new(&camera(DVec3::ZERO), Some(wall(3.0)));
    assert!(photo.saw(DVec3::X * 2.9) && photo.saw(DVec3::X * 3.2) && !photo.saw(DVec3::X * 3.4));
    // Nothing is hit: everything is seen; and what is very far is as far as everything behind it.
    assert!(Observer::new(&camera(DVec3::ZERO), Some(wall(f32::INFINITY))).saw(DVec3::X * 1e9));
    assert!(Observer::new(&camera(DVec3::ZERO), Some(wall(2e3))).saw(DVec3::X * 1e9));
    // An edge lies anywhere within a pixel of the map: its neighbours speak for it.
    let mut edge = wall(3.0);
    edge.distance[0] = f32::INFINITY;
    let photo = Observer::new(&camera(DVec3::ZERO), Some(edge));
    assert!(photo.saw(DVec3::new(9.0, 2.0, 2.0)) && !photo.saw(DVec3::new(9.0, -2.0, -2.0)));
    // A map of the wrong length hides nothing.
    let broken = DepthMap { distance: vec![1.0; 3], ..wall(1.0) };
    assert!(Observer::new(&camera(DVec3::ZERO), Some(broken)).saw(DVec3::X * 5.0));
}

#[test]
fn two_photos_must_have_seen_it() {
    let photos = [DVec3::ZERO, DVec3::Y, DVec3::Y * 50.0].map(|eye| Observer::new(&camera(eye), None));
    let both = Target::Point(DVec3::new(5.0, 0.5, 0.0));
    let one = Target::Point(DVec3::new(5.0, -4.5, 0.0));
    assert!(seen_by(&photos, both, 2) && !seen_by(&photos, both, 3));
    assert!(seen_by(&photos, one, 1) && !seen_by(&photos, one, 2));
    assert!(seen_by(&photos, Target::Sky(DVec3::X), 3) && !seen_by(&photos, Target::Sky(DVec3::NEG_X), 1));
    assert!(seen_by(&[], both, 0) && !seen_by(&[], both, 1));
}
