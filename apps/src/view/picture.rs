//! One picture of one layer: drawn, coloured, encoded, timed.

use super::header::{Drawer, Header, Quality};
use super::out::Out;
use super::pace::{Pace, scaled};
use super::protocol::{Draw, LARGEST_PICTURE, Layer};
use super::scene::Scene3d;
use super::turn::{SMALL, turn};
use engine::memory::frames as frame_memory;
use engine::picture::{self, png_bytes};
use engine::render::{Rendered, plain_query};
use engine::system::{Canonical, LayerRequest, Layers, Median, Normals, Query};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use scene_io::Size;
use std::time::{Duration, Instant};
use systems::splats::Cloud;

/// Error of a pixel from skipped work: one step of an 8-bit picture.
const ERROR_BUDGET: f32 = 1.0 / 255.0;

/// JPEG quality while things move, and between. What rests comes as PNG, without loss.
const JPEG_QUALITY: u8 = 85;

/// How much of a new range of depths goes into the one drawn: a scale that follows each picture is unquiet.
const DEPTH_SHARE: f32 = 0.25;

/// Time between two pictures that are not finished.
const PART_EVERY: Duration = Duration::from_millis(350);

/// What is remembered from picture to picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Painter {
    /// Of the scene itself, and of the cloud that stands for it.
    paces: [[Pace; Layer::COUNT]; 2],
    depths: Option<[f32; 2]>,
}

/// A picture and the message that holds it.
pub(crate) struct Sketch {
    pub(crate) picture: RgbImage,
    pub(crate) message: Vec<u8>,
}

impl Painter {
    /// Size of a picture that is drawn in time, and so waits for nobody.
    pub(crate) fn quick_size(&mut self, draw: &Draw, drawer: Drawer) -> Size {
        at_most_small(self.pace(draw, drawer).size(draw.full_size()))
    }

    fn pace(&mut self, draw: &Draw, drawer: Drawer) -> &mut Pace {
        &mut self.paces[usize::from(drawer == Drawer::Cloud)][draw.layer as usize]
    }

