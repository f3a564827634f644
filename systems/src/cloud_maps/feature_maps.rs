//! Feature maps of a reference photo as the appearance of a cloud.
//!
//! A step encodes its photo, and the networks learn from that photo's gradient. In half of the steps the reference is not all of what
//! the step compares: in one of four it is a part of the photo, in one of four it comes without its camera. So Gaussians learn to do
//! without the place in the photo that they are projected to, which most of them have to where another photo is the reference.

use super::cached::{Cached, CloudTones, fingerprint};
use super::fusion::{ChunkBars, Reader, ToneOf, inputs, toned};
use super::map_network::{MapMemory, MapNetwork};
use super::reference::{CAMERA, Code, Reference};
use super::sampling::Texels;
use super::settings::MapSettings;
use crate::cloud_appearance::rate_left;
use crate::fields::{NetworkParameters, RowNetwork};
use crate::views::{ColourAppearance, ColourBars, DrawnCloud, Learns, PlaceCodes, SeenPhoto, VisibleCloud};
use engine::memory::room_for;
use engine::system::{Appearance, SystemError, Tensor, TensorMap, f32_tensor, take_numbers};
use field_core::mlp::MlpConfig;
use field_core::rng::Rng;
use float_core::Simd;
use optim::AdamConfig;
use rayon::prelude::*;
use splat_core::ProjectedGaussian;
use std::sync::Mutex;

/// Streams of random numbers.
const STREAM: u64 = 0x6d61_7073;
const PARTS: u64 = 0x6d61_7070;
/// Names in checkpoints.
const ENCODER: &str = "maps.encoder";
const TONES: &str = "maps.tones";
const PHOTOS: &str = "maps.photos";
/// Steps whose reference is a part of the photo, and steps without its camera.
const IN_PARTS: f32 = 0.25;
const WITHOUT_CAMERA: f32 = 0.25;

/// The networks, and the photos as they were last seen.
pub(crate) struct FeatureMaps {
    settings: MapSettings,
    /// Steps of the schedule.
    horizon: u64,
    seed: u64,
    network: MapNetwork,
    encoder: NetworkParameters,
    fusion: RowNetwork,
    tones: NetworkParameters,
    simd: Simd,
    /// `[photos][3 * side * side + camera]`; a photo that was not seen yet has a camera of zeros.
    photos: Vec<f32>,
    /// What the step looks at.
    current: Option<Current>,
    /// What it said, for the next step of the optimisers.
    held: Option<Held>,
    cached: Mutex<Cached>,
}

/// The reference of a step.
struct Current {
    view: usize,
    code: Vec<f32>,
    memory: MapMemory,
}

/// Gradients with respect to the parameters of the network of tones, and to the maps.
struct Held {
    tones: Vec<f32>,
    maps: Vec<f32>,
}

