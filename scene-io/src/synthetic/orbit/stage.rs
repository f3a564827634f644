//! What stands on the stage, how it is painted, and how it moves.

use crate::random::random;
use crate::synthetic::shape::Shape;
use crate::synthetic::snapshot::PosedThing;
use crate::synthetic::snapshot::body::{Form, Placement, Posed, Warp};
use crate::synthetic::snapshot::pattern::Pattern;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::TAU;

/// What moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OrbitMotion {
    /// Some things move on a stage that does not.
    #[default]
    Some,
    /// Nothing: everything stays as it is at time 0.
    Nothing,
    /// Nothing, for what would move is not there: the stage and what stands still on it.
    Gone,
    /// Everything: the stage turns with all that stands on it, and what moves on it still does.
    Everything,
}

/// How a thing moves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    /// It stays.
    Still(Placement),
    /// Along a circle about the middle of the stage, turning on the way.
    Circle { radius: f64, start: f64, sweep: f64, height: f64, spin: f64 },
    /// In place, becoming flatter and higher; its lowest point stays on the ground.
    Breathe { foot: DVec3, radius: f64, phase: f64 },
    /// Rooted, leaning and twisting.
    Sway { foot: DVec3, towards: f64, phase: f64 },
    /// A part of an arm with a shoulder and an elbow.
    Arm { foot: DVec3, towards: f64, phase: f64, part: Part },
}

/// Parts of the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Shoulder,
    Upper,
    Elbow,
    Fore,
    Hand,
}

/// Height of the shoulder over the foot, length of the upper arm, length of the forearm.
const ARM: [f64; 3] = [0.30, 0.34, 0.28];

impl Course {
    fn at(&self, time: f64) -> Placement {
        // All courses are smooth at every time and nowhere at rest at time 0.
        match *self {
            Self::Still(placement) => placement,
            Self::Circle { radius, start, sweep, height, spin } => {
                let angle = start + sweep * time;
                let tilt = DMat3::from_rotation_x(0.35) * DMat3::from_rotation_y(0.25);
                let c = (DVec2::from_angle(angle) * radius).extend(height + 0.05 * (TAU * time + 1.0).sin());
                Placement::rigid(DMat3::from_rotation_z(angle + spin * time) * tilt, c)
            }
            Self::Breathe { foot, radius, phase } => {
                let wide = (0.17 * (TAU * time + phase).sin()).exp();
                let scale = DVec3::new(wide, wide, 1.0 / (wide * wide));
                let c = foot + DVec3::Z * (radius * scale.z);
                Placement { r: DMat3::IDENTITY, c, warp: Warp::Stretch(scale) }
            }
            Self::Sway { foot, towards, phase } => {
                let swing = TAU * time + phase;
                let lean = DVec2::from_angle(towards + 0.5 * time) * (0.15 + 0.6 * swing.sin());
                let warp = Warp::Bend { lean, twist: 1.2 + 2.2 * (swing + 1.1).sin() };
                Placement { r: DMat3::IDENTITY, c: foot, warp }
            }
            Self::Arm { foot, towards, phase, part } => {
                let swing = |slow: f64, shift: f64| (TAU * slow * time + phase + shift).sin();
                let upper = DMat3::from_rotation_z(towards + 0.45 * swing(0.8, 0.4))
                    * DMat3::from_rotation_y(0.45 + 0.35 * swing(1.0, 0.0));
                let fore = upper * DMat3::from_rotation_y(0.9 + 0.5 * swing(0.9, 2.0));
                let shoulder = foot + DVec3::Z * ARM[0];
                let elbow = shoulder + upper.z_axis * ARM[1];
                let (r, c) = match part {
                    Part::Shoulder => (upper, shoulder),
                    Part::Upper => (upper, shoulder + upper.z_axis * (0.5 * ARM[1])),
                    Part::Elbow => (fore, elbow),
                    Part::Fore => (fore, elbow + fore.z_axis * (0.5 * ARM[2])),
                    Part::Hand => (fore, elbow + fore.z_axis * ARM[2]),
                };
                Placement::rigid(r, c)
            }
        }
    }
}

