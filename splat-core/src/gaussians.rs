//! A cloud of Gaussians: raw parameters, as they are optimised and stored.

use alloc::{vec, vec::Vec};

use crate::SplatError;

/// Value of the constant spherical harmonic, `1 / (2 sqrt(pi))`: at degree 0 the colour is `SH_0 * dc + 1/2`.
pub const SH_0: f32 = 0.282_094_79;
/// Largest degree of the spherical harmonics.
pub const MAX_DEGREE: usize = 3;

/// Number of coefficients of one colour channel above the constant one: `(degree + 1)² - 1`.
#[must_use]
pub const fn rest_len(degree: usize) -> usize {
    (degree + 1) * (degree + 1) - 1
}

/// Raw parameters of `n` Gaussians, component by component: row `k` of `mean` is `mean[k * n..][..n]`.
///
/// | field | rows | used as |
/// | --- | --- | --- |
/// | `mean` | 3 | position, world units |
/// | `log_scale` | 3 | standard deviations `exp`, world units |
/// | `wxyz` | 4 | rotation, normalised when used |
/// | `logit` | 1 | opacity `1 / (1 + exp(-x))` |
/// | `dc` | 3 | colour at degree 0, see [`SH_0`] |
/// | `rest` | `3 * rest_len(degree)` | row `3 (k - 1) + channel` is coefficient `k >= 1` |
///
/// 59 parameters (236 bytes) per Gaussian at degree 3.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, sections 4 and 5.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    n: usize,
    degree: usize,
    /// `[3][n]`
    pub mean: Vec<f32>,
    /// `[3][n]`
    pub log_scale: Vec<f32>,
    /// `[4][n]`
    pub wxyz: Vec<f32>,
    /// `[n]`
    pub logit: Vec<f32>,
    /// `[3][n]`
    pub dc: Vec<f32>,
    /// `[3 * rest_len(degree)][n]`
    pub rest: Vec<f32>,
}

impl Gaussians {
    /// `n` Gaussians at the origin: standard deviation 1, no rotation, opacity 1/2, grey.
    ///
    /// # Errors
    /// [`SplatError::Degree`] above [`MAX_DEGREE`].
    ///
    /// # Panics
    /// If there is no memory for `n` Gaussians.
    pub fn new(n: usize, degree: usize) -> Result<Self, SplatError> {
        if degree > MAX_DEGREE {
            return Err(SplatError::Degree { got: degree });
        }
        let mut wxyz = vec![0.0; 4 * n];
        wxyz[..n].fill(1.0);
        Ok(Self {
            n,
            degree,
            mean: vec![0.0; 3 * n],
            log_scale: vec![0.0; 3 * n],
            wxyz,
            logit: vec![0.0; n],
            dc: vec![0.0; 3 * n],
            rest: vec![0.0; 3 * rest_len(degree) * n],
        })
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there are no Gaussians.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Degree of the spherical harmonics.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Number of parameters of one Gaussian: 14 at degree 0, 59 at degree 3.
    #[must_use]
    pub fn parameters_per_gaussian(&self) -> usize {
        14 + 3 * rest_len(self.degree)
    }

    /// Whether every field has `rows * n` values.
    ///
    /// # Errors
    /// [`SplatError::Shape`] naming the field.
    pub fn check(&self) -> Result<(), SplatError> {
        let rows = [3, 3, 4, 1, 3, 3 * rest_len(self.degree)];
        for ((field, values), rows) in self.fields().into_iter().zip(rows) {
            if values.len() != rows * self.n {
                return Err(SplatError::Shape { what: field.name(), want: rows * self.n, got: values.len() });
            }
        }
        Ok(())
    }

    /// Names and values of the fields, in the order of the table above.
    #[must_use]
    pub fn fields(&self) -> [(Field, &[f32]); 6] {
        [
            (Field::Mean, &self.mean),
            (Field::LogScale, &self.log_scale),
            (Field::Wxyz, &self.wxyz),
            (Field::Logit, &self.logit),
            (Field::Dc, &self.dc),
            (Field::Rest, &self.rest),
        ]
    }

    /// Mutable [`fields`](Self::fields).
    pub fn fields_mut(&mut self) -> [(Field, &mut [f32]); 6] {
        [
            (Field::Mean, &mut self.mean),
            (Field::LogScale, &mut self.log_scale),
            (Field::Wxyz, &mut self.wxyz),
            (Field::Logit, &mut self.logit),
            (Field::Dc, &mut self.dc),
            (Field::Rest, &mut self.rest),
        ]
    }

    /// Keep the first `n` Gaussians, in place. Does nothing if there are `n` or fewer.
    ///
    /// # Panics
    /// If the fields have other lengths than [`Gaussians::check`] expects.
    pub fn truncate(&mut self, n: usize) {
        let before = self.n;
        if n >= before {
            return;
        }
        let fields =
            [&mut self.mean, &mut self.log_scale, &mut self.wxyz, &mut self.logit, &mut self.dc, &mut self.rest];
        for field in fields {
            let rows = field.len() / before;
            for row in 1..rows {
                field.copy_within(row * before..row * before + n, row * n);
            }
            field.truncate(rows * n);
        }
        self.n = n;
    }
}

/// A field of [`Gaussians`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Field {
    /// Positions.
    Mean,
    /// Logarithms of standard deviations.
    LogScale,
    /// Rotations.
    Wxyz,
    /// Opacities.
    Logit,
    /// Colours at degree 0.
    Dc,
    /// Coefficients of the spherical harmonics above degree 0.
    Rest,
}

impl Field {
    /// Name of the field in [`Gaussians`].
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::LogScale => "log_scale",
            Self::Wxyz => "wxyz",
            Self::Logit => "logit",
            Self::Dc => "dc",
            Self::Rest => "rest",
        }
    }
}
