//! The lips and how they move; the board and what is on it.

use crate::random::random;
use crate::synthetic::shape::Shape;
use crate::synthetic::snapshot::PosedThing;
use crate::synthetic::snapshot::body::{Form, Placement, Posed};
use crate::synthetic::snapshot::pattern::Pattern;
use glam::{DMat3, DVec3};

/// Half the size of the closed mouth.
pub(super) const HALF: DVec3 = DVec3::new(0.55, 0.25, 0.42);
/// Half the axes of the ellipsoid that makes its edges round, in halves of its size: its faces stay flat in the middle.
pub(super) const ROUND: f64 = 1.3;
/// Where the middle of the closed mouth is.
pub(super) const MIDDLE: DVec3 = DVec3::new(0.0, -0.10, 0.0);

/// Half the size of the board: the knobs do not come out of its back.
const BOARD: DVec3 = DVec3::new(1.0, 0.08, 1.0);
/// Where the front of the board is.
const FRONT: f64 = 0.60;

/// Way of each lip, up or down, when the mouth is open.
const LIFT: f64 = 0.20;
/// Turn of each lip about x then, radians: wider in front than behind.
const TILT: f64 = 0.22;
/// Way of each half of the lower lip, left or right, when they are parted.
const APART: f64 = 0.20;
/// Turn of each half about y then, radians: wider below than above.
const ROLL: f64 = 0.15;
/// Turn of the whole mouth about x when it is bowed, radians.
const BOW: f64 = 0.14;

/// How far the mouth is open, how far the halves of its lower lip are apart and how far it is bowed, each in `[0, 1]`, and 0 at
/// the times 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Gesture {
    open: f64,
    apart: f64,
    bowed: f64,
}

impl Gesture {
    fn at(time: f64) -> Self {
        // Nothing is apart but while all is open: no lip runs into another.
        Self {
            open: rise(time, 0.06, 0.30) - rise(time, 0.70, 0.94),
            apart: rise(time, 0.32, 0.47) - rise(time, 0.53, 0.68),
            bowed: rise(time, 0.0, 0.5) - rise(time, 0.5, 1.0),
        }
    }
}

/// From exactly 0 until `from` to exactly 1 from `to` on, smooth to the second derivative.
fn rise(time: f64, from: f64, to: f64) -> f64 {
    let u = ((time - from) / (to - from)).clamp(0.0, 1.0);
    u * u * u * (10.0 - u * (15.0 - 6.0 * u))
}

/// A piece of the mouth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lip {
    Upper,
    /// Of the lower lip, for who stands before it.
    LeftHalf,
    RightHalf,
}

impl Lip {
    /// Its share of the closed mouth, in the axes of that.
    fn shape(self) -> Shape {
        let (mut low, mut high) = (-HALF, HALF);
        match self {
            Self::Upper => low.z = 0.0,
            Self::LeftHalf => (high.x, high.z) = (0.0, 0.0),
            Self::RightHalf => (low.x, high.z) = (0.0, 0.0),
        }
        Shape::Cut { radii: HALF * ROUND, low, high }
    }

    fn at(self, time: f64) -> Placement {
        let Gesture { open, apart, bowed } = Gesture::at(time);
        let half = |side: f64| {
            let jaw = DMat3::from_rotation_x(TILT * open);
            let r = jaw * DMat3::from_rotation_y(-side * ROLL * apart);
            (r, jaw * (DVec3::X * (side * APART * apart)) - DVec3::Z * (LIFT * open))
        };
        let (r, c) = match self {
            Self::Upper => (DMat3::from_rotation_x(-TILT * open), DVec3::Z * (LIFT * open)),
            Self::LeftHalf => half(-1.0),
            Self::RightHalf => half(1.0),
        };
        let head = DMat3::from_rotation_x(BOW * bowed);
        Placement::rigid(head * r, head * c + MIDDLE)
    }
}

/// How a thing moves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    /// It stays.
    Still(Placement),
    /// As a piece of the mouth.
    Lip(Lip),
}

/// A piece of the mouth, or something that stands still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Thing {
    form: Form,
    pattern: Pattern,
    /// Of the cuts through a lip.
    inside: Option<Pattern>,
    course: Course,
}

impl Thing {
    /// As a snapshot of a time holds it.
    pub(super) fn posed(&self, time: f64) -> PosedThing {
        let (placement, moves) = match self.course {
            Course::Still(placement) => (placement, false),
            Course::Lip(lip) => (lip.at(time), true),
        };
        PosedThing { posed: Posed::new(self.form, placement), pattern: self.pattern, inside: self.inside, moves }
    }
}

