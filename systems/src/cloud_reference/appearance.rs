//! A reference photo as the appearance of a cloud, whatever is made of it.
//!
//! A step encodes its photo, and the networks learn from that photo's gradient. In half of the steps the reference is not all of what
//! the step compares: in one of four it is a part of the photo, in one of four it comes without its camera. So Gaussians learn to do
//! without their place in the photo, which most of them have to where another photo is the reference.

use super::cached::{Cached, CloudTones, fingerprint};
use super::fusion::{DIRECTION, OUTPUTS, OWN, Reader, ToneOf, toned};
use super::map_network::{SIDE, is_side};
use super::reading::PhotoCode;
use super::reference::{CAMERA, Reference};
use crate::cloud_appearance::rate_left;
use crate::fields::{NetworkParameters, RowNetwork};
use crate::views::{ColourAppearance, ColourBars, Learns, SeenPhoto, VisibleCloud, first_of, positive, unless};
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
/// Steps whose reference is a part of the photo, and steps without its camera.
const IN_PARTS: f32 = 0.25;
const WITHOUT_CAMERA: f32 = 0.25;

/// Settings that all kinds have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferenceSettings {
    /// `encoder_side`
    pub(crate) side: usize,
    pub(crate) tone_width: usize,
    pub(crate) tone_scale: f32,
    pub(crate) tone_lr: f64,
    pub(crate) encoder_lr: f64,
    /// Whether tones depend on where Gaussians are seen from.
    pub(crate) directed: bool,
}

/// Networks wider than this are a mistake.
const MOST_WIDTH: usize = 512;

impl ReferenceSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let Self { side, tone_width, tone_scale, tone_lr, encoder_lr, .. } = *self;
        // The encoder's layers multiply each other: with more, features have no bounds.
        let is_rate = encoder_lr > 0.0 && encoder_lr <= 0.1;
        first_of([
            unless(is_side(side), "encoder_side", side, SIDE),
            unless((1..=MOST_WIDTH).contains(&tone_width), "tone_width", tone_width, "must be 1 to 512"),
            positive("tone_scale", tone_scale.into()),
            positive("tone_lr", tone_lr),
            unless(is_rate, "encoder_lr", encoder_lr, "must be above 0, and at most 0.1"),
        ])
    }
}

/// The networks, and the photos as they were last seen.
pub(crate) struct ReferenceAppearance<C: PhotoCode> {
    settings: ReferenceSettings,
    /// Steps of the schedule.
    horizon: u64,
    seed: u64,
    code: C,
    encoder: NetworkParameters,
    fusion: RowNetwork,
    tones: NetworkParameters,
    simd: Simd,
    /// `[photos][3 * side * side + depths + camera]`; a photo that was not seen yet has a camera of zeros.
    photos: Vec<f32>,
    /// What the step looks at.
    current: Option<Current<C::Memory>>,
    /// What it said, for the next step of the optimisers.
    held: Option<Held>,
    cached: Mutex<Cached>,
}

/// The reference of a step.
struct Current<M> {
    view: usize,
    code: Vec<f32>,
    memory: M,
}

/// Gradients with respect to the parameters of the network of tones, and to the code.
struct Held {
    tones: Vec<f32>,
    code: Vec<f32>,
}

