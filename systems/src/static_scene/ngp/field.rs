//! The field: a hash grid, a network for density and one for colour.

use super::NgpConfig;
use super::head::Head;
use crate::buffers::{shapes_hold, sized};
use crate::deform::{Deform, DeformScratch, Moments, Points};
use crate::fields::{Features, HashGridFeatures, VoxelFeatures, xavier};
use crate::space::InternalRay;
use engine::system::SystemError;
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;
use float_core::Simd;

/// Streams of random numbers of the initial parameters.
const INIT: u64 = 0x696e_6974;

/// Parameters and shapes of the field. Positions are in the grid's `[0, 1]^3`.
pub(super) struct Field {
    pub(super) simd: Simd,
    /// What is learnt about places.
    pub(super) features: Box<dyn Features>,
    pub(super) density: Mlp,
    pub(super) colour: Mlp,
    pub(super) harmonics: SphericalHarmonics,
    pub(super) density_params: Vec<f32>,
    pub(super) colour_params: Vec<f32>,
    /// The networks' parameters as the kernels read them: renewed after each step.
    pub(super) density_packed: Packed,
    pub(super) colour_packed: Packed,
    pub(super) density_bias: f32,
    /// What one photo alone shows; only where a method asks.
    pub(super) head: Option<Head>,
    /// What moves; `None`: nothing does.
    pub(super) deform: Option<Deform>,
}

/// The moments of a field in which nothing moves.
static NEVER: Moments = Moments { dims: 0, rows: Vec::new(), times: Vec::new(), still: Vec::new() };

/// The moments of points: which row of `moments` is that of each. Unused where nothing moves.
#[derive(Clone, Copy)]
pub(super) struct When<'a> {
    pub(super) moments: &'a Moments,
    /// `[n]`
    pub(super) which: &'a [u32],
}

/// Work space of [`Field::features`].
#[derive(Default)]
pub(super) struct Placing {
    deform: DeformScratch,
    /// `[3][n]`, where points are, before they are canonical.
    x: Vec<f32>,
    /// Interpolated features, where these are not what the network sees.
    raw: Vec<f32>,
}

impl Placing {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.deform.bytes() + 4 * (self.x.capacity() + self.raw.capacity())
    }
}

/// Scratch for evaluating density without gradients.
#[derive(Default)]
pub(super) struct DensityScratch {
    features: Vec<f32>,
    raw: Vec<f32>,
    mlp: Vec<f32>,
    placing: Placing,
}

impl DensityScratch {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        4 * (self.features.capacity() + self.raw.capacity() + self.mlp.capacity()) + self.placing.bytes()
    }
}

impl Field {
    /// `codes` are the lengths of the appearance and of the transient codes.
    pub(super) fn new(
        config: &NgpConfig,
        codes: [Option<usize>; 2],
        deform: Option<Deform>,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let seen = deform.as_ref().map_or(0, Deform::seen_rows);
        let rng = Rng::new(seed, INIT);
        let features: Box<dyn Features> = match config.voxels {
            0 => Box::new(HashGridFeatures::new(config.hash_grid(), rng.substream(0))?),
            _ => Box::new(VoxelFeatures::new(config.voxel_grid())?),
        };
        let density = config.density_mlp(features.rows() + seen)?;
        let colour = config.colour_mlp(codes[0].unwrap_or(0))?;
        let density_params = xavier(&density, rng.substream(1));
        let colour_params = xavier(&colour, rng.substream(2));
        let head = codes[1].map(|dims| {
            let (geometry, width) = (density.outputs(), config.head_width);
            let start = (config.step_min, config.head_bias);
            Head::new(geometry, dims, width, start, config.mixture.into(), rng.substream(3))
        });
        let mut field = Self {
            head: head.transpose()?,
            deform,
            simd: Simd::best(),
            features,
            density,
            colour,
            harmonics: SphericalHarmonics::new(config.sh_degree, Directions::Unit)
                .map_err(|e| super::config::bad("sh_degree", config.sh_degree, &e.to_string()))?,
            density_params,
            colour_params,
            density_packed: Packed::default(),
            colour_packed: Packed::default(),
            density_bias: config.density_bias,
        };
        field.pack();
        Ok(field)
    }

    /// Renew the packed parameters.
    pub(super) fn pack(&mut self) {
        self.density.pack(&self.density_params, &mut self.density_packed);
        self.colour.pack(&self.colour_params, &mut self.colour_packed);
        if let Some(head) = &mut self.head {
            head.pack();
        }
    }

    /// Bring gradients of what the density network sees, `bars` `[rows][n]` of `features`, to the table and to positions: those
    /// of the interpolated features, those of what a deformation adds.
    pub(super) fn pull<'b>(
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
    pub(super) fn basis<'b>(
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

    /// Moments of the training views.
    pub(super) fn moments(&self) -> &Moments {
        self.deform.as_ref().map_or(&NEVER, Deform::moments)
    }

    /// The moment of a time.
    pub(super) fn moments_at(&self, time: f64) -> Moments {
        self.deform.as_ref().map_or_else(Moments::default, |deform| deform.moments_at(&[time]))
    }

    /// What the density network sees: features of the grid, and what a deformation adds.
    pub(super) fn rows(&self) -> usize {
        self.density.inputs()
    }

    /// What the density network sees of points, `out` `[rows][n]`. Their positions `x` `[3][n]` become canonical ones.
    pub(super) fn seen(&self, x: &mut [f32], when: When<'_>, out: &mut [f32], placing: &mut Placing) {
        let (features, seen) = out.split_at_mut(self.features.rows() * (x.len() / 3));
        if let Some(deform) = &self.deform {
            let was = sized(&mut placing.x, x.len());
            was.copy_from_slice(x);
            let points = Points { x: was, which: when.which, moments: when.moments };
            deform.place(points, x, seen, &mut placing.deform);
        }
        self.features.encode(x, features, &mut placing.raw);
    }

    /// Densities, per internal unit, at `x` `[3][n]`, which become canonical.
    pub(super) fn densities(&self, x: &mut [f32], when: When<'_>, out: &mut [f32], scratch: &mut DensityScratch) {
        let n = out.len();
        let features = sized(&mut scratch.features, self.rows() * n);
        self.seen(x, when, features, &mut scratch.placing);
        let raw = sized(&mut scratch.raw, self.density.outputs() * n);
        let mlp = sized(&mut scratch.mlp, self.density.infer_scratch_len());
        self.density.infer(self.simd, &self.density_packed, features, n, n, raw, n, mlp);
        for (out, raw) in out.iter_mut().zip(&raw[..]) {
            *out = self.density_of(*raw);
        }
    }

    /// Density of a raw output: `exp`, finite.
    #[inline(always)]
    pub(super) fn density_of(&self, raw: f32) -> f32 {
        (raw + self.density_bias).clamp(-80.0, 80.0).exp()
    }

    /// Bytes of the parameters and their packed copies.
    pub(super) fn bytes(&self) -> usize {
        4 * (self.features.parameters().len() + 3 * (self.density_params.len() + self.colour_params.len()))
    }
}
