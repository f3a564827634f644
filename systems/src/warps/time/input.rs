//! A row of numbers for any time.

/// A row of numbers for any time, of what was learned.
pub(super) trait TimeInput: Send + Sync {
    /// Numbers of a row.
    fn dims(&self) -> usize;

    /// `[times][dims]`, of times in `[0, 1]`.
    fn rows(&self, learned: &[f32], times: &[f64]) -> Vec<f32>;

    /// Add the gradient of what is learned, from that of the rows of the training views, `[views][dims]`.
    fn backward(&self, learned: &[f32], rows_bar: &[f32], learned_bar: &mut [f32]);

    /// Whether anything is learned.
    fn learns(&self) -> bool {
        true
    }

    /// What is learned has changed.
    fn renew(&mut self, _learned: &[f32]) {}
}

/// `[rows][n]` to `[n][rows]`.
pub(super) fn transposed(rows: usize, n: usize, from: &[f32]) -> Vec<f32> {
    (0..n).flat_map(|i| (0..rows).map(move |r| from[r * n + i])).collect()
}
