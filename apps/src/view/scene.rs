//! What can be looked at: the seam between the viewer and what draws.

use super::cropped::Cropped;
use super::protocol::{AppearanceMix, Layer};
use engine::crop::Crop;
use engine::render::Rendered;
use engine::system::{Appearance, Layers, Query, System};
use glam::DQuat;
use image::RgbImage;
use render_core::camera::Camera;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Something that pictures can be drawn of, from any camera.
pub(crate) trait Scene3d: Send + Sync {
    /// All that the page needs to know.
    fn describe(&self) -> Description;

    /// Training steps behind what is drawn; 0 where there were none.
    fn step(&self) -> u64;

    /// What was behind the scene in training, `0..=1` each.
    fn background(&self) -> [f32; 3];

    /// The layers that `query` asks for as `camera` sees them; `None` as soon as `go_on` says no, which is asked now and
    /// then and shown the rows that are done.
    fn draw(&self, camera: &Camera, query: &Query, go_on: &mut dyn FnMut(&Layers) -> bool) -> Option<Rendered>;

    /// The cloud that stands for the scene while the camera moves, and wherever it is cropped; `None` where there is none, or not
    /// yet.
    fn cloud(&self, _query: &Query) -> Option<Arc<Cropped>> {
        None
    }

    /// Whether pictures of the scene itself are so quick that nothing has to stand for it.
    fn is_quick(&self) -> bool {
        false
    }

    /// What the page shows of that cloud, as the message `fast`; empty where there is nothing to say.
    fn fast_message(&self) -> String {
        String::new()
    }

    /// What is shown: a run folder or a file. A crop is kept there.
    fn place(&self) -> &Path;

    /// An appearance as the scene knows it; one that it does not have is the mean of all.
    fn appearance(&self, mix: &AppearanceMix) -> Appearance;

    /// A photo of [`Description::photos`] as it was taken (`Layer::Photo`), or what the system makes of it, as grey: which
    /// pixels show the place itself (`Layer::Mask`), how far they may be from it (`Layer::Uncertainty`).
    ///
    /// # Errors
    /// A sentence for the person: no such photo, no such layer, a file that cannot be read.
    fn photo(&self, photo: usize, layer: Layer) -> Result<RgbImage, String>;

    /// The box `[min, max]` that canonical points are drawn in, world units.
    fn bounds(&self) -> [[f64; 3]; 2];

    /// The system whose scene flow `Layer::Flow` draws; `None` where nothing moves, or the system has no scene flow.
    fn flow_system(&self) -> Option<&dyn System> {
        None
    }
}

/// What the page needs to know of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Description {
    /// What it is called.
    pub(crate) title: String,
    /// How it was made, in a few words.
    pub(crate) subtitle: String,
    /// Training steps behind it; 0 where there were none.
    pub(crate) step: u64,
    /// Cameras of photos, those trained on first.
    pub(crate) photos: Vec<Photo>,
    /// A point to turn around, world units.
    pub(crate) pivot: [f64; 3],
    /// Whether the pivot is only a guess: the depth in the first picture says more.
    pub(crate) pivot_is_guess: bool,
    /// Up, a unit vector.
    pub(crate) up: [f64; 3],
    /// About how far the cameras stand from the pivot, world units.
    pub(crate) radius: f64,
    /// Whether the scene moves.
    pub(crate) moves: bool,
    /// Photos whose appearance can be chosen; empty where there is one.
    pub(crate) appearances: Vec<String>,
    /// Layers that there are, by their words.
    pub(crate) layers: Vec<&'static str>,
    /// What was behind the scene in training, `0..=1`.
    pub(crate) background: [f32; 3],
    /// Longest side of the photos, pixels.
    pub(crate) longest_side: u32,
    /// The crop that is kept beside the scene.
    pub(crate) crop: Crop,
}

/// The camera of a photo.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Photo {
    pub(crate) name: String,
    pub(crate) held_out: bool,
    /// World units.
    pub(crate) position: [f64; 3],
    /// Camera-to-world, CV axes.
    pub(crate) wxyz: [f64; 4],
    /// Tangents of half the angles across and down.
    pub(crate) tangents: [f64; 2],
    pub(crate) time: f64,
}

impl Photo {
    pub(crate) fn new(name: &str, camera: &Camera, time: f64, held_out: bool) -> Self {
        let q = DQuat::from_mat3(&camera.pose.r).normalize();
        Self {
            name: name.into(),
            held_out,
            position: camera.pose.c.to_array(),
            wxyz: [q.w, q.x, q.y, q.z],
            tangents: [
                f64::from(camera.width) / 2.0 / camera.fx.max(1e-9),
                f64::from(camera.height) / 2.0 / camera.fy.max(1e-9),
            ],
            time,
        }
    }
}
