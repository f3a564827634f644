//! One picture of one layer: drawn, coloured, encoded, timed.

use super::pace::Pace;
use super::protocol::{Draw, Header, Layer, Quality};
use super::scene::Scene3d;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use std::time::Instant;
use systems::picture::{self, png_bytes};
use systems::render::{Rendered, plain_query};
use systems::system::{Canonical, LayerRequest, Normals, Query};

/// Error of a pixel from skipped work: one step of an 8-bit picture.
const ERROR_BUDGET: f32 = 1.0 / 255.0;

/// JPEG quality while things move, and between. What rests comes as PNG, without loss.
const JPEG_QUALITY: u8 = 85;

/// How much of a new range of depths goes into the one drawn: a scale that follows each picture is unquiet.
const DEPTH_SHARE: f32 = 0.25;

/// What is remembered from picture to picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Painter {
    paces: [Pace; Layer::COUNT],
    depths: Option<[f32; 2]>,
}

impl Painter {
    /// Size of a picture that is drawn in time.
    pub(crate) fn quick_size(&mut self, draw: &Draw) -> (u32, u32) {
        self.paces[draw.layer as usize].size(draw.full_size())
    }

    /// The message that holds a picture; `None` when `go_on` said no.
    ///
    /// # Errors
    /// A sentence for the person.
    pub(crate) fn paint(
        &mut self,
        scene: &dyn Scene3d,
        draw: &Draw,
        (size, quality): ((u32, u32), Quality),
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Vec<u8>>, String> {
        let clock = Instant::now();
        let camera = draw.eye.camera(size);
        let query = query(scene, draw);
        let Some(view) = scene.draw(&camera, &query, go_on) else { return Ok(None) };
        let picture = self.coloured(scene, draw.layer, &view);
        let file = if quality == Quality::Full { png_bytes(&picture) } else { jpeg_bytes(&picture)? };
        let seconds = clock.elapsed().as_secs_f64();
        self.paces[draw.layer as usize].measured(size, seconds);
        let depths = self.depths.filter(|_| draw.layer == Layer::Depth).unwrap_or_default();
        Ok(Some(header(scene, draw, (depths, quality), &picture, seconds).before(&file)))
    }

    fn coloured(&mut self, scene: &dyn Scene3d, layer: Layer, view: &Rendered) -> RgbImage {
        match layer {
            Layer::Depth => {
                let [near, far] = picture::depth_range(&[view]);
                let old = self.depths.unwrap_or([near, far]);
                let mix = |old: f32, new: f32| old + DEPTH_SHARE * (new - old);
                let range = [mix(old[0], near), mix(old[1], far)];
                self.depths = Some(range);
                picture::depth(view, range)
            }
            Layer::Opacity => picture::opacity(view),
            Layer::Normals => picture::normals(view),
            Layer::Canonical => picture::canonical(view, scene.bounds()),
            Layer::Colour | Layer::Photo | Layer::Mask | Layer::Uncertainty => picture::colour(view),
        }
    }
}

/// The message that holds a photo or what is made of it.
///
/// # Errors
/// A sentence for the person.
pub(crate) fn photo(scene: &dyn Scene3d, draw: &Draw) -> Result<Vec<u8>, String> {
    let clock = Instant::now();
    let photo = draw.photo.ok_or_else(|| format!("`photo` is missing: layer `{}` is of a photo", draw.layer.name()))?;
    let picture = scene.photo(photo, draw.layer)?;
    let file = png_bytes(&picture);
    let seconds = clock.elapsed().as_secs_f64();
    Ok(header(scene, draw, ([0.0; 2], Quality::Full), &picture, seconds).before(&file))
}

/// The point seen at a pixel, `None` where nothing is.
pub(crate) fn seen_point(scene: &dyn Scene3d, pick: &super::protocol::Pick) -> Option<[f64; 3]> {
    let camera = pick.camera();
    let query = Query { time: pick.time, ..plain_query([0.0; 3], 0.0) };
    let view = scene.draw(&camera, &query, &|| true)?;
    let t = [view.layers.median_depth.first()?, view.layers.depth.first()?].into_iter().find(|t| t.is_finite())?;
    let point = camera.ray(glam::DVec2::splat(0.5))?.at(f64::from(*t));
    point.is_finite().then(|| point.to_array())
}

fn query(scene: &dyn Scene3d, draw: &Draw) -> Query {
    let normals = if draw.layer == Layer::Normals { Normals::Compute } else { Normals::Skip };
    let canonical = if draw.layer == Layer::Canonical { Canonical::Compute } else { Canonical::Skip };
    let background = draw.background.unwrap_or_else(|| scene.background());
    Query {
        layers: LayerRequest { normals, canonical },
        appearance: scene.appearance(&draw.light),
        time: draw.time,
        ..plain_query(background, ERROR_BUDGET)
    }
}

fn header(
    scene: &dyn Scene3d,
    draw: &Draw,
    (depths, quality): ([f32; 2], Quality),
    picture: &RgbImage,
    seconds: f64,
) -> Header {
    let side = |n: u32| u16::try_from(n).unwrap_or(u16::MAX);
    let size = (side(picture.width()), side(picture.height()));
    let step = u32::try_from(scene.step()).unwrap_or(u32::MAX);
    Header { id: draw.id, step, ms: (seconds * 1e3) as f32, depths, size, quality }
}

fn jpeg_bytes(picture: &RgbImage) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|e| format!("the picture cannot be encoded: {e}"))?;
    Ok(bytes)
}
