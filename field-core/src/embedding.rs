//! Embeddings: a learned vector for each index, for images, cameras, times.

use crate::FieldError;
use crate::error::check_len;

/// A table of `count` vectors of `width` numbers, `[count][width]`; the numbers are the caller's.
///
/// # Shapes
/// * `table`, `grad` `[count][width]`
/// * `index` `[n]`, each below `count`
/// * `out`, `out_bar` `[width][n]`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Embedding {
    count: usize,
    width: usize,
}

impl Embedding {
    /// `count` vectors of `width` numbers. Both may be 0.
    #[must_use]
    pub fn new(count: usize, width: usize) -> Self {
        Self { count, width }
    }

    /// Number of vectors.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Numbers of a vector.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Length of the table.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.count * self.width
    }

    /// `out[c][i] = table[index[i]][c]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`]; [`FieldError::Index`] names the first index without a vector.
    ///
    /// # Panics
    /// May do so where `count * width` does not fit `usize`.
    pub fn encode(&self, table: &[f32], index: &[u32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check(table.len(), index, out.len())?;
        let n = index.len();
        for c in 0..self.width {
            for (out, &index) in out[c * n..(c + 1) * n].iter_mut().zip(index) {
                *out = table[index as usize * self.width + c];
            }
        }
        Ok(())
    }

    /// `grad[index[i]][c] += out_bar[c][i]`, samples in order.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    ///
    /// # Panics
    /// As [`encode`](Self::encode).
    pub fn encode_backward(&self, index: &[u32], out_bar: &[f32], grad: &mut [f32]) -> Result<(), FieldError> {
        self.check(grad.len(), index, out_bar.len())?;
        let n = index.len();
        for c in 0..self.width {
            for (out_bar, &index) in out_bar[c * n..(c + 1) * n].iter().zip(index) {
                grad[index as usize * self.width + c] += out_bar;
            }
        }
        Ok(())
    }

    /// The mean of all vectors, `mean` `[width]`: a neutral code, as for an image that was not trained on. All 0 for an empty table.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    ///
    /// # Panics
    /// As [`encode`](Self::encode).
    pub fn mean(&self, table: &[f32], mean: &mut [f32]) -> Result<(), FieldError> {
        check_len("table", table.len(), self.params_len())?;
        check_len("mean", mean.len(), self.width)?;
        for (c, mean) in mean.iter_mut().enumerate() {
            let sum: f64 = (0..self.count).map(|i| f64::from(table[i * self.width + c])).sum();
            *mean = (sum / self.count.max(1) as f64) as f32;
        }
        Ok(())
    }

    fn check(&self, table: usize, index: &[u32], out: usize) -> Result<(), FieldError> {
        check_len("table", table, self.params_len())?;
        check_len("out", out, index.len() * self.width)?;
        match index.iter().position(|&i| i as usize >= self.count) {
            Some(at) => Err(FieldError::Index { what: "index", index: at, got: index[at] as usize, limit: self.count }),
            None => Ok(()),
        }
    }
}
