//! A file of Gaussians, as something to look at.

use super::protocol::{Layer, Light};
use super::run_scene::title;
use super::scene::{Description, Photo, Scene3d};
use image::RgbImage;
use render_core::camera::Camera;
use std::path::Path;
use systems::RunError;
use systems::render::Rendered;
use systems::splats::Cloud;
use systems::system::{Appearance, Query};

/// A cloud and what it is called.
pub(crate) struct CloudScene {
    cloud: Cloud,
    /// That the page can step through: there are no photos.
    views: Vec<Camera>,
    title: String,
}

impl CloudScene {
    /// Read a file.
    ///
    /// # Errors
    /// As [`Cloud::open`].
    pub(crate) fn open(path: &Path) -> Result<Self, RunError> {
        let cloud = Cloud::open(path)?;
        Ok(Self { views: cloud.views(), cloud, title: title(path) })
    }

    /// What was dropped, clamped or ignored while reading.
    pub(crate) fn notes(&self) -> &[String] {
        self.cloud.notes()
    }
}

impl Scene3d for CloudScene {
    fn describe(&self) -> Description {
        let (middle, radius) = self.cloud.extent();
        let named = |(k, camera): (usize, &Camera)| Photo::new(&format!("view {}", k + 1), camera, 0.0, false);
        Description {
            title: self.title.clone(),
            subtitle: format!("{} Gaussians", self.cloud.len()),
            step: 0,
            photos: self.views.iter().enumerate().map(named).collect(),
            pivot: middle.to_array(),
            // The first view may be one from inside.
            pivot_is_guess: true,
            up: self.cloud.up().to_array(),
            radius,
            moves: false,
            lights: Vec::new(),
            layers: [Layer::Colour, Layer::Depth, Layer::Normals, Layer::Opacity].map(Layer::name).to_vec(),
            background: self.background(),
            longest_side: 1280,
        }
    }

    fn step(&self) -> u64 {
        0
    }

    fn background(&self) -> [f32; 3] {
        [0.0; 3]
    }

    fn draw(&self, camera: &Camera, query: &Query, go_on: &dyn Fn() -> bool) -> Option<Rendered> {
        if go_on() { self.cloud.render(camera, query).ok() } else { None }
    }

    fn appearance(&self, _light: &Light) -> Appearance {
        Appearance::Mean
    }

    fn photo(&self, photo: usize, _layer: Layer) -> Result<RgbImage, String> {
        Err(format!("`photo` = {photo}: a file of Gaussians has no photos"))
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let (middle, radius) = self.cloud.extent();
        [(middle - radius).to_array(), (middle + radius).to_array()]
    }
}
