//! Camera poses: where a camera stands and how it is turned, and how files write that down.

use float_core::m64;
use glam::{DMat3, DQuat, DVec3};

use crate::error::PoseError;

/// Deviation from a rotation that is left unmentioned, and that which is still repaired.
const SILENT: f64 = 1e-6;
const REPAIRABLE: f64 = 1e-3;

/// Camera-to-world pose with CV camera axes (x right, y down, z forward): `x_world = r x_camera + c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation, camera to world: the columns are right, down and forward in the world.
    pub r: DMat3,
    /// Camera centre in the world.
    pub c: DVec3,
}

/// What the columns of a camera-to-world matrix in a file mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Right, down, forward: OpenCV, COLMAP, Nerfies. The axes of [`Pose`].
    Cv,
    /// Right, up, backward: OpenGL, Blender, NeRF, nerfstudio, instant-ngp.
    Gl,
    /// Down, right, backward: `poses_bounds.npy` of LLFF.
    Llff,
}

/// What had to be done to a matrix before it was a pose; worth a warning unless [`Repair::None`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Repair {
    /// Nothing beyond rounding.
    None,
    /// The nearest rotation was taken.
    Orthonormalised {
        /// `|R^T R - I|` (Frobenius) of what was given.
        error: f64,
    },
    /// A uniform scale was divided out.
    Scaled {
        /// That scale.
        scale: f64,
    },
}

impl Axes {
    /// Columns written in these axes as CV columns, and back: each change of axes is its own inverse.
    fn swap_cv(self, m: DMat3) -> DMat3 {
        let DMat3 { x_axis: a, y_axis: b, z_axis: c } = m;
        match self {
            Self::Cv => m,
            Self::Gl => DMat3::from_cols(a, -b, -c),
            Self::Llff => DMat3::from_cols(b, a, -c),
        }
    }
}

impl Pose {
    /// At the origin, looking along world `+z` with `+y` down.
    pub const IDENTITY: Self = Self { r: DMat3::IDENTITY, c: DVec3::ZERO };

    /// From the rows of a camera-to-world matrix `[R | c]`, checked and repaired.
    ///
    /// A uniform scale is divided out and a deviation from a rotation of up to 1e-3 is removed by taking the nearest
    /// rotation; [`Repair`] tells about either.
    ///
    /// # Errors
    /// [`PoseError`] when an entry is not finite, or the 3x3 part is singular, mirrors, or is too far from a rotation.
    pub fn from_matrix(rows: &[[f64; 4]; 3], axes: Axes) -> Result<(Self, Repair), PoseError> {
        for (row, values) in rows.iter().enumerate() {
            if let Some(column) = values.iter().position(|v| !v.is_finite()) {
                return Err(PoseError::NonFinite { row, column });
            }
        }
        let column = |j: usize| DVec3::new(rows[0][j], rows[1][j], rows[2][j]);
        let (r, repair) = nearest_rotation(DMat3::from_cols(column(0), column(1), column(2)))?;
        Ok((Self { r: axes.swap_cv(r), c: column(3) }, repair))
    }

    /// Rows of the camera-to-world matrix `[R | c]` in the axes of a file.
    #[must_use]
    pub fn to_matrix(&self, axes: Axes) -> [[f64; 4]; 3] {
        let m = axes.swap_cv(self.r);
        let row = |i: usize| [m.x_axis[i], m.y_axis[i], m.z_axis[i], self.c[i]];
        [row(0), row(1), row(2)]
    }

    /// From world-to-camera `x_camera = R x_world + t` with CV axes.
    #[must_use]
    pub fn from_w2c(r: DMat3, t: DVec3) -> Self {
        Self { r: r.transpose(), c: -(r.transpose() * t) }
    }

    /// `(R, t)` of world-to-camera `x_camera = R x_world + t`, CV axes.
    #[must_use]
    pub fn to_w2c(&self) -> (DMat3, DVec3) {
        let r = self.r.transpose();
        (r, -(r * self.c))
    }

