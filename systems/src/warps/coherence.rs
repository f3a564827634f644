//! The coherence loss: what is near one another stays as far apart as it is, as rigid as possible (Sorkine and Alexa, 2007).
//!
//! A sample is compared with a neighbour at the same time, a short way off in a random direction: in the canonical scene the two
//! should be as far apart. Distances are held, not displacements, so that what turns as a whole costs nothing
//! ([`losses::coherence`]). Where space is contracted they are those of the contracted space.

use super::at::{Moved, Moves, TILE};
use super::deform::Deform;
use super::pass::recorded;
use super::points::{DeformGrad, DeformScratch, Points};
use super::regularisers::CoherenceSettings;
use field_core::rng::Rng;
use field_core::tape::{Node, Tape};
use losses::coherence;
use std::f32::consts::TAU;

/// Pairs of a tile: both of a pair go through the network.
const PAIRS: usize = TILE / 2;

/// A point of the unit cube `reach` away from another, in direction `i` of `draws`, uniform over the sphere. Axes along which it would
/// leave the cube are mirrored.
pub(crate) fn neighbour(x: [f32; 3], reach: f32, draws: Rng, i: u64) -> [f32; 3] {
    let [height, turn, ..] = draws.uniform4_at(i);
    // Slices of a sphere of one thickness have one area (Archimedes).
    let height = 2.0 * height - 1.0;
    let ring = (1.0 - height * height).max(0.0).sqrt();
    let (sin, cos) = (TAU * turn).sin_cos();
    let step = [ring * cos, ring * sin, height].map(|e| reach * e);
    [0, 1, 2].map(|a| {
        let there = x[a] + step[a];
        if (0.0..=1.0).contains(&there) { there } else { x[a] - step[a] }
    })
}

impl Deform {
    /// Sum over points of `w` times what the changed distance to a neighbour costs, and `factor` times its gradient, added to `grad`.
    /// The neighbour of point `i` is drawn by draw `i`. Points without weight are left out, and those of times at which nothing moves.
    pub(crate) fn coherence(
        &self,
        points: Points<'_>,
        w: &[f32],
        draws: Rng,
        factor: f64,
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) -> f64 {
        if !self.warps() {
            return 0.0;
        }
        let CoherenceSettings { coherence_reach: reach, coherence_scale: scale, .. } = self.coherence;
        let DeformScratch { tape: arena, columns, x, time, t, x_bar: way_bar, near, way, .. } = scratch;
        columns.clear();
        columns.extend((0..points.which.len() as u32).filter(|&i| w[i as usize] > 0.0 && !points.rests(i)));
        let (dims, mut sum) = (points.time_steps.dims, 0.0);
        for columns in columns.chunks(PAIRS) {
            let m = columns.len();
            points.gather(columns, x, time, t);
            for buffer in [&mut *near, &mut *way, &mut *way_bar] {
                buffer.clear();
                buffer.resize(3 * m, 0.0);
            }
            for (k, &i) in columns.iter().enumerate() {
                let here = [0, 1, 2].map(|a| x[a * m + k]);
                let there = neighbour(here, reach, draws, i.into());
                for a in 0..3 {
                    near[a * m + k] = there[a];
                    way[a * m + k] = there[a] - here[a];
                }
            }
            self.count_octaves(2 * m, Moves::Yes);
            let w: Vec<f32> = columns.iter().map(|&i| w[i as usize]).collect();
            let mut tape = Tape::new(arena, &self.params);
            let when = recorded(tape.input(dims, m, time));
            let here = self.canonical(&mut tape, x, when, t);
            let beside = self.canonical(&mut tape, near, when, t);
            let there = recorded(tape.sub(beside, here));
            let ways = recorded(tape.value(there)).data;
            let fits = "three rows each, as many weights";
            sum += coherence::coherence_backward(way, ways, &w, scale, factor, way_bar).expect(fits);
            recorded(tape.backward(&[(there, &way_bar[..])], &mut grad.params));
            grad.add_times(&points, columns, recorded(tape.gradient(when)));
        }
        sum
    }

    /// Where points `x` `[3][m]` of the unit cube are in the canonical scene. They themselves have no gradient.
    fn canonical<'a>(&'a self, tape: &mut Tape<'a>, x: &[f32], when: Node, t: &[f32]) -> Node {
        let at = recorded(tape.constant(3, t.len(), x));
        let Moved { x: there, .. } = recorded(self.record(tape, at, when, t, Moves::Yes));
        there.expect("a warp moves points")
    }
}
