//! Real spherical harmonics of directions, up to `l = 4`.

use float_core::{Simd, Task, Vector, m32};

use super::lattice::cell::{BLOCK, Lanes};
use super::{axes, check_points, rows_mut};
use crate::FieldError;
use crate::error::check_len;

/// `c x^i y^j z^k`.
struct Term {
    c: f32,
    powers: [u8; 3],
}

const fn t(c: f64, i: u8, j: u8, k: u8) -> Term {
    Term { c: c as f32, powers: [i, j, k] }
}

/// Largest degree: bands `l = 0..=4`.
pub const MAX_DEGREE: usize = 5;

/// The orthonormal basis as polynomials on the unit sphere, index `l l + l + m`, with the Condon-Shortley phase.
#[rustfmt::skip]
static BASIS: [&[Term]; MAX_DEGREE * MAX_DEGREE] = [
    &[t(0.28209479177387814, 0, 0, 0)], // l = 0, m = 0
    &[t(-0.48860251190292, 0, 1, 0)], // l = 1, m = -1
    &[t(0.4886025119029199, 0, 0, 1)], // l = 1, m = 0
    &[t(-0.48860251190292, 1, 0, 0)], // l = 1, m = 1
    &[t(1.0925484305920792, 1, 1, 0)], // l = 2, m = -2
    &[t(-1.0925484305920792, 0, 1, 1)], // l = 2, m = -1
    &[t(-0.31539156525252005, 0, 0, 0), t(0.9461746957575601, 0, 0, 2)], // l = 2, m = 0
    &[t(-1.0925484305920792, 1, 0, 1)], // l = 2, m = 1
    &[t(0.5462742152960396, 2, 0, 0), t(-0.5462742152960396, 0, 2, 0)], // l = 2, m = 2
    &[t(-1.770130769779931, 2, 1, 0), t(0.5900435899266436, 0, 3, 0)], // l = 3, m = -3
    &[t(2.8906114426405547, 1, 1, 1)], // l = 3, m = -2
    &[t(0.4570457994644658, 0, 1, 0), t(-2.285228997322329, 0, 1, 2)], // l = 3, m = -1
    &[t(-1.1195289977703462, 0, 0, 1), t(1.865881662950577, 0, 0, 3)], // l = 3, m = 0
    &[t(0.4570457994644658, 1, 0, 0), t(-2.285228997322329, 1, 0, 2)], // l = 3, m = 1
    &[t(1.4453057213202773, 2, 0, 1), t(-1.4453057213202773, 0, 2, 1)], // l = 3, m = 2
    &[t(-0.5900435899266436, 3, 0, 0), t(1.770130769779931, 1, 2, 0)], // l = 3, m = 3
    &[t(2.503342941796705, 3, 1, 0), t(-2.503342941796705, 1, 3, 0)], // l = 4, m = -4
    &[t(-5.310392309339792, 2, 1, 1), t(1.7701307697799307, 0, 3, 1)], // l = 4, m = -3
    &[t(-0.94617469575756, 1, 1, 0), t(6.62322287030292, 1, 1, 2)], // l = 4, m = -2
    &[t(2.0071396306718676, 0, 1, 1), t(-4.683325804901025, 0, 1, 3)], // l = 4, m = -1
    &[t(0.31735664074561293, 0, 0, 0), t(-3.1735664074561294, 0, 0, 2), t(3.7024941420321507, 0, 0, 4)], // l = 4, m = 0
    &[t(2.0071396306718676, 1, 0, 1), t(-4.683325804901025, 1, 0, 3)], // l = 4, m = 1
    &[t(-0.47308734787878, 2, 0, 0), t(3.31161143515146, 2, 0, 2), t(0.47308734787878, 0, 2, 0), t(-3.31161143515146, 0, 2, 2)], // l = 4, m = 2
    &[t(-1.7701307697799307, 3, 0, 1), t(5.310392309339792, 1, 2, 1)], // l = 4, m = 3
    &[t(0.6258357354491763, 4, 0, 0), t(-3.7550144126950573, 2, 2, 0), t(0.6258357354491763, 0, 4, 0)], // l = 4, m = 4
];

/// Whether directions have unit length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// Any length: they are normalised first.
    Any,
    /// They have unit length, to rounding: saves the square root and the check. Gradients are tangent to the sphere, as
    /// those of `Any` are.
    Unit,
}

