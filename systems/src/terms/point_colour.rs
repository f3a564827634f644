//! Each sample has the colour of its pixel, as far as it is seen (TiNeuVox, Fang et al., 2022, released code).

use super::ray_term::{RayBars, RayTerm, TileRays};
use losses::point_colour;

/// The squared errors of the colours of single samples, by weight; mean over the rays that count.
pub(crate) struct PointColour {
    /// Its factor.
    pub(crate) factor: f32,
}

impl RayTerm for PointColour {
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64) {
        let n = rays.w.len();
        let per_ray = self.factor * rays.per_ray();
        let (r_bar, rest) = bars.rgb.add().split_at_mut(n);
        let (g_bar, b_bar) = rest.split_at_mut(n);
        let mut sum = 0.0;
        for r in 0..rays.rays() {
            let (span, pixel) = (rays.span(r), r / rays.per_pixel);
            let (factor, truth) = (f64::from(rays.weight[pixel] * per_ray), rays.truth[pixel]);
            // Nothing is known of what a pixel that does not count shows.
            if factor == 0.0 {
                continue;
            }
            let (w, rgb) = (&rays.w[span.clone()], [0, 1, 2].map(|c| &rays.rgb[c * n..][span.clone()]));
            let bars = [&mut r_bar[span.clone()], &mut g_bar[span.clone()], &mut b_bar[span]];
            let fits = "samples are those of the rays";
            sum += factor * point_colour::of_ray(w, rgb, truth).expect(fits);
            point_colour::of_ray_backward(w, rgb, truth, factor * f64::from(rays.share), bars).expect(fits);
        }
        *loss += sum;
    }
}
