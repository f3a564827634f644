//! SF-NeRF: occluders are filtered out in image space.
//!
//! Lee, Kim, Heo, Lee, "Semantic-aware Occlusion Filtering Neural Radiance Fields in the Wild", 2023, section 3.
//!
//! Each photo has a code; a network (`filter`) whose input is the place of a pixel, the code and, where the photo has them,
//! features of a self-supervised network predicts how opaque (`alpha`), of what colour (`C_t`) and how uncertain (`beta`) the
//! occluder before the pixel is. It is composited over the render of the field:
//!
//! ```text
//! Y' = alpha C_t + (1 - alpha) C
//! L  = |Y' - Y|^2 / (2 beta^2) + ln beta + lambda_alpha alpha      ([`layer`])
//!    + 0.1 (1 - alpha) |C_coarse - Y|^2                            for fields with a coarse render; alpha a constant
//!    + lambda_sm sum_k 2^k |d alpha / d gamma_k(p)|_1              on 256 pixels of the batch, evenly spread ([`smoothness`])
//! ```
//!
//! Opacities are samples of a Binary Concrete distribution in training, nearly a coin toss, so that the field cannot rely
//! on shares; elsewhere the noise is left out. Pictures of the scene show the field alone.
//!
//! With few photos the filter comes from another scene's run (`pretrained`). The prior on densities, of weight 1e-10, is the
//! field's: its setting `sparsity`.

mod config;
mod filter;
mod layer;
mod pretrained;
mod rates;
mod smoothness;
#[cfg(test)]
mod twin;

pub use config::{FeatureKind, FilterConfig, LayerConfig};
pub use pretrained::{Freeze, PretrainedConfig};

use super::planning::{Build, Planning};
use crate::claims::Claim;
use crate::codes::CodeTable;
use crate::occluders::OccluderModel;
use crate::occluders::likelihood::likelihood;
use crate::occluders::photo_features::{AskedBy, read_features};
use crate::occluders::pixel_error::squared;
use crate::photo_model::{Outcome, PhotoAndRender, Pixel, PixelBar};
use engine::data::Batch;
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use filter::{Filter, FilterInput, OUTPUTS, Shape};
use float_core::Simd;
use layer::{Cost, Layer, LayerLoss};
use losses::concrete::{BinaryConcrete, noise};
use pretrained::{FilterStart, Pretrained};
use rates::Rates;
use scene_io::Features;
use smoothness::{Pick, Smoothness};
use std::path::PathBuf;
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "sf-nerf",
    paper: "Lee et al., 2023",
    what: "Appearance: a free code for each photo; occluders: a filter network in the photo's plane",
    take: "to compare; better with feature files beside the photos",
    differs: "On ngp's field with a filter 64 wide, beta_min 0.1 and a hold of 250 steps; features only from files beside the \
              photos, a pretrained filter only from another run. `--field mlp` has the published sizes and steps.",
    mark: "small filter, ngp field",
};

/// Random streams: initial weights, and the noise of each pixel of a step.
const INIT: u64 = 0x6669_6c74;
const NOISE: u64 = 0x636f_696e;

/// Who asks for features.
const FILES: AskedBy = AskedBy { field: "filter_features", value: "\"files\"", without: "filter_features=none" };

/// Weight of the loss of a coarse render.
const COARSE: f32 = 0.1;

/// Pixels of a batch that the smoothness of opacities is measured on.
const SMOOTH_PIXELS: usize = 256;

/// Factor of the prior on densities.
const SPARSITY: f32 = 1e-10;

/// The filter.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let filter: FilterConfig =
        planning.settings.of(&planning.by_field(FilterConfig::HASH_GRID, FilterConfig::PUBLISHED))?;
    filter.check()?;
    let layer: LayerConfig = planning.settings.of(&planning.by_field(LayerConfig::HASH_GRID, LayerConfig::PUBLISHED))?;
    layer.check()?;
    let mut pretrained: PretrainedConfig = planning.settings.of(&PretrainedConfig::default())?;
    let start = FilterStart::of(&mut pretrained)?;
    planning.settings.record(&pretrained);
    planning.lines.push(start.line(pretrained.filter_freeze));
    planning.of_field.sparsity = SPARSITY;
    let (scene, data, seed) = (planning.scene, planning.data, planning.run.seed);
    Ok(Box::new(move || {
        let features = match filter.filter_features {
            FeatureKind::Files => read_features(scene, data, FILES)?,
            FeatureKind::None => Vec::new(),
        };
        let mut model = SfNerf::new(&filter, &layer, features, data.len(), seed)?;
        model.begin_with(start, pretrained.filter_freeze)?;
        Ok(Box::new(model))
    }))
}

