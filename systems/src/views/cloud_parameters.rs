//! Parameters of a cloud.

use splat_core::density::{Fresh, Rows};
use splat_core::{Gaussians, SplatError};

/// Parameters of a cloud: those of every Gaussian, and rows that a system adds.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CloudParameters {
    /// Positions, sizes, rotations, opacities, colours.
    pub(crate) gaussians: Gaussians,
    /// `[rows][n]`: codes, labels, features of each Gaussian.
    pub(crate) extra: Vec<f32>,
    /// Number of extra rows.
    pub(crate) rows: usize,
}

impl CloudParameters {
    /// With `rows` extra rows of 0.
    pub(crate) fn new(gaussians: Gaussians, rows: usize) -> Self {
        Self { extra: vec![0.0; rows * gaussians.len()], rows, gaussians }
    }

    /// Number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.gaussians.len()
    }

    /// Number of parameters of one Gaussian.
    pub(crate) fn per_gaussian(&self) -> usize {
        self.gaussians.parameters_per_gaussian() + self.rows
    }

    /// The extra rows after a change of the Gaussians; new ones are copies.
    pub(super) fn follow_extra(&mut self, changed: &Rows) -> Result<(), SplatError> {
        self.extra = changed.apply("extra", &self.extra, self.rows, Fresh::Copied)?;
        Ok(())
    }
}
