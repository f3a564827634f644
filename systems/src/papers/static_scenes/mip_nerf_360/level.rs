//! Memory of a round: the intervals of a tile's rays, and the Gaussians that stand for them.

use field_core::tape::Arena;

/// One round.
#[derive(Default)]
pub(super) struct Level {
    pub(super) arena: Arena,
    /// `[rays + 1]`
    pub(super) offsets: Vec<u32>,
    /// `[n + rays]` fenceposts in normalised distance.
    pub(super) s: Vec<f32>,
    /// `[n]` where each interval begins, internal units.
    pub(super) t: Vec<f32>,
    /// `[n]`
    pub(super) dt: Vec<f32>,
    /// `[n]`
    pub(super) w: Vec<f32>,
    /// `[2 K][n]` means and variances along the `K` directions.
    pub(super) x: Vec<f32>,
    /// `[3][n]`
    pub(super) d: Vec<f32>,
    /// Gradient of what the round's tape puts out.
    pub(super) bar: Vec<f32>,
    pub(super) mean: Vec<f32>,
    pub(super) cov: Vec<f32>,
    /// As `x` and `d`, their gradients; only where those of rays are asked for.
    pub(super) x_bar: Vec<f32>,
    pub(super) d_bar: Vec<f32>,
}

/// What stands for an interval.
pub(super) struct Gaussian {
    pub(super) mean: [f64; 3],
    /// Upper triangle of the covariance.
    pub(super) cov: [f64; 6],
}

impl Level {
    /// Make room for `n` intervals.
    pub(super) fn make_room(&mut self, n: usize) {
        for (buffer, rows) in [
            (&mut self.t, 1),
            (&mut self.dt, 1),
            (&mut self.w, 1),
            (&mut self.mean, 3),
            (&mut self.cov, 6),
            (&mut self.d, 3),
        ] {
            buffer.resize(rows * n, 0.0);
        }
    }

    /// Gaussian of interval `i`.
    pub(super) fn put(&mut self, n: usize, i: usize, gaussian: Gaussian) {
        let Gaussian { mean, cov } = gaussian;
        for (a, m) in mean.into_iter().enumerate() {
            self.mean[a * n + i] = m as f32;
        }
        for (a, c) in cov.into_iter().enumerate() {
            self.cov[a * n + i] = c as f32;
        }
    }
}