    /// From COLMAP's world-to-camera quaternion (w first) and translation.
    ///
    /// The quaternion is normalised; [`Repair::Scaled`] tells its length when that is off by more than 1e-3.
    ///
    /// # Errors
    /// [`PoseError::Quaternion`] when it is zero or not finite, [`PoseError::NonFinite`] when `t` is not finite (the
    /// translation counts as column 3).
    pub fn from_colmap(wxyz: [f64; 4], t: [f64; 3]) -> Result<(Self, Repair), PoseError> {
        let [w, x, y, z] = wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let norm = q.length();
        if !(norm > 1e-12 && norm.is_finite()) {
            return Err(PoseError::Quaternion { norm });
        }
        if let Some(row) = t.iter().position(|v| !v.is_finite()) {
            return Err(PoseError::NonFinite { row, column: 3 });
        }
        let repair = if (norm - 1.0).abs() > REPAIRABLE { Repair::Scaled { scale: norm } } else { Repair::None };
        Ok((Self::from_w2c(DMat3::from_quat(q.normalize()), DVec3::from_array(t)), repair))
    }

    /// COLMAP's world-to-camera quaternion (w first, `w >= 0`) and translation.
    #[must_use]
    pub fn to_colmap(&self) -> ([f64; 4], [f64; 3]) {
        let (r, t) = self.to_w2c();
        let q = DQuat::from_mat3(&r).normalize();
        let s = if q.w < 0.0 { -1.0 } else { 1.0 };
        ([s * q.w, s * q.x, s * q.y, s * q.z], t.to_array())
    }

    /// A camera at `eye` that sees `target` in its centre, its image upright with respect to `up`.
    ///
    /// Where `up` is parallel to the view, or zero, some other upright direction is taken. `None` when `eye` and
    /// `target` coincide or a coordinate is not finite.
    #[must_use]
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        let right = forward.cross(up.normalize_or_zero());
        // Below 1e-6 rad between view and `up` the right axis is rounding noise.
        let right = if right.length() > 1e-6 { right.normalize() } else { forward.any_orthonormal_vector() };
        let down = forward.cross(right);
        Some(Self { r: DMat3::from_cols(right, down, forward), c: eye })
    }

    /// A point from camera to world coordinates.
    #[must_use]
    pub fn to_world(&self, x_camera: DVec3) -> DVec3 {
        self.r * x_camera + self.c
    }

    /// A point from world to camera coordinates.
    #[must_use]
    pub fn to_camera(&self, x_world: DVec3) -> DVec3 {
        self.r.transpose() * (x_world - self.c)
    }

    /// `self` after `inner`: `x -> self(inner(x))`.
    #[must_use]
    pub fn compose(&self, inner: &Self) -> Self {
        Self { r: self.r * inner.r, c: self.to_world(inner.c) }
    }

    /// The inverse motion.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (r, c) = self.to_w2c();
        Self { r, c }
    }
}

/// A rotation, a uniform scale and a shift: `x -> scale r x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Scale, `> 0`.
    pub scale: f64,
    /// Rotation.
    pub r: DMat3,
    /// Shift, in the units after scaling.
    pub t: DVec3,
}

impl Similarity {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, r: DMat3::IDENTITY, t: DVec3::ZERO };

    /// A point.
    #[must_use]
    pub fn point(&self, x: DVec3) -> DVec3 {
        self.r * x * self.scale + self.t
    }

    /// A direction: turned, not scaled.
    #[must_use]
    pub fn direction(&self, d: DVec3) -> DVec3 {
        self.r * d
    }

    /// A camera that sees the transformed scene as `pose` sees the original one.
    #[must_use]
    pub fn pose(&self, pose: &Pose) -> Pose {
        Pose { r: self.r * pose.r, c: self.point(pose.c) }
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (scale, r) = (1.0 / self.scale, self.r.transpose());
        Self { scale, r, t: -(r * self.t) * scale }
    }
}

