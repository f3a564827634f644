//! Cameras 10^6 units from the origin, fields of view to 179 degrees, points at 1e-6, matrices that are not poses.

use glam::{DMat3, DQuat, DVec2, DVec3};
use render_core::camera::{Camera, Lens, Pose, RayTable};
use render_core::error::PoseError;
use render_core::pose::Axes;
use stress::{Tally, close, ensure};

/// A square camera that sees this angle, degrees.
fn camera(view: f64, side: u32, centre: DVec3) -> Camera {
    let half = f64::from(side) / 2.0;
    let f = half / (view.to_radians() / 2.0).tan();
    let r = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0));
    Camera::pinhole(side, side, f, f, half, half, Pose { r, c: centre })
}

pub(crate) fn cases(tally: &mut Tally) {
    let centres = [DVec3::ZERO, DVec3::new(1e6, -1e6, 1e6), DVec3::splat(1e-6), DVec3::new(0.0, 1e9, 0.0)];
    for view in [0.01, 1.0, 60.0, 120.0, 170.0, 179.0] {
        for side in [1, 64, 65_535] {
            for centre in centres {
                for lens in [Lens::PINHOLE, Lens::opencv5([-1e-4, 0.0, 1e-5, -1e-5, 0.0])] {
                    let camera = Camera { lens, ..camera(view, side, centre) };
                    let name = format!("{view} degrees, {side} pixels, centre {centre}, {lens:?}");
                    tally.case(name, "pixel to ray to point to pixel within rounding of the centre", || {
                        let prepared = camera.prepare();
                        for (u, v) in [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (0.123, 0.9)] {
                            let pixel = DVec2::new(u, v) * f64::from(side);
                            let Some(ray) = prepared.ray(pixel) else {
                                return ensure(!lens.is_pinhole(), || format!("a pinhole has no ray for {pixel}"));
                            };
                            ensure((ray.d.length() - 1.0).abs() < 1e-12, || format!("direction {}", ray.d))?;
                            for t in [1e-6, 1.0, 1e6] {
                                let Some(back) = prepared.project(ray.at(t)) else {
                                    return Err(format!("{pixel} at {t:e} is not seen"));
                                };
                                // The point is rounded to ulps of the centre, seen from t at the obliquity of the ray.
                                let z = camera.optical_axis().dot(ray.d);
                                let ulps = 16.0 * f64::EPSILON * (centre.length() + t + 1.0) / t;
                                let bound = camera.fx * (ulps / (z * z) + 1e-9 / z.min(1.0)) + 1e-9 * f64::from(side);
                                close("the distance to the pixel", (back - pixel).length(), 0.0, bound)?;
                            }
                        }
                        Ok(())
                    });
                }
            }
        }
    }
    for view in [60.0, 179.0] {
        let camera = camera(view, 64, DVec3::splat(1e6));
        tally.case(format!("table of directions, {view} degrees"), "f32 directions within 1e-6 of f64", || {
            let table = RayTable::new(&camera);
            for (x, y) in [(0, 0), (31, 7), (63, 63)] {
                let d = table.direction(x, y).ok_or("no direction")?;
                let want = camera.direction_in_camera(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
                let got = DVec3::new(d[0].into(), d[1].into(), d[2].into());
                close("the angle", (got - want).length(), 0.0, 1e-6)?;
            }
            Ok(())
        });
    }
    let rows = |r: [[f64; 3]; 3]| r.map(|r| [r[0], r[1], r[2], 1e6]);
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut bad = Vec::new();
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for (i, j) in [(0, 0), (1, 2), (2, 1)] {
            let mut m = identity;
            m[i][j] = value;
            bad.push((format!("{value} in a rotation"), m));
        }
    }
    for value in [2e-3, 0.1, 1e6, 1e300] {
        let mut m = identity;
        m[0][1] = value;
        bad.push((format!("shear of {value:e}"), m));
    }
    bad.push(("a mirror".into(), [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
    bad.push(("zeros".into(), [[0.0; 3]; 3]));
    bad.push(("equal rows".into(), [[1.0, 0.0, 0.0]; 3]));
    for (name, m) in bad {
        tally.case(name, "refused with one line about the matrix", || match Pose::from_matrix(&rows(m), Axes::Gl) {
            Ok((pose, _)) => Err(format!("taken as {pose:?}")),
            Err(e) => ensure(e.to_string().starts_with("pose matrix"), || format!("said: {e}")),
        });
    }
    for scale in [1e-30, 1e-6, 1.0, 1e6, 1e30] {
        tally.case(format!("a rotation scaled by {scale:e}"), "the rotation itself", || {
            let m = identity.map(|r| r.map(|v| v * scale));
            match Pose::from_matrix(&rows(m), Axes::Cv) {
                Ok((pose, _)) => close("the rotation", (pose.r.x_axis - DVec3::X).length(), 0.0, 1e-12),
                // So small that its determinant has no digits.
                Err(PoseError::Singular { .. }) if scale < 1e-20 => Ok(()),
                Err(e) => Err(format!("refused: {e}")),
            }
        });
    }
}