/// Something on the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Thing {
    form: Form,
    pattern: Pattern,
    course: Course,
    motion: OrbitMotion,
    /// The whole stage is turned by this, radians.
    turn: f64,
}

impl Thing {
    /// Does it move at any time?
    pub(super) fn moves(&self) -> bool {
        match self.motion {
            OrbitMotion::Some => !matches!(self.course, Course::Still(_)),
            OrbitMotion::Nothing | OrbitMotion::Gone => false,
            OrbitMotion::Everything => true,
        }
    }

    /// Where it is at a time.
    pub(super) fn at(&self, time: f64) -> Placement {
        let (time, turn) = match self.motion {
            OrbitMotion::Some => (time, self.turn),
            OrbitMotion::Nothing | OrbitMotion::Gone => (0.0, self.turn),
            OrbitMotion::Everything => (time, self.turn + 0.9 * time),
        };
        let inner = self.course.at(time);
        let stage = DMat3::from_rotation_z(turn);
        Placement { r: stage * inner.r, c: stage * inner.c, ..inner }
    }

    /// As a snapshot of a time holds it.
    pub(super) fn posed(&self, time: f64) -> PosedThing {
        let posed = Posed::new(self.form, self.at(time));
        PosedThing { posed, pattern: self.pattern, inside: None, moves: self.moves() }
    }
}

