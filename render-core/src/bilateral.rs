//! Depth that is smoothed without its edges: the bilateral filter.
//!
//! Letters: `D_p` the depth of pixel `p`, `G` a Gaussian, `W` the square window around `p`.
//!
//! ```text
//! D'_p = sum_q G_s(|p - q|) G_r(|D_p - D_q|) D_q / sum_q G_s(|p - q|) G_r(|D_p - D_q|),    q in W, D_q known
//! ```
//!
//! The pixel itself has weight 1, so that the sum never vanishes. A hole stays a hole, and counts for nobody. Depth is
//! known where it is finite and positive. `sigma_r` is in units of depth: one far beyond the range of depths makes a plain
//! Gaussian blur of it, which moves edges (as the 64 of EndoNeRF's released code does for depths around 1).
//!
//! Source: Tomasi & Manduchi, "Bilateral filtering for gray and color images", 1998, section 2; EndoNeRF, 2022, export of
//! point clouds.

use crate::error::{RenderError, check_len};
use alloc::vec::Vec;
use float_core::m32;

/// The filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilateral {
    /// Pixels that the window reaches to each side.
    pub radius: usize,
    /// Deviation in the picture, pixels, `> 0`.
    pub sigma_s: f32,
    /// Deviation of depths, their unit, `> 0`.
    pub sigma_r: f32,
}

fn is_known(d: f32) -> bool {
    d.is_finite() && d > 0.0
}

impl Bilateral {
    /// Filter a map.
    ///
    /// # Shapes and units
    /// * `d` `[height][width]`, depths; holes are 0, negative, NaN or infinite
    /// * `out` the same, written: 0 where `d` has a hole
    ///
    /// # Errors
    /// [`RenderError::Shape`] where lengths disagree, [`RenderError::NonFinite`] for a deviation that is not positive.
    ///
    /// # Panics
    /// If there is no memory for a window of `radius`. May do so where `width * height` does not fit `usize`.
    pub fn apply(self, d: &[f32], [width, height]: [usize; 2], out: &mut [f32]) -> Result<(), RenderError> {
        check_len("d", width * height, d.len())?;
        check_len("out", d.len(), out.len())?;
        for (what, sigma) in [("sigma_s", self.sigma_s), ("sigma_r", self.sigma_r)] {
            if !is_known(sigma) {
                return Err(RenderError::NonFinite { what, index: 0 });
            }
        }
        let radius = self.radius.min(width.max(height)) as isize;
        let near = -0.5 / (self.sigma_s * self.sigma_s);
        // Gaussians of both coordinates multiply.
        let space: Vec<f32> = (0..=radius).map(|k| m32::exp((k * k) as f32 * near)).collect();
        for (p, out) in out.iter_mut().enumerate() {
            let [x, y] = [(p % width) as isize, (p / width) as isize];
            *out = 0.0;
            if !is_known(d[p]) {
                continue;
            }
            // Differences to the pixel: what is common to all depths cannot lose digits.
            let (mut sum, mut weight) = (0.0, 0.0);
            for v in (y - radius).max(0)..=(y + radius).min(height as isize - 1) {
                for u in (x - radius).max(0)..=(x + radius).min(width as isize - 1) {
                    let q = d[v as usize * width + u as usize];
                    if is_known(q) {
                        let [difference, far] = [q - d[p], (q - d[p]) / self.sigma_r];
                        let w =
                            space[(u - x).unsigned_abs()] * space[(v - y).unsigned_abs()] * m32::exp(-0.5 * far * far);
                        // Nothing of a difference without end.
                        if w > 0.0 {
                            sum += w * difference;
                            weight += w;
                        }
                    }
                }
            }
            *out = d[p] + sum / weight;
        }
        Ok(())
    }
}
