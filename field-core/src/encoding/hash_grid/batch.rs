//! All levels of a batch; with the feature `rayon`, on the current thread pool.
//!
//! Forward: a task for each level and chunk of samples. Backward of the table: a task for each level, because a level's
//! entries are added to in the order of the samples. Backward of the positions: a task for each chunk.

use float_core::Simd;

use super::{HashGrid, MAX_LEVELS, Touched};
use crate::FieldError;
use crate::encoding::lattice::features::{Features, Packed};
use crate::encoding::lattice::kernel::{Axes, Gather, PositionGradient};
use crate::encoding::{axes, check_points, rows_mut};
use crate::error::check_len;

/// Samples of one task.
const CHUNK: usize = 4096;

/// Run both, on two threads if there is a pool.
#[cfg(feature = "rayon")]
fn join(a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    rayon::join(a, b);
}
#[cfg(not(feature = "rayon"))]
fn join(a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    a();
    b();
}

/// One level of the backward pass.
struct LevelJob<'a> {
    level: usize,
    out_bar: &'a [f32],
    grad: &'a mut [f32],
    touched: Option<&'a mut [u64]>,
}

/// A stretch of the batch in the backward pass of the positions.
struct PositionJob<'a> {
    params: &'a [f32],
    /// Samples of the whole batch, the stride of `out_bar`.
    n: usize,
    levels: usize,
    out_bar: &'a [f32],
    /// Where the stretch starts.
    at: usize,
    x: Axes<'a>,
    x_dot: Option<Axes<'a>>,
    x_bar: [&'a mut [f32]; 3],
}

impl<'a> PositionJob<'a> {
    /// The whole batch.
    fn new(
        params: &'a [f32],
        levels: usize,
        x: Axes<'a>,
        x_dot: Option<Axes<'a>>,
        out_bar: &'a [f32],
        x_bar: &'a mut [f32],
    ) -> Self {
        Self { params, n: x[0].len(), levels, out_bar, at: 0, x, x_dot, x_bar: rows_mut(x_bar) }
    }
}