/// The basis of bands `l < degree`: `degree^2` functions of a direction.
///
/// Order and signs are those of instant-ngp, tiny-cuda-nn and 3D Gaussian splatting: `1, -y, z, -x, xy, …`, index
/// `l l + l + m`, with the Condon-Shortley phase. Directions are normalised first, and gradients go through the
/// normalisation: they do not depend on how the polynomials continue off the sphere.
///
/// # Shapes
/// * `d` `[3][n]` directions
/// * `out` `[degree^2][n]`
///
/// # Numerics
/// All SIMD levels give the same bits.
///
/// # Source
/// Müller et al., "Instant neural graphics primitives", 2022, section 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SphericalHarmonics {
    degree: usize,
    directions: Directions,
}

impl SphericalHarmonics {
    /// A basis of degree `1..=5`; 4 gives the usual 16 functions.
    ///
    /// # Errors
    /// [`FieldError::Config`].
    pub fn new(degree: usize, directions: Directions) -> Result<Self, FieldError> {
        if !(1..=MAX_DEGREE).contains(&degree) {
            return Err(FieldError::Config { what: "degree", got: degree as f64, accepts: "1 to 5" });
        }
        Ok(Self { degree, directions })
    }

    /// Rows of the output, `degree^2`.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.degree * self.degree
    }

    /// `out` `[degree^2][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`]; [`FieldError::Direction`] for a direction that is zero or not finite, except with
    /// [`Directions::Unit`].
    pub fn encode(&self, simd: Simd, d: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check(d, d.len(), out.len())?;
        let mut out = Rows { n: d.len() / 3, data: out };
        self.blocks(simd, d, |at, len, b| {
            for (r, terms) in BASIS[..self.out_rows()].iter().enumerate() {
                let mut y = [0.0; BLOCK];
                for term in *terms {
                    b.add(&mut y, term.c, term.powers);
                }
                out.row(r, at, len).copy_from_slice(&y[..len]);
            }
        });
        Ok(())
    }

    /// Adds to `d_bar` `[3][n]`.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn encode_backward(&self, simd: Simd, d: &[f32], out_bar: &[f32], d_bar: &mut [f32]) -> Result<(), FieldError> {
        self.check(d, d_bar.len(), out_bar.len())?;
        let n = d.len() / 3;
        let mut d_bar: [&mut [f32]; 3] = rows_mut(d_bar);
        self.blocks(simd, d, |at, len, b| {
            let u_bar = self.gradient(b, |r| block(&out_bar[r * n + at..][..len]));
            let tangential = b.project(&u_bar);
            for (d_bar, g) in d_bar.iter_mut().zip(&tangential) {
                add(&mut d_bar[at..][..len], g);
            }
        });
        Ok(())
    }

    /// Derivative along `d_dot` `[3][n]`: `out_dot` `[degree^2][n]`.
    ///
    /// Its gradient with respect to `d_dot` is [`encode_backward`](Self::encode_backward) of the tangent's cotangent.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn tangent(&self, simd: Simd, d: &[f32], d_dot: &[f32], out_dot: &mut [f32]) -> Result<(), FieldError> {
        self.check(d, d_dot.len(), out_dot.len())?;
        let d_dot = axes(d_dot);
        let mut out_dot = Rows { n: d.len() / 3, data: out_dot };
        self.blocks(simd, d, |at, len, b| {
            let u_dot = b.project(&d_dot.map(|row| block(&row[at..][..len])));
            for (r, terms) in BASIS[..self.out_rows()].iter().enumerate() {
                let mut y = [0.0; BLOCK];
                for term in *terms {
                    for (a, u_dot) in u_dot.iter().enumerate() {
                        if let Some((c, powers)) = term_derivative(term.c, term.powers, a) {
                            let mut derivative = [0.0; BLOCK];
                            b.add(&mut derivative, c, powers);
                            for i in 0..BLOCK {
                                y[i] += derivative[i] * u_dot[i];
                            }
                        }
                    }
                }
                out_dot.row(r, at, len).copy_from_slice(&y[..len]);
            }
        });
        Ok(())
    }

    /// Adds the gradient of [`tangent`](Self::tangent) with respect to `d` to `d_bar` `[3][n]`.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn tangent_backward_d(
        &self,
        simd: Simd,
        d: &[f32],
        d_dot: &[f32],
        out_dot_bar: &[f32],
        d_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(d, d_dot.len(), out_dot_bar.len())?;
        check_len("d_bar", d_bar.len(), d.len())?;
        let n = d.len() / 3;
        let d_dot = axes(d_dot);
        let mut d_bar: [&mut [f32]; 3] = rows_mut(d_bar);
        self.blocks(simd, d, |at, len, b| {
            let cotangent = |r: usize| block(&out_dot_bar[r * n + at..][..len]);
            let q = d_dot.map(|row| block(&row[at..][..len]));
            let u_dot = b.project(&q);
            let p = self.gradient(b, cotangent);
            let mut v = self.hessian_product(b, &u_dot, cotangent);
            // u_dot = (q - u (u . q)) / |d| depends on d through u, twice, and through |d|.
            let (uq, pu, pu_dot) = (dot(&b.u, &q), dot(&p, &b.u), dot(&p, &u_dot));
            for a in 0..3 {
                for i in 0..BLOCK {
                    v[a][i] -= (p[a][i] * uq[i] + q[a][i] * pu[i]) * b.inverse_norm[i];
                }
            }
            let tangential = b.project(&v);
            for a in 0..3 {
                let mut g = [0.0; BLOCK];
                for i in 0..BLOCK {
                    g[i] = tangential[a][i] - b.u[a][i] * pu_dot[i] * b.inverse_norm[i];
                }
                add(&mut d_bar[a][at..][..len], &g);
            }
        });
        Ok(())
    }

    /// `sum over r of g_r grad Y_r(u)`.
    #[inline(always)]
    fn gradient(&self, b: &Block, g: impl Fn(usize) -> Lanes) -> [Lanes; 3] {
        let mut sum = [[0.0; BLOCK]; 3];
        for (r, terms) in BASIS[..self.out_rows()].iter().enumerate() {
            let g = g(r);
            for (a, sum) in sum.iter_mut().enumerate() {
                let mut derivative = [0.0; BLOCK];
                for (c, powers) in terms.iter().filter_map(|term| term_derivative(term.c, term.powers, a)) {
                    b.add(&mut derivative, c, powers);
                }
                for i in 0..BLOCK {
                    sum[i] += g[i] * derivative[i];
                }
            }
        }
        sum
    }

    /// `sum over r of g_r Hessian Y_r(u) v`.
    #[inline(always)]
    fn hessian_product(&self, b: &Block, v: &[Lanes; 3], g: impl Fn(usize) -> Lanes) -> [Lanes; 3] {
        let mut sum = [[0.0; BLOCK]; 3];
        for (r, terms) in BASIS[..self.out_rows()].iter().enumerate() {
            let g = g(r);
            for (a, sum) in sum.iter_mut().enumerate() {
                for (e, v) in v.iter().enumerate() {
                    let mut second = [0.0; BLOCK];
                    let first = terms.iter().filter_map(|term| term_derivative(term.c, term.powers, a));
                    for (c, powers) in first.filter_map(|(c, powers)| term_derivative(c, powers, e)) {
                        b.add(&mut second, c, powers);
                    }
                    for i in 0..BLOCK {
                        sum[i] += g[i] * second[i] * v[i];
                    }
                }
            }
        }
        sum
    }

    fn check(&self, d: &[f32], like_d: usize, out: usize) -> Result<(), FieldError> {
        check_points(d)?;
        check_len("d_dot", like_d, d.len())?;
        check_len("out", out, d.len() / 3 * self.out_rows())?;
        if self.directions == Directions::Any {
            let [x, y, z] = axes(d);
            let bad = |i: &usize| {
                let largest = x[*i].abs().max(y[*i].abs()).max(z[*i].abs());
                let sum = x[*i] + y[*i] + z[*i];
                largest == 0.0 || largest.is_infinite() || sum.is_nan()
            };
            if let Some(index) = (0..x.len()).find(bad) {
                return Err(FieldError::Direction { index });
            }
        }
        Ok(())
    }

    /// Call `body` with the start, the length and the powers of each block of directions.
    fn blocks(&self, simd: Simd, d: &[f32], body: impl FnMut(usize, usize, &Block)) {
        simd.run(Blocks { directions: self.directions, d: axes(d), body });
    }
}