/// The filter, and the loss with it.
struct SfNerf {
    filter: Filter,
    codes: CodeTable,
    /// Of each training view; empty where there are none.
    features: Vec<Arc<Features>>,
    loss: LayerLoss,
    lambda_smooth: f64,
    smoothness: Smoothness,
    rates: Rates,
    seed: u64,
    /// A filter to be read before the first step, and the SHA-256 of its file.
    later: Option<(PathBuf, String)>,
    /// Each pixel of the batch.
    layers: Vec<Layer>,
    raw_bar: Vec<[f32; OUTPUTS]>,
    code_bar: Vec<f32>,
}

impl SfNerf {
    /// For `views` photos with these features, one of each, or none.
    fn new(
        filter: &FilterConfig,
        layer: &LayerConfig,
        features: Vec<Arc<Features>>,
        views: usize,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let shape = Shape {
            octaves: filter.filter_octaves,
            width: filter.filter_width,
            code: filter.transient_dims,
            channels: features.first().map_or(0, |f| f.channels),
        };
        Ok(Self {
            filter: Filter::new(shape, Rng::new(seed, INIT))?,
            codes: CodeTable::new("filter", views, filter.transient_dims, seed),
            features,
            loss: LayerLoss {
                concrete: BinaryConcrete { temperature: layer.filter_temperature },
                likelihood: likelihood(layer.beta_min, layer.tail),
                lambda_alpha: layer.filter_opacity,
            },
            lambda_smooth: f64::from(layer.filter_smoothness),
            smoothness: Smoothness::default(),
            rates: Rates {
                filter: f64::from(filter.filter_lr),
                codes: f64::from(filter.transient_lr),
                hold: filter.filter_hold,
                ease: filter.filter_ease,
            },
            seed,
            later: None,
            layers: Vec::new(),
            raw_bar: Vec::new(),
            code_bar: Vec::new(),
        })
    }

    /// Take the weights of another run, where there are any.
    fn begin_with(&mut self, start: FilterStart, freeze: Freeze) -> Result<(), SystemError> {
        match start {
            FilterStart::Scratch => return Ok(()),
            FilterStart::Of(pretrained) => pretrained.fill(&mut self.filter)?,
            FilterStart::Later(path, sha256) => self.later = Some((path, sha256)),
        }
        self.filter.freeze = freeze;
        Ok(())
    }

    /// The occluder before each pixel of a batch.
    fn predict(&mut self, batch: &Batch, step: u64) {
        let rng = Rng::new(self.seed, NOISE).substream(step);
        let Self { filter, codes, features, layers, loss, .. } = self;
        layers.clear();
        filter.forward(
            Simd::best(),
            batch.len(),
            |i| input_of(codes, features, batch, i),
            |i, raw| layers.push(loss.layer(raw, noise(rng.uniform_at(i as u64)))),
        );
    }

    /// Gradients of the filter and of the codes of the batch.
    fn gradients(&mut self, outcome: &Outcome<'_>) {
        self.raw_bars(outcome);
        self.measure_smoothness(outcome);
        self.filter.backward(outcome.simd, &self.raw_bar, &mut self.code_bar);
        self.smoothness.add_to(&mut self.filter);
    }

    /// Derivative of the mean over the batch with respect to the raw outputs, without the prior.
    fn raw_bars(&mut self, outcome: &Outcome<'_>) {
        let mut bars = std::mem::take(&mut self.raw_bar);
        bars.clear();
        bars.extend(self.layers.iter().enumerate().map(|(i, layer)| {
            let factor = outcome.share * outcome.batch.weight[i];
            self.loss.raw_bar(layer, outcome.pixels[i].rgb, outcome.truth[i], factor)
        }));
        self.raw_bar = bars;
    }

