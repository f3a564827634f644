//! The elastic loss: a deformation should be nearly rigid where matter is (Nerfies, section 3.3).

use super::at::{Moved, Moves};
use super::deform::Deform;
use super::pass::recorded;
use super::points::{DeformGrad, DeformScratch, Points};
use field_core::tape::Tape;
use losses::elastic;
use std::sync::atomic::Ordering;

/// Points of a tile: the tangents of a network need several times the memory of the network.
const TILE: usize = 128;

impl Deform {
    /// Sum over points of `w` times the robust elastic energy of the deformation there (`losses::elastic`), and `factor` times
    /// its gradient, added to `grad`. Points without weight are left out.
    pub(crate) fn elastic(
        &self,
        points: Points<'_>,
        w: &[f32],
        factor: f64,
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) -> f64 {
        if !self.warps() {
            return 0.0;
        }
        let DeformScratch { tape: arena, columns, x, time, t, x_bar: j_bar, .. } = scratch;
        columns.clear();
        columns.extend((0..points.which.len() as u32).filter(|&i| w[i as usize] > 0.0 && !points.rests(i)));
        let (dims, mut sum) = (points.time_steps.dims, 0.0);
        for columns in columns.chunks(TILE) {
            let m = columns.len();
            points.gather(columns, x, time, t);
            self.count_octaves(m, Moves::Yes);
            let w: Vec<f32> = columns.iter().map(|&i| w[i as usize]).collect();
            let mut tape = Tape::new(arena, &self.params);
            let at = recorded(tape.input(3, m, x));
            let when = recorded(tape.input(dims, m, time));
            let Moved { x: there, .. } = recorded(self.record(&mut tape, at, when, t, Moves::Yes));
            let there = there.expect("a warp moves points");
            let jacobian = recorded(tape.jacobian(there, at));
            let j = recorded(tape.value(jacobian)).data;
            j_bar.clear();
            j_bar.resize(9 * m, 0.0);
            let fits = "nine rows, as many weights";
            sum += elastic::elastic_backward(j, &w, self.elastic.elastic_scale, factor, j_bar).expect(fits);
            let flips = elastic::orientation_flips(j).expect(fits) as u64;
            self.counts.elastic.fetch_add(m as u64, Ordering::Relaxed);
            self.counts.folded.fetch_add(flips, Ordering::Relaxed);
            recorded(tape.backward(&[(jacobian, &j_bar[..])], &mut grad.params));
            grad.add_times(&points, columns, recorded(tape.gradient(when)));
        }
        sum
    }
}
