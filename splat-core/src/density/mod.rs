//! Where a cloud has too few Gaussians, too many, or ones that are of no use.
//!
//! Every function looks at a cloud and says what becomes of its rows: [`Rows`], which moments of an optimiser, statistics,
//! features and codes follow with the same call; where new Gaussians are not mere copies, a [`Change`] brings the new cloud along.
//! Nothing here knows of an optimiser, and nothing depends on the number of threads: random numbers are functions of a stream
//! (one for each step, say `Rng::new(seed, 0).substream(step)`) and the row.
//!
//! * [`Adc`] of 3DGS: clone and split where the picture pulls hardest ([`Pull`]), prune what is faint or large.
//! * [`Mcmc`]: a fixed budget; the dead move to where there is matter, and all are stirred.
//! * [`by_place`]: neighbours in space as neighbours in memory.
//! * [`keep_strongest`], [`without_non_finite`], [`keep_in_range`]: what any of them needs.
//!
//! ```
//! use field_core::rng::Rng;
//! use splat_core::Gaussians;
//! use splat_core::density::{Adc, Fresh};
//!
//! let cloud = Gaussians::new(3, 0)?;
//! let pull = [1e-5, 3e-4, 0.0];
//! let grown = Adc::DEFAULT.grow(&cloud, &pull, 1.0, 1000, Rng::new(7, 0).substream(600))?;
//! // The second was split: it is gone, its two children are at the end.
//! assert_eq!(grown.rows.from(), [0, 2, 1, 1]);
//! let moments = grown.rows.apply("moments", &[0.1, 0.2, 0.3], 1, Fresh::Is(0.0))?;
//! assert_eq!(moments, [0.1, 0.3, 0.0, 0.0]);
//! # Ok::<(), splat_core::SplatError>(())
//! ```

mod adc;
mod guard;
mod mcmc;
mod noise;
mod place;
mod pull;
mod rows;

pub use adc::Adc;
pub use guard::{LOG_SCALE_MIN, LOGIT_MAX, keep_in_range, keep_strongest, without_non_finite};
pub use mcmc::{Mcmc, share};
pub use place::by_place;
pub use pull::Pull;
pub use rows::{Change, Fresh, Rows};

use float_core::m64;

use crate::Gaussians;

/// Opacity of Gaussian `i`.
///
/// # Panics
/// When there is no such Gaussian.
#[must_use]
pub fn opacity(cloud: &Gaussians, i: usize) -> f64 {
    m64::logistic(f64::from(cloud.logit[i]))
}

/// Standard deviations of Gaussian `i`, world units.
fn scales(cloud: &Gaussians, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|k| m64::exp(f64::from(cloud.log_scale[k * cloud.len() + i])))
}

/// The largest of [`scales`]; 0 if none is a number.
fn largest_scale(cloud: &Gaussians, i: usize) -> f64 {
    scales(cloud, i).into_iter().fold(0.0, f64::max)
}

/// Rotation of Gaussian `i`, row by row: the quaternion normalised, the identity where it is too short to be a direction.
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
