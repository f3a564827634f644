//! Scene flow that a moving part has learned, at points of the scene's frame, from any time to any other.
//!
//! ```text
//! x <- x + |f| S(x, t),   t <- t + f frames        S: to the next frame where f > 0, to the previous one where f < 0; |f| <= 1
//! ```
//!
//! A frame on a point is where its scene flow says, between two frames on the straight line to there, over more of them flow upon flow.
//! A point whose matter is for the most part that of the still part stays where it is: that is what is seen there. So does a point beyond
//! the cells in which something moves.
//!
//! Source: Li, Niklaus, Snavely, Wang, "Neural Scene Flow Fields for Space-Time View Synthesis of Dynamic Scenes", 2021: times between
//! two frames.

use super::driver::RaySystem;
use super::scene_flow::FlowConfig;
use crate::buffers::sized;
use crate::fields::{DensityScratch, MovingPart, When};
use crate::warps::TimeSteps;
use glam::DVec3;
use rayon::prelude::*;

/// Points of one task.
const TASK: usize = 256;
/// Share of the matter of a point from which on the moving part has it.
const MOST: f32 = 0.5;

/// The scene flow of a moving part.
pub(super) struct LearnedFlow<'a> {
    driver: &'a RaySystem,
    part: &'a MovingPart,
    flow: &'a FlowConfig,
}

/// A piece of the way through time, of a frame at most.
struct Leg {
    /// The time at which it begins.
    time_steps: TimeSteps,
    /// Frames, backwards below 0.
    way: f32,
}

#[derive(Default)]
struct Scratch {
    /// `[3][n]`, and time steps of the points.
    x: Vec<f32>,
    which: Vec<u32>,
    raw: Vec<f32>,
    density: DensityScratch,
    share: Vec<f32>,
    /// `[6][m]`, and what is said besides.
    flow: Vec<f32>,
    hidden: Vec<f32>,
}

impl<'a> LearnedFlow<'a> {
    /// `None` where there is none, or nothing moves (yet).
    pub(super) fn of(driver: &'a RaySystem) -> Option<Self> {
        let part = driver.field.moving.as_ref()?;
        let flow = driver.config.moving.as_ref()?.flow.as_ref()?;
        Some(Self { driver, part, flow })
    }

    /// See [`engine::system::System::scene_flow`]: it is known of all points.
    pub(super) fn follow(&self, points: &[[f64; 3]], times: [f64; 2], out: &mut [Option<[f64; 3]>]) {
        let legs = self.legs(times);
        let tasks = out.par_chunks_mut(TASK).zip(points.par_chunks(TASK));
        tasks.for_each_init(Scratch::default, |scratch, (out, points)| self.follow_some(points, &legs, out, scratch));
    }

    fn legs(&self, times: [f64; 2]) -> Vec<Leg> {
        let frames = Frames::of(self.part.time_steps());
        let [from, to] = times.map(|time| frames.place(time));
        let whole = to - from;
        let leg = |k: usize| {
            let at = from + whole.signum() * k as f64;
            let time_steps = self.driver.field.time_steps_at(frames.time(at));
            Leg { time_steps, way: (to - at).clamp(-1.0, 1.0) as f32 }
        };
        (0..whole.abs().ceil() as usize).map(leg).collect()
    }

