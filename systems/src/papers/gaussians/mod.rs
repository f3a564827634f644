//! Systems of Gaussians.

pub(crate) mod splat;
