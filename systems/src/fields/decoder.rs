//! From features to density and colour: two networks, or linear maps whose coefficients a network learns for each direction.
//!
//! | decoder | density | colour |
//! | --- | --- | --- |
//! | `hybrid` | `(s, g) = MLP(f)` | `sigmoid(MLP(s, g, Y(d), code))` |
//! | `explicit` | `s = a . f` | `sigmoid(f . b_c(Y(d), code))` for each channel `c`, `b` an MLP |
//!
//! `sigma = exp(s + bias)`. The density's rows are `s`, and what colours depend on: all outputs of the network, or `s` and `f`.
//!
//! Source of the explicit one: Fridovich-Keil et al., "K-Planes", 2023, section 3.4.

use super::basis::{ColourBasis, Columns};
use super::networks::{NetworkConfig, NetworkPrecision};
use crate::settings::{Settings, together};
use engine::system::{MOST_LAYERS, MOST_UNITS, SystemError, at_most};
use field_core::mlp::{Bias, Mlp, MlpConfig, Packed};
use float_core::Simd;
use serde::{Deserialize, Serialize};

/// Which decoder a field has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DecoderKind {
    /// Two networks.
    #[default]
    Hybrid,
    /// Linear maps.
    Explicit,
}

/// Settings of linear maps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplicitConfig {
    /// How the basis multiplies: `f32`, or `bf16` with sums in f32.
    pub precision: NetworkPrecision,
    /// Width of the hidden layers of the colour basis.
    pub basis_width: usize,
    /// Hidden layers of the colour basis.
    pub basis_layers: usize,
    /// Degree of the spherical harmonics of the view direction that the colour basis sees, 1 to 4; 2 is the direction itself.
    pub sh_degree: usize,
    /// Added to the raw log-density: the density that training begins with.
    pub density_bias: f32,
}

/// A decoder that can be chosen: `--set decoder=…`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecoderChoice {
    /// The one that is chosen.
    pub decoder: DecoderKind,
    /// Settings of linear maps, where these are chosen.
    pub explicit: ExplicitConfig,
}

/// A decoder and its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Decoder<'a> {
    Hybrid(&'a NetworkConfig),
    Explicit(&'a ExplicitConfig),
}

/// The name alone.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DecoderName {
    /// What turns features into density and colour: `hybrid` or `explicit`.
    decoder: DecoderKind,
}

impl DecoderChoice {
    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let DecoderName { decoder } = settings.of(&DecoderName { decoder: self.decoder })?;
        let explicit = if decoder == DecoderKind::Explicit { settings.of(&self.explicit)? } else { self.explicit };
        Ok(Self { decoder, explicit })
    }
}

impl ExplicitConfig {
    /// A basis of four layers of 128, which sees the direction itself.
    pub(crate) const PAPER: Self =
        Self { precision: NetworkPrecision::F32, basis_width: 128, basis_layers: 4, sh_degree: 2, density_bias: -1.0 };

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        at_most(&[("basis_width", self.basis_width, MOST_UNITS), ("basis_layers", self.basis_layers, MOST_LAYERS)])?;
        if !self.density_bias.is_finite() {
            return refuse("density_bias", self.density_bias.to_string(), "must be finite");
        }
        if !(1..=4).contains(&self.sh_degree) {
            return refuse("sh_degree", self.sh_degree.to_string(), "must be 1, 2, 3 or 4");
        }
        Ok(())
    }
}

impl Decoder<'_> {
    /// Degree of the spherical harmonics that colours depend on.
    pub(crate) fn sh_degree(&self) -> usize {
        match self {
            Self::Hybrid(config) => config.sh_degree,
            Self::Explicit(config) => config.sh_degree,
        }
    }

    /// Added to the raw log-density.
    pub(crate) fn density_bias(&self) -> f32 {
        match self {
            Self::Hybrid(config) => config.density_bias,
            Self::Explicit(config) => config.density_bias,
        }
    }

    /// Density and colour of this many features; colours see a code of length `code`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(crate) fn made(&self, features: usize, code: usize) -> Result<(DensityDecoder, ColourDecoder), SystemError> {
        match self {
            Self::Hybrid(config) => {
                let (density, colour) = (config.density_mlp(features)?, config.colour_mlp(code)?);
                Ok((DensityDecoder::Network(density), ColourDecoder::Network(colour)))
            }
            Self::Explicit(config) => {
                let refuse = |e: field_core::mlp::MlpError| together("basis_width, basis_layers", config, e);
                let linear = MlpConfig::new(features, vec![], 1).with_bias(Bias::None);
                let density = config.precision.of(Mlp::new(&linear).map_err(refuse)?);
                let hidden = vec![config.basis_width; config.basis_layers];
                let seen = config.sh_degree * config.sh_degree + code;
                let basis = Mlp::new(&MlpConfig::new(seen, hidden, 3 * features).with_bias(Bias::None));
                let basis = ColourBasis::new(config.precision.of(basis.map_err(refuse)?), features);
                Ok((DensityDecoder::Linear(density), ColourDecoder::Basis(basis)))
            }
        }
    }
}

/// From features to the raw log-density and what colours depend on. As [`Mlp`], whose functions these are.
pub(crate) enum DensityDecoder {
    /// A network.
    Network(Mlp),
    /// A linear map of the features, which go on to the colours as they are.
    Linear(Mlp),
}

impl DensityDecoder {
    /// The network, or the linear map.
    pub(crate) fn mlp(&self) -> &Mlp {
        match self {
            Self::Network(mlp) | Self::Linear(mlp) => mlp,
        }
    }

    /// Rows of features.
    pub(crate) fn inputs(&self) -> usize {
        self.mlp().inputs()
    }

