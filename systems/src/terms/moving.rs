//! What moves is little, and a place moves or stands still: terms on the share of a ray's matter that moves.
//!
//! ```text
//! L = a sum_k w_k P_k + b sum_k w_k H(P_k)       mean over rays; P the moving part's share of a sample, w its weight
//! ```
//!
//! The first is the sparsity of the blend of NSFF and DynamicNeRF (Gao et al., 2021, equation 16), the second their entropy; weights are
//! held: neither should make a surface thinner.

use super::ray_term::{RayBars, RayTerm, TileRays};
use losses::entropy;

/// The moving share of what rays show, and the entropy of it.
pub(crate) struct MovingShare {
    /// Factor of the share.
    pub(crate) share: f32,
    /// Factor of its entropy.
    pub(crate) entropy: f32,
}

impl RayTerm for MovingShare {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        if rays.moving.is_empty() {
            return;
        }
        let bar = bars.moving.add();
        let [share, disorder] = [self.share, self.entropy].map(f64::from);
        for r in 0..rays.rays() {
            let of_ray = f64::from(rays.weight[r / rays.per_pixel] * rays.per_ray());
            for i in rays.span(r) {
                let (p, w) = (rays.moving[i], of_ray * f64::from(rays.w[i]));
                if p > 0.0 {
                    *loss += w * (share * f64::from(p) + disorder * entropy::value(p));
                    bar[i] += (w * f64::from(rays.share) * (share + disorder * entropy::derivative(p))) as f32;
                }
            }
        }
    }
}
