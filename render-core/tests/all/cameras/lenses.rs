//! Lenses to test with, and each model written down again from its definition.

use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;
use render_core::camera::{Camera, Lens, Pose};

/// One of every kind, as strong as real ones get.
pub(crate) const SAMPLES: [(&str, Lens); 9] = [
    ("pinhole", Lens::PINHOLE),
    ("barrel", Lens::Perspective { k: [-0.28, 0.07, -0.005, 0.0, 0.0, 0.0], p: [0.0; 2] }),
    ("pincushion", Lens::Perspective { k: [0.15, 0.03, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] }),
    ("tangential", Lens::Perspective { k: [-0.1, 0.02, 0.0, 0.0, 0.0, 0.0], p: [0.004, -0.006] }),
    ("rational", Lens::Perspective { k: [0.9, 0.3, 0.01, 1.2, 0.5, 0.03], p: [1e-3, 5e-4] }),
    ("fisheye", Lens::Fisheye { k: [0.02, -0.006, 0.002, -3e-4] }),
    ("equidistant", Lens::Fisheye { k: [0.0; 4] }),
    ("fov", Lens::Fov { omega: 0.95 }),
    ("thin prism", Lens::ThinPrismFisheye { k: [-0.03, 0.004, 1e-3, -2e-4], p: [1e-3, -2e-3], s: [3e-3, -1e-3] }),
];

/// A camera of 96 x 72 pixels, off-centre, `fx != fy`, half diagonal about 45 degrees.
pub(crate) fn sample_camera(lens: Lens) -> Camera {
    let pose =
        Pose { r: DMat3::from_quat(DQuat::from_xyzw(0.2, -0.4, 0.1, 0.9).normalize()), c: DVec3::new(1.5, -0.5, 2.0) };
    Camera { lens, ..Camera::pinhole(96, 72, 61.0, 58.5, 49.25, 34.5, pose) }
}

/// Any lens, from none to strong; some fold inside the picture.
pub(crate) fn any_lens() -> impl Strategy<Value = Lens> {
    let p = || [-0.003..0.003_f64, -0.003..0.003_f64];
    prop_oneof![
        1 => Just(Lens::PINHOLE),
        3 => ([-0.4..0.3_f64, -0.1..0.1, -0.02..0.02], p())
            .prop_map(|([k1, k2, k3], p)| Lens::Perspective { k: [k1, k2, k3, 0.0, 0.0, 0.0], p }),
        2 => ([-0.3..0.9_f64, -0.1..0.3, -0.02..0.02, -0.3..0.9, -0.1..0.3, -0.02..0.02], p())
            .prop_map(|(k, p)| Lens::Perspective { k, p }),
        3 => [-0.1..0.1_f64, -0.02..0.02, -0.005..0.005, -0.001..0.001].prop_map(|k| Lens::Fisheye { k }),
        1 => prop_oneof![Just(0.0), 1e-9..1e-3_f64, 0.1..1.5_f64].prop_map(|omega| Lens::Fov { omega }),
        2 => ([-0.1..0.1_f64, -0.02..0.02, -0.005..0.005, -0.001..0.001], p(), p())
            .prop_map(|(k, p, s)| Lens::ThinPrismFisheye { k, p, s }),
    ]
}

/// A camera with any lens and pose, from tele to wide angle.
pub(crate) fn any_camera() -> impl Strategy<Value = Camera> {
    (testkit::strategies::any_camera(), any_lens()).prop_map(|(data, lens)| {
        let rows = data.rotation.map(DVec3::from_array);
        let pose =
            Pose { r: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(), c: DVec3::from_array(data.centre) };
        Camera { lens, ..Camera::pinhole(data.width, data.height, data.f[0], data.f[1], data.c[0], data.c[1], pose) }
    })
}

/// Pixel of a point in camera axes, `Z > 0`, from the definitions of the models; no limits, nothing clever.
pub(crate) fn naive_project(camera: &Camera, x: DVec3) -> DVec2 {
    let (a, b) = (x.x / x.z, x.y / x.z);
    let r = (a * a + b * b).sqrt();
    let theta = r.atan();
    if r == 0.0 || camera.lens == (Lens::Fov { omega: 0.0 }) {
        return DVec2::new(camera.fx * a + camera.cx, camera.fy * b + camera.cy);
    }
    let tangential = |a: f64, b: f64, [p1, p2]: [f64; 2]| {
        let r2 = a * a + b * b;
        (2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a), 2.0 * p2 * a * b + p1 * (r2 + 2.0 * b * b))
    };
    let (xd, yd) = match camera.lens {
        Lens::Perspective { k, p } => {
            let (r2, r4, r6) = (r.powi(2), r.powi(4), r.powi(6));
            let g = (1.0 + k[0] * r2 + k[1] * r4 + k[2] * r6) / (1.0 + k[3] * r2 + k[4] * r4 + k[5] * r6);
            let (tx, ty) = tangential(a, b, p);
            (g * a + tx, g * b + ty)
        }
        Lens::Fisheye { k } => {
            let [t2, t4, t6, t8] = [2, 4, 6, 8].map(|n| theta.powi(n));
            let theta_d = theta * (1.0 + k[0] * t2 + k[1] * t4 + k[2] * t6 + k[3] * t8);
            (theta_d / r * a, theta_d / r * b)
        }
        Lens::Fov { omega } => {
            let r_d = (2.0 * r * (omega / 2.0).tan()).atan() / omega;
            (r_d / r * a, r_d / r * b)
        }
        Lens::ThinPrismFisheye { k, p, s } => {
            let (u, v) = (theta / r * a, theta / r * b);
            let [t2, t4, t6, t8] = [2, 4, 6, 8].map(|n| theta.powi(n));
            let g = 1.0 + k[0] * t2 + k[1] * t4 + k[2] * t6 + k[3] * t8;
            let (tx, ty) = tangential(u, v, p);
            (g * u + tx + s[0] * t2, g * v + ty + s[1] * t2)
        }
    };
    DVec2::new(camera.fx * xd + camera.cx, camera.fy * yd + camera.cy)
}
