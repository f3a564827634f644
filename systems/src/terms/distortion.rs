//! Weight that is spread along a ray costs (mip-NeRF 360, Barron et al., 2022, equation 15).

use super::ray_term::{RayBars, RayTerm, TileRays};
use losses::{Edges, RayIntervals, Reduction, distortion};
use render_core::ray_distance::RayDistance;

/// The distortion loss, in normalised distance.
pub(crate) struct Distortion {
    /// Its factor.
    pub(crate) factor: f32,
    /// From distances along a ray to normalised ones.
    pub(crate) distance: RayDistance,
}

impl RayTerm for Distortion {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        let n = rays.w.len();
        let [start, end] = &mut bars.room;
        start.clear();
        end.clear();
        for i in 0..n {
            let at = rays.t[i] - rays.lead * rays.dt[i];
            start.push(self.distance.s_of(at.into()) as f32);
            end.push(self.distance.s_of((at + rays.dt[i]).into()) as f32);
        }
        let intervals = RayIntervals { offsets: rays.offsets, edges: Edges::Apart { start, end } };
        let factor = f64::from(self.factor * rays.per_ray());
        let fits = "offsets and samples are those of the tile";
        *loss += factor * distortion::distortion(intervals, rays.w, Reduction::Sum).expect(fits);
        let factor = factor * f64::from(rays.share);
        distortion::distortion_backward(intervals, rays.w, Reduction::Sum, factor, bars.w.add()).expect(fits);
    }
}
