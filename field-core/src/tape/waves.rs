//! Encodings by waves as tape operations: frequency, integrated, spherical harmonics.

use super::encode::Encoder;
use crate::FieldError;
use crate::encoding::EncodingBars;
use crate::encoding::frequency::Frequency;
use crate::encoding::integrated::{Gaussians, Integrated};
use crate::encoding::spherical_harmonics::SphericalHarmonics;
use float_core::Simd;

/// A frequency encoding with a weight for each octave; `W` borrows the weights (`&[f32]`) or owns them (`Vec<f32>`).
#[derive(Clone, Copy, Debug)]
pub struct Windowed<W> {
    /// The encoding.
    pub encoding: Frequency,
    /// `[octaves]`, or `None` for 1.
    pub window: Option<W>,
}

impl Windowed<&[f32]> {
    /// An encoding whose octaves all have weight 1.
    #[must_use]
    pub fn open(encoding: Frequency) -> Self {
        Self { encoding, window: None }
    }
}

impl<W: AsRef<[f32]>> Windowed<W> {
    fn weights(&self) -> Option<&[f32]> {
        self.window.as_ref().map(W::as_ref)
    }
}

impl<W: AsRef<[f32]> + Send + Sync> Encoder for Windowed<W> {
    const NAME: &'static str = "frequency";

    fn in_rows(&self) -> usize {
        self.encoding.dims()
    }

    fn out_rows(&self) -> usize {
        self.encoding.out_rows()
    }

    fn encode(&self, simd: Simd, _table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.encoding.encode(simd, x, self.weights(), out)
    }

    fn backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        bars.x.map_or(Ok(()), |x_bar| self.encoding.encode_backward(simd, x, self.weights(), out_bar, x_bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.encoding.tangent(simd, x, self.weights(), x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let Some(x_bar) = bars.x else { return Ok(()) };
        self.encoding.tangent_backward_x(simd, x, self.weights(), x_dot, out_dot_bar, x_bar)
    }
}

impl Encoder for Frequency {
    const NAME: &'static str = "frequency";

    fn in_rows(&self) -> usize {
        self.dims()
    }

    fn out_rows(&self) -> usize {
        Frequency::out_rows(self)
    }

    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        Encoder::encode(&Windowed::open(*self), simd, table, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        Windowed::open(*self).backward(simd, table, x, out_bar, bars)
    }

    fn tangent(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        Windowed::open(*self).tangent(simd, table, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        Windowed::open(*self).tangent_backward(simd, table, x, x_dot, out_dot_bar, bars)
    }
}

impl Encoder for Integrated {
    const NAME: &'static str = "integrated";

    fn in_rows(&self) -> usize {
        2 * self.dims()
    }

    fn out_rows(&self) -> usize {
        Integrated::out_rows(self)
    }

    fn encode(&self, simd: Simd, _table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        let Gaussians { mean, var } = Gaussians::stacked(x);
        Integrated::encode(self, simd, mean, var, out)
    }

    fn backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let Some(x_bar) = bars.x else { return Ok(()) };
        let Gaussians { mean, var } = Gaussians::stacked(x);
        let (mean_bar, var_bar) = x_bar.split_at_mut(mean.len());
        self.encode_backward(simd, mean, var, out_bar, Some(mean_bar), Some(var_bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        Integrated::tangent(self, simd, Gaussians::stacked(x), Gaussians::stacked(x_dot), out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let Some(x_bar) = bars.x else { return Ok(()) };
        let (mean_bar, var_bar) = x_bar.split_at_mut(x.len() / 2);
        let (at, dot) = (Gaussians::stacked(x), Gaussians::stacked(x_dot));
        Integrated::tangent_backward(self, simd, at, dot, out_dot_bar, Some(mean_bar), Some(var_bar))
    }
}

impl Encoder for SphericalHarmonics {
    const NAME: &'static str = "spherical_harmonics";

    fn in_rows(&self) -> usize {
        3
    }

    fn out_rows(&self) -> usize {
        SphericalHarmonics::out_rows(self)
    }

    fn encode(&self, simd: Simd, _table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        SphericalHarmonics::encode(self, simd, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        bars.x.map_or(Ok(()), |x_bar| self.encode_backward(simd, x, out_bar, x_bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        SphericalHarmonics::tangent(self, simd, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        _table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        bars.x.map_or(Ok(()), |x_bar| self.tangent_backward_d(simd, x, x_dot, out_dot_bar, x_bar))
    }
}
