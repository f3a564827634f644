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