impl<C: PhotoCode> ReferenceAppearance<C> {
    /// At the start, for `photos` photos, before any of them was seen. The schedule has `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn of_code(
        settings: ReferenceSettings,
        code: C,
        photos: usize,
        horizon: u64,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let numbers = photo_len::<C>(settings.side);
        room_for("encoder_side", settings.side, photos.saturating_mul(numbers))?;
        let rng = Rng::new(seed, STREAM);
        let encoder = NetworkParameters::new(C::NAMES[0], code.init(rng.substream(0)), AdamConfig::DEFAULT);
        let nothing = vec![0.0; code.code_len()];
        let reading = code.reading(&nothing);
        let of_direction = if settings.directed { DIRECTION } else { 0 };
        let inputs = OWN + reading.features() + reading.whole.len() + of_direction;
        drop(reading);
        let mut params = Vec::new();
        let config = MlpConfig::new(inputs, vec![settings.tone_width; 2], OUTPUTS);
        let mut fusion = RowNetwork::new(&config, rng.substream(1), &mut params).map_err(|e| SystemError::Config {
            field: "tone_width",
            value: settings.tone_width.to_string(),
            problem: e.to_string(),
        })?;
        fusion.pack(&params);
        Ok(Self {
            settings,
            horizon,
            seed,
            code,
            encoder,
            fusion,
            tones: NetworkParameters::new(C::NAMES[1], params, AdamConfig::DEFAULT),
            simd: Simd::best(),
            photos: vec![0.0; photos * numbers],
            current: None,
            held: None,
            cached: Mutex::default(),
        })
    }

    /// The parameters of the network of tones; those that a test sets.
    #[cfg(test)]
    pub(crate) fn tone_parameters(&self) -> &[f32] {
        &self.tones.values
    }

    #[cfg(test)]
    pub(crate) fn set_tone_parameters(&mut self, params: Vec<f32>) {
        self.tones.values = params;
        self.changed();
    }

    /// The parameters of the encoder; those that a test sets.
    #[cfg(test)]
    pub(crate) fn encoder_parameters(&self) -> &[f32] {
        &self.encoder.values
    }

    #[cfg(test)]
    pub(crate) fn set_encoder_parameters(&mut self, params: Vec<f32>) {
        self.encoder.values = params;
        self.changed();
    }

    /// What is held: the gradients with respect to the parameters of the network of tones, and to the code.
    #[cfg(test)]
    pub(crate) fn gradients(&self) -> (Vec<f32>, Vec<f32>) {
        self.held.as_ref().map(|held| (held.tones.clone(), held.code.clone())).unwrap_or_default()
    }

    /// The gradient with respect to the encoder's parameters.
    #[cfg(test)]
    pub(crate) fn encoder_gradient(&mut self) -> Vec<f32> {
        let (Some(held), Some(current)) = (&self.held, &mut self.current) else { return Vec::new() };
        self.code.backward(&self.encoder.values, &held.code, &mut current.memory)
    }

    /// The code of what the step looks at.
    #[cfg(test)]
    pub(crate) fn current_code(&self) -> Option<&[f32]> {
        self.current.as_ref().map(|current| &current.code[..])
    }

    /// The networks are not what they were.
    fn changed(&mut self) {
        self.fusion.pack(&self.tones.values);
        self.cached = Mutex::default();
    }

    /// The numbers of a photo as it was last seen, and of its camera; `None` before.
    fn kept(&self, view: usize) -> Option<(&[f32], &[f32])> {
        let kept = self.photos.chunks_exact(photo_len::<C>(self.settings.side)).nth(view)?;
        let (photo, camera) = kept.split_at(kept.len() - CAMERA);
        camera.iter().any(|x| *x != 0.0).then_some((photo, camera))
    }

    /// A photo as it was last seen; `None` before.
    fn photo(&self, view: usize) -> Option<Reference> {
        let (photo, rows) = self.kept(view)?;
        let (pixels, depth) = photo.split_at(3 * self.settings.side * self.settings.side);
        let mut camera = [0.0; CAMERA];
        camera.copy_from_slice(rows);
        Some(Reference { pixels: pixels.to_vec(), depth: depth.to_vec(), camera })
    }

    /// Keep a photo as it is seen now.
    fn keep(&mut self, view: usize, photo: &Reference) {
        let len = photo_len::<C>(self.settings.side);
        let Some(kept) = self.photos.chunks_exact_mut(len).nth(view) else { return };
        let (rest, camera) = kept.split_at_mut(len - CAMERA);
        let (pixels, depth) = rest.split_at_mut(photo.pixels.len());
        pixels.copy_from_slice(&photo.pixels);
        camera.copy_from_slice(&photo.camera);
        depth.fill(0.0);
        depth.iter_mut().zip(&photo.depth).for_each(|(kept, z)| *kept = *z);
    }

    /// The code of a photo.
    fn encoded(&self, reference: &Reference, memory: &mut C::Memory) -> Vec<f32> {
        self.code.forward(&self.encoder.values, reference, memory)
    }

    /// The mean of the codes of all photos that were seen, without their places.
    fn mean(&self) -> Vec<f32> {
        if let Some(mean) = self.cached.lock().ok().and_then(|cached| cached.mean.clone()) {
            return mean;
        }
        let photos = self.photos.len() / photo_len::<C>(self.settings.side);
        let seen: Vec<usize> = (0..photos).filter(|view| self.kept(*view).is_some()).collect();
        let encode = |memory: &mut C::Memory, view: &usize| {
            let photo = self.photo(*view)?;
            Some(self.encoded(&photo.without_place(), memory))
        };
        // Sixteen photos at a time bound the memory; they are summed in their order.
        let mut sum = vec![0.0; self.code.code_len()];
        for views in seen.chunks(16) {
            let codes: Vec<Option<Vec<f32>>> = views.par_iter().map_init(C::Memory::default, encode).collect();
            for code in codes.iter().flatten() {
                sum.iter_mut().zip(code).for_each(|(sum, x)| *sum += x / seen.len() as f32);
            }
        }
        if let Ok(mut cached) = self.cached.lock() {
            cached.mean = Some(sum.clone());
        }
        sum
    }

    fn reader<'a>(&'a self, code: &'a [f32], eye: Option<[f32; 3]>) -> Reader<'a> {
        assert_eq!(code.len(), self.code.code_len(), "a code has as many numbers as those of the photos");
        Reader {
            scale: self.settings.tone_scale,
            network: &self.fusion,
            reading: self.code.reading(code),
            directed: self.settings.directed,
            eye,
            simd: self.simd,
        }
    }

    /// What the step looks at, where it is this photo.
    fn current(&self, appearance: &Appearance) -> Option<&Current<C::Memory>> {
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
        let tones = self.reader(&code, None).tones(&seen.cloud, &all);
        apply(&tones, rgb);
        if let Ok(mut cached) = self.cached.lock() {
            cached.tones = Some(CloudTones { code, cloud, tones });
        }
    }
}

