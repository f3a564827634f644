//! From the gradients of the Gaussians that stand for pieces of cones back to the rays.

use render_core::contract::{Norm, contract_backward, contract_covariance_backward};
use render_core::frustum::{Moments, symmetric, symmetric_backward};
use render_core::ray::{Ray, RayBar};

/// Gradient with respect to a Gaussian in space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GaussianBar {
    pub(crate) mean: [f64; 3],
    /// Of the entries of the covariance's upper triangle `xx xy xz yy yz zz`.
    pub(crate) cov: [f64; 6],
}

impl GaussianBar {
    /// Add to `bar` what this says of the internal ray along which the Gaussian has these `moments`, which stay. Where space is
    /// contracted, by this norm, it is the gradient with respect to the contracted Gaussian.
    pub(crate) fn pull(self, contraction: Option<Norm>, moments: &Moments<f64>, ray: &Ray, bar: &mut RayBar) {
        let (o, d) = (ray.o.to_array(), ray.d.to_array());
        let Self { mean, cov } = match contraction {
            None => self,
            Some(norm) => {
                let (mean, cov) = moments.covariance(o, d);
                self.before(norm, mean, cov)
            }
        };
        let (mut o_bar, mut d_bar) = ([0.0; 3], [0.0; 3]);
        moments.covariance_backward(d, mean, cov, &mut o_bar, &mut d_bar);
        *bar += RayBar { o: o_bar.into(), d: d_bar.into() };
    }

    /// The gradient with respect to the Gaussian that was contracted.
    fn before(self, norm: Norm, mean: [f64; 3], cov: [f64; 6]) -> Self {
        let (mut before, mut cov_bar) = (Self { mean: [0.0; 3], cov: [0.0; 6] }, [[0.0; 3]; 3]);
        let [xx, xy, xz, yy, yz, zz] = self.cov;
        // What is below the diagonal is not read.
        let out_bar = [[xx, xy, xz], [0.0, yy, yz], [0.0, 0.0, zz]];
        contract_backward(norm, mean, self.mean, &mut before.mean);
        contract_covariance_backward(norm, mean, &symmetric(cov), &out_bar, &mut before.mean, &mut cov_bar);
        symmetric_backward(&cov_bar, &mut before.cov);
        before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use render_core::contract::{contract, contract_covariance};
    use testkit::gradient::{Tolerance, check_pair, cotangent};

    /// Mean and triangle of the covariance of a ray's Gaussian, contracted.
    fn gaussian(contraction: Option<Norm>, moments: &Moments<f64>, ray: &[f64]) -> ([f64; 3], [f64; 6]) {
        let (mean, cov) = moments.covariance(ray[..3].try_into().unwrap(), ray[3..].try_into().unwrap());
        let Some(norm) = contraction else { return (mean, cov) };
        let c = contract_covariance(norm, mean, &symmetric(cov));
        (contract(norm, mean), [c[0][0], c[0][1], c[0][2], c[1][1], c[1][2], c[2][2]])
    }

    /// The contraction has second derivatives here, and no border within the step of a difference.
    fn smooth(contraction: Option<Norm>, x: [f64; 3]) -> bool {
        let mut sizes = x.map(f64::abs);
        sizes.sort_by(f64::total_cmp);
        match contraction {
            None => true,
            Some(Norm::L2) => (x.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).abs() > 1e-4,
            Some(Norm::Max) => (sizes[2] - 1.0).abs() > 1e-4 && sizes[2] - sizes[1] > 1e-4,
        }
    }

    proptest! {
        #![proptest_config(testkit::property::cases(128))]

        #[test]
        fn gaussians_bring_their_gradients_to_the_ray(
            o in prop::array::uniform3(-0.8_f64..0.8), d in prop::array::uniform3(-1.0_f64..1.0),
            (t0, length) in (0.0_f64..3.0, 0.01_f64..3.0),
            radius in prop_oneof![Just(0.0), Just(0.01), 0.0..0.5_f64], seed in 0..1000_u64,
        ) {
            if d.iter().map(|d| d * d).sum::<f64>() < 0.05 {
                return Ok(());
            }
            let (moments, ray) = (Moments::conical(t0, t0 + length, radius), [o, d].concat());
            for contraction in [None, Some(Norm::L2), Some(Norm::Max)] {
                if !smooth(contraction, gaussian(None, &moments, &ray).0) {
                    continue;
                }
                let forward = |ray: &[f64], out: &mut [f64]| {
                    let (mean, cov) = gaussian(contraction, &moments, ray);
                    out[..3].copy_from_slice(&mean);
                    out[3..].copy_from_slice(&cov);
                };
                let backward = |ray: &[f64], out_bar: &[f64], ray_bar: &mut [f64]| {
                    let [o, d] = [0, 3].map(|at| <[f64; 3]>::try_from(&ray[at..at + 3]).unwrap().into());
                    let (mean, cov) = (out_bar[..3].try_into().unwrap(), out_bar[3..].try_into().unwrap());
                    let mut bar = RayBar::default();
                    GaussianBar { mean, cov }.pull(contraction, &moments, &Ray { o, d }, &mut bar);
                    let bars = bar.o.to_array().into_iter().chain(bar.d.to_array());
                    ray_bar.iter_mut().zip(bars).for_each(|(sum, bar)| *sum += bar);
                };
                let out = check_pair(&ray, &cotangent(9, seed), forward, backward, Tolerance::TWIN);
                prop_assert!(out.is_ok(), "{contraction:?} {ray:?}: {}", out.unwrap_err());
            }
        }
    }
}
