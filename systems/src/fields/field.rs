//! A field: features of points, a network for density and one for colour; and a deformation, where something moves.

use super::placing::{Placing, When, fill_times, knows_time, seen, steps_of};
use super::{ColourDecoder, Decoder, DensityDecoder, Features, Mixed, MovingPart, MovingPoints, xavier};
use crate::buffers::{shapes_hold, sized};
use crate::space::InternalRay;
use crate::warps::{Deform, TimeSteps};
use engine::system::SystemError;
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::mlp::Packed;
use field_core::rng::Rng;
use float_core::Simd;

/// Parameters and shapes of the field. Positions are in the grid's `[0, 1]^3`.
pub(crate) struct Field {
    pub(crate) simd: Simd,
    /// What is learnt about places.
    pub(crate) features: Box<dyn Features>,
    pub(crate) density: DensityDecoder,
    pub(crate) colour: ColourDecoder,
    pub(crate) harmonics: SphericalHarmonics,
    pub(crate) density_params: Vec<f32>,
    pub(crate) colour_params: Vec<f32>,
    /// The networks' parameters as the kernels read them: renewed after each step.
    pub(crate) density_packed: Packed,
    pub(crate) colour_packed: Packed,
    pub(crate) density_bias: f32,
    /// What moves points; `None`: nothing does.
    pub(crate) deform: Option<Deform>,
    /// What moves before what stands still, with its deformation; `None`: one field for all.
    pub(crate) moving: Option<MovingPart>,
    /// Time steps of the training views, where no deformation has them.
    time_steps: TimeSteps,
}

/// Scratch for evaluating density without gradients.
#[derive(Default)]
pub(crate) struct DensityScratch {
    features: Vec<f32>,
    raw: Vec<f32>,
    mlp: Vec<f32>,
    placing: Placing,
    moving: MovingPoints,
    mixed: Mixed,
}

impl DensityScratch {
    /// Points of the last pass at which something moves, and both parts there.
    pub(crate) fn moving(&self) -> (&MovingPoints, &Mixed) {
        (&self.moving, &self.mixed)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        4 * (self.features.capacity() + self.raw.capacity() + self.mlp.capacity())
            + self.placing.bytes()
            + self.moving.bytes()
            + self.mixed.bytes()
    }
}