    fn follow_some(&self, points: &[[f64; 3]], legs: &[Leg], out: &mut [Option<[f64; 3]>], s: &mut Scratch) {
        let (space, head, n) = (&self.driver.space, self.flow.head(), points.len());
        let internal: Vec<_> = points.iter().map(|&point| space.internal_point(DVec3::from(point))).collect();
        let mut p = vec![0.0; 3 * n];
        for (i, at) in internal.iter().enumerate() {
            let at = at.unwrap_or([0.0; 3]);
            (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
        }
        let mut was = vec![0.0; 3 * n];
        space.grid_positions(self.driver.field.simd, &p, &mut was);
        let (mut x, mut moves) = (was.clone(), vec![false; n]);
        for (k, leg) in legs.iter().enumerate() {
            self.see(&x, leg, s);
            let (moving, mixed) = s.density.moving();
            let m = moving.columns.len();
            if m == 0 {
                break;
            }
            if k == 0 {
                let share = sized(&mut s.share, n);
                mixed.shares(moving.all(), share);
                for (moves, (share, at)) in moves.iter_mut().zip(share.iter().zip(&internal)) {
                    *moves = at.is_some() && *share >= MOST;
                }
            }
            head.read(mixed.after_gate(self.part, moving.all()), m, &mut s.flow, &mut s.hidden);
            let first = if leg.way > 0.0 { 0 } else { 3 };
            for (j, &i) in moving.columns.iter().enumerate().filter(|(_, i)| moves[**i as usize]) {
                for a in 0..3 {
                    let x = &mut x[a * n + i as usize];
                    *x = (*x + leg.way.abs() * s.flow[(first + a) * m + j]).clamp(0.0, 1.0);
                }
            }
        }
        let world = |x: [f32; 3]| space.world_point(space.internal_of_grid(x));
        for (i, out) in out.iter_mut().enumerate() {
            let [from, to] = [&was, &x].map(|x| [x[i], x[n + i], x[2 * n + i]]);
            *out = Some(if from == to { [0.0; 3] } else { (world(to) - world(from)).to_array() });
        }
    }

    /// What the field has at points `x` `[3][n]` of the unit cube where a leg begins; it stays in the scratch.
    fn see(&self, x: &[f32], leg: &Leg, s: &mut Scratch) {
        let (field, n) = (&self.driver.field, x.len() / 3);
        s.x.clear();
        s.x.extend_from_slice(x);
        s.which.clear();
        s.which.resize(n, 0);
        let raw = sized(&mut s.raw, field.density.outputs() * n);
        field.outputs(&mut s.x, When { time_steps: &leg.time_steps, which: &s.which }, raw, &mut s.density);
    }
}

/// Times of the frames, each once, in order.
struct Frames(Vec<f64>);

impl Frames {
    fn of(steps: &TimeSteps) -> Self {
        let mut times: Vec<f64> = steps.times.iter().map(|&t| 0.5 * (f64::from(t) + 1.0)).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        Self(times)
    }

    /// How many frames a time is after the first one: in parts of one between two of them, and up to one beyond the ends. Always 0 where
    /// there are not two.
    fn place(&self, time: f64) -> f64 {
        let times = &self.0;
        if times.len() < 2 {
            return 0.0;
        }
        let after = times.partition_point(|t| *t <= time).clamp(1, times.len() - 1);
        let [before_it, it] = [times[after - 1], times[after]];
        let place = (after - 1) as f64 + (time - before_it) / (it - before_it);
        place.clamp(-1.0, times.len() as f64)
    }

