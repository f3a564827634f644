//! Poses of files to [`Pose`]: axes turned to CV, rotations checked.

use glam::{DMat3, DVec3};
use render_core::camera::Pose;

/// Camera axes of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axes {
    /// x right, y up, looking along -z: Blender, nerfstudio, instant-ngp.
    Gl,
    /// Columns are (down, right, backwards): `poses_bounds.npy`.
    Llff,
    /// x right, y down, looking along z: Nerfies.
    Cv,
}

/// What was mended in a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Mended {
    /// Nothing.
    Nothing,
    /// A uniform scale was divided out of the rotation.
    Scale(f64),
    /// The rotation was made orthonormal; the deviation was this.
    Orthonormal(f64),
}

/// Why a pose was refused.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BadPose {
    /// Row and column of the offending entry, where there is one.
    pub(crate) entry: Option<(usize, usize)>,
    pub(crate) value: String,
    pub(crate) what: String,
    pub(crate) remedy: &'static str,
}

/// Rotations nearer to orthonormal than this are taken as they are: printing to 7 digits makes such errors.
const EXACT: f64 = 1e-6;
/// Rotations nearer than this are mended, others refused.
const MENDABLE: f64 = 1e-3;

/// The rotation as the file writes it, checked: a rotation, or near one, or one times a scale.
pub(crate) fn checked_rotation(m: DMat3) -> Result<(DMat3, Mended), BadPose> {
    for row in 0..3 {
        for column in 0..3 {
            let v = m.col(column)[row];
            if !v.is_finite() {
                return Err(BadPose {
                    entry: Some((row, column)),
                    value: v.to_string(),
                    what: "is not a finite number".into(),
                    remedy: "remove the frame or estimate its pose again",
                });
            }
        }
    }
    let refuse = |value: String, what: &str, remedy| Err(BadPose { entry: None, value, what: what.into(), remedy });
    let size = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
    // Entries of 1e200 would overflow below; no scaled export comes near.
    if !(1e-30..=1e30).contains(&size) {
        return refuse(
            format!("longest column {size:e}"),
            "the rotation is singular or out of range",
            "remove the frame or estimate its pose again",
        );
    }
    let determinant = m.determinant() / size.powi(3);
    if determinant.abs() < 1e-6 {
        return refuse(
            format!("determinant {:e}", m.determinant()),
            "the rotation is singular",
            "remove the frame or estimate its pose again",
        );
    }
    if determinant < 0.0 {
        return refuse(
            format!("determinant {:.6}", m.determinant()),
            "the pose is left-handed (a mirrored export)",
            "export with right-handed axes; poses are not flipped silently",
        );
    }
    let (r, scale) = if deviation(m) <= MENDABLE {
        (m, 1.0)
    } else {
        let scale = m.determinant().cbrt();
        (m * (1.0 / scale), scale)
    };
    let off = deviation(r);
    if off > MENDABLE {
        return refuse(
            format!("|R^T R - I| = {off:.3e}"),
            "the upper left 3x3 is not a rotation",
            "remove shear and uneven scale from the cameras, or estimate the poses again",
        );
    }
    let mended = match (scale == 1.0, off <= EXACT) {
        (false, _) => Mended::Scale(scale),
        (true, false) => Mended::Orthonormal(off),
        (true, true) => Mended::Nothing,
    };
    Ok((if off <= EXACT { r } else { nearest_rotation(r) }, mended))
}

/// Frobenius norm of `R^T R - I`.
fn deviation(r: DMat3) -> f64 {
    let d = r.transpose() * r - DMat3::IDENTITY;
    d.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The rotation nearest to a matrix that is almost one: Newton's iteration for the polar factor (Higham 1986), which
/// converges quadratically to what an SVD gives.
fn nearest_rotation(mut r: DMat3) -> DMat3 {
    for _ in 0..8 {
        r = (r + r.inverse().transpose()) * 0.5;
    }
    r
}

/// A camera-to-world pose in CV axes from a file's rotation and centre.
pub(crate) fn pose_from(axes: Axes, rotation: DMat3, centre: DVec3) -> Result<(Pose, Mended), BadPose> {
    for (row, v) in centre.to_array().into_iter().enumerate() {
        if !v.is_finite() {
            return Err(BadPose {
                entry: Some((row, 3)),
                value: v.to_string(),
                what: "is not a finite number".into(),
                remedy: "remove the frame or estimate its pose again",
            });
        }
    }
    let (r, mended) = checked_rotation(rotation)?;
    let r = match axes {
        Axes::Gl => DMat3::from_cols(r.x_axis, -r.y_axis, -r.z_axis),
        // (down, right, backwards) to (right, down, forwards).
        Axes::Llff => DMat3::from_cols(r.y_axis, r.x_axis, -r.z_axis),
        Axes::Cv => r,
    };
    Ok((Pose { r, c: centre }, mended))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_rotation() -> impl Strategy<Value = DMat3> {
        prop::array::uniform3(-3.0..3.0_f64).prop_map(|w| {
            let w = DVec3::from(w);
            DMat3::from_axis_angle(w.try_normalize().unwrap_or(DVec3::X), w.length())
        })
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn small_errors_are_mended_to_the_rotation(r in any_rotation(), e in prop::array::uniform9(-1e-4..1e-4_f64)) {
            // A symmetric error on the right has the rotation itself as nearest rotation.
            let e = DMat3::from_cols_array(&e);
            let (got, mended) = checked_rotation(r * (DMat3::IDENTITY + (e + e.transpose()) * 0.5)).unwrap();
            if mended != Mended::Nothing {
                prop_assert!(deviation(got) < 1e-14);
                prop_assert!((got - r).to_cols_array().iter().all(|x| x.abs() < 1e-12));
            }
        }

        #[test]
        fn uniform_scale_is_divided_out(r in any_rotation(), scale in 0.01..100.0_f64) {
            prop_assume!((scale - 1.0).abs() > 0.01);
            let (got, mended) = checked_rotation(r * scale).unwrap();
            prop_assert!(matches!(mended, Mended::Scale(s) if (s - scale).abs() < 1e-9 * scale));
            prop_assert!((got - r).to_cols_array().iter().all(|x| x.abs() < 1e-9));
        }

        #[test]
        fn mirrored_poses_are_refused(r in any_rotation()) {
            let mirrored = DMat3::from_cols(r.x_axis, r.y_axis, -r.z_axis);
            prop_assert!(checked_rotation(mirrored).unwrap_err().what.contains("left-handed"));
        }
    }

    #[test]
    fn bad_matrices_are_refused() {
        let nan = DMat3::from_cols(DVec3::X, DVec3::new(0.0, f64::NAN, 0.0), DVec3::Z);
        assert_eq!(checked_rotation(nan).unwrap_err().entry, Some((1, 1)));
        for m in [DMat3::ZERO, DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z), DMat3::IDENTITY * 1e200] {
            assert!(checked_rotation(m).unwrap_err().what.contains("singular"));
        }
        let sheared = DMat3::from_cols(DVec3::X, DVec3::new(0.2, 1.0, 0.0), DVec3::Z);
        assert!(checked_rotation(sheared).unwrap_err().what.contains("not a rotation"));
    }

    #[test]
    fn axes_are_turned_to_right_down_forward() {
        // Looking along world -z with y up, as an OpenGL camera at rest does.
        let (gl, _) = pose_from(Axes::Gl, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let down_right_back = DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z);
        let (llff, _) = pose_from(Axes::Llff, down_right_back, DVec3::ZERO).unwrap();
        for pose in [gl, llff] {
            assert_eq!(pose.r, DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z));
        }
    }
}
