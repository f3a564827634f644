//! Solid shapes and where a ray first meets them.

use super::polynomial::roots;
use glam::{DMat3, DVec2, DVec3};
use render_core::ray::Ray;

/// A solid around the origin of its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Block from `-half` to `half`.
    Block {
        /// Half the size along each axis.
        half: DVec3,
    },
    /// Closed cylinder around z, from `-half_height` to `half_height`.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half the height.
        half_height: f64,
    },
    /// Ring around z.
    Torus {
        /// From the middle of the ring to the middle of the tube.
        ring: f64,
        /// Radius of the tube, below `ring`.
        tube: f64,
    },
    /// What a box leaves of an ellipsoid around the origin: a block with round edges, or a piece of one.
    Cut {
        /// Half the axes of the ellipsoid.
        radii: DVec3,
        /// Smallest coordinates of the box.
        low: DVec3,
        /// Largest coordinates of the box.
        high: DVec3,
    },
}

impl Shape {
    /// Distance to the first point of the surface beyond `after`, and the outward normal there, for a ray given in the
    /// shape's own axes. A ray that starts inside meets the surface from within.
    #[must_use]
    pub fn hit(&self, o: DVec3, d: DVec3, after: f64) -> Option<(f64, DVec3)> {
        match *self {
            Self::Sphere { radius } => {
                let (near, far) = quadratic(1.0, o.dot(d), o.length_squared() - radius * radius)?;
                let t = first(near, far, after)?;
                Some((t, ((o + d * t) / radius).normalize()))
            }
            Self::Block { half } => block(o, d, half, after),
            Self::Cylinder { radius, half_height } => cylinder(o, d, radius, half_height, after),
            Self::Torus { ring, tube } => torus(o, d, ring, tube, after),
            Self::Cut { radii, low, high } => cut(o, d, radii, [low, high], after),
        }
    }

    /// Is a point, in the shape's own axes, inside or on the surface?
    #[must_use]
    pub fn contains(&self, p: DVec3) -> bool {
        match *self {
            Self::Sphere { radius } => p.length_squared() <= radius * radius,
            Self::Block { half } => p.abs().cmple(half).all(),
            Self::Cylinder { radius, half_height } => {
                p.truncate().length_squared() <= radius * radius && p.z.abs() <= half_height
            }
            Self::Torus { ring, tube } => DVec2::new(p.truncate().length() - ring, p.z).length_squared() <= tube * tube,
            Self::Cut { radii, low, high } => {
                (p / radii).length_squared() <= 1.0 && p.cmpge(low).all() && p.cmple(high).all()
            }
        }
    }

    /// Radius of a ball around the origin that holds the shape.
    #[must_use]
    pub fn radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => radius,
            Self::Block { half } => half.length(),
            Self::Cylinder { radius, half_height } => radius.hypot(half_height),
            Self::Torus { ring, tube } => ring + tube,
            Self::Cut { radii, low, high } => low.abs().max(high.abs()).min(radii).length().min(radii.max_element()),
        }
    }
}

/// A shape in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// What.
    pub shape: Shape,
    /// Shape-to-world rotation.
    pub r: DMat3,
    /// The shape's origin in the world.
    pub c: DVec3,
}

impl Placed {
    /// First surface point of a world ray beyond `after`: distance, outward normal in the world, point in the shape's
    /// axes.
    #[must_use]
    pub fn hit(&self, ray: &Ray, after: f64) -> Option<(f64, DVec3, DVec3)> {
        let from = ray.o - self.c;
        // Most rays miss most shapes: look at the ball around it first.
        let along = from.dot(ray.d);
        if from.length_squared() - along * along > self.shape.radius().powi(2) * (1.0 + 1e-9) {
            return None;
        }
        let back = self.r.transpose();
        let (o, d) = (back * from, back * ray.d);
        let (t, n) = self.shape.hit(o, d, after)?;
        Some((t, self.r * n, o + d * t))
    }