struct Blocks<'a, F> {
    directions: Directions,
    d: [&'a [f32]; 3],
    body: F,
}

impl<F: FnMut(usize, usize, &Block)> Task for Blocks<'_, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let n = self.d[0].len();
        for at in (0..n).step_by(BLOCK) {
            let len = BLOCK.min(n - at);
            let b = Block::new(self.directions, self.d.map(|row| block(&row[at..][..len])));
            (self.body)(at, len, &b);
        }
    }
}

/// Sixteen directions and their powers.
struct Block {
    u: [Lanes; 3],
    /// `1 / |d|`.
    inverse_norm: Lanes,
    /// `u_a^k`.
    powers: [[Lanes; MAX_DEGREE]; 3],
}

impl Block {
    #[inline(always)]
    fn new(directions: Directions, d: [Lanes; 3]) -> Self {
        let [dx, dy, dz] = &d;
        let mut b = Self { u: d, inverse_norm: [1.0; BLOCK], powers: [[[1.0; BLOCK]; MAX_DEGREE]; 3] };
        if directions == Directions::Any {
            for i in 0..BLOCK {
                let [x, y, z] = [dx[i], dy[i], dz[i]];
                // Scaled, so that squares neither overflow nor vanish. Lanes past the end are 0.
                let largest = x.abs().max(y.abs()).max(z.abs());
                let largest = if largest > 0.0 { largest } else { 1.0 };
                let [x, y, z] = [x / largest, y / largest, z / largest];
                let norm = m32::sqrt(x * x + y * y + z * z);
                let norm = if norm > 0.0 { norm } else { 1.0 };
                b.u[0][i] = x / norm;
                b.u[1][i] = y / norm;
                b.u[2][i] = z / norm;
                b.inverse_norm[i] = 1.0 / norm / largest;
            }
        }
        for a in 0..3 {
            for k in 1..MAX_DEGREE {
                for i in 0..BLOCK {
                    b.powers[a][k][i] = b.powers[a][k - 1][i] * b.u[a][i];
                }
            }
        }
        b
    }