impl FeatureMaps {
    /// At the start, for `photos` photos, before any of them was seen. The schedule has `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(settings: MapSettings, photos: usize, horizon: u64, seed: u64) -> Result<Self, SystemError> {
        settings.check()?;
        let numbers = 3 * settings.encoder_side * settings.encoder_side + CAMERA;
        room_for("encoder_side", settings.encoder_side, photos.saturating_mul(numbers))?;
        let rng = Rng::new(seed, STREAM);
        let network = MapNetwork::new(&settings)?;
        let encoder = NetworkParameters::new(ENCODER, network.init(rng.substream(0)), AdamConfig::DEFAULT);
        let mut params = Vec::new();
        let config = MlpConfig::new(inputs(&settings), vec![settings.tone_width; 2], super::fusion::OUTPUTS);
        let mut fusion = RowNetwork::new(&config, rng.substream(1), &mut params).map_err(|e| SystemError::Config {
            field: "tone_width",
            value: settings.tone_width.to_string(),
            problem: e.to_string(),
        })?;
        fusion.pack(&params);
        Ok(Self {
            horizon,
            seed,
            network,
            encoder,
            fusion,
            tones: NetworkParameters::new(TONES, params, AdamConfig::DEFAULT),
            simd: Simd::best(),
            photos: vec![0.0; photos * numbers],
            settings,
            current: None,
            held: None,
            cached: Mutex::default(),
        })
    }

    /// The parameters of the network of tones; those that a test sets.
    #[cfg(test)]
    pub(super) fn tone_parameters(&self) -> &[f32] {
        &self.tones.values
    }

    #[cfg(test)]
    pub(super) fn set_tone_parameters(&mut self, params: Vec<f32>) {
        self.tones.values = params;
        self.changed();
    }

    /// What is held: the gradients with respect to the parameters of the network of tones, and to the maps.
    #[cfg(test)]
    pub(super) fn gradients(&self) -> (Vec<f32>, Vec<f32>) {
        self.held.as_ref().map(|held| (held.tones.clone(), held.maps.clone())).unwrap_or_default()
    }

    /// The code of what the step looks at.
    #[cfg(test)]
    pub(super) fn current_code(&self) -> Option<&[f32]> {
        self.current.as_ref().map(|current| &current.code[..])
    }

    /// The networks are not what they were.
    fn changed(&mut self) {
        self.fusion.pack(&self.tones.values);
        self.cached = Mutex::default();
    }

    /// Numbers of a photo.
    fn photo_len(&self) -> usize {
        3 * self.settings.encoder_side * self.settings.encoder_side + CAMERA
    }

    /// A photo as it was last seen; `None` before.
    fn photo(&self, view: usize) -> Option<(&[f32], [f32; CAMERA])> {
        let (pixels, rows) = self.photos.chunks_exact(self.photo_len()).nth(view)?.split_at(self.photo_len() - CAMERA);
        let mut camera = [0.0; CAMERA];
        camera.copy_from_slice(rows);
        camera.iter().any(|x| *x != 0.0).then_some((pixels, camera))
    }

    /// The code of a picture.
    fn encoded(&self, pixels: &[f32], camera: &[f32; CAMERA], memory: &mut MapMemory) -> Vec<f32> {
        let mut code = self.network.forward(&self.encoder.values, pixels, memory).to_vec();
        code.extend(camera);
        code
    }

    /// The mean maps of all photos that were seen. It has no camera.
    fn mean(&self) -> Vec<f32> {
        if let Some(mean) = self.cached.lock().ok().and_then(|cached| cached.mean.clone()) {
            return mean;
        }
        let seen: Vec<usize> =
            (0..).take(self.photos.len() / self.photo_len()).filter(|i| self.photo(*i).is_some()).collect();
        let encode = |memory: &mut MapMemory, view: &usize| {
            let (pixels, camera) = self.photo(*view)?;
            Some(self.encoded(pixels, &camera, memory))
        };
        // Sixteen photos at a time bound the memory; they are summed in their order.
        let mut sum = vec![0.0; self.settings.map_numbers() + CAMERA];
        for views in seen.chunks(16) {
            let codes: Vec<Option<Vec<f32>>> = views.par_iter().map_init(MapMemory::default, encode).collect();
            for code in codes.iter().flatten() {
                sum.iter_mut().zip(code).for_each(|(sum, x)| *sum += x / seen.len() as f32);
            }
        }
        sum[self.settings.map_numbers()..].fill(0.0);
        if let Ok(mut cached) = self.cached.lock() {
            cached.mean = Some(sum.clone());
        }
        sum
    }

    fn reader<'a>(&'a self, code: &'a [f32]) -> Reader<'a> {
        let code = Code::new(&self.settings, code);
        let texels = Texels::new(&self.settings, &code);
        Reader { settings: &self.settings, network: &self.fusion, texels, code, simd: self.simd }
    }

    /// What the step looks at, where it is this photo.
    fn current(&self, appearance: &Appearance) -> Option<&Current> {
        self.current.as_ref().filter(|current| *appearance == Appearance::View(current.view))
    }

    /// Turn colours into those of a code: the tones of all Gaussians are worked out once.
    fn forward_cached(&self, code: Vec<f32>, seen: VisibleCloud<'_>, rgb: &mut [[f32; 3]]) {
        let cloud = fingerprint(&seen.cloud);
        let scale = self.settings.tone_scale;
        let apply = |tones: &[ToneOf], rgb: &mut [[f32; 3]]| {
            let each = rgb.iter_mut().zip(seen.gaussians);
            each.for_each(|(rgb, gaussian)| *rgb = toned(*rgb, &tones[gaussian.index as usize], scale));
        };
        if let Ok(cached) = self.cached.lock()
            && let Some(known) = cached.tones.as_ref().filter(|known| known.cloud == cloud && known.code == code)
        {
            apply(&known.tones, rgb);
            return;
        }
        let all: Vec<u32> = (0..seen.cloud.gaussians.len() as u32).collect();
        let tones = self.reader(&code).tones(&seen.cloud, &all);
        apply(&tones, rgb);
        if let Ok(mut cached) = self.cached.lock() {
            cached.tones = Some(CloudTones { code, cloud, tones });
        }
    }

    /// Add what chunks say of Gaussians to the gradients of a cloud.
    fn add_own(&self, seen: VisibleCloud<'_>, chunks: &[ChunkBars], base: &mut [[f32; 3]], extra: &mut [f32]) {
        let (all, sampled) = (seen.cloud.gaussians.len(), self.settings.sampled_maps);
        let mut rest = (seen.gaussians, base);
        for chunk in chunks {
            let (of_base, of_codes) = chunk.own();
            let n = of_base.len() / 3;
            let (visible, base) = (&rest.0[..n], &mut rest.1[..n]);
            for (i, base) in base.iter_mut().enumerate() {
                *base = [0, 1, 2].map(|c| base[c] + of_base[c * n + i]);
            }
            for (row, bars) in of_codes.chunks_exact(n.max(1)).enumerate() {
                let each = visible.iter().zip(bars);
                each.for_each(|(gaussian, bar)| extra[row * all + gaussian.index as usize] += bar);
            }
            for (at, bar) in chunk.coordinates.iter().enumerate() {
                let (gaussian, row) = (&visible[at / sampled], PlaceCodes::ROWS + 2 * (at % sampled));
                (0..2).for_each(|k| extra[(row + k) * all + gaussian.index as usize] += bar[k]);
            }
            rest = (&rest.0[n..], &mut std::mem::take(&mut rest.1)[n..]);
        }
    }

    /// What coordinates beyond the borders of their map cost: `sample_weight` times the mean of how far they are beyond.
    fn keep_within(&self, cloud: &DrawnCloud<'_>, extra_bar: &mut [f32]) {
        let first = PlaceCodes::ROWS * cloud.gaussians.len();
        let coordinates = &cloud.extra[first..];
        let share = self.settings.sample_weight / coordinates.len().max(1) as f32;
        for (bar, x) in extra_bar[first..].iter_mut().zip(coordinates).filter(|(_, x)| x.abs() > 1.0) {
            *bar += share * x.signum();
        }
    }
}