    /// Is a world point inside?
    #[must_use]
    pub fn contains(&self, x: DVec3) -> bool {
        self.shape.contains(self.r.transpose() * (x - self.c))
    }
}

/// Roots of `a t^2 + 2 b t + c`, ascending.
fn quadratic(a: f64, b: f64, c: f64) -> Option<(f64, f64)> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    // The root without cancellation first, the other one from their product.
    let q = -(b + discriminant.sqrt().copysign(b));
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (q / a, c / q) };
    Some((t0.min(t1), t0.max(t1)))
}

fn first(near: f64, far: f64, after: f64) -> Option<f64> {
    [near, far].into_iter().find(|t| *t > after)
}

fn block(o: DVec3, d: DVec3, half: DVec3, after: f64) -> Option<(f64, DVec3)> {
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if o[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        let towards = d[axis].signum();
        let near = (-towards * half[axis] - o[axis]) / d[axis];
        let far = (towards * half[axis] - o[axis]) / d[axis];
        if near > enter.0 {
            enter = (near, axis);
        }
        if far < leave.0 {
            leave = (far, axis);
        }
    }
    if enter.0 > leave.0 {
        return None;
    }
    let (t, axis, outward) = if enter.0 > after {
        (enter.0, enter.1, -d[enter.1].signum())
    } else if leave.0 > after && leave.0 < f64::INFINITY {
        (leave.0, leave.1, d[leave.1].signum())
    } else {
        return None;
    };
    let mut n = DVec3::ZERO;
    n[axis] = outward;
    Some((t, n))
}

fn cylinder(o: DVec3, d: DVec3, radius: f64, half_height: f64, after: f64) -> Option<(f64, DVec3)> {
    // The solid is where an infinite cylinder and a slab overlap: intervals of t, which are cut with each other.
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, true), (f64::INFINITY, true));
    let a = d.truncate().length_squared();
    let c = o.truncate().length_squared() - radius * radius;
    // Parallel to the axis: below 1e-24 the distance from the axis changes less than rounding over any scene.
    if a > 1e-24 {
        let (near, far) = quadratic(a, o.truncate().dot(d.truncate()), c)?;
        (enter.0, leave.0) = (near, far);
    } else if c > 0.0 {
        return None;
    }
    if d.z != 0.0 {
        let near = (-d.z.signum() * half_height - o.z) / d.z;
        let far = (d.z.signum() * half_height - o.z) / d.z;
        if near > enter.0 {
            enter = (near, false);
        }
        if far < leave.0 {
            leave = (far, false);
        }
    } else if o.z.abs() > half_height {
        return None;
    }
    if enter.0 > leave.0 {
        return None;
    }
    let (t, round, sign) = if enter.0 > after {
        (enter.0, enter.1, -1.0)
    } else if leave.0 > after && leave.0 < f64::INFINITY {
        (leave.0, leave.1, 1.0)
    } else {
        return None;
    };
    let p = o + d * t;
    let n = if round { p.truncate().extend(0.0).normalize() } else { DVec3::Z * (sign * d.z.signum()) };
    Some((t, n))
}

fn torus(o: DVec3, d: DVec3, ring: f64, tube: f64, after: f64) -> Option<(f64, DVec3)> {
    // Measured from the point of the ray nearest to the middle: small numbers, few digits lost.
    let shift = -o.dot(d);
    let o = o + d * shift;
    let reach = ((ring + tube).powi(2) - o.length_squared()).max(0.0).sqrt();
    // (|p|^2 + ring^2 - tube^2)^2 = 4 ring^2 (px^2 + py^2), with |p|^2 = t^2 + |o|^2 because o is perpendicular to d.
    let k = o.length_squared() + ring * ring - tube * tube;
    let (oxy, dxy, four) = (o.truncate(), d.truncate(), 4.0 * ring * ring);
    let quartic = [
        k * k - four * oxy.length_squared(),
        -2.0 * four * oxy.dot(dxy),
        2.0 * k - four * dxy.length_squared(),
        0.0,
        1.0,
    ];
    let (found, n) = roots(&quartic, (after - shift).max(-reach), reach);
    let t = *found[..n].iter().find(|t| **t + shift > after)?;
    let p = o + d * t;
    let middle = p.truncate().normalize_or_zero().extend(0.0) * ring;
    Some((t + shift, (p - middle).normalize()))
}

