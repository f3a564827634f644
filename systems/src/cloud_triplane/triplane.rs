//! A photo projected back to three planes, and its tones as a whole, as the appearance of a cloud.
//!
//! The code of an appearance is `[3][channels][side / 2][side / 2]`, features of the planes; the box that these reach over; the numbers of
//! the photo as a whole. A Gaussian reads each plane where it lies, and takes the sum. Without depths, or without a camera, planes and box
//! are 0, and so are features. Nothing is learnt through places: depths have no gradient.

use super::back_projection::shown;
use super::planes::{PlaneBox, scattered};
use super::settings::{CHANNELS, PLANES, TriplaneSettings};
use crate::appearance::photo_network::{ForwardMemory, PhotoNetwork, Picture};
use crate::cloud_reference::{
    Joined, MapMemory, MapNetwork, PhotoCode, Reading, Reference, ReferenceAppearance, TILTS, Texels,
};
use engine::system::SystemError;
use field_core::conv::{Encoder, EncoderConfig, Size};
use field_core::rng::Rng;
use rayon::prelude::*;

/// The appearance.
pub(crate) type Triplane = ReferenceAppearance<TriplaneCode>;

/// Channels of the network of the photo as a whole.
const OF_PHOTO: [usize; 4] = [8, 16, 32, 32];

impl Triplane {
    /// At the start, for `photos` photos, before any of them was seen. The schedule has `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(settings: TriplaneSettings, photos: usize, horizon: u64, seed: u64) -> Result<Self, SystemError> {
        settings.check()?;
        let planes = MapNetwork::new(settings.shape(), "plane_side")?;
        let encoder = match settings.photo_dims {
            0 => None,
            dims => Some(Encoder::new(EncoderConfig::new(3, OF_PHOTO.to_vec(), dims)).map_err(|e| {
                SystemError::Config { field: "photo_dims", value: dims.to_string(), problem: e.to_string() }
            })?),
        };
        let photo = encoder.map(|encoder| PhotoNetwork::new(encoder, &TILTS));
        let from = if settings.plane_from < 1.0 { (settings.plane_from * horizon as f64) as u64 } else { u64::MAX };
        Self::of_code(settings.reference(), TriplaneCode { settings, planes, photo, from }, photos, horizon, seed)
    }
}

/// Makes planes and numbers of a photo. Parameters: those of the network of planes, then those of the photo as a whole.
pub(crate) struct TriplaneCode {
    settings: TriplaneSettings,
    planes: MapNetwork,
    photo: Option<PhotoNetwork>,
    /// Step from which on photos are projected back.
    from: u64,
}

/// What the way back needs.
#[derive(Default)]
pub(crate) struct TriplaneMemory {
    /// Whether anything was projected back.
    has_planes: bool,
    planes: [MapMemory; PLANES],
    photo: ForwardMemory,
    pixels: Vec<f32>,
}

impl TriplaneCode {
    /// Features of all planes.
    fn features(&self) -> usize {
        PLANES * self.planes.map_numbers()
    }

    /// Where the numbers of the photo as a whole begin.
    fn first_of_photo(&self) -> usize {
        self.features() + PlaneBox::NUMBERS
    }

    /// The photo as a whole.
    fn picture<'a>(&self, pixels: &'a [f32], all: &'a [f32]) -> Picture<'a> {
        let side = self.settings.encoder_side;
        Picture { x: pixels, alpha: all, size: Size::one(side, side) }
    }

    /// Every pixel counts.
    fn all(&self) -> Vec<f32> {
        vec![1.0; self.settings.encoder_side * self.settings.encoder_side]
    }
}

impl PhotoCode for TriplaneCode {
    const NAMES: [&'static str; 3] = ["triplane.encoder", "triplane.tones", "triplane.photos"];
    const READS_DEPTH: bool = true;
    type Memory = TriplaneMemory;

    fn code_len(&self) -> usize {
        self.first_of_photo() + self.settings.photo_dims
    }

    fn init(&self, rng: Rng) -> Vec<f32> {
        let mut params = self.planes.init(rng.substream(0));
        // Neither says anything before it knows what is worth saying.
        self.planes.begin_at_zero(&mut params);
        if let Some(photo) = &self.photo {
            let mut own = vec![0.0; photo.param_count()];
            photo.init(rng.substream(1), &mut own);
            photo.begin_at_zero(&mut own);
            params.extend(own);
        }
        params
    }

    fn forward(&self, params: &[f32], reference: &Reference, memory: &mut TriplaneMemory) -> Vec<f32> {
        let (of_planes, of_photo) = params.split_at(self.planes.param_count());
        let mut code = vec![0.0; self.first_of_photo()];
        let points = shown(reference, self.settings.encoder_side);
        let within = PlaneBox::of(&points, self.settings.plane_crop);
        memory.has_planes = within.is_any();
        if memory.has_planes {
            let (features, of_box) = code.split_at_mut(self.features());
            of_box.copy_from_slice(&within.numbers());
            let side = self.settings.plane_side;
            let scattered = scattered(&points, &within, side);
            features
                .par_chunks_exact_mut(self.planes.map_numbers())
                .zip(scattered.par_chunks_exact(CHANNELS * side * side))
                .zip(&mut memory.planes)
                .for_each(|((features, plane), memory)| {
                    features.copy_from_slice(self.planes.forward(of_planes, plane, memory));
                });
        }
        if let Some(photo) = &self.photo {
            memory.pixels.clone_from(&reference.pixels);
            let mut whole = Vec::new();
            let all = self.all();
            photo.forward(of_photo, self.picture(&memory.pixels, &all), &mut memory.photo, &mut whole);
            code.extend(whole);
        }
        code
    }

    fn backward(&self, params: &[f32], code_bar: &[f32], memory: &mut TriplaneMemory) -> Vec<f32> {
        let (of_planes, of_photo) = params.split_at(self.planes.param_count());
        let mut grad = vec![0.0; params.len()];
        let (planes_grad, photo_grad) = grad.split_at_mut(of_planes.len());
        if memory.has_planes {
            let bars = code_bar[..self.features()].par_chunks_exact(self.planes.map_numbers());
            let each: Vec<Vec<f32>> = bars
                .zip(&mut memory.planes)
                .map(|(bar, memory)| self.planes.backward(of_planes, bar, memory))
                .collect();
            for own in each {
                planes_grad.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            }
        }
        if let Some(photo) = &self.photo {
            let (all, bar) = (self.all(), &code_bar[self.first_of_photo()..]);
            let picture = self.picture(&memory.pixels, &all);
            photo.backward(of_photo, picture, &mut memory.photo, bar, photo_grad, None);
        }
        grad
    }

    fn memory_len(&self) -> usize {
        // The scattered points and the photo besides, with what its network holds of it: eight channels and half as much again.
        let photo = (3 + 3 * OF_PHOTO[0] / 2) * self.settings.encoder_side.pow(2);
        PLANES * (self.planes.memory_len() + CHANNELS * self.settings.plane_side.pow(2)) + photo
    }

    fn reading<'a>(&'a self, code: &'a [f32]) -> Reading<'a> {
        let (features, rest) = code.split_at(self.features());
        Reading {
            code,
            texels: Texels::new(features, self.settings.plane_channels, self.settings.feature_side()),
            joined: Joined::Sum,
            places: Box::new(PlaneBox::read(&rest[..PlaneBox::NUMBERS])),
            whole: self.first_of_photo()..code.len(),
        }
    }

    fn depth_from(&self) -> u64 {
        self.from
    }
}