/// The things of a seed: the ground first.
pub(super) fn things(seed: u64, motion: OrbitMotion) -> Vec<Thing> {
    let draw = |index: u64| random(seed, 50_000 + index);
    let turn = TAU * draw(0);
    let mut list: Vec<Thing> = Vec::new();
    let mut add = |form: Form, course: Course, colours: [[f64; 3]; 3], fine: f64| {
        let index = list.len() as u64;
        let pattern = Pattern::new(colours, fine, |k| draw(100 + 32 * index + k));
        list.push(Thing { form, pattern, course, motion, turn });
    };
    let on = |degrees: f64, radius: f64, z: f64| (DVec2::from_angle(degrees.to_radians()) * radius).extend(z);
    let still = |c: DVec3, r: DMat3| Course::Still(Placement::rigid(r, c));
    let ball = |radius| Form::Solid(Shape::Sphere { radius });
    let block = |x, y, z| Form::Solid(Shape::Block { half: DVec3::new(x, y, z) });
    let post = |radius, half_height| Form::Solid(Shape::Cylinder { radius, half_height });
    // The stage and what stands still on it.
    let stone = [[0.56, 0.50, 0.38], [0.13, 0.18, 0.24], [0.62, 0.40, 0.28]];
    add(post(1.05, 0.04), still(on(0.0, 0.0, -0.04), DMat3::IDENTITY), stone, 13.0);
    let wood = [[0.48, 0.24, 0.10], [0.66, 0.46, 0.22], [0.24, 0.12, 0.08]];
    add(block(0.14, 0.11, 0.13), still(on(150.0, 0.75, 0.13), DMat3::from_rotation_z(0.4)), wood, 22.0);
    let leaf = [[0.10, 0.36, 0.18], [0.46, 0.58, 0.20], [0.05, 0.20, 0.22]];
    add(post(0.07, 0.20), still(on(215.0, 0.88, 0.20), DMat3::IDENTITY), leaf, 24.0);
    let rose = [[0.58, 0.14, 0.34], [0.74, 0.50, 0.62], [0.32, 0.06, 0.26]];
    let ring = Form::Solid(Shape::Torus { ring: 0.13, tube: 0.055 });
    add(ring, still(on(318.0, 0.80, 0.055), DMat3::IDENTITY), rose, 24.0);
    let foot = on(252.0, 0.64, 0.0);
    let iron = [[0.20, 0.22, 0.26], [0.52, 0.54, 0.58], [0.10, 0.12, 0.18]];
    add(post(0.075, 0.13), still(foot + DVec3::Z * 0.13, DMat3::IDENTITY), iron, 22.0);
    // What moves.
    let crate_ = [[0.72, 0.26, 0.08], [0.84, 0.68, 0.16], [0.36, 0.08, 0.06]];
    let circle = Course::Circle { radius: 0.66, start: 0.0, sweep: 1.9, height: 0.31, spin: 1.3 };
    add(block(0.19, 0.14, 0.15), circle, crate_, 18.0);
    let sea = [[0.08, 0.26, 0.60], [0.56, 0.74, 0.82], [0.06, 0.46, 0.44]];
    add(ball(0.28), Course::Breathe { foot: DVec3::ZERO, radius: 0.28, phase: TAU * draw(1) }, sea, 17.0);
    let moss = [[0.70, 0.66, 0.10], [0.20, 0.50, 0.16], [0.84, 0.80, 0.56]];
    let sway = Course::Sway { foot: on(188.0, 0.60, 0.0), towards: 1.2, phase: TAU * draw(2) };
    add(Form::Bar { radius: 0.095, height: 0.70 }, sway, moss, 23.0);
    let phase = TAU * draw(3);
    let arm = |part| Course::Arm { foot, towards: 0.0, phase, part };
    let coat = [[0.44, 0.16, 0.56], [0.82, 0.78, 0.70], [0.22, 0.10, 0.34]];
    let skin = [[0.80, 0.42, 0.22], [0.90, 0.74, 0.50], [0.52, 0.14, 0.10]];
    add(ball(0.10), arm(Part::Shoulder), skin, 24.0);
    add(block(0.06, 0.06, 0.5 * ARM[1]), arm(Part::Upper), coat, 24.0);
    add(ball(0.09), arm(Part::Elbow), skin, 26.0);
    add(block(0.05, 0.05, 0.5 * ARM[2]), arm(Part::Fore), coat, 26.0);
    add(ball(0.10), arm(Part::Hand), skin, 24.0);
    if motion == OrbitMotion::Gone {
        list.retain(|thing| matches!(thing.course, Course::Still(_)));
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_is_smooth_and_never_rests_at_time_0() {
        let step = 1e-4;
        for thing in things(3, OrbitMotion::Some).iter().filter(|t| t.moves()) {
            let q = DVec3::new(0.05, 0.03, 0.06);
            let speed = |time: f64| (thing.at(time + step).place(q) - thing.at(time).place(q)) / step;
            let fast = (0..1000).map(|i| speed(f64::from(i) * 1e-3).length()).fold(0.0, f64::max);
            assert!(fast < 4.0, "{fast} units over the sequence: {thing:?}");
            assert!(speed(0.0).length() > 1e-3 * fast, "rests at time 0: {thing:?}");
            for i in 0..1000 {
                let time = f64::from(i) * 1e-3;
                assert!((speed(time + step) - speed(time)).length() < 0.02, "jerks at {time}: {thing:?}");
            }
        }
    }

    #[test]
    fn as_much_moves_as_is_asked_for() {
        let count = |motion| things(0, motion).iter().filter(|t| t.moves()).count();
        let all = things(0, OrbitMotion::Some).len();
        assert_eq!([count(OrbitMotion::Nothing), count(OrbitMotion::Everything)], [0, all]);
        // Without what moves the rest is as it was, and where it was.
        let still: Vec<Thing> = things(0, OrbitMotion::Gone);
        assert_eq!(still.len(), all - count(OrbitMotion::Some));
        for (gone, some) in still.iter().zip(things(0, OrbitMotion::Some)) {
            assert_eq!((gone.pattern, gone.at(0.3)), (some.pattern, some.at(0.3)));
        }
        assert!((6..all).contains(&count(OrbitMotion::Some)));
        for motion in [OrbitMotion::Some, OrbitMotion::Nothing, OrbitMotion::Everything] {
            for thing in things(0, motion) {
                let moved = thing.at(0.0).place(DVec3::ONE * 0.1) != thing.at(0.37).place(DVec3::ONE * 0.1);
                assert_eq!(moved, thing.moves(), "{thing:?}");
            }
        }
    }
}
