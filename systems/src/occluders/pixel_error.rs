//! The loss of a pixel's error: squared, or a robust kernel of its length.

use crate::limits::{refuse, within};
use crate::photo_model::PixelBar;
use engine::system::SystemError;
use losses::kernel::Kernel;
use serde::{Deserialize, Serialize};

/// Least scale of errors, colour units: thousands of times below the steps of 8-bit colours. With much smaller ones derivatives
/// overflow.
pub(crate) const LEAST_SCALE: f32 = 1e-6;

/// The kernel of an error's length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KernelKind {
    /// Its square.
    #[default]
    Squared,
    /// The length.
    L1,
    /// Square near 0, length further out.
    Charbonnier,
    /// Logarithm further out.
    Cauchy,
    /// Bounded.
    GemanMcClure,
    /// Bounded, and sooner.
    Welsch,
}

/// Settings of the loss of a pixel's error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KernelConfig {
    /// `squared`, `l1`, `charbonnier`, `cauchy`, `gemanmcclure` or `welsch`.
    pub kernel: KernelKind,
    /// Scale of the kernels from `charbonnier` on, colour units.
    pub kernel_scale: f32,
}

impl KernelConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        within("kernel_scale", self.kernel_scale, LEAST_SCALE..=1e3)?;
        match self.kernel().check() {
            Ok(()) => Ok(()),
            Err(e) => refuse("kernel_scale", self.kernel_scale, e.to_string()),
        }
    }

    /// The kernel.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        let c = self.kernel_scale;
        match self.kernel {
            KernelKind::Squared => Kernel::Squared,
            KernelKind::L1 => Kernel::L1,
            KernelKind::Charbonnier => Kernel::Charbonnier { c },
            KernelKind::Cauchy => Kernel::Cauchy { c },
            KernelKind::GemanMcClure => Kernel::GemanMcClure { c },
            KernelKind::Welsch => Kernel::Welsch { c },
        }
    }
}

/// `weight |C - Y|^2 / 3`: the squared error of a pixel, mean over channels, times `weight`; and its derivative.
pub(crate) fn squared(rgb: [f32; 3], truth: [f32; 3], weight: f32) -> (f32, PixelBar) {
    let e = [0, 1, 2].map(|c| rgb[c] - truth[c]);
    let loss = e.iter().map(|e| e * e).sum::<f32>() / 3.0;
    (weight * loss, PixelBar::colour(e.map(|e| weight * 2.0 * e / 3.0)))
}

/// `|C - Y|`.
pub(crate) fn residual(rgb: [f32; 3], truth: [f32; 3]) -> f32 {
    (0..3).map(|c| (rgb[c] - truth[c]).powi(2)).sum::<f32>().sqrt()
}

/// `weight kernel(|C - Y|) / 3`, and its derivative. A third, as the squared error is a mean over channels.
pub(crate) fn kernel_loss(kernel: Kernel, rgb: [f32; 3], truth: [f32; 3], weight: f32) -> (f32, PixelBar) {
    if kernel == Kernel::Squared {
        return squared(rgb, truth, weight);
    }
    let e = residual(rgb, truth);
    // The derivative of kernel(|C - Y|) is its weight times the error.
    let w = weight * kernel.weight(e, 0.0) / 3.0;
    (weight * kernel.value(e, 0.0) / 3.0, PixelBar::colour([0, 1, 2].map(|c| w * (rgb[c] - truth[c]))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivative_is_that_of_differences() {
        let (rgb, truth) = ([0.5, 0.75, 0.25], [0.25, 0.7, 0.75]);
        let kinds = [
            KernelKind::Squared,
            KernelKind::L1,
            KernelKind::Charbonnier,
            KernelKind::Cauchy,
            KernelKind::GemanMcClure,
            KernelKind::Welsch,
        ];
        for kernel in kinds {
            let settings = KernelConfig { kernel, kernel_scale: 0.3 };
            settings.check().unwrap();
            let (_, bar) = kernel_loss(settings.kernel(), rgb, truth, 0.5);
            for c in 0..3 {
                let at = |by: f32| {
                    let mut moved = rgb;
                    moved[c] += by;
                    kernel_loss(settings.kernel(), moved, truth, 0.5).0
                };
                let want = (at(1e-2) - at(-1e-2)) / 2e-2;
                assert!((bar.rgb[c] - want).abs() < 2e-3, "{kernel:?}: {bar:?} {want}");
            }
        }
        assert_eq!(squared(rgb, truth, 0.5), kernel_loss(Kernel::Squared, rgb, truth, 0.5));
    }

    #[test]
    fn scales_that_overflow_are_refused() {
        let settings = |kernel_scale| KernelConfig { kernel: KernelKind::Welsch, kernel_scale };
        settings(LEAST_SCALE).check().unwrap();
        settings(1e3).check().unwrap();
        for (scale, word) in [(-1.0, "-1"), (9e-7, "0.0000009"), (1001.0, "1001"), (f32::NAN, "NaN")] {
            let want = format!("`kernel_scale` = {word}: must be in 0.000001..=1000");
            assert_eq!(settings(scale).check().unwrap_err().to_string(), want);
        }
    }
}
