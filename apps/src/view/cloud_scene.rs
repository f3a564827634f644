//! A file of Gaussians, as something to look at.

use super::cropped::Cropped;
use super::protocol::{AppearanceMix, Layer};
use super::run_scene::title;
use super::scene::{Description, Photo, Scene3d};
use engine::RunError;
use engine::crop::Crop;
use engine::render::Rendered;
use engine::system::{Appearance, Layers, Query};
use image::RgbImage;
use render_core::camera::Camera;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use systems::splats::Cloud;

/// A cloud and what it is called.
pub(crate) struct CloudScene {
    cloud: Arc<Cropped>,
    path: PathBuf,
    crop: Crop,
    /// That the page can step through: there are no photos.
    views: Vec<Camera>,
    title: String,
}

impl CloudScene {
    /// Read a file.
    ///
    /// # Errors
    /// As [`Cloud::open`] and [`Crop::of`].
    pub(crate) fn open(path: &Path) -> Result<Self, RunError> {
        let crop = Crop::of(path)?.unwrap_or_default();
        let cloud = Cloud::open(path)?;
        let views = cloud.views();
        Ok(Self { views, cloud: Arc::new(Cropped::new(cloud)), path: path.into(), crop, title: title(path) })
    }

    /// What was dropped, clamped or ignored while reading.
    pub(crate) fn notes(&self) -> &[String] {
        self.cloud.whole().notes()
    }
}

impl Scene3d for CloudScene {
    fn describe(&self) -> Description {
        let (middle, radius) = self.cloud.whole().extent();
        let named = |(k, camera): (usize, &Camera)| Photo::new(&format!("view {}", k + 1), camera, 0.0, false);
        Description {
            title: self.title.clone(),
            subtitle: format!("{} Gaussians", self.cloud.whole().len()),
            step: 0,
            photos: self.views.iter().enumerate().map(named).collect(),
            pivot: middle.to_array(),
            // The first view may be one from inside.
            pivot_is_guess: true,
            up: self.cloud.whole().up().to_array(),
            radius,
            moves: false,
            appearances: Vec::new(),
            layers: [Layer::Colour, Layer::Depth, Layer::Normals, Layer::Opacity].map(Layer::name).to_vec(),
            background: self.background(),
            longest_side: 1280,
            crop: self.crop.clone(),
        }
    }

    fn step(&self) -> u64 {
        0
    }

    fn background(&self) -> [f32; 3] {
        [0.0; 3]
    }

    fn draw(&self, camera: &Camera, query: &Query, go_on: &mut dyn FnMut(&Layers) -> bool) -> Option<Rendered> {
        if go_on(&Layers::default()) { self.cloud.whole().render(camera, query).ok() } else { None }
    }

    fn cloud(&self, _query: &Query) -> Option<Arc<Cropped>> {
        Some(self.cloud.clone())
    }

    fn is_quick(&self) -> bool {
        true
    }

    fn fast_message(&self) -> String {
        json!({ "type": "fast", "state": "own", "hints": self.cloud.hints() }).to_string()
    }

    fn place(&self) -> &Path {
        &self.path
    }

    fn appearance(&self, _mix: &AppearanceMix) -> Appearance {
        Appearance::Mean
    }

    fn photo(&self, photo: usize, _layer: Layer) -> Result<RgbImage, String> {
        Err(format!("`photo` = {photo}: a file of Gaussians has no photos"))
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let (middle, radius) = self.cloud.whole().extent();
        [(middle - radius).to_array(), (middle + radius).to_array()]
    }
}
