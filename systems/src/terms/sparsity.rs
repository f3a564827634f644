//! A prior on densities: `ln(1 + 2 sigma^2)`, mean over the samples of a ray (PlenOctrees, Yu et al., 2021; SF-NeRF's `L_sigma`).

use super::ray_term::{RayBars, RayTerm, TileRays};
use losses::sparsity;

/// The prior on static densities; sum over rays.
pub(crate) struct Sparsity {
    /// Its factor.
    pub(crate) factor: f32,
}

impl RayTerm for Sparsity {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        let factor = f64::from(self.factor * rays.per_ray());
        let sigma = &mut bars.room[0];
        sigma.clear();
        sigma.extend(rays.tau.iter().zip(rays.dt).map(|(tau, dt)| if *dt > 0.0 { tau / dt } else { 0.0 }));
        let sigma_bar = bars.sigma.add();
        for r in 0..rays.rays() {
            let span = rays.span(r);
            *loss += factor * sparsity::density(&sigma[span.clone()]);
            let bar = factor * f64::from(rays.share);
            sparsity::density_backward(&sigma[span.clone()], bar, &mut sigma_bar[span]).expect("as many");
        }
    }
}
