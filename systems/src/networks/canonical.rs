//! Where points of a time are in the canonical scene.

use super::recipe::Recipe;
use super::render::TASK;
use super::samples::Level;
use super::two_level::{TwoLevel, recorded};
use super::when::When;
use field_core::tape::{Tape, TapeError};
use rayon::prelude::*;

impl<R: Recipe> TwoLevel<R> {
    /// See [`engine::system::System::canonical`]: as the fine network has it. Points that are not moved keep their bits, and so do those
    /// that the space does not reach. Where space is contracted or projective a canonical point may lie beyond all space; the nearest
    /// that does not is given.
    pub(super) fn canonical_points(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        out.copy_from_slice(points);
        let time = time as f32;
        if !self.shapes.displaces() || time == 0.0 {
            return;
        }
        out.par_chunks_mut(TASK).zip(points.par_chunks(TASK)).for_each_init(Level::default, |level, (out, points)| {
            let (n, internal) = (points.len(), self.put_points(points, level));
            let x = recorded(self.canonical_x(level, time));
            for (i, out) in out.iter_mut().enumerate() {
                let [from, to] = [&level.x, &x].map(|x| [x[i], x[n + i], x[2 * n + i]]);
                if internal[i].is_some() && from != to {
                    let unit = to.map(|x| 0.5 * x + 0.5);
                    *out = self.space.world_point(self.space.internal_of_grid(unit)).to_array();
                }
            }
        });
    }

    /// Where the samples of a level are in the canonical scene, `[3][n]` in `[-1, 1]`.
    fn canonical_x(&self, level: &mut Level, time: f32) -> Result<Vec<f32>, TapeError> {
        let (ops, n) = (self.ops(), level.t.len());
        let Level { arena, x, .. } = level;
        let mut tape = Tape::new(arena, self.network(1));
        let at = tape.constant(3, n, x)?;
        let displacement = ops.levels[1].displacement().zip(When::of_all(&mut tape, n, time));
        let Some((displacement, when)) = displacement else { return Ok(x.clone()) };
        let displaced = displacement.displaced(&mut tape, at, when)?;
        Ok(tape.value(displaced.x)?.data.to_vec())
    }
}
