//! Cameras.

use super::{any_point, any_rotation};
use proptest::prelude::*;

/// A camera as plain numbers: axes x right, y down, z forward; the centre of pixel `(i, j)` at `(i + 0.5, j + 0.5)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraData {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal lengths, pixels.
    pub f: [f64; 2],
    /// Principal point, pixels.
    pub c: [f64; 2],
    /// OpenCV distortion `k1 k2 p1 p2 k3`, mild enough that the image of 1.2 times the field of view does not fold.
    pub distortion: [f64; 5],
    /// Camera-to-world rotation, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Camera centre in the world.
    pub centre: [f64; 3],
}

impl CameraData {
    /// The same camera without distortion.
    #[must_use]
    pub fn pinhole(self) -> Self {
        Self { distortion: [0.0; 5], ..self }
    }
}

/// Rotation (camera-to-world, row by row) and centre.
pub fn any_pose() -> impl Strategy<Value = ([[f64; 3]; 3], [f64; 3])> {
    (any_rotation(), any_point())
}

/// A camera: 1 to 64 pixels a side, from tele to wide angle (half diagonal up to about 55 degrees), pixels nearly
/// square, the principal point up to a tenth of the size off the middle; a third without distortion.
pub fn any_camera() -> impl Strategy<Value = CameraData> {
    // Per unit of k, r^2 <= (1.2 * 1.44)^2, so that 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6 stays above 0.2.
    let distortion = prop_oneof![
        1 => Just([0.0; 5]),
        2 => [-0.05..0.05, -0.005..0.01, -0.003..0.003, -0.003..0.003, -0.0002..0.0005_f64],
    ];
    let size = prop_oneof![4 => 8..=64_u32, 1 => 1..8_u32];
    let shape = (size.clone(), size, 0.5..4.0_f64, 0.95..1.05_f64, [-0.1..0.1, -0.1..0.1_f64]);
    (shape, distortion, any_pose()).prop_map(|((width, height, focal, aspect, off), distortion, (rotation, centre))| {
        let (w, h) = (f64::from(width), f64::from(height));
        let fx = focal * w.max(h);
        CameraData {
            width,
            height,
            f: [fx, fx * aspect],
            c: [w * (0.5 + off[0]), h * (0.5 + off[1])],
            distortion,
            rotation,
            centre,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::count;
    use super::*;

    proptest! {
        #![proptest_config(crate::property::cases(256))]

        #[test]
        fn distortion_does_not_fold_inside_the_field_of_view(camera in any_camera()) {
            let [k1, k2, p1, p2, k3] = camera.distortion;
            let (w, h) = (f64::from(camera.width), f64::from(camera.height));
            for step in 0..=8 {
                for (x, y) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
                    // From the axis to 1.2 times the corner, in normalised coordinates.
                    let s = 1.2 * f64::from(step) / 8.0;
                    let [x, y] = [s * (x - camera.c[0]) / camera.f[0], s * (y - camera.c[1]) / camera.f[1]];
                    let r2 = x * x + y * y;
                    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                    let radial_r2 = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
                    let jacobian = [
                        radial + 2.0 * x * x * radial_r2 + 2.0 * p1 * y + 6.0 * p2 * x,
                        2.0 * x * y * radial_r2 + 2.0 * p1 * x + 2.0 * p2 * y,
                        radial + 2.0 * y * y * radial_r2 + 6.0 * p1 * y + 2.0 * p2 * x,
                    ];
                    prop_assert!(jacobian[0] * jacobian[2] - jacobian[1] * jacobian[1] > 0.1);
                }
            }
        }
    }

    #[test]
    fn the_special_cases_come_up() {
        assert!(count(any_camera(), |c| c.distortion == [0.0; 5]) > 60);
        assert!(count(any_camera(), |c| c.width.min(c.height) < 8) > 40);
        assert!(count(any_camera(), |c| c.f[0] < f64::from(c.width)) > 20);
    }
}
