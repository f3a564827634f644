//! What a deformation costs besides the pictures (Nerfies, sections 3.3 and 3.4): it should be nearly rigid where matter is,
//! and leave the background where it is.

use super::pass::{DeformGrad, DeformScratch, Points, recorded};
use super::record::{Moved, Warps};
use super::{Deform, PlanesOfTime};
use field_core::rng::Rng;
use field_core::tape::Tape;
use losses::kernel::Kernel;
use losses::{background, elastic, variation};
use std::sync::atomic::Ordering;

/// Points of a tile: the tangents of a network need several times the memory of the network.
const TILE: usize = 128;

/// The axis of time of planes.
const TIME: usize = 3;

/// Work space of the background loss.
#[derive(Default)]
pub(crate) struct StillWork {
    pub(crate) grad: DeformGrad,
    scratch: DeformScratch,
}

impl Deform {
    /// Sum over points of `w` times the robust elastic energy of the deformation there (equations 5 and 6), and `factor` times
    /// its gradient, added to `grad`. Points without weight are not looked at.
    pub(crate) fn elastic(
        &self,
        points: Points<'_>,
        w: &[f32],
        (c, factor): (f32, f64),
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) -> f64 {
        if !self.warps() {
            return 0.0;
        }
        let DeformScratch { arena, columns, x, moment, t, x_bar: j_bar, .. } = scratch;
        columns.clear();
        let moves = |&i: &u32| w[i as usize] > 0.0 && !points.moments.still[points.which[i as usize] as usize];
        columns.extend((0..points.which.len() as u32).filter(moves));
        let (ops, dims, mut sum) = (self.ops(), points.moments.dims, 0.0);
        for columns in columns.chunks(TILE) {
            let m = columns.len();
            Self::fill_tile(&points, columns, x, moment, t);
            self.count_octaves(m, Warps::Yes);
            let w: Vec<f32> = columns.iter().map(|&i| w[i as usize]).collect();
            let mut tape = Tape::new(arena, &self.params);
            let at = recorded(tape.input(3, m, x));
            let when = recorded(tape.input(dims, m, moment));
            let Moved { x: there, .. } = recorded(self.record(&ops, &mut tape, at, (when, t), Warps::Yes));
            let jacobian = recorded(tape.jacobian(there, at));
            let j = recorded(tape.value(jacobian)).data;
            j_bar.clear();
            j_bar.resize(9 * m, 0.0);
            let fits = "nine rows, as many weights";
            sum += elastic::elastic_backward(j, &w, c, factor, j_bar).expect(fits);
            let flips = elastic::orientation_flips(j).expect(fits) as u64;
            self.counts.looked.fetch_add(m as u64, Ordering::Relaxed);
            self.counts.folded.fetch_add(flips, Ordering::Relaxed);
            recorded(tape.backward(&[(jacobian, &j_bar[..])], &mut grad.params));
            let bars = recorded(tape.gradient(when));
            for (k, &i) in columns.iter().enumerate() {
                let out = &mut grad.moments[points.which[i as usize] as usize * dims..][..dims];
                out.iter_mut().enumerate().for_each(|(d, sum)| *sum += bars[d * m + k]);
            }
        }
        sum
    }

    /// Sum over points of what moving them costs (section 3.4), and `factor` times its gradient, added to `grad`.
    pub(crate) fn background(
        &self,
        points: Points<'_>,
        (form, factor): (background::Form, f64),
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) -> f64 {
        let n = points.which.len();
        if !self.warps() || n == 0 {
            return 0.0;
        }
        let (mut there, mut seen) = (vec![0.0; 3 * n], vec![0.0; self.seen_rows() * n]);
        self.place(points, &mut there, &mut seen, scratch);
        // In the units of the cube [-1, 1]^3.
        there.iter_mut().zip(points.x).for_each(|(there, was)| *there = 2.0 * (*there - was));
        let mut bar = vec![0.0; 3 * n];
        let fits = "three rows";
        let sum = background::background(&there, form).expect(fits);
        background::background_backward(&there, form, 2.0 * factor, &mut bar).expect(fits);
        seen.fill(0.0);
        self.learn(points, &mut bar, &seen, grad, scratch);
        sum
    }

    /// Add the gradient of what neighbours on the planes cost each other, in space and in time (K-Planes, section 3.3).
    pub(super) fn smooth_planes(&mut self) {
        let Some(&PlanesOfTime { variation: factors, .. }) = self.config.planes.as_ref() else { return };
        let mut at = self.plane_start;
        for planes in &self.planes {
            for (k, pair) in planes.pairs().enumerate() {
                let range = planes.plane_range(k);
                let range = at + range.start..at + range.end;
                let [wide, high] = pair.map(|axis| planes.resolution()[axis] as usize);
                let (params, bar) = (&self.params[range.clone()], &mut self.grad[range]);
                for (axis, along) in [(1, pair[0]), (0, pair[1])] {
                    let factor = factors[usize::from(along == TIME)];
                    if factor > 0.0 {
                        let shape = [high, wide, planes.features()];
                        variation::total_variation_backward(
                            params,
                            &shape,
                            &[axis],
                            Kernel::Squared,
                            factor.into(),
                            bar,
                        )
                        .expect("a plane has this shape");
                    }
                }
            }
            at += planes.params_len();
        }
    }

    /// Points of the background, `[3][n]` in the unit cube, for [`Deform::holds_background`].
    pub(crate) fn set_background(&mut self, points: Vec<f32>) {
        self.still_points = points;
    }

    /// The gradient of the background loss at random points of the background, each at a random moment, written to `work`.
    /// Whether there is one.
    pub(crate) fn holds_background(&self, rng: &Rng, work: &mut StillWork) -> bool {
        let (known, n) = (self.still_points.len() / 3, self.config.background_points);
        if self.config.background == 0.0 || known == 0 || n == 0 || !self.warps() {
            return false;
        }
        let at = |i: usize, of: usize| (rng.u64_at(i as u64) % of as u64) as usize;
        let chosen: Vec<usize> = (0..n).map(|i| at(2 * i, known)).collect();
        let which: Vec<u32> = (0..n).map(|i| at(2 * i + 1, self.moments.len()) as u32).collect();
        let x: Vec<f32> =
            self.still_points.chunks_exact(known).flat_map(|row| chosen.iter().map(move |&i| row[i])).collect();
        work.grad.begin(self);
        let points = Points { x: &x, which: &which, moments: &self.moments };
        let form = background::Form::NERFIES;
        let factor = f64::from(self.config.background) / n as f64;
        self.background(points, (form, factor), &mut work.grad, &mut work.scratch);
        true
    }
}
