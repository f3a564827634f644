//! How space is laid out, and where the scene is in it.

use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// How space is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SpaceKind {
    /// Everything lies in a box.
    Box,
    /// An inner cube, and all the rest of space contracted around it.
    Contracted,
    /// All cameras look the same way: normalised device coordinates.
    Ndc,
}

impl SpaceKind {
    /// Internal length of the unit cube that features are over: of a side of the inner cube, and twice that where space is contracted.
    #[must_use]
    pub(crate) fn grid_span(self) -> f32 {
        if self == Self::Contracted { 4.0 } else { 2.0 }
    }

    /// The word in `--set space=…`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Contracted => "contracted",
            Self::Ndc => "ndc",
        }
    }
}

/// Where the scene is. Lengths but for `centre` and `radius` are *internal*: the radius of the scene is 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpaceConfig {
    /// How space is laid out: `box`, `contracted` or `ndc`.
    pub space: SpaceKind,
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units: half the side of a box scene, the inner region of an unbounded one.
    pub radius: f64,
    /// Distance before which nothing is sampled.
    pub near: f32,
    /// Cubes that rays go through, each twice the size of the one before.
    pub cascades: usize,
}

impl SpaceConfig {
    /// Half the side of the outermost cube, internal units.
    #[must_use]
    pub fn extent(&self) -> f64 {
        f64::from(1_u32 << (self.cascades.clamp(1, 16) - 1))
    }

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        for (field, value) in [("radius", self.radius), ("near", f64::from(self.near))] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value.to_string(), "must be positive and finite");
            }
        }
        if self.near > 1e6 {
            return refuse("near", self.near.to_string(), "must be at most 1e6 radii");
        }
        if !self.centre.iter().all(|c| c.is_finite()) {
            return refuse("centre", format!("{:?}", self.centre), "must be three finite numbers");
        }
        if !(1..=16).contains(&self.cascades) || (self.space != SpaceKind::Contracted && self.cascades != 1) {
            let problem = "must be in 1..=16, and 1 unless `space` is contracted";
            return refuse("cascades", self.cascades.to_string(), problem);
        }
        Ok(())
    }
}
