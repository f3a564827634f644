//! The tone of each Gaussian in each photo:
//!
//! ```text
//! (b, g) = f(e_j, g_i, c_i)          code of the photo, code of the Gaussian, its colour from all around (equation 4)
//! c'_i = (1 + s g) c_i(d) + s b      its colour in the photo (equation 5); s is `tone_scale`
//! ```
//!
//! The code of the photo is the same for all Gaussians: what the first layer makes of it is added to the biases once.

use super::settings::{ToneSettings, rate_left};
use crate::buffers::sized;
use crate::codes::CodeTable;
use crate::fields::{NetworkParameters, RowNetwork};
use crate::views::{ColourAppearance, ColourBars, Learns, PlaceCodes, VisibleCloud};
use engine::system::{Appearance, SystemError, Tensor, TensorMap};
use field_core::init::Init;
use field_core::mlp::MlpConfig;
use field_core::rng::Rng;
use float_core::Simd;
use optim::AdamConfig;
use rayon::prelude::*;

/// Gaussians per task.
const CHUNK: usize = 1024;
/// Stream of random numbers.
const STREAM: u64 = 0x746f_6e65;
/// Name in checkpoints.
const NAME: &str = "tone.network";
/// Summands and factors of three channels.
const OUTPUTS: usize = 6;

/// The codes of the photos, and the network.
pub(crate) struct Tone {
    settings: ToneSettings,
    /// Steps of the schedule.
    horizon: u64,
    /// One for each photo.
    codes: CodeTable,
    /// Of what belongs to a Gaussian; its parameters are the first ones.
    network: RowNetwork,
    /// Those of the network, then `[width][dims]`, what its first layer makes of a photo's code.
    params: NetworkParameters,
    simd: Simd,
    /// What the last photos said, for the next step.
    held: Vec<Held>,
}

/// What a photo brings to the gradient.
struct Held {
    /// With respect to all parameters.
    params: Vec<f32>,
    /// The photo, where it has a code, and the gradient with respect to that.
    view: Option<u32>,
    code: Vec<f32>,
}

/// Buffers of a chunk.
#[derive(Default)]
struct Scratch {
    x: Vec<f32>,
    y: Vec<f32>,
    y_bar: Vec<f32>,
    acts: Vec<f32>,
    scratch: Vec<f32>,
}

/// What one chunk of Gaussians brings.
struct ChunkBars {
    /// `[3 + ROWS][n]`, with respect to colours from all around and to codes of Gaussians.
    inputs: Vec<f32>,
    network: Vec<f32>,
}

/// Numbers of a Gaussian that the network sees.
const INPUTS: usize = 3 + PlaceCodes::ROWS;

