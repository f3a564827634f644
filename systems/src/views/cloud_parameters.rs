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

/// All Gaussians of some clouds in one, of the highest of their degrees.
pub(super) fn joined(clouds: &[&Gaussians]) -> Gaussians {
    if let [one] = clouds {
        return (*one).clone();
    }
    let n = clouds.iter().map(|cloud| cloud.len()).sum();
    let degree = clouds.iter().map(|cloud| cloud.degree()).max().unwrap_or(0);
    let mut all = Gaussians::new(n, degree).expect("the degree of a cloud is a degree");
    let mut first = 0;
    for cloud in clouds {
        for ((_, to), (_, from)) in all.fields_mut().into_iter().zip(cloud.fields()) {
            // Coefficients above a cloud's degree stay 0.
            for (to, from) in to.chunks_exact_mut(n.max(1)).zip(from.chunks_exact(cloud.len().max(1))) {
                to[first..][..from.len()].copy_from_slice(from);
            }
        }
        first += cloud.len();
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_are_joined_one_after_the_other() {
        let mut one = Gaussians::new(2, 0).unwrap();
        one.mean = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let mut two = Gaussians::new(1, 1).unwrap();
        two.mean = vec![7.0, 8.0, 9.0];
        two.rest.fill(0.5);
        let all = joined(&[&one, &two]);
        assert_eq!((all.len(), all.degree()), (3, 1));
        assert_eq!(all.mean, [1.0, 2.0, 7.0, 3.0, 4.0, 8.0, 5.0, 6.0, 9.0]);
        assert_eq!(all.rest[..3], [0.0, 0.0, 0.5]);
        assert_eq!(joined(&[&one]), one);
        assert!(joined(&[]).is_empty());
    }
}
