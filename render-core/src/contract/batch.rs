//! Contraction of many `f32` points, feature-major, in vectors.

use float_core::{Simd, Task, Vector};

use super::Norm;
use crate::error::{RenderError, check_len};

/// [`contract`](super::contract) of `n` points.
///
/// # Shapes
/// * `x` `[3][n]` points
/// * `y` `[3][n]` out
///
/// # Errors
/// [`RenderError::Shape`] when `x` is not a multiple of 3 long, or `y` is of another length.
pub fn contract_batch(simd: Simd, norm: Norm, x: &[f32], y: &mut [f32]) -> Result<(), RenderError> {
    let n = x.len() / 3;
    check_len("x", 3 * n, x.len())?;
    check_len("y", 3 * n, y.len())?;
    simd.run(Forward { norm, n, x, y });
    Ok(())
}

/// Gradient of [`contract_batch`]: adds `J^T y_bar` of each point to `x_bar`.
///
/// # Shapes
/// * `x`, `y_bar`, `x_bar` `[3][n]`
///
/// # Errors
/// [`RenderError::Shape`] when the lengths disagree.
pub fn contract_batch_backward(
    simd: Simd,
    norm: Norm,
    x: &[f32],
    y_bar: &[f32],
    x_bar: &mut [f32],
) -> Result<(), RenderError> {
    let n = x.len() / 3;
    check_len("x", 3 * n, x.len())?;
    check_len("y_bar", 3 * n, y_bar.len())?;
    check_len("x_bar", 3 * n, x_bar.len())?;
    simd.run(Backward { norm, n, x, y_bar, x_bar });
    Ok(())
}

/// Points `at .. at + LANES` of a `[3][n]` array; lanes past the end are 0.
#[inline(always)]
fn load<V: Vector>(x: &[f32], n: usize, at: usize) -> [V; 3] {
    if at + V::LANES <= n {
        return [V::load(&x[at..]), V::load(&x[n + at..]), V::load(&x[2 * n + at..])];
    }
    core::array::from_fn(|a| {
        let mut lanes = [0.0; MAX_LANES];
        lanes[..n - at].copy_from_slice(&x[a * n + at..(a + 1) * n]);
        V::load(&lanes)
    })
}

#[inline(always)]
fn store<V: Vector>(v: [V; 3], x: &mut [f32], n: usize, at: usize) {
    for (a, v) in v.into_iter().enumerate() {
        let row = &mut x[a * n + at..(a + 1) * n];
        if row.len() >= V::LANES {
            v.store(row);
        } else {
            let mut lanes = [0.0; MAX_LANES];
            v.store(&mut lanes);
            row.copy_from_slice(&lanes[..row.len()]);
        }
    }
}

/// Lanes of the widest vector.
const MAX_LANES: usize = 16;

/// Direction, `1 / m`, and `m - 1`, which is positive outside of the unit ball.
///
/// Inside, the first two may hold anything.
#[inline(always)]
fn outside<V: Vector>(norm: Norm, x: [V; 3]) -> ([V; 3], V, V) {
    let abs = |v: V| v.max(-v);
    // At least one half: lanes inside of the unit ball don't divide by 0.
    let s = abs(x[0]).max(abs(x[1])).max(abs(x[2])).max(V::splat(0.5));
    let u = x.map(|x| x / s);
    let n = match norm {
        Norm::L2 => u[0].mul_add(u[0], u[1].mul_add(u[1], u[2] * u[2])).sqrt(),
        Norm::Max => V::splat(1.0),
    };
    (u.map(|u| u / n), V::splat(1.0) / s / n, s * n - V::splat(1.0))
}

struct Forward<'a> {
    norm: Norm,
    n: usize,
    x: &'a [f32],
    y: &'a mut [f32],
}

impl Task for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        const { assert!(V::LANES <= MAX_LANES) };
        for at in (0..self.n).step_by(V::LANES) {
            let x = load::<V>(self.x, self.n, at);
            let (u, inv_m, beyond) = outside(self.norm, x);
            let factor = V::splat(2.0) - inv_m;
            let y = core::array::from_fn(|a| beyond.select_positive(factor * u[a], x[a]));
            store(y, self.y, self.n, at);
        }
    }
}

struct Backward<'a> {
    norm: Norm,
    n: usize,
    x: &'a [f32],
    y_bar: &'a [f32],
    x_bar: &'a mut [f32],
}

impl Task for Backward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        const { assert!(V::LANES <= MAX_LANES) };
        let one = V::splat(1.0);
        for at in (0..self.n).step_by(V::LANES) {
            let x = load::<V>(self.x, self.n, at);
            let y_bar = load::<V>(self.y_bar, self.n, at);
            let x_bar = load::<V>(self.x_bar, self.n, at);
            let (u, inv_m, beyond) = outside(self.norm, x);
            let across = (V::splat(2.0) - inv_m) * inv_m;
            let along = u[0].mul_add(y_bar[0], u[1].mul_add(y_bar[1], u[2] * y_bar[2]));
            let radial = match self.norm {
                Norm::L2 => {
                    let k = (inv_m * inv_m - across) * along;
                    u.map(|u| u * k)
                }
                Norm::Max => {
                    // u[k] is the sign of the largest coordinate k, which takes all of the radial part.
                    let k = V::splat(2.0) * inv_m * (inv_m - one) * along;
                    let zero = V::splat(0.0);
                    let [a, b, c] = u.map(|u| u.max(-u));
                    let first = (a.max(b).max(c) - a).select_positive(zero, one);
                    let second = (b.max(c) - b).select_positive(zero, one) * (one - first);
                    let third = one - first - second;
                    [u[0] * k * first, u[1] * k * second, u[2] * k * third]
                }
            };
            let new = core::array::from_fn(|a| {
                x_bar[a] + beyond.select_positive(across.mul_add(y_bar[a], radial[a]), y_bar[a])
            });
            store(new, self.x_bar, self.n, at);
        }
    }
}
