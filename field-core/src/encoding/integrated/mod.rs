//! Integrated encoding: the mean of a frequency encoding over a Gaussian instead of its value at a point.
//!
//! Octaves finer than the Gaussian are damped, so that a network gets no detail that a pixel cannot resolve.
//! Along the coordinate axes [`Integrated`] takes means and the diagonal of the covariances as they are; along other
//! directions [`Projection`] comes first, for instance onto those of an [`icosahedron`].

mod icosahedron;
mod projection;

pub use icosahedron::icosahedron;
pub use projection::Projection;

use super::lattice::cell::{BLOCK, Lanes};
use crate::FieldError;
use crate::error::check_len;
use float_core::{Simd, Task, Vector, vecmath};

/// Encoding of Gaussians with `dims` independent coordinates by `octaves` octaves.
///
/// Rows of the output, for each octave `k`: for all dimensions `exp(-4^k var / 2) sin(2^k mean)`, then for all dimensions
/// the same with the cosine. The order is that of [`Frequency`](super::frequency::Frequency), and so are the values where
/// the variance is 0. On the tape ([`Encoder`](crate::tape::Encoder)) the input is `[mean; var]`, `2 dims` rows.
///
/// # Shapes
/// * `mean`, `var` `[dims][n]`; variances `>= 0` (smaller ones count as 0)
/// * `out` `[out_rows][n]`
///
/// # Numerics
/// Products with powers of two and the reduction of what comes out are exact: sines are within 2 units in the last place for
/// all octaves. Factors below `1e-38` are exactly 0, also for
/// an infinite variance; blocks of samples where all are 0 cost no sine. NaN gives NaN, and so do means whose
/// product with the frequency is infinite.
///
/// # Source
/// Barron et al., "Mip-NeRF", 2021, eqs. 12 to 16.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Integrated {
    dims: usize,
    octaves: usize,
}

/// Gaussians with independent coordinates, or a direction in the space of them.
#[derive(Clone, Copy, Debug)]
pub struct Gaussians<'a> {
    /// Means, `[dims][n]`.
    pub mean: &'a [f32],
    /// Variances, `[dims][n]`.
    pub var: &'a [f32],
}

impl<'a> Gaussians<'a> {
    /// The halves of `[mean; var]`, `[2 dims][n]`.
    #[must_use]
    pub fn stacked(rows: &'a [f32]) -> Self {
        let (mean, var) = rows.split_at(rows.len() / 2);
        Self { mean, var }
    }

    /// Whether this is a direction at `at`.
    fn check_dot(self, at: Gaussians<'_>) -> Result<(), FieldError> {
        check_len("mean_dot", self.mean.len(), at.mean.len())?;
        check_len("var_dot", self.var.len(), at.var.len())
    }
}

/// Most octaves: `2^31`.
const MAX_OCTAVES: usize = 32;

impl Integrated {
    /// An encoding.
    ///
    /// # Errors
    /// [`FieldError::Config`] for `dims = 0`, no octave or more than 32.
    pub fn new(dims: usize, octaves: usize) -> Result<Self, FieldError> {
        if dims == 0 {
            return Err(FieldError::Config { what: "dims", got: 0.0, accepts: "at least 1" });
        }
        if !(1..=MAX_OCTAVES).contains(&octaves) {
            return Err(FieldError::Config { what: "octaves", got: octaves as f64, accepts: "1 to 32" });
        }
        Ok(Self { dims, octaves })
    }

    /// Coordinates encoded.
    #[must_use]
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// Octaves.
    #[must_use]
    pub fn octaves(&self) -> usize {
        self.octaves
    }