impl Tone {
    /// All tones are those of the cloud at the start, nearly. The schedule is of `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(settings: ToneSettings, photos: usize, horizon: u64, seed: u64) -> Result<Self, SystemError> {
        settings.check()?;
        let (dims, width) = (settings.appearance_dims, settings.tone_width);
        let rng = Rng::new(seed, STREAM);
        let mut params = Vec::new();
        let config = MlpConfig::new(INPUTS, vec![width; 2], OUTPUTS);
        let network = RowNetwork::new(&config, rng.substream(0), &mut params).map_err(|e| SystemError::Config {
            field: "tone_width",
            value: width.to_string(),
            problem: e.to_string(),
        })?;
        let mut of_code = vec![0.0; width * dims];
        Init::XavierUniform.fill(rng.substream(1), INPUTS + dims, width, &mut of_code);
        params.extend(of_code);
        Ok(Self {
            settings,
            horizon,
            codes: CodeTable::new("tone", photos, dims, seed),
            network,
            params: NetworkParameters::new(NAME, params, AdamConfig::DEFAULT),
            simd: Simd::best(),
            held: Vec::new(),
        })
    }

    /// The parameters of the network; those that a test sets.
    #[cfg(test)]
    pub(super) fn parameters(&self) -> &[f32] {
        &self.params.values
    }

    #[cfg(test)]
    pub(super) fn set_parameters(&mut self, params: Vec<f32>) {
        self.params.values = params;
    }

    /// What is held: the gradients with respect to all parameters and to the code of the last photo.
    #[cfg(test)]
    pub(super) fn gradients(&self) -> (Vec<f32>, Vec<f32>) {
        (self.gradient(), self.held.last().map_or_else(Vec::new, |held| held.code.clone()))
    }

    /// What the first layer makes of each number of a code: of each unit a row.
    fn of_code(&self) -> std::slice::ChunksExact<'_, f32> {
        let first = self.params.values.len() - self.settings.tone_width * self.settings.appearance_dims;
        self.params.values[first..].chunks_exact(self.settings.appearance_dims)
    }

    /// The network of a code.
    ///
    /// # Panics
    /// For a code of another length: it is of another system.
    fn network(&self, code: &[f32]) -> RowNetwork {
        assert_eq!(code.len(), self.settings.appearance_dims, "a code has as many numbers as those of the photos");
        let (mut network, mut params) = (self.network.clone(), self.params.values.clone());
        for (bias, row) in params[network.first_biases()].iter_mut().zip(self.of_code()) {
            *bias += row.iter().zip(code).map(|(w, x)| w * x).sum::<f32>();
        }
        network.pack(&params);
        network
    }

    /// What the network sees of Gaussians: `[INPUTS][n]`.
    fn inputs<'x>(seen: VisibleCloud<'_>, x: &'x mut Vec<f32>) -> &'x [f32] {
        let VisibleCloud { cloud, gaussians: visible, .. } = seen;
        let (n, all) = (visible.len(), cloud.gaussians.len());
        let x = sized(x, INPUTS * n);
        let rows = cloud.gaussians.dc.chunks_exact(all.max(1)).take(3);
        let rows = rows.chain(cloud.extra.chunks_exact(all.max(1)).take(PlaceCodes::ROWS));
        for (row, out) in rows.zip(x.chunks_exact_mut(n.max(1))) {
            out.iter_mut().zip(visible).for_each(|(x, gaussian)| *x = row[gaussian.index as usize]);
        }
        x
    }

    /// Backward twin of one chunk of [`ColourAppearance::forward`]; `bar` becomes the gradient with respect to `rgb`.
    fn chunk_backward(
        &self,
        network: &RowNetwork,
        seen: VisibleCloud<'_>,
        rgb: &[[f32; 3]],
        bar: &mut [[f32; 3]],
        scratch: &mut Scratch,
    ) -> ChunkBars {
        let n = seen.gaussians.len();
        let Scratch { x, y, y_bar, acts, scratch } = scratch;
        let x = Self::inputs(seen, x);
        let (y, y_bar) = (sized(y, OUTPUTS * n), sized(y_bar, OUTPUTS * n));
        let acts = network.forward(self.simd, x, n, y, acts);
        let scale = self.settings.tone_scale;
        for (i, (rgb, bar)) in rgb.iter().zip(bar).enumerate() {
            for c in 0..3 {
                y_bar[c * n + i] = scale * bar[c];
                y_bar[(3 + c) * n + i] = scale * rgb[c] * bar[c];
                bar[c] *= 1.0 + scale * y[(3 + c) * n + i];
            }
        }
        let mut inputs = vec![0.0; INPUTS * n];
        let network = network.backward(self.simd, acts, y_bar, n, &mut inputs, scratch);
        ChunkBars { inputs, network }
    }

    /// The gradients of all chunks of a photo, in their order.
    fn all_backward(
        &self,
        code: &[f32],
        seen: VisibleCloud<'_>,
        rgb: &[[f32; 3]],
        bar: &mut [[f32; 3]],
    ) -> Vec<ChunkBars> {
        let network = self.network(code);
        let chunks = seen.gaussians.par_chunks(CHUNK).zip(rgb.par_chunks(CHUNK)).zip(bar.par_chunks_mut(CHUNK));
        chunks
            .map_init(Scratch::default, |scratch, ((gaussians, rgb), bar)| {
                self.chunk_backward(&network, VisibleCloud { gaussians, ..seen }, rgb, bar, scratch)
            })
            .collect()
    }

    /// What chunks bring to all parameters, and to the code.
    fn fold(&self, code: &[f32], chunks: &[ChunkBars]) -> Held {
        let mut params = vec![0.0; self.params.values.len()];
        self.network.fold(chunks.iter().map(|chunk| &chunk.network[..]), &mut Vec::new(), &mut params);
        let biases = params[self.network.first_biases()].to_vec();
        let mut code_bar = vec![0.0; code.len()];
        let first = params.len() - self.settings.tone_width * code.len();
        let rows = params[first..].chunks_exact_mut(code.len().max(1));
        for ((bias_bar, row), row_bar) in biases.iter().zip(self.of_code()).zip(rows) {
            for (k, w) in row.iter().enumerate() {
                row_bar[k] = bias_bar * code[k];
                code_bar[k] += bias_bar * w;
            }
        }
        Held { params, view: None, code: code_bar }
    }

    /// The gradient of what is held, summed in the order in which it came.
    fn gradient(&self) -> Vec<f32> {
        let mut sum = vec![0.0; self.params.values.len()];
        for held in &self.held {
            sum.iter_mut().zip(&held.params).for_each(|(sum, bar)| *sum += bar);
        }
        sum
    }
}

