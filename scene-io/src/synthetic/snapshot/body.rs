//! Solids that move and change shape, and where a ray first meets them.

use crate::synthetic::polynomial::roots;
use crate::synthetic::shape::Shape;
use glam::{DMat3, DVec2, DVec3};
use render_core::ray::Ray;

/// A solid at rest, in its own axes: the coordinates of its material points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// One of the shapes.
    Solid(Shape),
    /// A round bar around z that stands on `z = 0`.
    Bar {
        /// Radius.
        radius: f64,
        /// Length.
        height: f64,
    },
}

/// How a form differs from its rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warp {
    /// Not at all.
    Rigid,
    /// `v = scale * q`, component by component.
    Stretch(DVec3),
    /// Twist about z, then lean that grows with the square of the height:
    /// `v = (R(twist * z) (x, y) + lean * z^2, z)`. The foot stays where it is, and so does the volume.
    Bend {
        /// Sideways way of the axis at `z = 1`.
        lean: DVec2,
        /// Radians per unit of height.
        twist: f64,
    },
}

/// Where and in which shape a form is at some time: `x = r warp(q) + c` takes material points to the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rotation.
    pub r: DMat3,
    /// The form's origin in the world.
    pub c: DVec3,
    /// Change of shape.
    pub warp: Warp,
}

impl Placement {
    /// A form at rest, turned and moved.
    pub(in crate::synthetic) fn rigid(r: DMat3, c: DVec3) -> Self {
        Self { r, c, warp: Warp::Rigid }
    }

    /// A material point in the world.
    #[must_use]
    pub fn place(&self, q: DVec3) -> DVec3 {
        let v = match self.warp {
            Warp::Rigid => q,
            Warp::Stretch(scale) => q * scale,
            Warp::Bend { lean, twist } => {
                (DVec2::from_angle(twist * q.z).rotate(q.truncate()) + lean * (q.z * q.z)).extend(q.z)
            }
        };
        self.r * v + self.c
    }

    /// The material point at a place of the world: the inverse of [`Placement::place`].
    #[must_use]
    pub fn material(&self, x: DVec3) -> DVec3 {
        let v = self.r.transpose() * (x - self.c);
        match self.warp {
            Warp::Rigid => v,
            Warp::Stretch(scale) => v / scale,
            Warp::Bend { lean, twist } => unbend(v, lean, twist),
        }
    }
}

fn unbend(v: DVec3, lean: DVec2, twist: f64) -> DVec3 {
    DVec2::from_angle(-twist * v.z).rotate(v.truncate() - lean * (v.z * v.z)).extend(v.z)
}

/// Where a ray meets a form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::synthetic) struct Meeting {
    /// Distance along the ray.
    pub(in crate::synthetic) t: f64,
    /// Outward unit normal in the world.
    pub(in crate::synthetic) normal: DVec3,
    /// The material point.
    pub(in crate::synthetic) q: DVec3,
    /// Outward unit normal at rest.
    pub(in crate::synthetic) rest_normal: DVec3,
}

/// A form at a time, with a ball around it that most rays miss.
#[derive(Clone, Copy, Debug)]
pub(in crate::synthetic) struct Posed {
    form: Form,
    pub(in crate::synthetic) placement: Placement,
    centre: DVec3,
    radius: f64,
}

impl Posed {
    /// # Panics
    /// Where a bar is stretched or anything else is bent: such surfaces have no polynomial here.
    pub(in crate::synthetic) fn new(form: Form, placement: Placement) -> Self {
        let (middle, radius) = match (form, placement.warp) {
            (Form::Solid(shape), Warp::Rigid) => (DVec3::ZERO, shape.radius()),
            (Form::Solid(shape), Warp::Stretch(scale)) => (DVec3::ZERO, shape.radius() * scale.max_element()),
            (Form::Bar { radius, height }, Warp::Rigid) => (DVec3::Z * (0.5 * height), radius.hypot(0.5 * height)),
            (Form::Bar { radius, height }, Warp::Bend { lean, .. }) => {
                let half = lean * (0.5 * height * height);
                (half.extend(0.5 * height), (half.length() + radius).hypot(0.5 * height))
            }
            (form, warp) => panic!("{form:?} cannot be warped by {warp:?}"),
        };
        Self { form, placement, centre: placement.r * middle + placement.c, radius }
    }

