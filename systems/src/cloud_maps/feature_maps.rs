//! Feature maps of a reference photo as the appearance of a cloud.
//!
//! The code of an appearance is `[maps][channels][side / 2][side / 2]`, then the camera that took the photo. A Gaussian reads the first
//! map where it is projected, the others at coordinates that it learns.

use super::settings::MapSettings;
use crate::cloud_reference::{
    CAMERA, Joined, MapMemory, MapNetwork, PhotoCode, Places, Reading, Reference, ReferenceAppearance, Tap, Texels,
};
use crate::views::{DrawnCloud, PlaceCodes};
use engine::system::SystemError;
use field_core::rng::Rng;

/// The appearance.
pub(crate) type FeatureMaps = ReferenceAppearance<MapCode>;

impl FeatureMaps {
    /// At the start, for `photos` photos, before any of them was seen. The schedule has `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(settings: MapSettings, photos: usize, horizon: u64, seed: u64) -> Result<Self, SystemError> {
        settings.check()?;
        let network = MapNetwork::new(settings.shape(), "encoder_side")?;
        Self::of_code(settings.reference(), MapCode { settings, network }, photos, horizon, seed)
    }
}

/// Makes maps of a photo.
pub(crate) struct MapCode {
    settings: MapSettings,
    network: MapNetwork,
}

impl PhotoCode for MapCode {
    const NAMES: [&'static str; 3] = ["maps.encoder", "maps.tones", "maps.photos"];
    const READS_DEPTH: bool = false;
    type Memory = MapMemory;

    fn code_len(&self) -> usize {
        self.network.map_numbers() + CAMERA
    }

    fn init(&self, rng: Rng) -> Vec<f32> {
        self.network.init(rng)
    }

    fn forward(&self, params: &[f32], reference: &Reference, memory: &mut MapMemory) -> Vec<f32> {
        let mut code = self.network.forward(params, &reference.pixels, memory).to_vec();
        code.extend(reference.camera);
        code
    }

    fn backward(&self, params: &[f32], code_bar: &[f32], memory: &mut MapMemory) -> Vec<f32> {
        // The camera is not learnt.
        self.network.backward(params, &code_bar[..self.network.map_numbers()], memory)
    }

    fn memory_len(&self) -> usize {
        self.network.memory_len()
    }

    fn reading<'a>(&'a self, code: &'a [f32]) -> Reading<'a> {
        let (maps, rows) = code.split_at(self.network.map_numbers());
        let mut camera = [0.0; CAMERA];
        camera.copy_from_slice(rows);
        Reading {
            code,
            texels: Texels::new(maps, self.settings.map_channels, self.settings.map_side()),
            joined: Joined::Beside,
            places: Box::new(InPhoto { camera }),
            whole: 0..0,
        }
    }

    /// What coordinates beyond the borders of their map cost: `sample_weight` times the mean of how far they are beyond.
    fn regularise(&self, cloud: &DrawnCloud<'_>, extra_bar: &mut [f32]) {
        let first = PlaceCodes::ROWS * cloud.gaussians.len();
        let coordinates = &cloud.extra[first..];
        let share = self.settings.sample_weight / coordinates.len().max(1) as f32;
        for (bar, x) in extra_bar[first..].iter_mut().zip(coordinates).filter(|(_, x)| x.abs() > 1.0) {
            *bar += share * x.signum();
        }
    }
}

/// The first map where Gaussians are projected, the others at coordinates of their own, which are the rows after their codes.
struct InPhoto {
    camera: [f32; CAMERA],
}

impl Places for InPhoto {
    fn tap(&self, cloud: &DrawnCloud<'_>, i: usize, map: usize, side: usize) -> Option<Tap> {
        let n = cloud.gaussians.len();
        match self.learnt_rows(map) {
            None => Tap::projected(&self.camera, [0, 1, 2].map(|k| cloud.gaussians.mean[k * n + i]), side),
            Some(row) => Some(Tap::at_coordinates([row, row + 1].map(|row| cloud.extra[row * n + i]), side)),
        }
    }

    fn learnt_rows(&self, map: usize) -> Option<usize> {
        map.checked_sub(1).map(|sampled| PlaceCodes::ROWS + 2 * sampled)
    }
}