/// Numbers that are kept of a photo.
fn photo_len<C: PhotoCode>(side: usize) -> usize {
    (3 + usize::from(C::READS_DEPTH)) * side * side + CAMERA
}

impl<C: PhotoCode> ColourAppearance for ReferenceAppearance<C> {
    fn code(&self, appearance: &Appearance) -> Vec<f32> {
        match appearance {
            Appearance::Code(code) => code.to_vec(),
            Appearance::View(view) => match self.photo(*view) {
                Some(photo) => self.encoded(&photo, &mut C::Memory::default()),
                None => self.mean(),
            },
            Appearance::Mean => self.mean(),
        }
    }

    fn looks(&self) -> bool {
        true
    }

    fn depth_side(&self, step: u64) -> Option<usize> {
        (C::READS_DEPTH && step >= self.code.depth_from()).then_some(self.settings.side)
    }

    fn look_at(&mut self, step: u64, view: usize, photo: &SeenPhoto<'_>) {
        let side = self.settings.side;
        let Some(whole) = Reference::of(photo, side) else { return };
        self.keep(view, &whole);
        // The mean of the photos is another one now.
        self.cached = Mutex::default();
        let rng = Rng::new(self.seed, PARTS).substream(step);
        let [u, ..] = rng.uniform4_at(0);
        let reference = match u {
            u if u < IN_PARTS => Reference::of_some_part(photo, side, rng.uniform4_at(1)).unwrap_or(whole),
            u if u < IN_PARTS + WITHOUT_CAMERA => whole.without_place(),
            _ => whole,
        };
        let mut memory = self.current.take().map(|current| current.memory).unwrap_or_default();
        let code = self.encoded(&reference, &mut memory);
        self.current = Some(Current { view, code, memory });
    }

