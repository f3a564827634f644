//! Gaussians in space, seen along a set of directions.

use crate::FieldError;
use crate::error::check_len;
use alloc::vec::Vec;
use float_core::{Simd, Task, Vector};

/// Means and variances of Gaussians along the `K` columns `p` of a basis: `p . mean` and `p^T Sigma p`.
///
/// What a Gaussian looks like along each direction alone; correlations between directions are dropped, as
/// [`Integrated`](super::Integrated) does not use them. With the coordinate axes this is the diagonal of `Sigma`.
///
/// # Shapes
/// * `mean` `[3][n]`; `cov` `[6][n]`, the upper triangle `xx xy xz yy yz zz` of each `Sigma`
/// * `along` `[K][n]`, `var` `[K][n]` out
///
/// # Numerics
/// `p^T Sigma p` is summed in `f32`; rounding below 0 is cut off, and no gradient passes there.
///
/// # Source
/// Barron et al., "Mip-NeRF 360", 2022, appendix (off-axis encoding).
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    /// Directions, and the products `xx 2xy 2xz yy 2yz zz` of their entries.
    columns: Vec<([f32; 3], [f32; 6])>,
}

impl Projection {
    /// Onto any directions; they need not have unit length.
    #[must_use]
    pub fn new(basis: &[[f64; 3]]) -> Self {
        let column = |p: &[f64; 3]| {
            let [x, y, z] = *p;
            let squares = [x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z];
            (p.map(|p| p as f32), squares.map(|s| s as f32))
        };
        Self { columns: basis.iter().map(column).collect() }
    }

    /// Directions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether there is no direction.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Writes `along` and `var` `[K][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn project(
        &self,
        simd: Simd,
        mean: &[f32],
        cov: &[f32],
        along: &mut [f32],
        var: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = Self::check(mean.len(), cov.len())?;
        check_len("along", along.len(), n * self.len())?;
        check_len("var", var.len(), n * self.len())?;
        simd.run(Project { columns: &self.columns, n, mean, cov, along, var });
        Ok(())
    }

    /// Adds to `mean_bar` `[3][n]` and `cov_bar` `[6][n]`, the gradients with respect to the entries of the triangle.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn project_backward(
        &self,
        cov: &[f32],
        along_bar: &[f32],
        var_bar: &[f32],
        mean_bar: &mut [f32],
        cov_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = Self::check(mean_bar.len(), cov.len())?;
        check_len("along_bar", along_bar.len(), n * self.len())?;
        check_len("var_bar", var_bar.len(), n * self.len())?;
        check_len("cov_bar", cov_bar.len(), cov.len())?;
        for (k, (p, squares)) in self.columns.iter().enumerate() {
            for i in 0..n {
                let bar = along_bar[k * n + i];
                for (a, p) in p.iter().enumerate() {
                    mean_bar[a * n + i] += p * bar;
                }
                if quadratic(squares, |a| cov[a * n + i]) > 0.0 {
                    let bar = var_bar[k * n + i];
                    for (a, s) in squares.iter().enumerate() {
                        cov_bar[a * n + i] += s * bar;
                    }
                }
            }
        }
        Ok(())
    }

    /// Number of Gaussians.
    fn check(mean: usize, cov: usize) -> Result<usize, FieldError> {
        let n = mean / 3;
        check_len("mean", mean, 3 * n)?;
        check_len("cov", cov, 6 * n)?;
        Ok(n)
    }
}

#[inline(always)]
fn quadratic(squares: &[f32; 6], cov: impl Fn(usize) -> f32) -> f32 {
    let [a, b, c, d, e, f] = *squares;
    (a * cov(0) + d * cov(3) + f * cov(5)) + (b * cov(1) + c * cov(2) + e * cov(4))
}

struct Project<'a> {
    columns: &'a [([f32; 3], [f32; 6])],
    n: usize,
    mean: &'a [f32],
    cov: &'a [f32],
    along: &'a mut [f32],
    var: &'a mut [f32],
}

impl Task for Project<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let n = self.n;
        if n == 0 {
            return;
        }
        let mean: [&[f32]; 3] = core::array::from_fn(|a| &self.mean[a * n..(a + 1) * n]);
        let cov: [&[f32]; 6] = core::array::from_fn(|a| &self.cov[a * n..(a + 1) * n]);
        let outs = self.along.chunks_exact_mut(n).zip(self.var.chunks_exact_mut(n));
        for ((p, squares), (along, var)) in self.columns.iter().zip(outs) {
            for i in 0..n {
                along[i] = p[0] * mean[0][i] + p[1] * mean[1][i] + p[2] * mean[2][i];
                let q = quadratic(squares, |a| cov[a][i]);
                // NaN is kept.
                var[i] = if q < 0.0 { 0.0 } else { q };
            }
        }
    }
}