    /// `y += c x^i y^j z^k`.
    #[inline(always)]
    fn add(&self, y: &mut Lanes, c: f32, [j, k, l]: [u8; 3]) {
        let [px, py, pz] = [&self.powers[0][j as usize], &self.powers[1][k as usize], &self.powers[2][l as usize]];
        for i in 0..BLOCK {
            y[i] += c * px[i] * py[i] * pz[i];
        }
    }

    /// `(v - u (u . v)) / |d|`: the (symmetric) Jacobian of the normalisation times `v`.
    #[inline(always)]
    fn project(&self, v: &[Lanes; 3]) -> [Lanes; 3] {
        let uv = dot(&self.u, v);
        let mut out = [[0.0; BLOCK]; 3];
        for a in 0..3 {
            for i in 0..BLOCK {
                out[a][i] = (v[a][i] - self.u[a][i] * uv[i]) * self.inverse_norm[i];
            }
        }
        out
    }
}

/// Derivative of a term along an axis, if it is not 0.
#[inline(always)]
fn term_derivative(c: f32, mut powers: [u8; 3], axis: usize) -> Option<(f32, [u8; 3])> {
    let power = powers[axis];
    powers[axis] = power.checked_sub(1)?;
    Some((c * f32::from(power), powers))
}

#[inline(always)]
fn dot(a: &[Lanes; 3], b: &[Lanes; 3]) -> Lanes {
    let mut out = [0.0; BLOCK];
    for i in 0..BLOCK {
        out[i] = a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i];
    }
    out
}

#[inline(always)]
fn block(row: &[f32]) -> Lanes {
    let mut lanes = [0.0; BLOCK];
    lanes[..row.len()].copy_from_slice(row);
    lanes
}

#[inline(always)]
fn add(row: &mut [f32], lanes: &Lanes) {
    for (x, lane) in row.iter_mut().zip(lanes) {
        *x += lane;
    }
}

/// Stretches of the rows of a matrix.
struct Rows<'a> {
    n: usize,
    data: &'a mut [f32],
}

impl Rows<'_> {
    #[inline(always)]
    fn row(&mut self, r: usize, at: usize, len: usize) -> &mut [f32] {
        &mut self.data[r * self.n + at..][..len]
    }
}
