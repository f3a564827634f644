//! The background loss: points of what stands still stay where they are (Nerfies, section 3.4).

use super::deform::Deform;
use super::points::{DeformGrad, DeformScratch, Points};
use super::regularisers::BackgroundSettings;
use field_core::rng::Rng;
use losses::background;

/// Work space of the background loss.
#[derive(Default)]
pub(crate) struct StillWork {
    pub(crate) grad: DeformGrad,
    scratch: DeformScratch,
}

impl Deform {
    /// Points of the background, `[3][n]` in the unit cube, for [`Deform::holds_background`].
    pub(crate) fn set_background(&mut self, points: Vec<f32>) {
        self.background_points = points;
    }

    /// The gradient of the background loss at random points of the background, each at a random time step, written to `work`.
    /// Whether there is one.
    pub(crate) fn holds_background(&self, rng: &Rng, work: &mut StillWork) -> bool {
        let BackgroundSettings { background_loss: factor, background_points: n } = self.background;
        let known = self.background_points.len() / 3;
        if factor == 0.0 || known == 0 || n == 0 || !self.warps() {
            return false;
        }
        let at = |i: usize, of: usize| (rng.u64_at(i as u64) % of as u64) as usize;
        let chosen: Vec<usize> = (0..n).map(|i| at(2 * i, known)).collect();
        let which: Vec<u32> = (0..n).map(|i| at(2 * i + 1, self.steps.len()) as u32).collect();
        let rows = self.background_points.chunks_exact(known);
        let x: Vec<f32> = rows.flat_map(|row| chosen.iter().map(move |&i| row[i])).collect();
        work.grad.begin(self);
        let points = Points { x: &x, which: &which, time_steps: &self.steps };
        self.background_loss(points, f64::from(factor) / n as f64, &mut work.grad, &mut work.scratch);
        true
    }

    /// Sum over points of what moving them costs, and `factor` times its gradient, added to `grad`.
    fn background_loss(
        &self,
        points: Points<'_>,
        factor: f64,
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
        let (form, fits) = (background::Form::NERFIES, "three rows");
        let sum = background::background(&there, form).expect(fits);
        background::background_backward(&there, form, 2.0 * factor, &mut bar).expect(fits);
        seen.fill(0.0);
        self.learn(points, &mut bar, &seen, grad, scratch);
        sum
    }
}