    /// The time of a place, from 0 to 1.
    fn time(&self, place: f64) -> f64 {
        let times = &self.0;
        if times.len() < 2 {
            return times.first().copied().unwrap_or(0.0);
        }
        let before = (place as usize).min(times.len() - 2);
        let time = times[before] + (place - before as f64) * (times[before + 1] - times[before]);
        time.clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::papers::dynamic::nsff;
    use crate::rays::budget_tests::randomised;
    use crate::rays::gradient_tests::{tiny, with_scene_flow};
    use crate::rays::moving_tests::filmed;
    use crate::space::SpaceKind;
    use engine::system::{FlowSource, System};

    /// World units of the planned reach: a tenth of a box of side 2.
    const REACH: f64 = 0.2;

    /// A part that goes as far as it can along x, on to the next frame and back to the previous one, wherever its last layer sees
    /// anything; with this weight of its gate.
    fn going(gate: f32) -> RaySystem {
        let mut driver = randomised(with_scene_flow(&filmed(8), nsff::flow, true), 5);
        let part = driver.field.moving.as_mut().unwrap();
        let (weights, inputs) = part.network.layers().last().map(|last| (last.weights.clone(), last.inputs)).unwrap();
        let first = weights.start + part.still_rows() * inputs;
        // The gate, to the next frame, to the previous one.
        for (row, weight) in [gate, 1e6, 0.0, 0.0, -1e6, 0.0, 0.0].into_iter().enumerate() {
            part.params[first + row * inputs..first + (row + 1) * inputs].fill(weight);
        }
        part.pack();
        driver
    }

    /// How far points go along x, frames of the reach.
    fn ways(driver: &RaySystem, times: [f64; 2]) -> Vec<f64> {
        let points: Vec<[f64; 3]> =
            (0..60).map(|i| [0, 1, 2].map(|a| 0.4 * f64::from(5 * i + 3 * a + 1).sin())).collect();
        let mut out = vec![None; points.len()];
        driver.scene_flow(&points, times[0], times[1], &mut out);
        let along_x = |way: Option<[f64; 3]>| {
            let [x, y, z] = way.unwrap();
            assert!(y == 0.0 && z == 0.0, "{y} {z}");
            x / REACH
        };
        out.into_iter().map(along_x).collect()
    }

    fn frame_times() -> Vec<f64> {
        let mut times: Vec<f64> = filmed(8).views().iter().map(|view| view.time).collect();
        times.sort_by(f64::total_cmp);
        times
    }

    #[test]
    fn points_go_as_their_scene_flow_says_from_any_time_to_any_other() {
        let driver = going(1e6);
        assert_eq!(driver.flow_source(), FlowSource::Learned);
        let t = frame_times();
        let between = 0.5 * (t[3] + t[4]);
        for (times, want) in [
            ([t[3], t[4]], 1.0),
            ([t[3], between], 0.5),
            ([between, t[4]], 0.5),
            ([t[3], t[5]], 2.0),
            ([t[4], t[3]], -1.0),
            ([between, t[2]], -1.5),
            ([0.0, 0.0], 0.0),
        ] {
            let ways = ways(&driver, times);
            let as_said = ways.iter().filter(|way| (**way - want).abs() < 1e-4).count();
            // Where the network sees nothing points do not move; they may get there.
            assert!(2 * as_said > ways.len(), "{times:?}: {as_said} of {} go {want}: {ways:?}", ways.len());
            assert!(ways.iter().all(|way| way.abs() < want.abs() + 1e-4 && way * want >= 0.0), "{times:?}: {ways:?}");
        }
    }

    #[test]
    fn what_is_seen_of_the_still_part_stays() {
        let t = frame_times();
        assert!(ways(&going(-1e6), [t[3], t[5]]).iter().all(|way| *way == 0.0));
        let still = randomised(tiny(SpaceKind::Box), 5);
        assert_eq!(still.flow_source(), FlowSource::Nothing);
        assert!(ways(&still, [0.0, 1.0]).iter().all(|way| *way == 0.0));
    }

    #[test]
    fn frames_are_counted_between_them_and_a_little_beyond() {
        let frames = Frames::of(&TimeSteps { times: vec![-0.5, 0.0, -0.5, 0.5], ..TimeSteps::default() });
        assert_eq!(frames.0, [0.25, 0.5, 0.75]);
        for (time, place) in [(0.25, 0.0), (0.375, 0.5), (0.75, 2.0), (0.125, -0.5), (0.0, -1.0), (1.0, 3.0)] {
            assert_eq!((frames.place(time), frames.time(place)), (place, time));
        }
        let near = Frames(vec![0.5, 0.5 + 1e-12]);
        assert_eq!([near.place(0.0), near.place(1.0)], [-1.0, 2.0], "not thousands of frames away");
        for few in [Frames(vec![]), Frames(vec![0.4])] {
            assert_eq!((few.place(0.9), few.place(0.1)), (0.0, 0.0));
        }
    }
}
