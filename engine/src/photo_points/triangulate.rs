//! Where rays meet.

use glam::{DMat3, DVec3};

/// How far along the ray `o + t d` (unit `d`) it comes nearest to the ray from `p` along `e` (unit): `None` where they are parallel,
/// or part before they meet (either distance is not positive).
#[must_use]
pub fn along_ray(o: DVec3, d: DVec3, p: DVec3, e: DVec3) -> Option<f64> {
    let n = d.cross(e);
    let square = n.length_squared();
    // sin of the angle below 1e-6: rounding decides.
    if square < 1e-12 {
        return None;
    }
    let b = p - o;
    let (t, s) = (b.cross(e).dot(n) / square, b.cross(d).dot(n) / square);
    (t > 0.0 && s > 0.0 && t.is_finite()).then_some(t)
}

/// The point with the least sum of squared distances to rays (origin, unit direction), each weighed: `None` for fewer than two,
/// or where they are parallel.
#[must_use]
pub fn nearest_to_rays(rays: &[(DVec3, DVec3, f64)]) -> Option<DVec3> {
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    // About the first origin: far from the world's, digits would be lost.
    let about = rays.first()?.0;
    let mut total = 0.0;
    for (o, d, w) in rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
        a += across * *w;
        b += across * (*o - about) * *w;
        total += w;
    }
    let a = a * (1.0 / total);
    // The smallest eigenvalue is the squared sine of the typical angle between the rays.
    let solvable = a.determinant() > 1e-12;
    if !solvable {
        return None;
    }
    let x = about + a.inverse() * (b * (1.0 / total));
    x.is_finite().then_some(x)
}