    /// The prior on opacities, on pixels evenly spread over the batch; its derivatives with respect to the raw opacities are
    /// added to theirs.
    fn measure_smoothness(&mut self, outcome: &Outcome<'_>) {
        let Self { filter, codes, features, layers, loss, lambda_smooth, smoothness, raw_bar, .. } = self;
        if *lambda_smooth == 0.0 {
            return smoothness.clear();
        }
        let n = layers.len();
        let count = SMOOTH_PIXELS.min(n);
        let picks: Vec<Pick> = (0..count)
            .map(|k| k * n / count)
            .filter(|&index| outcome.batch.weight[index] > 0.0)
            .map(|index| Pick { index, noise: layers[index].noise })
            .collect();
        let input_of = |i: usize| input_of(codes, features, outcome.batch, i);
        smoothness.measure(filter, outcome.simd, loss.concrete, *lambda_smooth, &picks, input_of);
        for (pick, bar) in picks.iter().zip(&smoothness.h_bar) {
            raw_bar[pick.index][0] += bar;
        }
    }
}

/// The input of the filter at a pixel of a batch.
fn input_of<'a>(codes: &'a CodeTable, features: &'a [Arc<Features>], batch: &Batch, i: usize) -> FilterInput<'a> {
    let view = batch.view[i] as usize;
    FilterInput { place: batch.place[i], code: codes.codes().of(view), features: features.get(view).map(|f| &**f) }
}

impl OccluderModel for SfNerf {
    fn begin(&mut self, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        if let Some((path, sha256)) = self.later.take() {
            Pretrained::read_again(&path, &sha256)?.fill(&mut self.filter)?;
        }
        self.predict(batch, step);
        Ok(())
    }

    /// `|Y' - Y|^2 / (2 beta^2) + ln beta + lambda_alpha alpha`, and its derivative with respect to `C`.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let layer = &self.layers[i];
        let Cost { loss, over_bar, .. } = self.loss.cost(layer, pixel.rgb, truth);
        (loss, PixelBar::colour(over_bar.map(|bar| bar * (1.0 - layer.alpha))))
    }

    /// `0.1 (1 - alpha) |C_coarse - Y|^2`
    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = squared(rgb, truth, COARSE * (1.0 - self.layers[i].alpha));
        (loss, bar.rgb)
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.gradients(outcome);
        let lr = outcome.lr * self.rates.filter;
        let filter = self.filter.step(outcome.simd, lr, lr * self.rates.eased(outcome.step));
        let lr = outcome.lr * self.rates.codes;
        filter + self.codes.learn(outcome.simd, lr, &outcome.batch.view, &self.code_bar, 0.0)
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let [width, height] = seen.size;
        let code = self.codes.codes().of(seen.view);
        let features = self.features.get(seen.view).map(|f| &**f);
        let input_of = |i: usize| {
            let place = [(i % width, width), (i / width, height)].map(|(at, size)| (at as f32 + 0.5) / size as f32);
            FilterInput { place, code, features }
        };
        let raw = self.filter.infer(Simd::best(), width * height, input_of);
        let alpha = |raw: [f32; OUTPUTS]| self.loss.layer(raw, 0.0).alpha;
        Some(raw.into_iter().map(|raw| if alpha(raw) < 0.5 { 1.0 } else { 0.0 }).collect())
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.codes.push_state(out);
        self.filter.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.codes.load_state(state)?;
        self.filter.load_state(state)?;
        self.later = None;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.codes.len() + self.filter.parameter_count()
    }

    fn memory_bytes(&self) -> usize {
        let held = |f: &Arc<Features>| 4 * f.data.len() / Arc::strong_count(f);
        let batch = size_of::<Layer>() * self.layers.capacity() + 4 * OUTPUTS * self.raw_bar.capacity();
        let codes = self.codes.bytes() + 4 * self.code_bar.capacity();
        self.filter.bytes() + self.smoothness.bytes() + codes + batch + self.features.iter().map(held).sum::<usize>()
    }
}

#[cfg(test)]
mod gradients;
