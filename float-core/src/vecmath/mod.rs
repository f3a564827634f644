//! Vector `exp`, logistic, sine and friends, over [`Vector`]. Fast versions of the door's functions, with measured errors.
//!
//! Largest error in units in the last place of the exact value, against `f64`, over the bit patterns of all `f32` taken in
//! steps of 1009 (4.3 million arguments; with `--all` the same program tries every one), and the bound that the tests hold:
//!
//! | function | scalar | AVX2, AVX-512 | bound | range |
//! | --- | --- | --- | --- | --- |
//! | [`exp`] | 0.96 | 0.99 | 1.1 | arguments count as clamped to `[-87, 88]` |
//! | [`exp_m1`], [`one_minus_exp_neg`] | 1.55 | 1.44 | 1.7 / 1.6 | as `exp` |
//! | [`exp_neg`] | 0.97 | 0.98 | 1.1 | 0 from 87 on |
//! | [`ln`] | 0.79 | 0.79 | 0.9 | all, subnormal numbers too |
//! | [`logistic`] | 2.23 | 2.23 | 2.4 | all, subnormal results too |
//! | [`softplus`] | 2.07 | 1.74 | 2.3 / 1.9 | all, subnormal results too |
//! | [`tanh`] | 2.45 | 2.45 | 2.6 | all |
//! | [`sin`], [`cos`], [`sin_cos`] | 1.50 | 1.50 | 1.7 | all; `f64` door from `2^25` on |
//! | [`sin_cos_pi`] | 1.58 | 1.58 | 1.7 | all |
//!
//! Time beside it: `cargo run --release -p float-core --example vecmath_table` (`-- --all` for every argument).
//!
//! AVX2 and AVX-512 give the same bits. The scalar level rounds twice where they fuse ([`Vector::mul_add`]), so its last
//! digits may differ; [`sin`], [`cos`], [`sin_cos`] and [`sin_cos_pi`] fuse nothing and give the same bits at every level.
//! NaN gives NaN unless a function says otherwise.
//!
//! [`Function`] lists them with their exact twins, for tables and benches.

mod exp;
mod function;
mod ln;
mod logistic;
mod sin_cos;
mod softplus;

pub use exp::{exp, exp_m1, exp_neg, one_minus_exp_neg};
pub use function::{Function, Worst};
pub use ln::ln;
pub use logistic::{logistic, tanh};
pub use sin_cos::{cos, sin, sin_cos, sin_cos_pi};
pub use softplus::softplus;

#[cfg(doc)]
use crate::Vector;

/// The polynomial with these coefficients, from the highest power down.
#[inline(always)]
fn polynomial<V: crate::Vector, const N: usize>(x: V, coefficients: [f32; N]) -> V {
    let mut p = V::splat(coefficients[0]);
    for c in &coefficients[1..] {
        p = p.mul_add(x, V::splat(*c));
    }
    p
}
