//! SF-NeRF: what stands before the scene is filtered out in image space.
//!
//! Lee, Kim, Heo, Lee, "Semantic-aware Occlusion Filtering Neural Radiance Fields in the Wild", 2023, section 3.
//!
//! Each photo has a code; a network that sees the place of a pixel, the code and, where the photo has them, features of a
//! self-supervised network says how opaque (`alpha`), of what colour (`C_t`) and how uncertain (`beta`) what covers the
//! pixel is. It is put over what the field renders there:
//!
//! ```text
//! Y' = alpha C_t + (1 - alpha) C
//! L  = |Y' - Y|^2 / (2 beta^2) + ln beta + lambda_alpha alpha
//!    + 0.1 (1 - alpha) |C_coarse - Y|^2                       for fields that look twice; alpha a constant
//!    + lambda_sm sum_k 2^k |d alpha / d gamma_k(p)|_1         on 256 pixels of the batch, evenly spread over it
//! ```
//!
//! Opacities are samples of a Binary Concrete distribution in training, nearly a coin toss, so that the field cannot rely
//! on shares; elsewhere the noise is left out. Pictures of the scene show the field alone.
//!
//! With few photos the filter comes from another scene's run ([`super::pretrained`]). The prior on densities, of weight 1e-10,
//! is the field's: its setting `sparsity`.