    /// The message that holds a picture of the scene itself; `None` when `go_on` said no.
    ///
    /// # Errors
    /// A sentence for the person.
    pub(crate) fn paint(
        &mut self,
        scene: &dyn Scene3d,
        draw: &Draw,
        size: Size,
        quality: Quality,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Vec<u8>>, String> {
        let Some(_turn) = turn(size, Drawer::Scene, go_on) else { return Ok(None) };
        let clock = Instant::now();
        let (camera, query) = (draw.eye.camera(size), query(scene, draw));
        fits(size, &query)?;
        let Some(view) = scene.draw(&camera, &query, &mut |_| go_on()) else { return Ok(None) };
        let picture = self.coloured(scene, draw.layer, &view);
        let message = self.message(scene, draw, &picture, quality, Drawer::Scene, clock)?;
        self.pace(draw, Drawer::Scene).measured(size, clock.elapsed().as_secs_f64());
        Ok(Some(message))
    }

    /// A picture of the cloud that stands for the scene; `None` when `go_on` said no.
    ///
    /// # Errors
    /// A sentence for the person.
    pub(crate) fn sketch(
        &mut self,
        scene: &dyn Scene3d,
        cloud: &Cloud,
        draw: &Draw,
        size: Size,
        quality: Quality,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Sketch>, String> {
        let Some(_turn) = turn(size, Drawer::Cloud, go_on) else { return Ok(None) };
        let clock = Instant::now();
        let (camera, query) = (draw.eye.camera(size), query(scene, draw));
        fits(size, &query)?;
        let view = cloud.render(&camera, &query).map_err(|e| e.to_string())?;
        let picture = self.coloured(scene, draw.layer, &view);
        let message = self.message(scene, draw, &picture, quality, Drawer::Cloud, clock)?;
        self.pace(draw, Drawer::Cloud).measured(size, clock.elapsed().as_secs_f64());
        Ok(Some(Sketch { picture, message }))
    }

    /// The best picture of the scene itself, drawn over one of the cloud: what is not finished is offered to `out` now and then.
    /// `None` when `go_on` said no.
    ///
    /// # Errors
    /// A sentence for the person.
    pub(crate) fn paint_over(
        &mut self,
        scene: &dyn Scene3d,
        draw: &Draw,
        below: &RgbImage,
        go_on: &dyn Fn() -> bool,
        out: &Out,
    ) -> Result<Option<Vec<u8>>, String> {
        let size = draw.full_size();
        let Some(_turn) = turn(size, Drawer::Scene, go_on) else { return Ok(None) };
        let clock = Instant::now();
        let (camera, query) = (draw.eye.camera(size), query(scene, draw));
        fits(size, &query)?;
        let mut sent = Instant::now();
        let range = self.depths;
        let mut part = |layers: &Layers| {
            let rows = (layers.rgb.len() / size.width.max(1) as usize) as u32;
            if rows > 0 && rows < size.height && sent.elapsed() >= PART_EVERY && out.has_room() {
                let view = Rendered { width: size.width, height: rows, layers: layers.clone() };
                let mut picture = below.clone();
                image::imageops::replace(&mut picture, &coloured(scene, draw.layer, &view, range), 0, 0);
                let seconds = clock.elapsed().as_secs_f64();
                let depths = range.filter(|_| draw.layer == Layer::Depth).unwrap_or_default();
                let header = header(
                    scene,
                    draw,
                    Kind { depths, quality: Quality::Better, drawer: Drawer::Both },
                    &picture,
                    seconds,
                );
                sent = Instant::now();
                if !jpeg_bytes(&picture).is_ok_and(|file| out.offer(header.before(&file))) {
                    return false;
                }
            }
            go_on()
        };
        let Some(view) = scene.draw(&camera, &query, &mut part) else { return Ok(None) };
        let picture = self.coloured(scene, draw.layer, &view);
        self.pace(draw, Drawer::Scene).measured(size, clock.elapsed().as_secs_f64());
        self.message(scene, draw, &picture, Quality::Full, Drawer::Scene, clock).map(Some)
    }

    fn message(
        &self,
        scene: &dyn Scene3d,
        draw: &Draw,
        picture: &RgbImage,
        quality: Quality,
        drawer: Drawer,
        clock: Instant,
    ) -> Result<Vec<u8>, String> {
        let file = if quality == Quality::Full { png_bytes(picture) } else { jpeg_bytes(picture)? };
        let depths = self.depths.filter(|_| draw.layer == Layer::Depth).unwrap_or_default();
        let seconds = clock.elapsed().as_secs_f64();
        Ok(header(scene, draw, Kind { depths, quality, drawer }, picture, seconds).before(&file))
    }

    /// A layer as a picture; the range of depths follows slowly.
    fn coloured(&mut self, scene: &dyn Scene3d, layer: Layer, view: &Rendered) -> RgbImage {
        if layer == Layer::Depth {
            let [near, far] = picture::depth_range(&[view]);
            let old = self.depths.unwrap_or([near, far]);
            let mix = |old: f32, new: f32| old + DEPTH_SHARE * (new - old);
            self.depths = Some([mix(old[0], near), mix(old[1], far)]);
        }
        coloured(scene, layer, view, self.depths)
    }
}

/// Refuses a picture that the machine has no memory for.
fn fits(size: Size, query: &Query) -> Result<(), String> {
    frame_memory::check_frame("the picture", size, query.layers).map_err(|e| e.to_string())
}

fn coloured(scene: &dyn Scene3d, layer: Layer, view: &Rendered, depths: Option<[f32; 2]>) -> RgbImage {
    match layer {
        Layer::Depth => picture::depth(view, depths.unwrap_or_else(|| picture::depth_range(&[view]))),
        Layer::Opacity => picture::opacity(view),
        Layer::Normals => picture::normals(view),
        Layer::Canonical => picture::canonical(view, scene.bounds()),
        Layer::Colour | Layer::Photo | Layer::Mask | Layer::Uncertainty => picture::colour(view),
    }
}

/// The size in its shape that has at most [`SMALL`] pixels.
fn at_most_small(size: Size) -> Size {
    if size.pixels() <= SMALL {
        return size;
    }
    let longest = f64::from(size.longest_side()) * (SMALL as f64 / size.pixels() as f64).sqrt();
    // The shorter side is rounded, and may be too long by half a pixel.
    (1..=longest as u32)
        .rev()
        .map(|side| scaled(size, side))
        .find(|size| size.pixels() <= SMALL)
        .unwrap_or(Size::new(1, 1))
}

/// The message that holds a photo or what is made of it.
///
/// # Errors
/// A sentence for the person.
pub(crate) fn photo(scene: &dyn Scene3d, draw: &Draw) -> Result<Vec<u8>, String> {
    let clock = Instant::now();
    let photo = draw.photo.ok_or_else(|| format!("`photo` is missing: layer `{}` is of a photo", draw.layer.name()))?;
    let mut picture = scene.photo(photo, draw.layer)?;
    let full = Size::from(picture.dimensions());
    let size = scaled(full, LARGEST_PICTURE);
    if size != full {
        picture = image::imageops::thumbnail(&picture, size.width, size.height);
    }
    let file = png_bytes(&picture);
    let seconds = clock.elapsed().as_secs_f64();
    Ok(header(scene, draw, Kind { depths: [0.0; 2], quality: Quality::Full, drawer: Drawer::Scene }, &picture, seconds)
        .before(&file))
}

/// The point seen at a pixel, `None` where nothing is.
pub(crate) fn seen_point(scene: &dyn Scene3d, pick: &super::protocol::Pick) -> Option<[f64; 3]> {
    let camera = pick.camera();
    let query = Query { time: pick.time, ..plain_query([0.0; 3], 0.0) };
    let view = scene.draw(&camera, &query, &mut |_| true)?;
    let t = [view.layers.median_depth.first()?, view.layers.depth.first()?].into_iter().find(|t| t.is_finite())?;
    let point = camera.ray(glam::DVec2::splat(0.5))?.at(f64::from(*t));
    point.is_finite().then(|| point.to_array())
}

pub(crate) fn query(scene: &dyn Scene3d, draw: &Draw) -> Query {
    let normals = if draw.layer == Layer::Normals { Normals::Compute } else { Normals::Skip };
    let canonical = if draw.layer == Layer::Canonical { Canonical::Compute } else { Canonical::Skip };
    let background = draw.background.unwrap_or_else(|| scene.background());
    Query {
        layers: LayerRequest { normals, canonical, median: Median::Skip },
        appearance: scene.appearance(&draw.appearance),
        time: draw.time,
        ..plain_query(background, ERROR_BUDGET)
    }
}

/// What a header says of a picture besides its size and when it was made.
struct Kind {
    /// Range of a picture of depths, zero otherwise.
    depths: [f32; 2],
    quality: Quality,
    drawer: Drawer,
}

fn header(scene: &dyn Scene3d, draw: &Draw, kind: Kind, picture: &RgbImage, seconds: f64) -> Header {
    let Kind { depths, quality, drawer } = kind;
    let side = |n: u32| u16::try_from(n).unwrap_or(u16::MAX);
    let size = (side(picture.width()), side(picture.height()));
    let step = u32::try_from(scene.step()).unwrap_or(u32::MAX);
    Header { id: draw.id, step, ms: (seconds * 1e3) as f32, depths, size, quality, drawer }
}

fn jpeg_bytes(picture: &RgbImage) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|e| format!("the picture cannot be encoded: {e}"))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_are_small_in_every_shape() {
        for side in 1..=LARGEST_PICTURE {
            for size in [Size::new(LARGEST_PICTURE, side), Size::new(side, LARGEST_PICTURE)] {
                let small = at_most_small(size);
                let area = small.pixels();
                assert!(area <= SMALL && small.width > 0 && small.height > 0, "{size}: {small}");
                assert!(area * 100 >= 98 * SMALL.min(size.pixels()), "{size}: {small}");
            }
        }
    }
}