    /// Rows: the raw log-density first.
    pub(crate) fn outputs(&self) -> usize {
        match self {
            Self::Network(mlp) => mlp.outputs(),
            Self::Linear(mlp) => 1 + mlp.inputs(),
        }
    }

    pub(crate) fn activations_len(&self, n: usize) -> usize {
        self.mlp().activations_len(n)
    }

    pub(crate) fn infer_scratch_len(&self) -> usize {
        self.mlp().infer_scratch_len()
    }

    pub(crate) fn backward_scratch_len(&self) -> usize {
        self.mlp().backward_scratch_len()
    }

    pub(crate) fn packed_grad_len(&self) -> usize {
        self.mlp().packed_grad_len()
    }

    /// Features that go on to the colours, rows 1 and on of `y`.
    fn pass_on(&self, x: &[f32], x_stride: usize, n: usize, y: &mut [f32], y_stride: usize) {
        if let Self::Linear(mlp) = self {
            for k in 0..mlp.inputs() {
                y[(1 + k) * y_stride..][..n].copy_from_slice(&x[k * x_stride..][..n]);
            }
        }
    }

    /// See [`Mlp::forward`].
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub(crate) fn forward(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        x_stride: usize,
        n: usize,
        y: &mut [f32],
        y_stride: usize,
        acts: &mut [f32],
    ) {
        self.mlp().forward(simd, packed, x, x_stride, n, y, y_stride, acts);
        self.pass_on(x, x_stride, n, y, y_stride);
    }

    /// See [`Mlp::infer`].
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub(crate) fn infer(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        x_stride: usize,
        n: usize,
        y: &mut [f32],
        y_stride: usize,
        scratch: &mut [f32],
    ) {
        self.mlp().infer(simd, packed, x, x_stride, n, y, y_stride, scratch);
        self.pass_on(x, x_stride, n, y, y_stride);
    }

    /// See [`Mlp::backward`].
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub(crate) fn backward(
        &self,
        simd: Simd,
        packed: &Packed,
        acts: &[f32],
        y_bar: &[f32],
        n: usize,
        x_bar: &mut [f32],
        x_stride: usize,
        grad: &mut [f32],
        scratch: &mut [f32],
    ) {
        self.mlp().backward(simd, packed, acts, y_bar, n, n, Some((&mut *x_bar, x_stride)), grad, scratch);
        if let Self::Linear(mlp) = self {
            for k in 0..mlp.inputs() {
                let bars = &y_bar[(1 + k) * n..][..n];
                x_bar[k * x_stride..][..n].iter_mut().zip(bars).for_each(|(sum, bar)| *sum += bar);
            }
        }
    }
}

/// From what [`DensityDecoder`] gives, directions and codes to colours.
pub(crate) enum ColourDecoder {
    /// A network.
    Network(Mlp),
    /// Features on a basis that is learnt for each direction.
    Basis(ColourBasis),
}

impl ColourDecoder {
    /// The network, or that of the basis.
    pub(crate) fn mlp(&self) -> &Mlp {
        match self {
            Self::Network(mlp) => mlp,
            Self::Basis(basis) => basis.mlp(),
        }
    }

    /// Rows: those of the density, then directions, then codes.
    pub(crate) fn inputs(&self) -> usize {
        match self {
            Self::Network(mlp) => mlp.inputs(),
            Self::Basis(basis) => basis.inputs(),
        }
    }

    pub(crate) fn activations_len(&self, n: usize) -> usize {
        match self {
            Self::Network(mlp) => mlp.activations_len(n),
            Self::Basis(basis) => basis.activations_len(n),
        }
    }

    pub(crate) fn infer_scratch_len(&self) -> usize {
        match self {
            Self::Network(mlp) => mlp.infer_scratch_len(),
            Self::Basis(basis) => basis.infer_scratch_len(),
        }
    }

    pub(crate) fn backward_scratch_len(&self) -> usize {
        self.mlp().backward_scratch_len()
    }

    pub(crate) fn packed_grad_len(&self) -> usize {
        self.mlp().packed_grad_len()
    }

    /// Colours `y` `[3][n]` of `x` `[inputs][n]`. See [`Mlp::forward`].
    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(crate) fn forward(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        n: usize,
        columns: Columns<'_>,
        y: &mut [f32],
        acts: &mut [f32],
    ) {
        match self {
            Self::Network(mlp) => mlp.forward(simd, packed, x, n, n, y, n, acts),
            Self::Basis(basis) => basis.forward(simd, packed, x, n, columns, y, acts),
        }
    }

    /// See [`Mlp::infer`].
    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(crate) fn infer(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        n: usize,
        columns: Columns<'_>,
        y: &mut [f32],
        scratch: &mut [f32],
    ) {
        match self {
            Self::Network(mlp) => mlp.infer(simd, packed, x, n, n, y, n, scratch),
            Self::Basis(basis) => basis.infer(simd, packed, x, n, columns, y, scratch),
        }
    }

    /// See [`Mlp::backward`]. With a basis, the gradient with respect to direction and code of a ray is in its first column alone.
    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(crate) fn backward(
        &self,
        simd: Simd,
        packed: &Packed,
        acts: &[f32],
        y_bar: &[f32],
        n: usize,
        columns: Columns<'_>,
        x_bar: Option<&mut [f32]>,
        grad: &mut [f32],
        scratch: &mut [f32],
    ) {
        match self {
            Self::Network(mlp) => {
                mlp.backward(simd, packed, acts, y_bar, n, n, x_bar.map(|x_bar| (x_bar, n)), grad, scratch);
            }
            Self::Basis(basis) => basis.backward(simd, packed, acts, y_bar, n, columns, x_bar, grad, scratch),
        }
    }
}