/// The things of a seed: the board first, the lips last.
pub(super) fn things(seed: u64) -> Vec<Thing> {
    let paint = |number: u64, colours: [[f64; 3]; 3], fine: f64| {
        Pattern::new(colours, fine, |k| random(seed, 40_000 + 32 * number + k))
    };
    let slate = paint(0, [[0.16, 0.24, 0.34], [0.56, 0.60, 0.52], [0.30, 0.40, 0.20]], 13.0);
    let brass = paint(1, [[0.72, 0.52, 0.14], [0.36, 0.22, 0.08], [0.86, 0.78, 0.46]], 24.0);
    let leaf = paint(2, [[0.10, 0.36, 0.18], [0.46, 0.58, 0.20], [0.05, 0.20, 0.22]], 24.0);
    let skin = paint(3, [[0.80, 0.46, 0.30], [0.90, 0.74, 0.54], [0.52, 0.20, 0.18]], 18.0);
    let flesh = paint(4, [[0.48, 0.03, 0.06], [0.76, 0.16, 0.20], [0.26, 0.02, 0.12]], 26.0);
    let still = |shape: Shape, pattern: Pattern, c: DVec3| Thing {
        form: Form::Solid(shape),
        pattern,
        inside: None,
        course: Course::Still(Placement::rigid(DMat3::IDENTITY, c)),
    };
    // Where no lip comes: the corners of the board.
    let on = |x: f64, z: f64| DVec3::new(x, FRONT, z);
    let mut list = vec![
        still(Shape::Block { half: BOARD }, slate, on(0.0, 0.0) + DVec3::Y * BOARD.y),
        still(Shape::Sphere { radius: 0.13 }, brass, on(-0.82, 0.80)),
        still(Shape::Block { half: DVec3::new(0.12, 0.10, 0.14) }, leaf, on(0.82, 0.78)),
        still(Shape::Sphere { radius: 0.11 }, leaf, on(0.84, -0.82)),
    ];
    // One pattern for all of them, in the axes of the closed mouth: it goes on across the cuts.
    list.extend([Lip::Upper, Lip::LeftHalf, Lip::RightHalf].map(|lip| Thing {
        form: Form::Solid(lip.shape()),
        pattern: skin,
        inside: Some(flesh),
        course: Course::Lip(lip),
    }));
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mouth_closes_exactly_and_nothing_parts_but_while_it_is_open() {
        let closed = Gesture { open: 0.0, apart: 0.0, bowed: 0.0 };
        assert_eq!([0.0, 1.0].map(Gesture::at), [closed; 2]);
        assert_eq!(Gesture::at(0.5), Gesture { open: 1.0, apart: 1.0, bowed: 1.0 });
        for i in 0..=1000 {
            let Gesture { open, apart, bowed } = Gesture::at(f64::from(i) * 1e-3);
            assert!([open, apart, bowed].iter().all(|x| (0.0..=1.0).contains(x)), "{open} {apart} {bowed}");
            assert!(apart == 0.0 || open == 1.0, "apart by {apart} while open by {open}");
        }
        for time in [0.03, 0.97] {
            let Gesture { open, apart, bowed } = Gesture::at(time);
            assert!(open == 0.0 && apart == 0.0 && bowed > 0.0, "a closed mouth bows");
        }
    }

    #[test]
    fn motion_is_smooth_and_at_rest_where_it_begins_and_ends() {
        let step = 1e-4;
        for lip in [Lip::Upper, Lip::LeftHalf, Lip::RightHalf] {
            let q = DVec3::new(0.3, -0.2, 0.2);
            let speed = |time: f64| (lip.at(time + step).place(q) - lip.at(time).place(q)) / step;
            let fast = (0..1000).map(|i| speed(f64::from(i) * 1e-3).length()).fold(0.0, f64::max);
            assert!((0.5..5.0).contains(&fast), "{fast} units over the sequence: {lip:?}");
            assert!(speed(0.0).length() < 1e-3 && speed(1.0 - step).length() < 1e-3, "{lip:?}");
            for i in 0..1000 {
                let time = f64::from(i) * 1e-3;
                assert!((speed(time + step) - speed(time)).length() < 0.02, "jerks at {time}: {lip:?}");
            }
        }
    }
}
