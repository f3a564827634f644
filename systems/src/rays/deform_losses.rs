//! What a deformation costs at the samples of a chunk besides the error of pixels: its elastic loss, and coherence.

use super::context::StepContext;
use crate::warps::{Deform, DeformGrad, DeformScratch, ElasticAt, Points};
use field_core::rng::Rng;

/// Samples of less weight do not pay for a Jacobian, or for a neighbour.
const FAINT: f32 = 1e-4;

/// The samples of a chunk by their weights, which are held.
pub(super) struct Weighed<'a> {
    /// `[n]`, weights of the samples.
    pub(super) w: &'a [f32],
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// Which of the samples the deformation's points are, in order; `None`: all.
    pub(super) moving: Option<&'a [u32]>,
    /// Weights of the points that a loss looks at, 0 for the others.
    pub(super) judged: &'a mut Vec<f32>,
}

impl Weighed<'_> {
    /// Fill `judged` with what `judge` makes of the weights of each ray.
    fn judge(&mut self, judge: impl Fn(&mut [f32])) {
        self.judged.clear();
        self.judged.extend_from_slice(self.w);
        for ray in self.offsets.windows(2) {
            judge(&mut self.judged[ray[0] as usize..ray[1] as usize]);
        }
        self.judged.iter_mut().filter(|w| **w < FAINT).for_each(|w| *w = 0.0);
        if let Some(moving) = self.moving {
            // In order: none is overwritten before it is read.
            for (k, &i) in moving.iter().enumerate() {
                self.judged[k] = self.judged[i as usize];
            }
            self.judged.truncate(moving.len());
        }
    }
}

/// Another weight for the sample of a ray in which half of its transmittance is gone, 0 for the others; 0 for all of a ray that loses
/// less.
fn middle_alone(w: &mut [f32], weight: impl Fn(f32) -> f32) {
    let mut sum = 0.0;
    let middle = w.iter().position(|w| {
        sum += w;
        sum >= 0.5
    });
    let middle = middle.map(|k| (k, weight(w[k])));
    w.fill(0.0);
    if let Some((k, weight)) = middle {
        w[k] = weight;
    }
}

/// What the deformation costs at its points `points`, mean over the rays of a pixel, and the gradient of that by the share of the
/// batch, added to `grad`. Neighbours are drawn from `draws`.
pub(super) fn learn(
    ctx: &StepContext<'_>,
    deform: &Deform,
    points: Points<'_>,
    mut weighed: Weighed<'_>,
    draws: Rng,
    grad: &mut DeformGrad,
    scratch: &mut DeformScratch,
) -> f64 {
    let per_pixel = ctx.per_pixel as f64;
    let mut loss = 0.0;
    let elastic = deform.elastic_factor();
    if elastic > 0.0 {
        weighed.judge(|w| {
            if deform.config().elastic_at == ElasticAt::Middle {
                middle_alone(w, |_| 1.0);
            }
        });
        let factor = f64::from(ctx.share * elastic) / per_pixel;
        loss += f64::from(elastic) * deform.elastic(points, weighed.judged, factor, grad, scratch);
    }
    let coherence = deform.coherence_factor();
    if coherence > 0.0 {
        weighed.judge(|w| middle_alone(w, |w| w));
        let factor = f64::from(ctx.share * coherence) / per_pixel;
        loss += f64::from(coherence) * deform.coherence(points, weighed.judged, draws, factor, grad, scratch);
    }
    loss / per_pixel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_looks_at_one_sample_of_a_ray_or_at_all_that_carry_weight() {
        // A ray that ends in its second sample, one that passes, and one whose first sample is next to nothing.
        let w = [0.4, 0.3, 0.3, 0.2, 0.1, 1e-5, 0.9];
        let offsets = [0, 3, 5, 7];
        let judged = |moving: Option<&[u32]>, judge: &dyn Fn(&mut [f32])| {
            let mut judged = vec![7.0; 20];
            Weighed { w: &w, offsets: &offsets, moving, judged: &mut judged }.judge(judge);
            judged
        };
        let by_weight = |w: &mut [f32]| middle_alone(w, |w| w);
        assert_eq!(judged(None, &by_weight), [0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.9]);
        assert_eq!(judged(None, &|w| middle_alone(w, |_| 1.0)), [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(judged(None, &|_| {}), [0.4, 0.3, 0.3, 0.2, 0.1, 0.0, 0.9]);
        assert_eq!(judged(Some(&[1, 2, 6]), &by_weight), [0.3, 0.0, 0.9]);
        assert!(judged(Some(&[]), &by_weight).is_empty());
    }
}