impl ColourAppearance for FeatureMaps {
    fn code(&self, appearance: &Appearance) -> Vec<f32> {
        match appearance {
            Appearance::Code(code) => code.to_vec(),
            Appearance::View(view) => match self.photo(*view) {
                Some((pixels, camera)) => self.encoded(pixels, &camera, &mut MapMemory::default()),
                None => self.mean(),
            },
            Appearance::Mean => self.mean(),
        }
    }

    fn looks(&self) -> bool {
        true
    }

    fn look_at(&mut self, step: u64, view: usize, photo: &SeenPhoto<'_>) {
        let side = self.settings.encoder_side;
        let Some(whole) = Reference::of(photo, side) else { return };
        let len = self.photo_len();
        if let Some(kept) = self.photos.chunks_exact_mut(len).nth(view) {
            let (pixels, camera) = kept.split_at_mut(len - CAMERA);
            pixels.copy_from_slice(&whole.pixels);
            camera.copy_from_slice(&whole.camera);
        }
        // The mean of the photos is another one now.
        self.cached = Mutex::default();
        let rng = Rng::new(self.seed, PARTS).substream(step);
        let [u, ..] = rng.uniform4_at(0);
        let reference = match u {
            u if u < IN_PARTS => Reference::of_some_part(photo, side, rng.uniform4_at(1)).unwrap_or(whole),
            u if u < IN_PARTS + WITHOUT_CAMERA => Reference { camera: [0.0; CAMERA], ..whole },
            _ => whole,
        };
        let mut memory = self.current.take().map(|current| current.memory).unwrap_or_default();
        let code = self.encoded(&reference.pixels, &reference.camera, &mut memory);
        self.current = Some(Current { view, code, memory });
    }

