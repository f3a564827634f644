//! proptest strategies for the things a radiance field is made of, as plain arrays.
//!
//! Each mixes ordinary values with the ones that break code: exact zeros, denormals, equal and nearly equal neighbours,
//! huge numbers, axis-aligned directions, angles next to 0 and pi. Numbers are `f32` where a kernel takes `f32` (they
//! convert to `f64` exactly) and `f64` where cameras and poses live.
//!
//! ```
//! use proptest::prelude::*;
//! use testkit::strategies::{any_densities, any_edges};
//!
//! proptest! {
//!     # /*
//!     #[test]
//!     # */
//!     fn optical_depth_is_never_negative(
//!         (t, sigma) in (0..64_usize).prop_flat_map(|n| (any_edges(n), any_densities(n)))
//!     ) {
//!         let depth: f32 = t.windows(2).zip(&sigma).map(|(t, sigma)| (t[1] - t[0]) * sigma).sum();
//!         prop_assert!(depth >= 0.0);
//!     }
//! }
//! # optical_depth_is_never_negative();
//! ```

mod camera;
mod image;
mod ray;

pub use camera::{CameraData, any_camera, any_pose};
pub use image::{ImageData, any_image};
pub use ray::{any_densities, any_density, any_edges, any_histogram, any_point, any_ray, any_step};

use proptest::prelude::*;

/// A unit vector, exact to `2^-52`: anywhere on the sphere, on an axis, or very near one.
pub fn any_unit_vector() -> impl Strategy<Value = [f64; 3]> {
    let ordinary = [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64];
    let axis = (0..3_usize, any::<bool>()).prop_map(|(axis, up)| {
        let mut d = [0.0; 3];
        d[axis] = if up { 1.0 } else { -1.0 };
        d
    });
    let near_axis =
        (axis.clone(), [small(), small(), small()]).prop_map(|(d, e)| [d[0] + e[0], d[1] + e[1], d[2] + e[2]]);
    prop_oneof![
        6 => ordinary.prop_filter_map("too short to normalise", normalise),
        1 => axis,
        1 => near_axis.prop_filter_map("too short to normalise", normalise),
    ]
}

/// A rotation matrix, row by row, determinant +1, orthonormal to about `1e-15`: any axis; angles anywhere, 0, tiny, and
/// at and next to pi, where logarithms and quaternions break.
pub fn any_rotation() -> impl Strategy<Value = [[f64; 3]; 3]> {
    use std::f64::consts::PI;
    let angle = prop_oneof![
        4 => -PI..PI,
        1 => Just(0.0),
        1 => small(),
        1 => Just(PI),
        1 => small().prop_map(|e| PI - e.abs()),
    ];
    (any_unit_vector(), angle).prop_map(|(axis, angle)| rotation(axis, angle))
}

/// `1e-16 ..= 1e-3`, either sign, every size alike.
fn small() -> impl Strategy<Value = f64> + Clone {
    (-16.0..-3.0_f64, any::<bool>()).prop_map(|(log, up)| if up { 10_f64.powf(log) } else { -(10_f64.powf(log)) })
}

fn normalise(d: [f64; 3]) -> Option<[f64; 3]> {
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length > 1e-3).then(|| d.map(|x| x / length))
}

/// Rodrigues' formula, row by row.
fn rotation([x, y, z]: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let (s, c) = angle.sin_cos();
    let k = 1.0 - c;
    [
        [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
        [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
        [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::strategy::ValueTree;

    /// How often `found` holds in 400 draws.
    pub(super) fn count<S: Strategy>(strategy: S, found: impl Fn(&S::Value) -> bool) -> usize {
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let mut draw = || strategy.new_tree(&mut runner).expect("a value").current();
        (0..400).filter(|_| found(&draw())).count()
    }

    proptest! {
        #![proptest_config(crate::property::cases(128))]

        #[test]
        fn unit_vectors_are_unit(d in any_unit_vector()) {
            prop_assert!((d.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-15);
        }

        #[test]
        fn rotations_are_orthonormal_and_proper(r in any_rotation()) {
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| r[i][k] * r[j][k]).sum();
                    prop_assert!((dot - f64::from(i == j)).abs() < 4e-15);
                }
            }
            let det = r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1])
                - r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0])
                + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
            prop_assert!((det - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn the_special_cases_come_up() {
        assert!(count(any_unit_vector(), |d| d.contains(&1.0)) > 5);
        assert!(count(any_unit_vector(), |d| d.iter().all(|x| x.abs() > 0.1)) > 100);
        let trace = |r: &[[f64; 3]; 3]| r[0][0] + r[1][1] + r[2][2];
        assert!(count(any_rotation(), |r| trace(r) == 3.0) > 10);
        assert!(count(any_rotation(), |r| trace(r) < -0.999) > 30);
    }
}