fn cut(o: DVec3, d: DVec3, radii: DVec3, [low, high]: [DVec3; 2], after: f64) -> Option<(f64, DVec3)> {
    // In the axes of the unit ball, from the point of the ray nearest to its middle: small numbers, few digits lost.
    let (from, along) = (o / radii, d / radii);
    let speed = along.length_squared();
    let nearest = -from.dot(along) / speed;
    let inside = (1.0 - (from + along * nearest).length_squared()) / speed;
    if inside < 0.0 {
        return None;
    }
    // The solid is where the ball and three slabs overlap: intervals of t, which are cut with each other.
    let (mut enter, mut leave) = ((nearest - inside.sqrt(), None), (nearest + inside.sqrt(), None));
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if o[axis] < low[axis] || o[axis] > high[axis] {
                return None;
            }
            continue;
        }
        let [a, b] = [low, high].map(|side| (side[axis] - o[axis]) / d[axis]);
        let (near, far) = (a.min(b), a.max(b));
        if near > enter.0 {
            enter = (near, Some(axis));
        }
        if far < leave.0 {
            leave = (far, Some(axis));
        }
    }
    if enter.0 > leave.0 {
        return None;
    }
    let (t, face, sign) = if enter.0 > after {
        (enter.0, enter.1, -1.0)
    } else if leave.0 > after {
        (leave.0, leave.1, 1.0)
    } else {
        return None;
    };
    let n = match face {
        Some(axis) => DVec3::AXES[axis] * (sign * d[axis].signum()),
        None => ((from + along * t) / radii).normalize(),
    };
    Some((t, n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use testkit::strategies::{any_rotation, any_unit_vector};

    const SHAPES: [Shape; 5] = [
        Shape::Sphere { radius: 0.7 },
        Shape::Block { half: DVec3::new(0.3, 0.5, 0.4) },
        Shape::Cylinder { radius: 0.4, half_height: 0.6 },
        Shape::Torus { ring: 0.6, tube: 0.2 },
        Shape::Cut {
            radii: DVec3::new(0.6, 0.5, 0.7),
            low: DVec3::new(-0.5, -0.4, 0.0),
            high: DVec3::new(0.1, 0.6, 0.55),
        },
    ];

    #[test]
    fn known_hits() {
        let down = |shape: Shape, x: f64| shape.hit(DVec3::new(x, 0.0, 5.0), -DVec3::Z, 0.0);
        for (shape, x, want) in
            [(SHAPES[0], 0.0, 4.3), (SHAPES[1], 0.2, 4.6), (SHAPES[2], 0.3, 4.4), (SHAPES[3], 0.6, 4.8)]
        {
            let (t, n) = down(shape, x).unwrap();
            assert!((t - want).abs() < 1e-14 && (n - DVec3::Z).length() < 1e-7, "{shape:?}: {t} {n}");
        }
        assert_eq!(down(SHAPES[0], 0.71), None);
        // Through the hole.
        assert_eq!(down(SHAPES[3], 0.0), None);
        // From within, and beyond the first surface.
        assert_eq!(SHAPES[1].hit(DVec3::ZERO, DVec3::X, 0.0), Some((0.3, DVec3::X)));
        assert_eq!(SHAPES[0].hit(DVec3::new(0.0, 0.0, 5.0), -DVec3::Z, 4.5).unwrap().1, -DVec3::Z);
        // A line through the tube: four surfaces, one after the other.
        let mut t = 0.0;
        let mut crossings = Vec::new();
        while let Some((next, _)) = SHAPES[3].hit(DVec3::new(-5.0, 0.0, 0.0), DVec3::X, t) {
            crossings.push(next);
            t = next + 1e-9;
        }
        for (got, want) in crossings.iter().zip([4.2, 4.6, 5.4, 5.8]) {
            assert!((got - want).abs() < 1e-13, "{crossings:?}");
        }
        assert_eq!(crossings.len(), 4);
    }

    #[test]
    fn a_cut_ellipsoid_is_met_on_its_planes_and_where_it_is_round() {
        let hit = |o: [f64; 3], d: DVec3| SHAPES[4].hit(o.into(), d, 0.0);
        // Onto the upper plane, the cut below, and one side.
        let (t, n) = hit([0.0, 0.0, 3.0], -DVec3::Z).unwrap();
        assert!((t - 2.45).abs() < 1e-14 && n == DVec3::Z, "{t} {n}");
        let (t, n) = hit([0.0, 0.0, -3.0], DVec3::Z).unwrap();
        assert!((t - 3.0).abs() < 1e-14 && n == -DVec3::Z, "{t} {n}");
        let (t, n) = hit([4.0, 0.0, 0.3], -DVec3::X).unwrap();
        assert!((t - 3.9).abs() < 1e-14 && n == DVec3::X, "{t} {n}");
        // The ellipsoid ends before the box does.
        let (t, n) = hit([0.0, 3.0, 0.0], -DVec3::Y).unwrap();
        assert!((t - 2.5).abs() < 1e-14 && (n - DVec3::Y).length() < 1e-14, "{t} {n}");
        // Level with a plane, beside it, and from within.
        assert_eq!(hit([-3.0, 0.0, -0.1], DVec3::X), None);
        assert_eq!(hit([-3.0, 0.0, 0.56], DVec3::X), None);
        let (t, n) = hit([0.0, 0.0, 0.2], -DVec3::Z).unwrap();
        assert!((t - 0.2).abs() < 1e-14 && n == -DVec3::Z, "{t} {n}");
        // Past a corner that the ellipsoid has rounded off.
        assert_eq!(hit([-0.45, -0.38, 3.0], -DVec3::Z), None);
        assert_eq!(SHAPES[4].radius(), 0.7, "the ellipsoid's: the corners of the box lie outside of it");
    }

    /// Distance to the first change between outside and inside, by small steps.
    fn march(placed: &Placed, ray: &Ray) -> Option<f64> {
        let start = placed.contains(ray.o);
        (1..=6000).map(|i| f64::from(i) * 1e-3).find(|t| placed.contains(ray.at(*t)) != start)
    }

    proptest! {
        #![proptest_config(testkit::property::cases(128))]

        #[test]
        fn hits_lie_where_marching_finds_them(
            which in 0..5_usize, r in any_rotation(), o in [-1.5..1.5, -1.5..1.5, -1.5..1.5_f64], d in any_unit_vector(),
        ) {
            let columns = r.map(DVec3::from);
            let placed = Placed {
                shape: SHAPES[which],
                r: DMat3::from_cols(columns[0], columns[1], columns[2]),
                c: DVec3::new(0.1, -0.2, 0.3),
            };
            let ray = Ray { o: DVec3::from(o), d: DVec3::from(d) };
            let hit = placed.hit(&ray, 0.0);
            if let Some((t, n, local)) = hit {
                prop_assert!((n.length() - 1.0).abs() < 1e-12);
                let x = ray.at(t);
                prop_assert!(!placed.contains(x + n * 1e-6) && placed.contains(x - n * 1e-6), "normal {} at {}", n, x);
                prop_assert!((placed.r * local + placed.c - x).length() < 1e-12);
                prop_assert!((n.dot(ray.d) < 0.0) != placed.contains(ray.o) || n.dot(ray.d).abs() < 1e-6);
            }
            // The march can miss slivers but not invent surfaces.
            if let Some(marched) = march(&placed, &ray) {
                let (t, ..) = hit.expect("the march found a surface");
                prop_assert!(t <= marched + 1e-9 && (marched - t < 1.1e-3 || t < marched), "{} against {}", t, marched);
            }
        }
    }
}
