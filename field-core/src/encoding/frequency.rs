//! Frequency (positional) encoding: sines and cosines of octaves.

use float_core::{Simd, Task, Vector, vecmath};

use super::lattice::cell::{BLOCK, Lanes};
use crate::FieldError;
use crate::error::check_len;

/// The frequency of octave 0; octave `k` has `2^k` times that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// `sin(2^k x)`: the released NeRF code.
    One,
    /// `sin(2^k pi x)`: the NeRF paper.
    Pi,
}

/// Whether the input itself is part of the encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identity {
    /// In front: the released NeRF code.
    Include,
    /// Sines and cosines only: the NeRF paper.
    Omit,
}

/// Encoding of `dims` numbers by `octaves` octaves.
///
/// Rows of the output: `x` if included, then for each octave `k` the sines of all dimensions and the cosines of all
/// dimensions.
///
/// # Shapes
/// * `x` `[dims][n]`
/// * `window` `[octaves]` weights of the octaves, `None` for 1; see [`window`](super::window). Never weights `x` itself
/// * `out` `[out_rows][n]`
///
/// # Numerics
/// The product of input and power of two is exact, and so is the reduction of what comes out of it
/// ([`vecmath::sin_cos`], [`vecmath::sin_cos_pi`]): sines and cosines are within 2 units in the last place for all octaves,
/// at every SIMD level with the same bits. NaN, infinity and products past `f32::MAX` give NaN.
///
/// Octaves of weight 0 are not computed: their rows are `+0`, they add nothing to gradients. That is what computing them and
/// multiplying by 0 gives, but for two things: where the product would be `-0` there is `+0` (numerically equal, and no sum
/// but one of `-0` alone can tell), and where `x` is NaN or infinite a closed octave is 0, not NaN. The open octaves and `x`
/// itself still pass NaN on.
///
/// # Source
/// Mildenhall et al., "NeRF", 2020, eq. 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frequency {
    dims: usize,
    octaves: usize,
    base: Base,
    identity: Identity,
}

/// Most octaves: `2^31` times the base.
const MAX_OCTAVES: usize = 32;

impl Frequency {
    /// An encoding.
    ///
    /// # Errors
    /// [`FieldError::Config`] for `dims = 0`, more than 32 octaves, or no output at all.
    pub fn new(dims: usize, octaves: usize, base: Base, identity: Identity) -> Result<Self, FieldError> {
        let refuse = |what, got: usize, accepts| Err(FieldError::Config { what, got: got as f64, accepts });
        if dims == 0 {
            return refuse("dims", dims, "at least 1");
        }
        if octaves > MAX_OCTAVES || (octaves == 0 && identity == Identity::Omit) {
            return refuse("octaves", octaves, "1 to 32, or 0 with the input itself");
        }
        Ok(Self { dims, octaves, base, identity })
    }