impl HashGrid {
    /// Features of all levels: `out` `[levels * features][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, params: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check_batch(Some(params), x, x, out.len())?;
        self.gather_levels(simd, params, axes(x), None, out);
        Ok(())
    }

    /// Derivative of all features along `x_dot` `[3][n]`: `out_dot` `[levels * features][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_batch(Some(params), x, x_dot, out_dot.len())?;
        self.gather_levels(simd, params, axes(x), Some(axes(x_dot)), out_dot);
        Ok(())
    }

    /// Add the gradient of the table to `grad` and mark what was touched.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    ///
    /// # Panics
    /// May do so if `touched` was made for another grid.
    pub fn encode_backward(
        &self,
        simd: Simd,
        x: &[f32],
        out_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut Touched>,
    ) -> Result<(), FieldError> {
        self.check_batch(None, x, x, out_bar.len())?;
        check_len("grad", grad.len(), self.params_len())?;
        self.scatter_levels(simd, axes(x), None, out_bar, grad, touched);
        Ok(())
    }

    /// Add the gradient of the table through [`tangent`](Self::tangent).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    ///
    /// # Panics
    /// May do so if `touched` was made for another grid.
    pub fn tangent_backward(
        &self,
        simd: Simd,
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut Touched>,
    ) -> Result<(), FieldError> {
        self.check_batch(None, x, x_dot, out_dot_bar.len())?;
        check_len("grad", grad.len(), self.params_len())?;
        self.scatter_levels(simd, axes(x), Some(axes(x_dot)), out_dot_bar, grad, touched);
        Ok(())
    }

    /// Add the gradient of the positions, `x_bar` `[3][n]`. Also the gradient of [`tangent`](Self::tangent) with
    /// respect to `x_dot`, given the tangent's cotangent.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward_x(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_batch(Some(params), x, x, out_bar.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        self.add_position_gradients(simd, PositionJob::new(params, self.config.levels, axes(x), None, out_bar, x_bar));
        Ok(())
    }

    /// [`encode_backward_x`](Self::encode_backward_x) of the first `levels` levels alone. Gradients grow with the resolution of
    /// a level and become noisy, so a deformation learns better from those of the coarse levels.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward_x_coarse(
        &self,
        simd: Simd,
        params: &[f32],
        levels: usize,
        x: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_batch(Some(params), x, x, out_bar.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        let levels = levels.min(self.config.levels);
        self.add_position_gradients(simd, PositionJob::new(params, levels, axes(x), None, out_bar, x_bar));
        Ok(())
    }

    /// Add the gradient of the positions through [`tangent`](Self::tangent): the mixed second derivatives (with
    /// [`Interpolation::Linear`](super::Interpolation) the pure ones are 0 inside cells).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward_x(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_batch(Some(params), x, x_dot, out_dot_bar.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        let levels = self.config.levels;
        self.add_position_gradients(
            simd,
            PositionJob::new(params, levels, axes(x), Some(axes(x_dot)), out_dot_bar, x_bar),
        );
        Ok(())
    }

    fn check_batch(&self, params: Option<&[f32]>, x: &[f32], x_dot: &[f32], out: usize) -> Result<(), FieldError> {
        if let Some(params) = params {
            check_len("params", params.len(), self.params_len())?;
        }
        check_points(x)?;
        check_len("x_dot", x_dot.len(), x.len())?;
        check_len("out", out, x.len() / 3 * self.out_rows())
    }

    fn gather_levels(&self, simd: Simd, params: &[f32], x: Axes<'_>, x_dot: Option<Axes<'_>>, out: &mut [f32]) {
        match self.config.features {
            1 => self.gather_from::<1>(simd, params, 0, x, x_dot, out),
            2 => self.gather_from::<2>(simd, params, 0, x, x_dot, out),
            4 => self.gather_from::<4>(simd, params, 0, x, x_dot, out),
            _ => self.gather_from::<8>(simd, params, 0, x, x_dot, out),
        }
    }

    /// The levels from `first` on that `out` holds rows of, halved until one is left.
    fn gather_from<const F: usize>(
        &self,
        simd: Simd,
        params: &[f32],
        first: usize,
        x: Axes<'_>,
        x_dot: Option<Axes<'_>>,
        out: &mut [f32],
    ) where
        Packed: Features<F>,
    {
        let row = x[0].len() * F;
        if row == 0 {
            return;
        }
        let levels = out.len() / row;
        if levels == 1 {
            let table = &params[self.level_range(first)];
            return self.gather_chunks::<F>(simd, table, first, x, x_dot, rows_mut(out));
        }
        let (a, b) = out.split_at_mut(levels / 2 * row);
        join(
            || self.gather_from::<F>(simd, params, first, x, x_dot, a),
            || self.gather_from::<F>(simd, params, first + levels / 2, x, x_dot, b),
        );
    }

    /// The samples of one level, halved until a chunk is left.
    fn gather_chunks<const F: usize>(
        &self,
        simd: Simd,
        table: &[f32],
        level: usize,
        x: Axes<'_>,
        x_dot: Option<Axes<'_>>,
        out: [&mut [f32]; F],
    ) where
        Packed: Features<F>,
    {
        let chunks = x[0].len().div_ceil(CHUNK);
        if chunks <= 1 {
            return simd.run(Gather { place: self.place(level, x, x_dot), table, out });
        }
        let mid = chunks / 2 * CHUNK;
        let (out_a, out_b) = split_rows_mut(out, mid);
        let x_dot_parts = x_dot.map(|x| split_rows(x, mid));
        let (x_a, x_b) = split_rows(x, mid);
        join(
            || self.gather_chunks::<F>(simd, table, level, x_a, x_dot_parts.map(|d| d.0), out_a),
            || self.gather_chunks::<F>(simd, table, level, x_b, x_dot_parts.map(|d| d.1), out_b),
        );
    }

    fn scatter_levels(
        &self,
        simd: Simd,
        x: Axes<'_>,
        x_dot: Option<Axes<'_>>,
        out_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut Touched>,
    ) {
        let row = x[0].len() * self.config.features;
        if row == 0 {
            return;
        }
        let count = self.config.levels;
        // Large tables miss the caches: heavy. Deal the levels, heaviest first, to the two halves in turn.
        let mut order: [usize; MAX_LEVELS] = core::array::from_fn(|level| level);
        order[..count].sort_by_key(|&level| core::cmp::Reverse(self.levels[level].entries));
        let mut slots = [0; MAX_LEVELS];
        for (rank, &level) in order[..count].iter().enumerate() {
            slots[level] = rank / 2 + rank % 2 * count.div_ceil(2);
        }
        let mut words = touched.map(Touched::levels_mut);
        let mut rest = grad;
        let mut jobs: [Option<LevelJob<'_>>; MAX_LEVELS] = [const { None }; MAX_LEVELS];
        for level in 0..count {
            let (grad, tail) = core::mem::take(&mut rest).split_at_mut(self.level_range(level).len());
            rest = tail;
            let touched = words.as_mut().and_then(Iterator::next);
            jobs[slots[level]] =
                Some(LevelJob { level, out_bar: &out_bar[level * row..(level + 1) * row], grad, touched });
        }
        self.scatter_jobs(simd, x, x_dot, &mut jobs[..count]);
    }

    /// The jobs, halved until one is left.
    fn scatter_jobs(&self, simd: Simd, x: Axes<'_>, x_dot: Option<Axes<'_>>, jobs: &mut [Option<LevelJob<'_>>]) {
        if let [job] = jobs {
            if let Some(job) = job.take() {
                self.scatter(simd, job.level, x, x_dot, job.out_bar, job.grad, job.touched);
            }
        } else if !jobs.is_empty() {
            let (a, b) = jobs.split_at_mut(jobs.len().div_ceil(2));
            join(|| self.scatter_jobs(simd, x, x_dot, a), || self.scatter_jobs(simd, x, x_dot, b));
        }
    }

    fn add_position_gradients(&self, simd: Simd, job: PositionJob<'_>) {
        match self.config.features {
            1 => self.position_chunks::<1>(simd, job),
            2 => self.position_chunks::<2>(simd, job),
            4 => self.position_chunks::<4>(simd, job),
            _ => self.position_chunks::<8>(simd, job),
        }
    }

    /// The samples of the batch, halved until a chunk is left; all levels of it, in order.
    fn position_chunks<const F: usize>(&self, simd: Simd, job: PositionJob<'_>)
    where
        Packed: Features<F>,
    {
        let PositionJob { params, n, levels, out_bar, at, x, x_dot, x_bar } = job;
        let len = x[0].len();
        if len > CHUNK {
            let mid = len.div_ceil(CHUNK) / 2 * CHUNK;
            let (bar_a, bar_b) = split_rows_mut(x_bar, mid);
            let (x_a, x_b) = split_rows(x, mid);
            let dot = x_dot.map(|x| split_rows(x, mid));
            let a = PositionJob { params, n, levels, out_bar, at, x: x_a, x_dot: dot.map(|d| d.0), x_bar: bar_a };
            let b =
                PositionJob { params, n, levels, out_bar, at: at + mid, x: x_b, x_dot: dot.map(|d| d.1), x_bar: bar_b };
            return join(|| self.position_chunks::<F>(simd, a), || self.position_chunks::<F>(simd, b));
        }
        let [mut x0, mut x1, mut x2] = x_bar;
        for level in 0..levels {
            simd.run(PositionGradient::<F> {
                place: self.place(level, x, x_dot),
                table: &params[self.level_range(level)],
                out_bar: core::array::from_fn(|f| &out_bar[(level * F + f) * n + at..][..len]),
                x_bar: [&mut x0, &mut x1, &mut x2].map(|x| &mut **x),
            });
        }
    }
}

fn split_rows<const N: usize>(rows: [&[f32]; N], mid: usize) -> ([&[f32]; N], [&[f32]; N]) {
    (rows.map(|r| &r[..mid]), rows.map(|r| &r[mid..]))
}

fn split_rows_mut<const N: usize>(rows: [&mut [f32]; N], mid: usize) -> ([&mut [f32]; N], [&mut [f32]; N]) {
    let mut tails: [&mut [f32]; N] = core::array::from_fn(|_| Default::default());
    let mut at = 0;
    let heads = rows.map(|row| {
        let (head, tail) = row.split_at_mut(mid);
        tails[at] = tail;
        at += 1;
        head
    });
    (heads, tails)
}