    fn encode(&self, photo: &SeenPhoto<'_>) -> Option<Vec<f32>> {
        let reference = Reference::of(photo, self.settings.encoder_side)?;
        Some(self.encoded(&reference.pixels, &reference.camera, &mut MapMemory::default()))
    }

    fn forward(&self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &mut [[f32; 3]]) {
        match self.current(appearance) {
            None => self.forward_cached(self.code(appearance), seen, rgb),
            Some(current) => {
                let tones = self.reader(&current.code).tones(&seen.cloud, &rows(seen.gaussians));
                let scale = self.settings.tone_scale;
                rgb.iter_mut().zip(&tones).for_each(|(rgb, tone)| *rgb = toned(*rgb, tone, scale));
            }
        }
    }

    fn backward(&mut self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bars: ColourBars<'_>) {
        let of_other;
        let code = match self.current(appearance) {
            Some(current) => &current.code,
            None => {
                of_other = self.code(appearance);
                &of_other
            }
        };
        let reader = self.reader(code);
        let chunks = reader.backward(&seen.cloud, &rows(seen.gaussians), rgb, bars.rgb);
        self.add_own(seen, &chunks, bars.base, bars.extra);
        self.keep_within(&seen.cloud, bars.extra);
        let mut tones = vec![0.0; self.tones.values.len()];
        self.fusion.fold(chunks.iter().map(|chunk| &chunk.network[..]), &mut Vec::new(), &mut tones);
        let maps = reader.maps_bar(&chunks);
        match &mut self.held {
            None => self.held = Some(Held { tones, maps }),
            Some(held) => {
                held.tones.iter_mut().zip(tones).for_each(|(sum, bar)| *sum += bar);
                held.maps.iter_mut().zip(maps).for_each(|(sum, bar)| *sum += bar);
            }
        }
    }

    fn code_bar(&self, code: &[f32], seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bar: &mut [[f32; 3]]) -> Vec<f32> {
        let reader = self.reader(code);
        let chunks = reader.backward(&seen.cloud, &rows(seen.gaussians), rgb, bar);
        let mut code_bar = reader.maps_bar(&chunks);
        // The camera is not learnt.
        code_bar.resize(code.len(), 0.0);
        code_bar
    }

    fn shared_parameters(&self) -> usize {
        self.tones.values.len()
    }

    fn bytes(&self) -> usize {
        // In a step: what the network holds, and gradients of that; the code, and what it is read as.
        4 * (self.photos.len() + 2 * self.network.memory_len() + 8 * self.settings.map_numbers())
    }
}

/// Which Gaussians they are.
fn rows(visible: &[ProjectedGaussian]) -> Vec<u32> {
    visible.iter().map(|gaussian| gaussian.index).collect()
}

impl Learns for FeatureMaps {
    fn step(&mut self, simd: Simd, step: u64) -> usize {
        let (held, current) = (self.held.take(), self.current.take());
        let Some(Held { tones, maps }) = held else { return 0 };
        let left = rate_left(step as f64 / self.horizon.max(1) as f64);
        let mut bad = self.tones.step(simd, left * self.settings.tone_lr, &tones);
        if let Some(mut current) = current {
            let gradient = self.network.backward(&self.encoder.values, &maps, &mut current.memory);
            bad += self.encoder.step(simd, left * self.settings.encoder_lr, &gradient);
        }
        self.changed();
        bad
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = self.encoder.state();
        out.extend(self.tones.state());
        out.push(f32_tensor(PHOTOS, &self.photos));
        out
    }

    fn forget(&mut self) {
        self.held = None;
        self.current = None;
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let photos = take_numbers(state, PHOTOS, self.photos.len())?;
        let (mut encoder, mut tones) = (self.encoder.clone(), self.tones.clone());
        encoder.load(state)?;
        tones.load(state)?;
        (self.encoder, self.tones, self.photos) = (encoder, tones, photos);
        self.forget();
        self.changed();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.encoder.values.len() + self.tones.values.len()
    }
}