    /// Numbers encoded.
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
        self.identity_rows() + 2 * self.dims * self.octaves
    }

    fn identity_rows(&self) -> usize {
        if self.identity == Identity::Include { self.dims } else { 0 }
    }

    /// `out` `[out_rows][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, x: &[f32], window: Option<&[f32]>, out: &mut [f32]) -> Result<(), FieldError> {
        let n = self.check(x, window, out.len(), "out")?;
        let identity = self.identity_rows() * n;
        out[..identity].copy_from_slice(&x[..identity]);
        self.close(window, n, out);
        self.octaves_of(simd, x, window, |o, sin, cos| {
            let w = o.window;
            put(&mut out[o.sin_row * n + o.at..][..o.len], sin, |_, s| w * s);
            put(&mut out[o.cos_row * n + o.at..][..o.len], cos, |_, c| w * c);
        });
        Ok(())
    }

    /// Adds to `x_bar` `[dims][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(
        &self,
        simd: Simd,
        x: &[f32],
        window: Option<&[f32]>,
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = self.check(x, window, out_bar.len(), "out_bar")?;
        check_len("x_bar", x_bar.len(), x.len())?;
        let identity = self.identity_rows() * n;
        for (x_bar, out_bar) in x_bar.iter_mut().zip(&out_bar[..identity]) {
            *x_bar += out_bar;
        }
        self.octaves_of(simd, x, window, |o, sin, cos| {
            let s_bar = &out_bar[o.sin_row * n + o.at..][..o.len];
            let c_bar = &out_bar[o.cos_row * n + o.at..][..o.len];
            let factor = o.window * o.frequency;
            let x_bar = &mut x_bar[o.dim * n + o.at..][..o.len];
            for i in 0..o.len {
                x_bar[i] += factor * (cos[i] * s_bar[i] - sin[i] * c_bar[i]);
            }
        });
        Ok(())
    }

    /// Derivative along `x_dot` `[dims][n]`: `out_dot` `[out_rows][n]`.
    ///
    /// Its gradient with respect to `x_dot` is [`encode_backward`](Self::encode_backward) of the tangent's cotangent.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        x: &[f32],
        window: Option<&[f32]>,
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = self.check(x, window, out_dot.len(), "out_dot")?;
        check_len("x_dot", x_dot.len(), x.len())?;
        let identity = self.identity_rows() * n;
        out_dot[..identity].copy_from_slice(&x_dot[..identity]);
        self.close(window, n, out_dot);
        self.octaves_of(simd, x, window, |o, sin, cos| {
            let factor = o.window * o.frequency;
            let dot = &x_dot[o.dim * n + o.at..][..o.len];
            put(&mut out_dot[o.sin_row * n + o.at..][..o.len], cos, |i, c| factor * dot[i] * c);
            put(&mut out_dot[o.cos_row * n + o.at..][..o.len], sin, |i, s| -factor * dot[i] * s);
        });
        Ok(())
    }

    /// Adds the gradient of [`tangent`](Self::tangent) with respect to `x` to `x_bar` `[dims][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward_x(
        &self,
        simd: Simd,
        x: &[f32],
        window: Option<&[f32]>,
        x_dot: &[f32],
        out_dot_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        let n = self.check(x, window, out_dot_bar.len(), "out_dot_bar")?;
        check_len("x_dot", x_dot.len(), x.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        self.octaves_of(simd, x, window, |o, sin, cos| {
            let s_bar = &out_dot_bar[o.sin_row * n + o.at..][..o.len];
            let c_bar = &out_dot_bar[o.cos_row * n + o.at..][..o.len];
            let factor = o.window * o.frequency * o.frequency;
            let dot = &x_dot[o.dim * n + o.at..][..o.len];
            let x_bar = &mut x_bar[o.dim * n + o.at..][..o.len];
            for i in 0..o.len {
                x_bar[i] -= factor * dot[i] * (sin[i] * s_bar[i] + cos[i] * c_bar[i]);
            }
        });
        Ok(())
    }

    fn check(&self, x: &[f32], window: Option<&[f32]>, rows: usize, what: &'static str) -> Result<usize, FieldError> {
        let n = x.len() / self.dims;
        check_len("x", x.len(), n * self.dims)?;
        check_len(what, rows, n * self.out_rows())?;
        window.map_or(Ok(()), |w| check_len("window", w.len(), self.octaves))?;
        Ok(n)
    }

    /// Zeros for the rows of octaves that [`octaves_of`](Self::octaves_of) passes over.
    fn close(&self, window: Option<&[f32]>, n: usize, out: &mut [f32]) {
        let octaves = out[self.identity_rows() * n..].chunks_exact_mut((2 * self.dims * n).max(1));
        for (out, _) in octaves.zip(window.unwrap_or_default()).filter(|(_, w)| **w == 0.0) {
            out.fill(0.0);
        }
    }

    /// Call `body` for each dimension, block of samples and octave whose weight is not 0.
    fn octaves_of(&self, simd: Simd, x: &[f32], window: Option<&[f32]>, body: impl FnMut(Octave, &Lanes, &Lanes)) {
        simd.run(Octaves { encoding: *self, x, window, body });
    }
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
    window: f32,
}

struct Octaves<'a, F> {
    encoding: Frequency,
    x: &'a [f32],
    window: Option<&'a [f32]>,
    body: F,
}

impl<F: FnMut(Octave, &Lanes, &Lanes)> Task for Octaves<'_, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let Frequency { dims, octaves, base, .. } = self.encoding;
        let kappa = match base {
            Base::One => 1.0,
            Base::Pi => core::f64::consts::PI,
        };
        let n = self.x.len() / dims;
        let first = self.encoding.identity_rows();
        for dim in 0..dims {
            let row = &self.x[dim * n..(dim + 1) * n];
            for (block, row) in row.chunks(BLOCK).enumerate() {
                let mut x = [0.0; BLOCK];
                x[..row.len()].copy_from_slice(row);
                for k in 0..octaves {
                    let window = self.window.map_or(1.0, |w| w[k]);
                    if window == 0.0 {
                        continue;
                    }
                    let octave = (1_u64 << k) as f32;
                    let frequency = (kappa * f64::from(octave)) as f32;
                    let (sin, cos) = sin_cos::<V>(&x, octave, base);
                    let sin_row = first + 2 * k * dims + dim;
                    let part = Octave {
                        dim,
                        at: block * BLOCK,
                        len: row.len(),
                        sin_row,
                        cos_row: sin_row + dims,
                        frequency,
                        window,
                    };
                    (self.body)(part, &sin, &cos);
                }
            }
        }
    }
}

/// Sines and cosines of `octave * x`, or `pi` times that. `octave` is a power of two.
#[inline(always)]
fn sin_cos<V: Vector>(x: &Lanes, octave: f32, base: Base) -> (Lanes, Lanes) {
    let (mut sin, mut cos) = ([0.0; BLOCK], [0.0; BLOCK]);
    let out = sin.chunks_exact_mut(V::LANES).zip(cos.chunks_exact_mut(V::LANES));
    for (x, (sin, cos)) in x.chunks_exact(V::LANES).zip(out) {
        let x = V::load(x) * V::splat(octave);
        let (s, c) = match base {
            Base::One => vecmath::sin_cos(x),
            Base::Pi => vecmath::sin_cos_pi(x),
        };
        s.store(sin);
        c.store(cos);
    }
    (sin, cos)
}

/// `row[i] = f(i, lanes[i])`.
#[inline(always)]
fn put(row: &mut [f32], lanes: &Lanes, f: impl Fn(usize, f32) -> f32) {
    for (i, (row, &lane)) in row.iter_mut().zip(lanes).enumerate() {
        *row = f(i, lane);
    }
}
