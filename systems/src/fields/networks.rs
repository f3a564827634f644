//! The two small networks of a field: one for density and what colour depends on, one for colour.

use engine::system::{MOST_LAYERS, MOST_UNITS, SystemError, at_most};
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Precision};
use serde::{Deserialize, Serialize};

/// How networks multiply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkPrecision {
    /// 32-bit floats.
    #[default]
    F32,
    /// Factors rounded to bfloat16, sums and parameters 32-bit floats.
    Bf16,
}

impl NetworkPrecision {
    pub(super) fn of(self, mlp: Mlp) -> Mlp {
        mlp.with_precision(match self {
            Self::F32 => Precision::F32,
            Self::Bf16 => Precision::Bf16,
        })
    }
}

/// Settings of the networks of a field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// How the networks multiply: `f32`, or `bf16` with sums in f32.
    pub precision: NetworkPrecision,
    /// Width of the hidden layers of both networks.
    pub width: usize,
    /// Hidden layers of the density network.
    pub density_layers: usize,
    /// Hidden layers of the colour network.
    pub colour_layers: usize,
    /// Outputs of the density network: log-density first, all of them feed the colour network.
    pub geometry: usize,
    /// Degree of the spherical harmonics of the view direction, 1 to 4.
    pub sh_degree: usize,
    /// Added to the raw log-density: the density that training begins with.
    pub density_bias: f32,
}

fn bad(field: &'static str, value: impl ToString, problem: &str) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.into() }
}

impl NetworkConfig {
    /// The density network of `inputs` features.
    ///
    /// # Errors
    /// [`SystemError::Config`] for an empty layer.
    ///
    /// # Panics
    /// If there is no memory for the layers; [`NetworkConfig::check`] refuses them.
    pub fn density_mlp(&self, inputs: usize) -> Result<Mlp, SystemError> {
        Mlp::new(&MlpConfig::new(inputs, vec![self.width; self.density_layers], self.geometry).with_bias(Bias::None))
            .map(|mlp| self.precision.of(mlp))
            .map_err(|e| bad("width, geometry", "", &e.to_string()))
    }

    /// The density network of a part that moves, of `inputs` features: one output more, its gate, and `more` after that.
    ///
    /// # Errors
    /// [`SystemError::Config`] for an empty layer.
    ///
    /// # Panics
    /// As [`NetworkConfig::density_mlp`].
    pub fn moving_mlp(&self, inputs: usize, more: usize) -> Result<Mlp, SystemError> {
        Self { geometry: self.geometry + 1 + more, ..*self }.density_mlp(inputs)
    }

    /// The colour network; `code` is the length of the appearance code it sees.
    ///
    /// # Errors
    /// [`SystemError::Config`] for an empty layer.
    ///
    /// # Panics
    /// As [`NetworkConfig::density_mlp`].
    pub fn colour_mlp(&self, code: usize) -> Result<Mlp, SystemError> {
        Mlp::new(
            &MlpConfig::new(
                self.geometry + self.sh_degree * self.sh_degree + code,
                vec![self.width; self.colour_layers],
                3,
            )
            .with_bias(Bias::None)
            .with_output_activation(Activation::LOGISTIC),
        )
        .map(|mlp| self.precision.of(mlp))
        .map_err(|e| bad("width, colour_layers", "", &e.to_string()))
    }

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[
            ("width", self.width, MOST_UNITS),
            ("geometry", self.geometry, MOST_UNITS),
            ("colour_layers", self.colour_layers, MOST_LAYERS),
        ])?;
        if !(1..=8).contains(&self.density_layers) {
            return Err(bad("density_layers", self.density_layers, "must be in 1..=8"));
        }
        if !self.density_bias.is_finite() {
            return Err(bad("density_bias", self.density_bias, "must be finite"));
        }
        if !(1..=4).contains(&self.sh_degree) {
            return Err(bad("sh_degree", self.sh_degree, "must be 1, 2, 3 or 4"));
        }
        Ok(())
    }
}
