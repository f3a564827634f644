//! Density control: where to add Gaussians to a cloud and which to remove.
//!
//! Every function takes a cloud and returns a change of its rows, [`Rows`]. An optimiser's moments, statistics, features and codes
//! follow with [`Rows::apply`]. Where new Gaussians are not mere copies, a [`Change`] holds the new cloud as well. Nothing depends on
//! an optimiser or on the number of threads: random numbers are functions of a stream (one per step, e.g.
//! `Rng::new(seed, 0).substream(step)`) and the row.
//!
//! * [`Adc`], adaptive density control of 3DGS: clone and split where the view-space gradient ([`ViewSpaceGradients`]) is large, prune
//!   transparent and large Gaussians, reset opacities.
//! * [`AxisSplit`]: splits along the longest axis that keep mass, centre and covariance.
//! * [`Mcmc`], 3DGS-MCMC: a fixed budget; dead Gaussians are relocated, and noise is added to positions.
//! * [`morton_order`]: neighbours in space become neighbours in memory.
//! * [`keep_strongest`], [`without_non_finite`], [`keep_in_range`], [`SizeLimit`]: limits for any of them.
//!
//! ```
//! use float_core::rng::Rng;
//! use splat_core::Gaussians;
//! use splat_core::density::{Adc, Fresh};
//!
//! let cloud = Gaussians::new(3, 0)?;
//! let gradient = [1e-5, 3e-4, 0.0];
//! let grown = Adc::DEFAULT.grow(&cloud, &gradient, 1.0, 1000, Rng::new(7, 0).substream(600))?;
//! // The second Gaussian was split: it is removed, and its two children are at the end.
//! assert_eq!(grown.rows.from(), [0, 2, 1, 1]);
//! let moments = grown.rows.apply("moments", &[0.1, 0.2, 0.3], 1, Fresh::Is(0.0))?;
//! assert_eq!(moments, [0.1, 0.3, 0.0, 0.0]);
//! # Ok::<(), splat_core::SplatError>(())
//! ```

mod adc;
mod axis_split;
mod guard;
mod mcmc;
mod morton;
mod noise;
mod rows;
mod size_limit;
mod view_space;

pub use adc::Adc;
pub use axis_split::AxisSplit;
pub use guard::{LOG_SCALE_MIN, LOGIT_MAX, keep_in_range, keep_strongest, without_non_finite};
pub use mcmc::{Mcmc, relocation};
pub use morton::morton_order;
pub use rows::{Change, Fresh, Rows};
pub use size_limit::SizeLimit;
pub use view_space::ViewSpaceGradients;

use float_core::m64;

use crate::Gaussians;

/// Opacity of Gaussian `i`.
///
/// # Panics
/// If there is no Gaussian `i`.
#[must_use]
pub fn opacity(cloud: &Gaussians, i: usize) -> f64 {
    m64::logistic(f64::from(cloud.logit[i]))
}

/// The parameter of an opacity in `(0, 1)`, the inverse of the logistic function.
#[must_use]
pub fn logit(opacity: f64) -> f32 {
    (m64::ln(opacity) - m64::ln_1p(-opacity)) as f32
}

/// Standard deviations of Gaussian `i`, world units.
fn scales(cloud: &Gaussians, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|k| m64::exp(f64::from(cloud.log_scale[k * cloud.len() + i])))
}

/// The largest of [`scales`]; 0 if all are NaN.
fn largest_scale(cloud: &Gaussians, i: usize) -> f64 {
    scales(cloud, i).into_iter().fold(0.0, f64::max)
}

/// Rotation matrix of Gaussian `i`, row by row: of the normalised quaternion, the identity if its norm is near 0.
fn rotation(cloud: &Gaussians, i: usize) -> [[f64; 3]; 3] {
    let q = [0, 1, 2, 3].map(|k| f64::from(cloud.wxyz[k * cloud.len() + i]));
    let norm = m64::sqrt(q.iter().map(|x| x * x).sum());
    let [w, x, y, z] = if norm > 1e-8 { q.map(|x| x / norm) } else { [1.0, 0.0, 0.0, 0.0] };
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}
