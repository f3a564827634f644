//! The loss of a picture as 3D Gaussian splatting trains: `(1 - lambda) mean |x - y| + lambda (1 - SSIM)`.
//!
//! Letters: `x` the rendered picture, `y` the truth, `g` weights of the pixels; SSIM under an 11x11 Gaussian window of 1.5
//! pixels that sees black beyond the edge ([`SsimVariant::ZERO_PADDED`], there in `f64` and for any picture that is to be
//! *measured*). `1 - SSIM` is not halved.
//!
//! ```text
//! p = (x + y) / 2    q = (x - y) / 2    mu_p = w * p    var_p = w * p^2 - mu_p^2    (q alike; w * is the window)
//! a = 4 mu_q^2 / (2 (mu_p^2 + mu_q^2) + C1)     b = 4 var_q / (2 (var_p + var_q) + C2)     1 - s = a + b - a b
//! ```
//!
//! That is the usual `s = A1 A2 / (B1 B2)` in half sum and half difference: four filtered planes instead of five, and `1 - s`
//! of nearly equal pictures is a sum of small numbers instead of a difference of large ones. `mu_y` is all that would be left
//! to prepare once a picture: one of four planes, for 12 bytes a pixel; it is not done.
//!
//! ```
//! use losses::dssim::{Dssim, Pair, Target};
//!
//! let (x, y) = (vec![0.5; 3 * 20 * 30], vec![128; 20 * 30 * 3]);
//! let pair = Pair { channels: 3, height: 20, width: 30, x: &x, target: Target::Bytes(&y), weights: None };
//! let mut dssim = Dssim::new(float_core::Simd::best());
//! let mut x_bar = vec![0.0; x.len()];
//! let loss = dssim.l1_dssim_backward(&pair, 0.2, 1.0, &mut x_bar)?;
//! assert!((loss.l1 - 0.5 / 255.0).abs() < 1e-7 && loss.dssim < 1e-4);
//! # Ok::<(), losses::LossError>(())
//! ```
//!
//! [`SsimVariant::ZERO_PADDED`]: crate::metrics::SsimVariant::ZERO_PADDED

mod band;
mod kernel;
mod pair;
mod scratch;

pub use pair::{Pair, Target};

use crate::metrics::Window;
use crate::{LossError, error::same};
use alloc::vec::Vec;
use float_core::Simd;
use pair::Derivatives;
use scratch::{Scratch, TAPS};

/// Both losses of a picture: means over all pixels and channels, left-out ones among them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct L1Dssim {
    /// `mean g |x - y|`.
    pub l1: f64,
    /// `mean g (1 - s)`.
    pub dssim: f64,
    /// `(1 - lambda) l1 + lambda dssim`.
    pub loss: f64,
}

/// Computes the loss; holds what it needs for that, so that a call allocates nothing once it has seen its largest picture.
#[derive(Clone, Debug)]
pub struct Dssim {
    simd: Simd,
    taps: [f32; TAPS],
    /// As many as threads have worked at once.
    pool: Vec<Scratch>,
    /// Sums `[l1, dssim]` of each `[channel][band]`.
    sums: Vec<[f64; 2]>,
}

impl Dssim {
    /// At a level of SIMD. Levels agree within rounding.
    #[must_use]
    pub fn new(simd: Simd) -> Self {
        let mut taps = [0.0; TAPS];
        for (tap, exact) in taps.iter_mut().zip(Window::Eleven.taps()) {
            *tap = exact as f32;
        }
        Self { simd, taps, pool: Vec::new(), sums: Vec::new() }
    }

