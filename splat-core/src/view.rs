//! The camera of a picture.

use crate::SplatError;

/// A pinhole camera: world-to-camera pose, intrinsics in pixels, size of the picture.
///
/// Camera axes are CV: x right, y down, z forward. Pixel `(i, j)` (column, row) has its centre at `(i + 0.5, j + 0.5)`. All fields of a
/// pinhole camera are here, so the struct is exhaustive: build it field by field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// World-to-camera rotation, row by row.
    pub r: [[f32; 3]; 3],
    /// World-to-camera translation: `x_camera = r x + t`.
    pub t: [f32; 3],
    /// Focal lengths `fx, fy`, pixels.
    pub f: [f32; 2],
    /// Principal point `cx, cy`, pixels.
    pub c: [f32; 2],
    /// Number of columns and rows.
    pub size: [usize; 2],
}

/// Longest side of a picture, pixels: positions on it are exact to 1/256 pixel as `f32`.
pub const MAX_SIDE: usize = 1 << 15;

impl View {
    /// A camera at the world's origin that looks along z (x right, y down), of a picture of `size` (columns, rows). The focal length is
    /// the longer side, the principal point the middle of the picture.
    #[must_use]
    pub fn at_origin(size: [usize; 2]) -> Self {
        let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let f = size[0].max(size[1]) as f32;
        Self { r, t: [0.0; 3], f: [f; 2], c: size.map(|n| 0.5 * n as f32), size }
    }

    /// View of a camera-to-world pose with rotation `r` and centre `o`, focal lengths `f` and principal point `c`. The pose is
    /// inverted in `f64`, then rounded.
    #[must_use]
    pub fn from_c2w(r: [[f64; 3]; 3], o: [f64; 3], f: [f64; 2], c: [f64; 2], size: [usize; 2]) -> Self {
        let w2c: [[f64; 3]; 3] = core::array::from_fn(|i| core::array::from_fn(|k| r[k][i]));
        let t = w2c.map(|row| -(row[0] * o[0] + row[1] * o[1] + row[2] * o[2]));
        Self {
            r: w2c.map(|row| row.map(|x| x as f32)),
            t: t.map(|x| x as f32),
            f: f.map(|x| x as f32),
            c: c.map(|x| x as f32),
            size,
        }
    }

    /// Whether size and focal lengths are in range and all numbers finite.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first number out of range.
    pub fn check(&self) -> Result<(), SplatError> {
        let value = |what, got: f32, accepts| Err(SplatError::Value { what, got: f64::from(got), accepts });
        for &side in &self.size {
            if !(1..=MAX_SIDE).contains(&side) {
                return value("view.size", side as f32, "1 to 32768 pixels");
            }
        }
        for &f in &self.f {
            if !(f.is_finite() && f > 0.0) {
                return value("view.f", f, "a positive number of pixels");
            }
        }
        let pose = self.r.iter().flatten().chain(&self.t);
        match pose.chain(&self.c).find(|x| !x.is_finite()) {
            Some(&x) => value("view", x, "finite numbers"),
            None => Ok(()),
        }
    }

    /// Centre of the camera, world units: `-r^T t`.
    #[must_use]
    pub fn centre(&self) -> [f32; 3] {
        core::array::from_fn(|k| -(0..3).map(|i| self.r[i][k] * self.t[i]).sum::<f32>())
    }

    /// Limits of `x / z` (axis 0) or `y / z` (axis 1) at which the Jacobian of a projection is taken: the picture and 15 % of its size
    /// on each side.
    #[must_use]
    pub(crate) fn tan_limits(&self, axis: usize) -> [f32; 2] {
        let (size, f, c) = (self.size[axis] as f32, self.f[axis], self.c[axis]);
        let margin = 0.15 * size / f;
        [-c / f - margin, (size - c) / f + margin]
    }
}
