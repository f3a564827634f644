//! Each ray ends on something or on nothing: the entropy of what reaches the background (TiNeuVox, Fang et al., 2022, released
//! code).

use super::ray_term::{RayBars, RayTerm, TileRays};
use losses::entropy;

/// The binary entropy of the transmittance behind a ray's last sample, mean over the rays that count.
pub(crate) struct BackgroundEntropy {
    /// Its factor.
    pub(crate) factor: f32,
}

impl RayTerm for BackgroundEntropy {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        let per_ray = self.factor * rays.per_ray();
        let mut sum = 0.0;
        for (r, (&p, bar)) in rays.trans_end.iter().zip(bars.trans_end.add()).enumerate() {
            let factor = f64::from(rays.weight[r / rays.per_pixel] * per_ray);
            sum += factor * entropy::value(p);
            *bar += (factor * f64::from(rays.share) * entropy::derivative(p)) as f32;
        }
        *loss += sum;
    }
}