    fn encode(&self, photo: &SeenPhoto<'_>) -> Option<Vec<f32>> {
        let reference = Reference::of(photo, self.settings.side)?;
        Some(self.encoded(&reference, &mut C::Memory::default()))
    }

    fn forward(&self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &mut [[f32; 3]]) {
        let of_other;
        let code = match self.current(appearance) {
            Some(current) => &current.code,
            None => {
                of_other = self.code(appearance);
                // Seen from elsewhere a Gaussian would have another tone.
                if !self.settings.directed {
                    return self.forward_cached(of_other, seen, rgb);
                }
                &of_other
            }
        };
        let tones = self.reader(code, seen.eye).tones(&seen.cloud, &rows(seen.gaussians));
        let scale = self.settings.tone_scale;
        rgb.iter_mut().zip(&tones).for_each(|(rgb, tone)| *rgb = toned(*rgb, tone, scale));
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
        let (reader, rows) = (self.reader(code, seen.eye), rows(seen.gaussians));
        let chunks = reader.backward(&seen.cloud, &rows, rgb, bars.rgb);
        reader.add_own(seen.cloud.gaussians.len(), &rows, &chunks, bars.base, bars.extra);
        self.code.regularise(&seen.cloud, bars.extra);
        let mut tones = vec![0.0; self.tones.values.len()];
        self.fusion.fold(chunks.iter().map(|chunk| &chunk.network[..]), &mut Vec::new(), &mut tones);
        let code = reader.code_bar(&chunks);
        drop(reader);
        match &mut self.held {
            None => self.held = Some(Held { tones, code }),
            Some(held) => {
                held.tones.iter_mut().zip(tones).for_each(|(sum, bar)| *sum += bar);
                held.code.iter_mut().zip(code).for_each(|(sum, bar)| *sum += bar);
            }
        }
    }

    fn code_bar(&self, code: &[f32], seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bar: &mut [[f32; 3]]) -> Vec<f32> {
        let reader = self.reader(code, seen.eye);
        let chunks = reader.backward(&seen.cloud, &rows(seen.gaussians), rgb, bar);
        reader.code_bar(&chunks)
    }

    fn shared_parameters(&self) -> usize {
        self.tones.values.len()
    }

    fn bytes(&self) -> usize {
        // In a step: what the network holds, and gradients of that; the code, and what it is read as.
        4 * (self.photos.len() + 2 * self.code.memory_len() + 8 * self.code.code_len())
    }
}

/// Which Gaussians they are.
fn rows(visible: &[ProjectedGaussian]) -> Vec<u32> {
    visible.iter().map(|gaussian| gaussian.index).collect()
}

impl<C: PhotoCode> Learns for ReferenceAppearance<C> {
    fn step(&mut self, simd: Simd, step: u64) -> usize {
        let (held, current) = (self.held.take(), self.current.take());
        let Some(Held { tones, code }) = held else { return 0 };
        let left = rate_left(step as f64 / self.horizon.max(1) as f64);
        let mut bad = self.tones.step(simd, left * self.settings.tone_lr, &tones);
        if let Some(mut current) = current {
            let gradient = self.code.backward(&self.encoder.values, &code, &mut current.memory);
            bad += self.encoder.step(simd, left * self.settings.encoder_lr, &gradient);
        }
        self.changed();
        bad
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = self.encoder.state();
        out.extend(self.tones.state());
        out.push(f32_tensor(C::NAMES[2], &self.photos));
        out
    }

    fn forget(&mut self) {
        self.held = None;
        self.current = None;
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let photos = take_numbers(state, C::NAMES[2], self.photos.len())?;
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