impl Field {
    /// A field of these features; `code` is the length of the appearance codes that its colours depend on.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(crate) fn new(
        features: Box<dyn Features>,
        decoder: Decoder<'_>,
        code: usize,
        deform: Option<Deform>,
        rng: &Rng,
    ) -> Result<Self, SystemError> {
        let seen = deform.as_ref().map_or(0, Deform::seen_rows);
        let (density, colour) = decoder.made(features.rows() + seen, code)?;
        let degree = decoder.sh_degree();
        let harmonics = SphericalHarmonics::new(degree, Directions::Unit).map_err(|e| SystemError::Config {
            field: "sh_degree",
            value: degree.to_string(),
            problem: e.to_string(),
        })?;
        let mut field = Self {
            density_params: xavier(density.mlp(), rng.substream(1)),
            colour_params: xavier(colour.mlp(), rng.substream(2)),
            time_steps: steps_of(features.view_times().to_vec()),
            deform,
            moving: None,
            simd: Simd::best(),
            features,
            density,
            colour,
            harmonics,
            density_packed: Packed::default(),
            colour_packed: Packed::default(),
            density_bias: decoder.density_bias(),
        };
        field.pack();
        Ok(field)
    }

    /// Renew the packed parameters.
    pub(crate) fn pack(&mut self) {
        self.density.mlp().pack(&self.density_params, &mut self.density_packed);
        self.colour.mlp().pack(&self.colour_params, &mut self.colour_packed);
    }

    /// Bring gradients of what the density network sees, `bars` `[rows][n]` of `features`, to the table and to positions: those
    /// of the interpolated features, those of what a deformation adds.
    pub(crate) fn pull<'b>(
        &self,
        features: &[f32],
        n: usize,
        bars: &'b mut [f32],
        raw: &'b mut Vec<f32>,
    ) -> (&'b [f32], &'b [f32]) {
        let (bars, seen) = bars.split_at_mut(self.features.rows() * n);
        (self.features.pull(features, n, bars, raw), seen)
    }

    /// What the colour network sees of rays: `[sh + more][rays]`, the basis of the view directions and room for `more` rows,
    /// which are returned.
    pub(crate) fn basis<'b>(
        &self,
        rays: &[InternalRay],
        more: usize,
        d: &mut Vec<f32>,
        out: &'b mut Vec<f32>,
    ) -> &'b mut [f32] {
        let n = rays.len();
        let d = sized(d, 3 * n);
        for (i, ray) in rays.iter().enumerate() {
            (d[i], d[n + i], d[2 * n + i]) = (ray.view[0], ray.view[1], ray.view[2]);
        }
        let rows = self.harmonics.out_rows() * n;
        let (basis, codes) = sized(out, rows + more * n).split_at_mut(rows);
        shapes_hold(self.harmonics.encode(self.simd, d, basis));
        codes
    }

    /// Time steps of the training views.
    pub(crate) fn time_steps(&self) -> &TimeSteps {
        match &self.moving {
            Some(moving) => moving.time_steps(),
            None => self.deform.as_ref().map_or(&self.time_steps, Deform::time_steps),
        }
    }

    /// The time step of a time.
    pub(crate) fn time_steps_at(&self, time: f64) -> TimeSteps {
        match self.deform() {
            Some(deform) => deform.time_steps_at(&[time]),
            None if self.time_steps().times.is_empty() => TimeSteps::default(),
            None => steps_of(vec![(2.0 * time - 1.0) as f32]),
        }
    }

    /// What the density network sees: features of the grid, and what a deformation adds.
    pub(crate) fn rows(&self) -> usize {
        self.density.inputs()
    }

    /// What the density network sees of points, `out` `[rows][n]`. Their positions `x` `[3][n]` become canonical ones.
    pub(crate) fn seen(&self, x: &mut [f32], when: When<'_>, out: &mut [f32], placing: &mut Placing) {
        seen(&*self.features, self.deform.as_ref(), x, when, out, placing);
    }

    /// Whether anything depends on the time: points, or what is seen of them.
    pub(crate) fn is_timed(&self) -> bool {
        self.deform.is_some() || knows_time(&*self.features) || self.moving.as_ref().is_some_and(MovingPart::is_timed)
    }

    /// Times of points, as the features take them: `[n]`, or none where these know no time.
    pub(crate) fn fill_times(&self, when: When<'_>, out: &mut Vec<f32>) {
        fill_times(&*self.features, when, out);
    }

    /// What moves points, and what else is learnt of the time: of the field, or of its moving part.
    pub(crate) fn deform(&self) -> Option<&Deform> {
        self.deform.as_ref().or_else(|| self.moving.as_ref()?.deform.as_ref())
    }

    /// The same, to learn.
    pub(crate) fn deform_mut(&mut self) -> Option<&mut Deform> {
        self.deform.as_mut().or_else(|| self.moving.as_mut()?.deform.as_mut())
    }

    /// Densities, per internal unit, at `x` `[3][n]`, which become canonical.
    pub(crate) fn densities(&self, x: &mut [f32], when: When<'_>, out: &mut [f32], scratch: &mut DensityScratch) {
        let mut raw = std::mem::take(&mut scratch.raw);
        let outputs = sized(&mut raw, self.density.outputs() * out.len());
        self.outputs(x, when, outputs, scratch);
        for (out, raw) in out.iter_mut().zip(&raw[..]) {
            *out = self.density_of(*raw);
        }
        scratch.raw = raw;
    }

    /// What the density network gives, `out` `[outputs][n]`, with the moving part in it, at `x` `[3][n]`, which become canonical where
    /// all of the field moves.
    pub(crate) fn outputs(&self, x: &mut [f32], when: When<'_>, out: &mut [f32], scratch: &mut DensityScratch) {
        let n = x.len() / 3;
        let features = sized(&mut scratch.features, self.rows() * n);
        self.seen(x, when, features, &mut scratch.placing);
        let mlp = sized(&mut scratch.mlp, self.density.infer_scratch_len());
        self.density.infer(self.simd, &self.density_packed, features, n, n, out, n, mlp);
        if let Some(moving) = &self.moving {
            scratch.moving.find(moving, x, when);
            scratch.mixed.infer(self.simd, moving, scratch.moving.all(), out);
        }
    }

    /// Density of a raw output: `exp`, finite.
    #[inline(always)]
    pub(crate) fn density_of(&self, raw: f32) -> f32 {
        (raw + self.density_bias).clamp(-80.0, 80.0).exp()
    }

    /// Bytes of the parameters and their packed copies.
    pub(crate) fn bytes(&self) -> usize {
        let moving = self.moving.as_ref().map_or(0, MovingPart::bytes);
        moving + 4 * (self.features.parameters().len() + 3 * (self.density_params.len() + self.colour_params.len()))
    }
}
