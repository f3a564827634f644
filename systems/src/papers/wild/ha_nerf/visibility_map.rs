//! The visibility map of Ha-NeRF (section 3.3): a small network over the photo's plane with a code for each photo.

use super::VisibilityConfig;
use crate::codes::CodeTable;
use crate::limits::refuse;
use crate::occluders::pixel_network::PixelNetwork;
use crate::photo_model::{Outcome, PhotoAndRender};
use engine::data::Batch;
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::mlp::{Mlp, MlpConfig};
use field_core::rng::Rng;
use float_core::Simd;
use float_core::m32::logistic;
use std::ops::Range;

/// Stream of the initial parameters.
const INIT: u64 = 0x0076_6973_6962_6c65;

/// The network and its input.
pub(super) struct VisibilityMap {
    input: Input,
    pub(super) network: PixelNetwork,
    lr: f64,
    code_lr: f64,
    code_bar: Vec<f32>,
}

/// The input of the network at a pixel: the code of its photo, and its place in the photo.
struct Input {
    codes: CodeTable,
    octaves: Frequency,
    simd: Simd,
}

impl Input {
    /// `[code, place, octaves of it][pixels]` for pixels whose photo and place are `of(i)`.
    fn fill(&self, of: impl Fn(usize) -> (usize, [f32; 2]), pixels: Range<usize>, x: &mut [f32]) {
        let (n, codes) = (pixels.len(), self.codes.codes());
        let (rows, octaves) = x.split_at_mut(codes.dims * n);
        let mut places = vec![0.0; 2 * n];
        for (j, i) in pixels.enumerate() {
            let (view, place) = of(i);
            for (k, &value) in codes.of(view).iter().enumerate() {
                rows[k * n + j] = value;
            }
            [places[j], places[n + j]] = place;
        }
        self.octaves.encode(self.simd, &places, None, octaves).expect("two rows in, theirs out");
    }
}

impl VisibilityMap {
    /// # Errors
    /// [`SystemError::Config`] for a network without size.
    pub(super) fn new(settings: &VisibilityConfig, views: usize, seed: u64) -> Result<Self, SystemError> {
        let octaves = match Frequency::new(2, settings.visibility_octaves, Base::One, Identity::Include) {
            Ok(octaves) => octaves,
            Err(e) => return refuse("visibility_octaves", settings.visibility_octaves, e.to_string()),
        };
        let mlp = Mlp::new(&MlpConfig::new(
            settings.visibility_dims + octaves.out_rows(),
            vec![settings.visibility_width; settings.visibility_depth],
            1,
        ));
        let mlp = match mlp {
            Ok(mlp) => mlp,
            Err(e) => return refuse("visibility_width", settings.visibility_width, e.to_string()),
        };
        Ok(Self {
            input: Input {
                codes: CodeTable::new("visibility", views, settings.visibility_dims, seed),
                octaves,
                simd: Simd::best(),
            },
            network: PixelNetwork::new("visibility_net", mlp, Rng::new(seed, INIT)),
            lr: f64::from(settings.visibility_lr),
            code_lr: f64::from(settings.visibility_code_lr),
            code_bar: Vec::new(),
        })
    }

    /// The map at the pixels of a batch, written to `m`.
    pub(super) fn forward(&mut self, batch: &Batch, m: &mut Vec<f32>) {
        let Self { input, network, .. } = self;
        m.clear();
        let of = |i: usize| (batch.view[i] as usize, batch.place[i]);
        let fill = |pixels: Range<usize>, x: &mut [f32]| input.fill(of, pixels, x);
        network.forward(input.simd, batch.len(), fill, |_, y| m.extend(y.iter().map(|&y| logistic(y))));
    }

    /// One step from the derivatives `m_bar(i)` of the loss with respect to the map `m` of [`VisibilityMap::forward`]. Returns
    /// the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>, m: &[f32], m_bar: impl Fn(usize) -> f32 + Sync) -> usize {
        let dims = self.input.codes.codes().dims;
        let Self { network, code_bar, .. } = self;
        code_bar.clear();
        code_bar.resize(outcome.batch.len() * dims, 0.0);
        network.backward(
            outcome.simd,
            |pixels, y_bar| {
                y_bar.iter_mut().zip(pixels).for_each(|(y_bar, i)| *y_bar = m_bar(i) * m[i] * (1.0 - m[i]));
            },
            |pixels, x_bar| {
                let n = pixels.len();
                for (j, bars) in code_bar[pixels.start * dims..pixels.end * dims].chunks_exact_mut(dims).enumerate() {
                    bars.iter_mut().enumerate().for_each(|(k, bar)| *bar = x_bar[k * n + j]);
                }
            },
        );
        network.step(outcome.simd, outcome.lr * self.lr)
            + self.input.codes.learn(outcome.simd, outcome.lr * self.code_lr, &outcome.batch.view, code_bar, 0.0)
    }

    /// The map of a whole photo, row by row.
    pub(super) fn of_view(&self, seen: &PhotoAndRender<'_>) -> Vec<f32> {
        let [width, height] = seen.size;
        let at = |n: usize, size: usize| (n as f32 + 0.5) / size as f32;
        let of = |i: usize| (seen.view, [at(i % width, width), at(i / width, height)]);
        let fill = |pixels: Range<usize>, x: &mut [f32]| self.input.fill(of, pixels, x);
        let mut m = self.network.infer(self.input.simd, width * height, fill);
        m.iter_mut().for_each(|m| *m = logistic(*m));
        m
    }

    pub(super) fn parameter_count(&self) -> usize {
        self.input.codes.len() + self.network.params.len()
    }

    pub(super) fn memory_bytes(&self) -> usize {
        self.input.codes.bytes() + self.network.bytes() + 4 * self.code_bar.capacity()
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.input.codes.push_state(out);
        self.network.push_state(out);
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.input.codes.load_state(state)?;
        self.network.load_state(state)
    }
}