    /// Rows of the output.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        2 * self.dims * self.octaves
    }

    /// `out` `[out_rows][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, mean: &[f32], var: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        let n = self.check(mean, var, out.len(), "out")?;
        simd.run(Octaves {
            encoding: *self,
            mean,
            var,
            body: |o: Octave, sin: &Lanes, cos: &Lanes| {
                out[o.sin_row * n + o.at..][..o.len].copy_from_slice(&sin[..o.len]);
                out[o.cos_row * n + o.at..][..o.len].copy_from_slice(&cos[..o.len]);
            },
        });
        Ok(())
    }

    /// Adds to `mean_bar` and `var_bar` `[dims][n]`; `None` skips one.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(
        &self,
        simd: Simd,
        mean: &[f32],
        var: &[f32],
        out_bar: &[f32],
        mut mean_bar: Option<&mut [f32]>,
        mut var_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        let n = self.check(mean, var, out_bar.len(), "out_bar")?;
        check_bars(mean.len(), &mean_bar, &var_bar)?;
        simd.run(Octaves {
            encoding: *self,
            mean,
            var,
            body: |o: Octave, sin: &Lanes, cos: &Lanes| {
                add_gradients(&o, n, sin, cos, out_bar, mean_bar.as_deref_mut(), var_bar.as_deref_mut());
            },
        });
        Ok(())
    }

    /// Derivative along `dot`: `out_dot` `[out_rows][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        at: Gaussians<'_>,
        dot: Gaussians<'_>,
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = self.check(at.mean, at.var, out_dot.len(), "out_dot")?;
        dot.check_dot(at)?;
        simd.run(Octaves {
            encoding: *self,
            mean: at.mean,
            var: at.var,
            body: |o: Octave, sin: &Lanes, cos: &Lanes| {
                let (sin, cos) = tangent_of(&o, n, sin, cos, dot.mean, dot.var);
                out_dot[o.sin_row * n + o.at..][..o.len].copy_from_slice(&sin[..o.len]);
                out_dot[o.cos_row * n + o.at..][..o.len].copy_from_slice(&cos[..o.len]);
            },
        });
        Ok(())
    }

    /// Adds the gradient of [`tangent`](Self::tangent) with respect to `mean` and `var` to their bars.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward(
        &self,
        simd: Simd,
        at: Gaussians<'_>,
        dot: Gaussians<'_>,
        out_dot_bar: &[f32],
        mut mean_bar: Option<&mut [f32]>,
        mut var_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        let n = self.check(at.mean, at.var, out_dot_bar.len(), "out_dot_bar")?;
        dot.check_dot(at)?;
        check_bars(at.mean.len(), &mean_bar, &var_bar)?;
        simd.run(Octaves {
            encoding: *self,
            mean: at.mean,
            var: at.var,
            body: |o: Octave, sin: &Lanes, cos: &Lanes| {
                // With z = cos + i sin, the tangent is z w and its derivatives are those of z, times w.
                let (sin, cos) = tangent_of(&o, n, sin, cos, dot.mean, dot.var);
                add_gradients(&o, n, &sin, &cos, out_dot_bar, mean_bar.as_deref_mut(), var_bar.as_deref_mut());
            },
        });
        Ok(())
    }

    fn check(&self, mean: &[f32], var: &[f32], rows: usize, what: &'static str) -> Result<usize, FieldError> {
        let n = mean.len() / self.dims;
        check_len("mean", mean.len(), n * self.dims)?;
        check_len("var", var.len(), mean.len())?;
        check_len(what, rows, n * self.out_rows())?;
        Ok(n)
    }
}

fn check_bars(len: usize, mean_bar: &Option<&mut [f32]>, var_bar: &Option<&mut [f32]>) -> Result<(), FieldError> {
    mean_bar.as_ref().map_or(Ok(()), |bar| check_len("mean_bar", bar.len(), len))?;
    var_bar.as_ref().map_or(Ok(()), |bar| check_len("var_bar", bar.len(), len))
}

/// `dz / dmean = i F z`, `dz / dvar = -F^2 z / 2` for `z = cos + i sin` (damped) of frequency `F`, transposed.
#[inline(always)]
fn add_gradients(
    o: &Octave,
    n: usize,
    sin: &Lanes,
    cos: &Lanes,
    out_bar: &[f32],
    mean_bar: Option<&mut [f32]>,
    var_bar: Option<&mut [f32]>,
) {
    let s_bar = &out_bar[o.sin_row * n + o.at..][..o.len];
    let c_bar = &out_bar[o.cos_row * n + o.at..][..o.len];
    if let Some(bar) = mean_bar {
        for (i, bar) in bar[o.dim * n + o.at..][..o.len].iter_mut().enumerate() {
            *bar += o.frequency * (cos[i] * s_bar[i] - sin[i] * c_bar[i]);
        }
    }
    if let Some(bar) = var_bar {
        let factor = -0.5 * o.frequency * o.frequency;
        for (i, bar) in bar[o.dim * n + o.at..][..o.len].iter_mut().enumerate() {
            *bar += factor * (sin[i] * s_bar[i] + cos[i] * c_bar[i]);
        }
    }
}