/// `|M^T M - I|`, Frobenius.
fn deviation(m: DMat3) -> f64 {
    let e = m.transpose() * m - DMat3::IDENTITY;
    m64::sqrt(e.x_axis.length_squared() + e.y_axis.length_squared() + e.z_axis.length_squared())
}

/// The rotation nearest to a (uniformly scaled) matrix.
///
/// # Errors
/// [`PoseError`] as for [`Pose::from_matrix`].
pub fn nearest_rotation(m: DMat3) -> Result<(DMat3, Repair), PoseError> {
    let size = m.x_axis.abs().max(m.y_axis.abs()).max(m.z_axis.abs()).max_element();
    // Scaled to entries of at most 1 first: determinants of tiny and huge matrices stay in range.
    let unit = m * (1.0 / size);
    let unit_det = unit.determinant();
    let det = unit_det * size * size * size;
    let invertible = size > 0.0 && unit_det.abs() > 1e-9;
    if !invertible {
        return Err(PoseError::Singular { det: if size > 0.0 { det } else { 0.0 } });
    }
    let scale = size * m64::cbrt(unit_det.abs());
    let mut r = m * (1.0 / scale);
    let error = deviation(r);
    if error > REPAIRABLE || error.is_nan() {
        return Err(PoseError::NotRotation { error });
    }
    if det < 0.0 {
        return Err(PoseError::LeftHanded { det });
    }
    // Newton's iteration for the polar factor (Higham 1986): the deviation squares with each step.
    for _ in 0..4 {
        r = (r + r.inverse().transpose()) * 0.5;
    }
    let repair = match () {
        () if (scale - 1.0).abs() > REPAIRABLE => Repair::Scaled { scale },
        () if deviation(m) > SILENT => Repair::Orthonormalised { error: deviation(m) },
        () => Repair::None,
    };
    Ok((r, repair))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_rotation() -> DMat3 {
        DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize())
    }

    #[test]
    fn nearest_rotation_of_a_rotation_is_itself() {
        let r = some_rotation();
        let (got, repair) = nearest_rotation(r).unwrap();
        assert!(got.abs_diff_eq(r, 1e-15));
        assert_eq!(repair, Repair::None);
    }

    #[test]
    fn nearest_rotation_repairs_small_errors_and_scales() {
        let r = some_rotation();
        let mut bent = r;
        bent.x_axis.y += 1e-4;
        let (got, repair) = nearest_rotation(bent).unwrap();
        assert!(deviation(got) < 1e-14 && got.abs_diff_eq(r, 2e-4));
        assert!(matches!(repair, Repair::Orthonormalised { error } if (1e-5..1e-3).contains(&error)));
        for scale in [1e-100, 0.01, 3.0, 1e90] {
            let (got, repair) = nearest_rotation(r * scale).unwrap();
            assert!(got.abs_diff_eq(r, 1e-14));
            assert!(matches!(repair, Repair::Scaled { scale: s } if (s / scale - 1.0).abs() < 1e-12));
        }
    }

    #[test]
    fn nearest_rotation_refuses_what_is_none() {
        let r = some_rotation();
        let mirrored = DMat3::from_cols(r.x_axis, r.y_axis, -r.z_axis);
        assert!(matches!(nearest_rotation(mirrored), Err(PoseError::LeftHanded { det }) if (det + 1.0).abs() < 1e-12));
        assert!(matches!(nearest_rotation(DMat3::ZERO), Err(PoseError::Singular { .. })));
        let flat = DMat3::from_cols(r.x_axis, r.y_axis, r.y_axis);
        assert!(matches!(nearest_rotation(flat), Err(PoseError::Singular { .. })));
        let stretched = DMat3::from_cols(r.x_axis, r.y_axis, r.z_axis * 1.1);
        assert!(matches!(nearest_rotation(stretched), Err(PoseError::NotRotation { .. })));
    }
}
