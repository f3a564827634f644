//! Rendered depth is held to measured depth (EndoNeRF, Wang et al., 2022, section 2.3).

use super::ray_term::{RayBars, RayTerm, TileRays};
use crate::samplers::MeasuredDepth;

impl RayTerm for MeasuredDepth {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        let w_bar = bars.w.add();
        for r in 0..rays.rays() {
            let (span, pixel) = (rays.span(r), r / rays.per_pixel);
            let (measured, weight) = (self.at(rays.view[pixel], rays.place[pixel]), rays.weight[pixel]);
            if measured > 0.0 && weight > 0.0 {
                let (w, t, dt) = (&rays.w[span.clone()], &rays.t[span.clone()], &rays.dt[span.clone()]);
                let factor = weight * rays.per_ray();
                *loss += f64::from(factor * self.learn(w, t, dt, measured, factor * rays.share, &mut w_bar[span]));
            }
        }
    }
}