/// `z (-F^2 var_dot / 2 + i F mean_dot)` as `(sin, cos)`.
#[inline(always)]
fn tangent_of(o: &Octave, n: usize, sin: &Lanes, cos: &Lanes, mean_dot: &[f32], var_dot: &[f32]) -> (Lanes, Lanes) {
    let mean_dot = &mean_dot[o.dim * n + o.at..][..o.len];
    let var_dot = &var_dot[o.dim * n + o.at..][..o.len];
    let (mut s, mut c) = ([0.0; BLOCK], [0.0; BLOCK]);
    for i in 0..o.len {
        let (damp, turn) = (-0.5 * o.frequency * o.frequency * var_dot[i], o.frequency * mean_dot[i]);
        s[i] = damp * sin[i] + turn * cos[i];
        c[i] = damp * cos[i] - turn * sin[i];
    }
    (s, c)
}

/// Where the sines and cosines of a block belong.
struct Octave {
    dim: usize,
    /// First sample of the block.
    at: usize,
    /// Its samples.
    len: usize,
    sin_row: usize,
    cos_row: usize,
    frequency: f32,
}

/// Calls `body` with the damped sines and cosines of each dimension, block of samples and octave.
struct Octaves<'a, F> {
    encoding: Integrated,
    mean: &'a [f32],
    var: &'a [f32],
    body: F,
}

impl<F: FnMut(Octave, &Lanes, &Lanes)> Task for Octaves<'_, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let Integrated { dims, octaves } = self.encoding;
        let n = self.mean.len() / dims;
        for dim in 0..dims {
            let rows = [self.mean, self.var].map(|x| &x[dim * n..(dim + 1) * n]);
            for (block, (mean_row, var_row)) in rows[0].chunks(BLOCK).zip(rows[1].chunks(BLOCK)).enumerate() {
                let (mut mean, mut var) = ([0.0; BLOCK], [0.0; BLOCK]);
                mean[..mean_row.len()].copy_from_slice(mean_row);
                var[..var_row.len()].copy_from_slice(var_row);
                let finite = mean.iter().all(|x| x.is_finite());
                for k in 0..octaves {
                    let frequency = (1_u64 << k) as f32;
                    let damp = damping::<V>(0.5 * frequency * frequency, &var);
                    let (sin, cos) = if finite && damp == [0.0; BLOCK] {
                        ([0.0; BLOCK], [0.0; BLOCK])
                    } else {
                        let (s, c) = sin_cos::<V>(&mean, frequency);
                        (times(&damp, &s), times(&damp, &c))
                    };
                    let sin_row = 2 * k * dims + dim;
                    let octave = Octave {
                        dim,
                        at: block * BLOCK,
                        len: mean_row.len(),
                        sin_row,
                        cos_row: sin_row + dims,
                        frequency,
                    };
                    (self.body)(octave, &sin, &cos);
                }
            }
        }
    }
}

/// `(sin(frequency x), cos(frequency x))` of each lane.
#[inline(always)]
fn sin_cos<V: Vector>(x: &Lanes, frequency: f32) -> (Lanes, Lanes) {
    let (mut sin, mut cos) = ([0.0; BLOCK], [0.0; BLOCK]);
    for j in (0..BLOCK).step_by(V::LANES) {
        let (s, c) = vecmath::sin_cos(V::load(&x[j..]) * V::splat(frequency));
        s.store(&mut sin[j..]);
        c.store(&mut cos[j..]);
    }
    (sin, cos)
}

/// `exp(-half var)` of each lane; 1 for variances below 0, NaN for NaN.
#[inline(always)]
fn damping<V: Vector>(half: f32, var: &Lanes) -> Lanes {
    let mut out = [0.0; BLOCK];
    let mut x = [0.0; BLOCK];
    for (x, &var) in x.iter_mut().zip(var) {
        *x = if var > 0.0 { half * var } else { 0.0 };
    }
    for j in (0..BLOCK).step_by(V::LANES) {
        vecmath::exp_neg(V::load(&x[j..])).store(&mut out[j..]);
    }
    for (out, &var) in out.iter_mut().zip(var) {
        *out = if var.is_nan() { var } else { *out };
    }
    out
}

#[inline(always)]
fn times(a: &Lanes, b: &Lanes) -> Lanes {
    core::array::from_fn(|i| a[i] * b[i])
}