    /// `mean g (1 - s)`: 0 for equal pictures, up to 2. 0 for an empty picture.
    ///
    /// # Numerics
    /// Rows are summed in `f32`, the rest in `f64`. Variances are floored at 0. `|x|` above 1e18 overflows; NaN in gives NaN
    /// out. The same bits with any number of threads.
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree.
    ///
    /// # Source
    /// Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004, eq. 13; Kerbl et al.,
    /// "3D Gaussian splatting for real-time radiance field rendering", 2023, eq. 7.
    pub fn dssim(&mut self, pair: &Pair<'_>) -> Result<f64, LossError> {
        Ok(self.l1_dssim(pair, 1.0)?.dssim)
    }

    /// Backward twin of [`dssim`](Self::dssim), which it returns: adds into `x_bar`, shaped as `x`.
    ///
    /// # Errors
    /// As [`dssim`](Self::dssim).
    pub fn dssim_backward(&mut self, pair: &Pair<'_>, loss_bar: f64, x_bar: &mut [f32]) -> Result<f64, LossError> {
        Ok(self.l1_dssim_backward(pair, 1.0, loss_bar, x_bar)?.dssim)
    }

    /// `(1 - lambda) mean g |x - y| + lambda mean g (1 - s)`, and both means; [`dssim`](Self::dssim) tells more.
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for `lambda` outside `[0, 1]`.
    pub fn l1_dssim(&mut self, pair: &Pair<'_>, lambda: f32) -> Result<L1Dssim, LossError> {
        check(pair, lambda)?;
        Ok(self.run(pair, lambda, None))
    }

    /// Backward twin of [`l1_dssim`](Self::l1_dssim), which it returns: adds into `x_bar`, shaped as `x`. The derivative of `|x|` at 0 is 0.
    ///
    /// # Errors
    /// As [`l1_dssim`](Self::l1_dssim).
    pub fn l1_dssim_backward(
        &mut self,
        pair: &Pair<'_>,
        lambda: f32,
        loss_bar: f64,
        x_bar: &mut [f32],
    ) -> Result<L1Dssim, LossError> {
        check(pair, lambda)?;
        same("x_bar", pair.x.len(), x_bar.len())?;
        let (n, lambda_wide) = (pair.x.len() as f64, f64::from(lambda));
        let derivatives =
            Derivatives { l1: (loss_bar * (1.0 - lambda_wide) / n) as f32, dssim: (loss_bar * lambda_wide / n) as f32 };
        Ok(self.run(pair, lambda, Some((derivatives, x_bar))))
    }

    fn run(&mut self, pair: &Pair<'_>, lambda: f32, gradient: Option<(Derivatives, &mut [f32])>) -> L1Dssim {
        if pair.x.is_empty() {
            return L1Dssim::default();
        }
        let Self { simd, taps, pool, sums } = self;
        band::for_all(*simd, taps, pool, sums, pair, gradient);
        let [l1, dssim] = self.sums.iter().fold([0.0; 2], |[l1, dssim], sum| [l1 + sum[0], dssim + sum[1]]);
        let (n, lambda) = (pair.x.len() as f64, f64::from(lambda));
        let (l1, dssim) = (l1 / n, dssim / n);
        L1Dssim { l1, dssim, loss: (1.0 - lambda) * l1 + lambda * dssim }
    }
}

fn check(pair: &Pair<'_>, lambda: f32) -> Result<(), LossError> {
    if !(0.0..=1.0).contains(&lambda) {
        return Err(LossError::Parameter { what: "`lambda`", value: lambda, range: "a number in [0, 1]" });
    }
    // A product past usize::MAX cannot be met by any slice.
    let product = |sides: &[usize]| sides.iter().try_fold(1_usize, |n, &x| n.checked_mul(x)).unwrap_or(usize::MAX);
    let values = product(&[pair.channels, pair.height, pair.width]);
    same("x", values, pair.x.len())?;
    same(
        "target",
        values,
        match pair.target {
            Target::Planes(y) => y.len(),
            Target::Bytes(y) => y.len(),
        },
    )?;
    pair.weights.map_or(Ok(()), |g| same("weights", product(&[pair.height, pair.width]), g.len()))
}
