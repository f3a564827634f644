//! Poses, their conversions, and what is refused.

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use render_core::error::PoseError;
use render_core::pose::{Axes, Pose, Repair, Similarity};
use testkit::strategies::any_pose;

fn pose((rows, c): ([[f64; 3]; 3], [f64; 3])) -> Pose {
    let rows = rows.map(DVec3::from_array);
    Pose { r: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(), c: DVec3::from_array(c) }
}

fn close(a: &Pose, b: &Pose) -> bool {
    a.r.abs_diff_eq(b.r, 1e-12) && (a.c - b.c).length() <= 1e-12 * (1.0 + b.c.length())
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn every_file_convention_round_trips(p in any_pose()) {
        let p = pose(p);
        for axes in [Axes::Cv, Axes::Gl, Axes::Llff] {
            let (back, repair) = Pose::from_matrix(&p.to_matrix(axes), axes).unwrap();
            prop_assert!(close(&back, &p) && repair == Repair::None, "{axes:?}: {back:?} {p:?}");
        }
        let (r, t) = p.to_w2c();
        prop_assert!(close(&Pose::from_w2c(r, t), &p));
        let (wxyz, t) = p.to_colmap();
        prop_assert!(wxyz[0] >= 0.0);
        let (back, repair) = Pose::from_colmap(wxyz, t).unwrap();
        prop_assert!(close(&back, &p) && repair == Repair::None, "{back:?} {p:?}");
        prop_assert!(close(&p.inverse().compose(&p), &Pose::IDENTITY) || p.c.length() > 1e3);
    }

    #[test]
    fn similarities_invert_and_keep_what_cameras_see(p in any_pose(), s in any_pose(), scale in 1e-3..1e3_f64) {
        let (p, s) = (pose(p), pose(s));
        let similarity = Similarity { scale, r: s.r, t: s.c };
        let x = p.to_world(DVec3::new(0.2, -0.3, 1.0));
        let moved = similarity.pose(&p).to_camera(similarity.point(x)) / scale;
        let size = 1.0 + p.c.length() + s.c.length() / scale;
        prop_assert!((moved - DVec3::new(0.2, -0.3, 1.0)).length() < 1e-12 * size);
        prop_assert!((similarity.inverse().point(similarity.point(x)) - x).length() < 1e-12 * size);
    }
}

#[test]
fn llff_columns_are_down_right_backward() {
    // Looking along +x in a world with z up: right is -y, down is -z.
    let (right, down, forward) = (DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
    let column = [down, right, -forward];
    let rows = core::array::from_fn(|i| [column[0][i], column[1][i], column[2][i], i as f64]);
    let (pose, _) = Pose::from_matrix(&rows, Axes::Llff).unwrap();
    assert_eq!(pose.r, DMat3::from_cols(right, down, forward));
    assert_eq!(pose.c, DVec3::new(0.0, 1.0, 2.0));
}

#[test]
fn bad_matrices_are_refused_in_one_line() {
    let id = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let error = |i: usize, j: usize, value: f64| {
        let mut m = id;
        m[i][j] = value;
        Pose::from_matrix(&m, Axes::Cv).unwrap_err()
    };
    assert_eq!(error(1, 3, f64::NAN), PoseError::NonFinite { row: 1, column: 3 });
    assert_eq!(error(1, 3, f64::NAN).to_string(), "pose matrix: row 1, column 3 is NaN or infinite");
    assert!(matches!(error(2, 2, 0.0), PoseError::Singular { .. }));
    assert!(matches!(error(2, 2, -1.0), PoseError::LeftHanded { .. }));
    assert!(matches!(error(0, 1, 0.1), PoseError::NotRotation { .. }));
    assert!(matches!(Pose::from_colmap([0.0; 4], [0.0; 3]), Err(PoseError::Quaternion { .. })));
    assert!(matches!(Pose::from_colmap([f64::NAN, 0.0, 0.0, 0.0], [0.0; 3]), Err(PoseError::Quaternion { .. })));
    let (_, repair) = Pose::from_colmap([2.0, 0.0, 0.0, 0.0], [0.0; 3]).unwrap();
    assert_eq!(repair, Repair::Scaled { scale: 2.0 });
}

#[test]
fn look_at_is_upright_and_centres_its_target() {
    let pose = Pose::look_at(DVec3::new(3.0, 0.0, 1.0), DVec3::new(0.0, 0.0, 1.0), DVec3::Z).unwrap();
    assert!((pose.r.determinant() - 1.0).abs() < 1e-14);
    assert!((pose.r.z_axis - DVec3::NEG_X).length() < 1e-14);
    assert!((pose.r.y_axis - DVec3::NEG_Z).length() < 1e-14, "down in the picture is down in the world");
    // Seen along -x with z up, +y is to the right.
    assert!((pose.r.x_axis - DVec3::Y).length() < 1e-14);
    // Straight down, with no up to speak of: still a rotation.
    for up in [DVec3::Z, DVec3::ZERO] {
        let pose = Pose::look_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, up).unwrap();
        assert!((pose.r.determinant() - 1.0).abs() < 1e-14 && (pose.r.z_axis - DVec3::NEG_Z).length() < 1e-14);
    }
    assert_eq!(Pose::look_at(DVec3::ONE, DVec3::ONE, DVec3::Z), None);
}