impl ColourAppearance for Tone {
    fn code(&self, appearance: &Appearance) -> Vec<f32> {
        self.codes.codes().code_of(appearance)
    }

    fn forward(&self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &mut [[f32; 3]]) {
        let network = self.network(&self.code(appearance));
        let scale = self.settings.tone_scale;
        let chunks = seen.gaussians.par_chunks(CHUNK).zip(rgb.par_chunks_mut(CHUNK));
        chunks.for_each_init(Scratch::default, |scratch, (visible, rgb)| {
            let n = visible.len();
            let Scratch { x, y, scratch, .. } = scratch;
            let x = Self::inputs(VisibleCloud { gaussians: visible, ..seen }, x);
            let (y, scratch) = (sized(y, OUTPUTS * n), sized(scratch, network.infer_scratch_len()));
            network.infer(self.simd, x, n, y, scratch);
            for (i, rgb) in rgb.iter_mut().enumerate() {
                *rgb = [0, 1, 2].map(|c| (1.0 + scale * y[(3 + c) * n + i]) * rgb[c] + scale * y[c * n + i]);
            }
        });
    }

    fn backward(&mut self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bars: ColourBars<'_>) {
        let code = self.code(appearance);
        let chunks = self.all_backward(&code, seen, rgb, bars.rgb);
        let all = seen.cloud.gaussians.len();
        for ((visible, base), chunk) in seen.gaussians.chunks(CHUNK).zip(bars.base.chunks_mut(CHUNK)).zip(&chunks) {
            let (of_base, of_places) = chunk.inputs.split_at(3 * visible.len());
            let n = visible.len();
            for (i, base) in base.iter_mut().enumerate() {
                *base = [0, 1, 2].map(|c| base[c] + of_base[c * n + i]);
            }
            for (row, place) in of_places.chunks_exact(n.max(1)).enumerate() {
                for (gaussian, bar) in visible.iter().zip(place) {
                    bars.extra[row * all + gaussian.index as usize] += bar;
                }
            }
        }
        let mut held = self.fold(&code, &chunks);
        if let Appearance::View(view) = appearance {
            held.view = u32::try_from(*view).ok();
        }
        self.held.push(held);
    }

    fn code_bar(&self, code: &[f32], seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bar: &mut [[f32; 3]]) -> Vec<f32> {
        let chunks = self.all_backward(code, seen, rgb, bar);
        self.fold(code, &chunks).code
    }
}

impl Learns for Tone {
    fn step(&mut self, simd: Simd, step: u64) -> usize {
        if self.held.is_empty() {
            return 0;
        }
        let gradient = self.gradient();
        let left = rate_left(step as f64 / self.horizon.max(1) as f64);
        let mut bad = self.params.step(simd, left * self.settings.tone_lr, &gradient);
        for held in std::mem::take(&mut self.held) {
            if let Some(view) = held.view {
                bad += self.codes.learn(simd, left * self.settings.code_lr, &[view], &held.code, 0.0);
            }
        }
        bad
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = self.params.state();
        self.codes.push_state(&mut out);
        out
    }

    fn forget(&mut self) {
        self.held.clear();
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let mut params = self.params.clone();
        params.load(state)?;
        self.codes.load_state(state)?;
        self.params = params;
        self.held.clear();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.params.values.len() + self.codes.len()
    }
}
