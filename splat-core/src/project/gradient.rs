//! The gradient of a projected Gaussian.

/// Gradient of the loss with respect to one [`ProjectedGaussian`](super::ProjectedGaussian) and its `K` features, summed over pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectedGradient<const K: usize> {
    /// With respect to the centre, per pixel: the view-space positional gradient.
    pub uv: [f32; 2],
    /// With respect to the conic's `a, b, c`.
    pub conic: [f32; 3],
    /// With respect to the opacity.
    pub opacity: f32,
    /// With respect to the features.
    pub features: [f32; K],
}

impl<const K: usize> Default for ProjectedGradient<K> {
    fn default() -> Self {
        Self { uv: [0.0; 2], conic: [0.0; 3], opacity: 0.0, features: [0.0; K] }
    }
}

impl<const K: usize> ProjectedGradient<K> {
    pub(crate) fn add(&mut self, more: &Self) {
        for (sum, x) in self.uv.iter_mut().zip(more.uv) {
            *sum += x;
        }
        for (sum, x) in self.conic.iter_mut().zip(more.conic) {
            *sum += x;
        }
        self.opacity += more.opacity;
        for (sum, x) in self.features.iter_mut().zip(more.features) {
            *sum += x;
        }
    }
}