    /// First surface point of a world ray beyond `after`.
    pub(in crate::synthetic) fn hit(&self, ray: &Ray, after: f64) -> Option<Meeting> {
        let from = ray.o - self.centre;
        let along = from.dot(ray.d);
        let reach = self.radius * self.radius * (1.0 + 1e-9) - (from.length_squared() - along * along);
        if reach < 0.0 || reach.sqrt() - along <= after {
            return None;
        }
        let Placement { r, c, warp } = self.placement;
        let back = r.transpose();
        let (o, d) = (back * (ray.o - c), back * ray.d);
        match (self.form, warp) {
            (Form::Solid(shape), Warp::Stretch(scale)) => {
                // In the form's own axes the direction is not a unit vector, and distances are longer by its length.
                let (o, d) = (o / scale, d / scale);
                let length = d.length();
                let (t, n) = shape.hit(o, d / length, after * length)?;
                let t = t / length;
                Some(Meeting { t, normal: (r * (n / scale)).normalize(), q: o + d * t, rest_normal: n })
            }
            (Form::Solid(shape), _) => {
                let (t, n) = shape.hit(o, d, after)?;
                Some(Meeting { t, normal: r * n, q: o + d * t, rest_normal: n })
            }
            (Form::Bar { radius, height }, warp) => {
                let (lean, twist) = match warp {
                    Warp::Bend { lean, twist } => (lean, twist),
                    _ => (DVec2::ZERO, 0.0),
                };
                // Measured from the point of the ray nearest to the ball's middle: small numbers, few digits lost.
                let shifted = bar(o - d * along, d, radius, height, lean, (-reach.sqrt()).max(after + along))?;
                let (t, v, n) = shifted;
                let q = unbend(v, lean, twist);
                let cap = n.truncate() == DVec2::ZERO;
                let rest_normal = if cap { n } else { q.truncate().extend(0.0).normalize_or_zero() };
                Some(Meeting { t: t - along, normal: r * n, q, rest_normal })
            }
        }
    }

    /// Is a world point inside?
    #[cfg(test)]
    pub(in crate::synthetic) fn contains(&self, x: DVec3) -> bool {
        let q = self.placement.material(x);
        match self.form {
            Form::Solid(shape) => shape.contains(q),
            Form::Bar { radius, height } => {
                q.truncate().length_squared() <= radius * radius && (0.0..=height).contains(&q.z)
            }
        }
    }
}