use super::codes::CodeTable;
use super::config::{FeatureKind, Freeze, WildConfig};
use super::cover::{Cost, Cover, CoverLoss};
use super::filter::{Filter, OUTPUTS, Shape, Spot};
use super::light::Light;
use super::likelihood::likelihood;
use super::photo_features::read_features;
use super::pretrained::{FilterStart, Pretrained};
use super::rates::Rates;
use super::slopes::{Pick, Slopes};
use super::squared;
use crate::method::{Codes, Method, Outcome, Pixel, PixelBar, Relit, SecondLight, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use losses::concrete::{BinaryConcrete, noise};
use scene_io::{Features, Scene};
use std::path::PathBuf;
use std::sync::Arc;

/// Random streams: initial weights, and the noise of each pixel of a step.
const INIT: u64 = 0x6669_6c74;
const NOISE: u64 = 0x636f_696e;

/// Weight of a field's first look.
const COARSE: f32 = 0.1;

/// Pixels of a batch that the smoothness of opacities is measured on.
const SMOOTH_PIXELS: usize = 256;

/// The method.
pub(super) struct SfNerf {
    light: Option<Light>,
    filter: Filter,
    codes: CodeTable,
    /// Of each training view; empty where there are none.
    features: Vec<Arc<Features>>,
    judge: CoverLoss,
    lambda_smooth: f64,
    rates: Rates,
    seed: u64,
    /// A filter to be read before the first step, and the SHA-256 of its file.
    later: Option<(PathBuf, String)>,
    /// Each pixel of the batch.
    cover: Vec<Cover>,
    raw_bar: Vec<[f32; OUTPUTS]>,
    code_bar: Vec<f32>,
}

impl SfNerf {
    pub(super) fn new(
        config: &WildConfig,
        light: Option<Light>,
        scene: &Scene,
        data: &Dataset,
        (start, seed): (FilterStart, u64),
    ) -> Result<Self, SystemError> {
        let features = match config.filter_features {
            FeatureKind::Files => read_features(scene, data)?,
            FeatureKind::None => Vec::new(),
        };
        let mut method = Self::with_features(config, light, features, data.len(), seed)?;
        match start {
            FilterStart::Scratch => {}
            FilterStart::Of(pretrained) => method.begin_with(&pretrained, config.filter_freeze)?,
            FilterStart::Later(path, sha256) => {
                method.filter.freeze = config.filter_freeze;
                method.later = Some((path, sha256));
            }
        }
        Ok(method)
    }

    fn begin_with(&mut self, pretrained: &Pretrained, freeze: Freeze) -> Result<(), SystemError> {
        pretrained.fill(&mut self.filter)?;
        self.filter.freeze = freeze;
        Ok(())
    }

    /// For `views` photos with these features, one of each, or none.
    fn with_features(
        config: &WildConfig,
        light: Option<Light>,
        features: Vec<Arc<Features>>,
        views: usize,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let shape = Shape {
            octaves: config.filter_octaves,
            width: config.filter_width,
            code: config.transient_dims,
            channels: features.first().map_or(0, |f| f.channels),
        };
        Ok(Self {
            light,
            filter: Filter::new(shape, Rng::new(seed, INIT))?,
            codes: CodeTable::new("filter", views, config.transient_dims, seed),
            features,
            judge: CoverLoss {
                concrete: BinaryConcrete { temperature: config.filter_temperature },
                likelihood: likelihood(config),
                lambda_alpha: config.filter_opacity,
            },
            lambda_smooth: f64::from(config.filter_smoothness),
            rates: Rates {
                filter: f64::from(config.filter_lr),
                codes: f64::from(config.transient_lr),
                hold: config.filter_hold,
                ease: config.filter_ease,
            },
            seed,
            later: None,
            cover: Vec::new(),
            raw_bar: Vec::new(),
            code_bar: Vec::new(),
        })
    }

    /// What stands before each pixel of a batch.
    fn cover(&mut self, batch: &Batch, step: u64) {
        let rng = Rng::new(self.seed, NOISE).substream(step);
        let Self { filter, codes, features, cover, judge, .. } = self;
        cover.clear();
        filter.forward(
            Simd::best(),
            batch.len(),
            |i| spot(codes, features, batch, i),
            |i, raw| cover.push(judge.cover(raw, noise(rng.uniform_at(i as u64)))),
        );
    }

    /// Gradients of the filter and of the codes of the batch.
    fn gradients(&mut self, outcome: &Outcome<'_>) {
        self.raw_bars(outcome);
        let slopes = self.slopes(outcome);
        self.filter.backward(outcome.simd, &self.raw_bar, &slopes, &mut self.code_bar);
    }

    /// Derivative of the mean over the batch with respect to the raw outputs, without the prior.
    fn raw_bars(&mut self, outcome: &Outcome<'_>) {
        let mut bars = std::mem::take(&mut self.raw_bar);
        bars.clear();
        bars.extend(self.cover.iter().enumerate().map(|(i, cover)| {
            let factor = outcome.share * outcome.batch.weight[i];
            self.judge.raw_bar(cover, outcome.pixels[i].rgb, outcome.truth[i], factor)
        }));
        self.raw_bar = bars;
    }

    /// The prior on opacities, on pixels evenly spread over the batch; its part in the raw opacities is added to their
    /// derivatives.
    fn slopes(&mut self, outcome: &Outcome<'_>) -> Slopes {
        if self.lambda_smooth == 0.0 {
            return Slopes::default();
        }
        let n = self.cover.len();
        let count = SMOOTH_PIXELS.min(n);
        let picks: Vec<Pick> = (0..count)
            .map(|k| k * n / count)
            .filter(|&index| outcome.batch.weight[index] > 0.0)
            .map(|index| Pick { index, noise: self.cover[index].noise })
            .collect();
        let spot = |i: usize| spot(&self.codes, &self.features, outcome.batch, i);
        let slopes = self.filter.slopes(outcome.simd, self.judge.concrete, self.lambda_smooth, &picks, spot);
        for (pick, bar) in picks.iter().zip(&slopes.h_bar) {
            self.raw_bar[pick.index][0] += bar;
        }
        slopes
    }
}

/// What the filter is told of a pixel of a batch.
fn spot<'a>(codes: &'a CodeTable, features: &'a [Arc<Features>], batch: &Batch, i: usize) -> Spot<'a> {
    let view = batch.view[i] as usize;
    Spot { place: batch.place[i], code: codes.codes().of(view), features: features.get(view).map(|f| &**f) }
}

impl Method for SfNerf {
    fn name(&self) -> &'static str {
        "sf-nerf"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::codes)
    }

    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::learning_codes)
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        if let Some((path, sha256)) = self.later.take() {
            self.begin_with(&Pretrained::read_again(&path, &sha256)?, self.filter.freeze)?;
        }
        self.cover(batch, step);
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch, step))
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let cover = &self.cover[i];
        let Cost { loss, over_bar, .. } = self.judge.cost(cover, pixel.rgb, truth);
        (loss, PixelBar::colour(over_bar.map(|bar| bar * (1.0 - cover.alpha))))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = squared(rgb, truth, COARSE * (1.0 - self.cover[i].alpha));
        (loss, bar.rgb)
    }

    fn second_light(&self, step: u64) -> Option<SecondLight> {
        self.light.as_ref()?.second_light(step)
    }

    fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        self.light.as_mut().map_or_else(|| vec![[0.0; 3]; relit.other.len()], |light| light.judge_second(relit))
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.gradients(outcome);
        let lr = outcome.lr * self.rates.filter;
        let filter = self.filter.step(outcome.simd, lr, lr * self.rates.eased(outcome.step));
        let codes = self.codes.learn(outcome.simd, outcome.lr * self.rates.codes, outcome.batch, &self.code_bar, 0.0);
        filter + codes + self.light.as_mut().map_or(0, |light| light.learn(outcome))
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        let [width, height] = seen.size;
        let code = self.codes.codes().of(seen.view);
        let features = self.features.get(seen.view).map(|f| &**f);
        let spot = |i: usize| {
            let place = [(i % width, width), (i / width, height)].map(|(at, size)| (at as f32 + 0.5) / size as f32);
            Spot { place, code, features }
        };
        let raw = self.filter.infer(Simd::best(), width * height, spot);
        let alpha = |raw: [f32; OUTPUTS]| self.judge.cover(raw, 0.0).alpha;
        Some(raw.into_iter().map(|raw| if alpha(raw) < 0.5 { 1.0 } else { 0.0 }).collect())
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.light.iter().for_each(|light| light.push_state(&mut out));
        self.codes.push_state(&mut out);
        self.filter.push_state(&mut out);
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))?;
        self.codes.load_state(state)?;
        self.filter.load_state(state)?;
        self.later = None;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len) + self.codes.len() + self.filter.len()
    }

    fn memory_bytes(&self) -> usize {
        let held = |f: &Arc<Features>| 4 * f.data.len() / Arc::strong_count(f);
        let batch = size_of::<Cover>() * self.cover.capacity() + 4 * OUTPUTS * self.raw_bar.capacity();
        let codes = self.codes.bytes() + 4 * self.code_bar.capacity();
        self.light.as_ref().map_or(0, Light::bytes)
            + self.filter.bytes()
            + codes
            + batch
            + self.features.iter().map(held).sum::<usize>()
    }
}

#[cfg(test)]
mod gradients;
