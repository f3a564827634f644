//! Quadrature rules, and where their samples lie.

use render_core::quadrature::Rule;

/// A [`Rule`] and where its samples lie in their intervals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// Constant from each sample to the next, as NeRF has it: the first order.
    LeftPoint,
    /// Constant in bins with a sample in each, in the middle where nothing is random, as mip-NeRF has it: the second order.
    MidPoint,
    /// Mean of both ends.
    Trapezoid,
    /// Linear between samples.
    PiecewiseLinear,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::LeftPoint, Self::MidPoint, Self::Trapezoid, Self::PiecewiseLinear];

    /// For tables: no spaces.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LeftPoint => "left-point",
            Self::MidPoint => "mid-point",
            Self::Trapezoid => "trapezoid",
            Self::PiecewiseLinear => "piecewise-linear",
        }
    }

    /// The rule of `render-core`.
    #[must_use]
    pub fn rule(self) -> Rule {
        match self {
            Self::LeftPoint | Self::MidPoint => Rule::PiecewiseConstant,
            Self::Trapezoid => Rule::Trapezoid,
            Self::PiecewiseLinear => Rule::PiecewiseLinear,
        }
    }
}
