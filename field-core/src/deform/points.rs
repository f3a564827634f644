//! Rigid motions of many points without a tape.

use crate::FieldError;
use crate::error::check_len;
use crate::stumpff::Lanes;
use float_core::{MAX_LANES, Simd, Task, Vector};

/// The rigid motion `exp(omega, v)` of each point applied to it: [`rigid`](super::rigid) without a tape.
///
/// # Shapes and units
/// All `[3][n]`: `x` world units, `omega` radians, `v` and `out` as `x`. `out` is written.
///
/// # Numerics
/// Values within 1e-6 of their size up to a few turns; with its backward twin finite up to angles of 1e12 (about 1e18 the
/// square of the angle times a coordinate leaves `f32`). With `omega = v = 0` the result is `x` to the bit.
///
/// # Errors
/// [`FieldError::Shape`] where lengths disagree or are not a multiple of 3.
pub fn rigid_points(simd: Simd, x: &[f32], omega: &[f32], v: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
    let n = samples(x, omega, v)?;
    check_len("out", out.len(), x.len())?;
    simd.run(Forward { n, at: [x, omega, v], out });
    Ok(())
}

/// Gradients of the inputs of [`rigid_points`], each `[3][n]`.
#[derive(Debug)]
pub struct RigidBars<'b> {
    /// Of the points.
    pub x: &'b mut [f32],
    /// Of the rotation vectors.
    pub omega: &'b mut [f32],
    /// Of `v`.
    pub v: &'b mut [f32],
}

/// Backward twin of [`rigid_points`]: adds into `bars`.
///
/// # Errors
/// As [`rigid_points`].
pub fn rigid_points_backward(
    simd: Simd,
    x: &[f32],
    omega: &[f32],
    v: &[f32],
    out_bar: &[f32],
    bars: RigidBars<'_>,
) -> Result<(), FieldError> {
    let n = samples(x, omega, v)?;
    check_len("out_bar", out_bar.len(), x.len())?;
    check_len("x_bar", bars.x.len(), x.len())?;
    check_len("omega_bar", bars.omega.len(), x.len())?;
    check_len("v_bar", bars.v.len(), x.len())?;
    simd.run(Backward { n, at: [x, omega, v], out_bar, bars: [bars.x, bars.omega, bars.v] });
    Ok(())
}

fn samples(x: &[f32], omega: &[f32], v: &[f32]) -> Result<usize, FieldError> {
    check_len("x", x.len(), x.len().div_ceil(3) * 3)?;
    check_len("omega", omega.len(), x.len())?;
    check_len("v", v.len(), x.len())?;
    Ok(x.len() / 3)
}

type Triple<V> = [V; 3];

/// Three rows of one vector of samples from `s` on; past the end 0.
#[inline(always)]
fn load<V: Vector>(rows: &[f32], n: usize, s: usize) -> Triple<V> {
    let row = |r: usize| V::load_part(&rows[r * n + s..(r + 1) * n]);
    [row(0), row(1), row(2)]
}

/// `combine(old, new)` for each number of three rows.
#[inline(always)]
fn store<V: Vector>(x: Triple<V>, rows: &mut [f32], n: usize, s: usize, combine: impl Fn(f32, f32) -> f32) {
    for (r, x) in x.into_iter().enumerate() {
        let mut values = [0.0; MAX_LANES];
        x.store(&mut values);
        for (out, &value) in rows[r * n + s..(r + 1) * n].iter_mut().zip(&values[..V::LANES]) {
            *out = combine(*out, value);
        }
    }
}

#[inline(always)]
fn cross<V: Vector>(a: Triple<V>, b: Triple<V>) -> Triple<V> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<V: Vector>(a: Triple<V>, b: Triple<V>) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn add<V: Vector>(a: Triple<V>, b: Triple<V>) -> Triple<V> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `s a + t b`.
#[inline(always)]
fn mix<V: Vector>(s: V, a: Triple<V>, t: V, b: Triple<V>) -> Triple<V> {
    [s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]]
}

/// `c_1`, `c_2`, `c_3` (or their derivatives) of squared angles.
#[inline(always)]
fn coefficients<V: Vector>(of: &[Lanes; 3], squared: V) -> [V; 3] {
    let mut u = [0.0; MAX_LANES];
    squared.store(&mut u);
    let one = |c: &Lanes| V::load(&c.lanes::<V>(&u[..V::LANES]));
    [one(&of[0]), one(&of[1]), one(&of[2])]
}

fn stumpff(order: u32) -> [Lanes; 3] {
    [Lanes::new(1, order), Lanes::new(2, order), Lanes::new(3, order)]
}

struct Forward<'a> {
    n: usize,
    /// `x`, `omega`, `v`.
    at: [&'a [f32]; 3],
    out: &'a mut [f32],
}

impl Task for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { n, at: [x, omega, v], out } = self;
        let stumpff = stumpff(0);
        for s in (0..n).step_by(V::LANES) {
            let [x, w, v]: [Triple<V>; 3] = [load(x, n, s), load(omega, n, s), load(v, n, s)];
            let [c1, c2, c3] = coefficients(&stumpff, dot(w, w));
            // The terms of `deform::rigid`, in its order.
            let inner = add(mix(c1, x, c2, v), cross(w, mix(c2, x, c3, v)));
            store(add(add(x, v), cross(w, inner)), out, n, s, |_, new| new);
        }
    }
}

struct Backward<'a> {
    n: usize,
    at: [&'a [f32]; 3],
    out_bar: &'a [f32],
    bars: [&'a mut [f32]; 3],
}

impl Task for Backward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { n, at: [x, omega, v], out_bar, bars: [x_bar, omega_bar, v_bar] } = self;
        let (stumpff, derivatives) = (stumpff(0), stumpff(1));
        for s in (0..n).step_by(V::LANES) {
            let [x, w, v]: [Triple<V>; 3] = [load(x, n, s), load(omega, n, s), load(v, n, s)];
            let g: Triple<V> = load(out_bar, n, s);
            let squared = dot(w, w);
            let [c1, c2, c3] = coefficients(&stumpff, squared);
            let [d1, d2, d3] = coefficients(&derivatives, squared);
            let twice = mix(c2, x, c3, v);
            let inner = add(mix(c1, x, c2, v), cross(w, twice));
            // Of `y = a x b`: a_bar = b x y_bar, b_bar = y_bar x a.
            let inner_bar = cross(g, w);
            let twice_bar = cross(inner_bar, w);
            let (x_inner, v_inner) = (dot(x, inner_bar), dot(v, inner_bar));
            let (x_twice, v_twice) = (dot(x, twice_bar), dot(v, twice_bar));
            let squared_bar = d1 * x_inner + d2 * (v_inner + x_twice) + d3 * v_twice;
            let turn = squared_bar + squared_bar;
            let w_bar = add(cross(inner, g), cross(twice, inner_bar));
            let w_bar = add(w_bar, [turn * w[0], turn * w[1], turn * w[2]]);
            let adds = |old: f32, new: f32| old + new;
            store(add(g, mix(c1, inner_bar, c2, twice_bar)), x_bar, n, s, adds);
            store(add(g, mix(c2, inner_bar, c3, twice_bar)), v_bar, n, s, adds);
            store(w_bar, omega_bar, n, s, adds);
        }
    }
}