/// First surface point of a leaning bar beyond `after`: distance, point and normal, all in the bar's axes after warping.
fn bar(o: DVec3, d: DVec3, radius: f64, height: f64, lean: DVec2, after: f64) -> Option<(f64, DVec3, DVec3)> {
    // Between the planes of the two ends.
    let (enter, leave) = if d.z != 0.0 {
        let (a, b) = (-o.z / d.z, (height - o.z) / d.z);
        (a.min(b), a.max(b))
    } else if (0.0..=height).contains(&o.z) {
        (f64::NEG_INFINITY, f64::INFINITY)
    } else {
        return None;
    };
    // Distance from the axis: u = u0 + u1 t + u2 t^2, because the axis lies at lean z^2.
    let u0 = o.truncate() - lean * (o.z * o.z);
    let u1 = d.truncate() - lean * (2.0 * o.z * d.z);
    let u2 = -lean * (d.z * d.z);
    let within = |t: f64| (u0 + u1 * t + u2 * (t * t)).length_squared() <= radius * radius;
    let cap = |t: f64, outward: f64| {
        (t > after && t.is_finite() && within(t)).then(|| (t, o + d * t, DVec3::Z * (outward * d.z.signum())))
    };
    if let Some(first) = cap(enter, -1.0) {
        return Some(first);
    }
    let quartic = [
        u0.length_squared() - radius * radius,
        2.0 * u0.dot(u1),
        u1.length_squared() + 2.0 * u0.dot(u2),
        2.0 * u1.dot(u2),
        u2.length_squared(),
    ];
    // Rays parallel to an end have no planes to stop at: they cannot get farther than this.
    let far = 2.0 * (o.length() + height + radius + lean.length() * height * height);
    let (found, n) = roots(&quartic, after.max(enter).max(-far), leave.min(far));
    if let Some(&t) = found[..n].iter().find(|t| **t > after) {
        let v = o + d * t;
        let u = v.truncate() - lean * (v.z * v.z);
        return Some((t, v, u.extend(-2.0 * v.z * u.dot(lean)).normalize()));
    }
    cap(leave, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use testkit::strategies::{any_rotation, any_unit_vector};

    fn posed(which: usize, r: DMat3, bend: [f64; 3]) -> Posed {
        let c = DVec3::new(0.1, -0.2, 0.3);
        let [a, b, twist] = bend;
        match which {
            0 => Posed::new(
                Form::Solid(Shape::Sphere { radius: 0.5 }),
                Placement { r, c, warp: Warp::Stretch(DVec3::new(1.0 + 0.3 * a, 0.8, 1.0 - 0.2 * b)) },
            ),
            1 => Posed::new(
                Form::Solid(Shape::Block { half: DVec3::new(0.3, 0.2, 0.4) }),
                Placement { r, c, warp: Warp::Stretch(DVec3::new(0.7, 1.2, 1.0 + 0.2 * a)) },
            ),
            2 => Posed::new(Form::Solid(Shape::Torus { ring: 0.4, tube: 0.15 }), Placement::rigid(r, c)),
            3 => Posed::new(Form::Bar { radius: 0.15, height: 0.9 }, Placement::rigid(r, c)),
            4 => Posed::new(
                Form::Solid(Shape::Cut {
                    radii: DVec3::new(0.5, 0.4, 0.6),
                    low: DVec3::new(-0.4, -0.5, 0.0),
                    high: DVec3::new(0.1, 0.3, 0.5),
                }),
                Placement { r, c, warp: Warp::Stretch(DVec3::new(1.2, 0.8, 1.0 + 0.2 * a)) },
            ),
            _ => Posed::new(
                Form::Bar { radius: 0.15, height: 0.9 },
                Placement { r, c, warp: Warp::Bend { lean: DVec2::new(a, b), twist } },
            ),
        }
    }

    /// Distance to the first change between outside and inside, by small steps.
    fn march(posed: &Posed, ray: &Ray) -> Option<f64> {
        let start = posed.contains(ray.o);
        (1..=4000).map(|i| f64::from(i) * 1e-3).find(|t| posed.contains(ray.at(*t)) != start)
    }

    proptest! {
        #![proptest_config(testkit::property::cases(192))]

        #[test]
        fn hits_lie_where_marching_finds_them(
            which in 0..6_usize, r in any_rotation(), bend in [-1.0..1.0, -1.0..1.0, -4.0..4.0_f64],
            o in [-1.5..1.5, -1.5..1.5, -1.5..1.5_f64], d in any_unit_vector(),
        ) {
            let columns = r.map(DVec3::from);
            let posed = posed(which, DMat3::from_cols(columns[0], columns[1], columns[2]), bend);
            let ray = Ray { o: DVec3::from(o), d: DVec3::from(d) };
            let hit = posed.hit(&ray, 0.0);
            if let Some(Meeting { t, normal, q, rest_normal }) = hit {
                prop_assert!(t > 0.0 && (normal.length() - 1.0).abs() < 1e-12);
                prop_assert!((rest_normal.length() - 1.0).abs() < 1e-9, "{}", rest_normal);
                let x = ray.at(t);
                prop_assert!(!posed.contains(x + normal * 1e-6) && posed.contains(x - normal * 1e-6), "{} at {}", normal, x);
                prop_assert!((posed.placement.place(q) - x).length() < 1e-11, "{} is not at {}", q, x);
                prop_assert!((posed.placement.material(x) - q).length() < 1e-11);
            }
            // The march can miss slivers but not invent surfaces.
            if let Some(marched) = march(&posed, &ray) {
                let Meeting { t, .. } = hit.expect("the march found a surface");
                prop_assert!(t <= marched + 1e-9 && (marched - t < 1.1e-3 || t < marched), "{} against {}", t, marched);
            }
        }
    }

    #[test]
    fn a_bar_is_met_from_all_sides() {
        let bend = Warp::Bend { lean: DVec2::new(0.5, 0.0), twist: 2.0 };
        let bar = Posed::new(
            Form::Bar { radius: 0.1, height: 1.0 },
            Placement { r: DMat3::IDENTITY, c: DVec3::ZERO, warp: bend },
        );
        let hit = |o: [f64; 3], d: DVec3| bar.hit(&Ray { o: o.into(), d }, 0.0).map(|m| (m.t, m.normal));
        // Onto the upper end, which has moved aside, and past where it was.
        let (t, n) = hit([0.5, 0.0, 3.0], -DVec3::Z).unwrap();
        assert!((t - 2.0).abs() < 1e-14 && n == DVec3::Z, "{t} {n}");
        assert_eq!(hit([-0.2, 0.0, 3.0], -DVec3::Z), None);
        // Level with the ends, at half height: the axis is at 0.125.
        let (t, n) = hit([-2.0, 0.0, 0.5], DVec3::X).unwrap();
        assert!((t - 2.025).abs() < 1e-12 && n.x < 0.0 && n.z > 0.0, "{t} {n}");
        // From inside, downwards to the foot.
        let (t, n) = hit([0.0, 0.0, 0.2], -DVec3::Z).unwrap();
        assert!((t - 0.2).abs() < 1e-14 && n == -DVec3::Z, "{t} {n}");
        assert_eq!(hit([0.0, 0.0, -0.1], DVec3::X), None);
    }
}
