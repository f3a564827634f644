//! Vector `exp`, logistic, sine and others, over [`Vector`]. Fast versions of the functions of [`m32`](crate::m32), with measured
//! errors.
//!
//! Largest error in units in the last place of the exact value, against `f64`, and the bound that the tests hold. Measured over
//! every `f32` (4.3 billion arguments) or over every 1009th bit pattern, as the row says:
//!
//! | function | scalar | AVX2, AVX-512 | bound | range | measured over |
//! | --- | --- | --- | --- | --- | --- |
//! | [`exp`] | 0.992 | 1.024 | 1.1 | arguments count as clamped to `[-87, 88]` | every argument |
//! | [`exp2`] | 2.294 | 2.042 | 2.4 / 2.2 | arguments count as clamped to `[-126, 127]` | every argument |
//! | [`exp_m1`], [`one_minus_exp_neg`] | 1.643 | 1.486 | 1.7 / 1.6 | as `exp` | every argument |
//! | [`exp_neg`] | 0.970 | 0.979 | 1.1 | 0 from 87 on | every 1009th |
//! | [`ln`] | 0.787 | 0.787 | 0.9 | all, subnormal numbers too | every 1009th |
//! | [`logistic`] | 2.402 | 2.402 | 2.5 | all, subnormal results too | every argument |
//! | [`softplus`] | 2.221 | 1.850 | 2.3 / 1.9 | all, subnormal results too | every argument |
//! | [`tanh`] | 2.499 | 2.499 | 2.6 | all | every argument |
//! | [`sin`], [`cos`], [`sin_cos`] | 1.543 | 1.543 | 1.7 | all; rounded [`m64`](crate::m64) from `2^25` on | every argument below `2^25` |
//! | [`sin_cos_pi`] | 1.650 | 1.650 | 1.7 | all | every argument |
//!
//! Table with times: `cargo run --release -p wildfield-float-core --example vecmath_table` (`-- --all` for every argument).
//!
//! AVX2 and AVX-512 give the same bits. The scalar level rounds twice where they fuse ([`Vector::mul_add`]), so its last
//! digits may differ; [`sin`], [`cos`], [`sin_cos`] and [`sin_cos_pi`] fuse nothing and give the same bits at every level.
//! NaN gives NaN unless a function says otherwise.
//!
//! [`Function`] lists them with exact versions, for tables and benches.

mod exp;
mod function;
mod ln;
mod logistic;
mod polynomial;
mod sin_cos;
mod softplus;

pub use exp::{exp, exp_m1, exp_neg, exp2, one_minus_exp_neg};
pub use function::{Function, Worst};
pub use ln::ln;
pub use logistic::{logistic, tanh};
pub use sin_cos::{cos, sin, sin_cos, sin_cos_pi};
pub use softplus::softplus;

#[cfg(doc)]
use crate::Vector;
