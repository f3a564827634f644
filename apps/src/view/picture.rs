//! One picture of one layer: drawn, coloured, encoded, timed.

use super::header::{Drawer, Header, Quality};
use super::out::Out;
use super::pace::{Pace, scaled};
use super::protocol::{Draw, LARGEST_PICTURE, Layer};
use super::scene::Scene3d;
use super::turn::{GoOn, SMALL, turn};
use engine::flow::{Shot, coloured as flow_picture, flow_in_place, full_length};
use engine::memory::frames as frame_memory;
use engine::picture::{self, png_bytes};
use engine::render::{Rendered, plain_query};
use engine::system::{Behind, Canonical, LayerRequest, Layers, Median, Normals, Query};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use render_core::camera::Camera;
use scene_io::{Flow, Size};
use std::time::{Duration, Instant};
use systems::splats::Cloud;

/// Error of a pixel from skipped work: one step of an 8-bit picture.
const ERROR_BUDGET: f32 = 1.0 / 255.0;

/// JPEG quality while things move, and between. What rests comes as PNG, without loss.
const JPEG_QUALITY: u8 = 85;

/// How much of a new range of depths or flow goes into the one drawn: a scale that follows each picture is unquiet.
const RANGE_SHARE: f32 = 0.25;

/// Length of the fullest colour while nothing has moved yet, pixels.
const STILL_LENGTH: f32 = 1.0;

/// Time between two pictures that are not finished.
const PART_EVERY: Duration = Duration::from_millis(350);

/// What is remembered from picture to picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Painter {
    /// Of the scene itself, and of the cloud that stands for it.
    paces: [[Pace; Layer::COUNT]; 2],
    depths: Option<[f32; 2]>,
    /// Length of flow with the fullest colour, pixels of the best picture.
    flow_length: Option<f32>,
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
        go_on: GoOn<'_>,
    ) -> Result<Option<Vec<u8>>, String> {
        let Some(turn) = turn(size, Drawer::Scene, go_on) else { return Ok(None) };
        turn.work(|| {
            let clock = Instant::now();
            let (camera, query) = (draw.eye.camera(size), query(scene, draw));
            fits(size, &query)?;
            let Some(view) = scene.draw(&camera, &query, &mut |_| go_on()) else { return Ok(None) };
            let Some(picture) = self.coloured(scene, draw, &camera, &view, go_on)? else { return Ok(None) };
            let message = self.message(scene, draw, &picture, quality, Drawer::Scene, clock)?;
            self.pace(draw, Drawer::Scene).measured(size, clock.elapsed().as_secs_f64());
            Ok(Some(message))
        })
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
        go_on: GoOn<'_>,
    ) -> Result<Option<Sketch>, String> {
        let Some(turn) = turn(size, Drawer::Cloud, go_on) else { return Ok(None) };
        turn.work(|| {
            let clock = Instant::now();
            let (camera, query) = (draw.eye.camera(size), query(scene, draw));
            fits(size, &query)?;
            let view = cloud.render(&camera, &query).map_err(|e| e.to_string())?;
            let Some(picture) = self.coloured(scene, draw, &camera, &view, go_on)? else { return Ok(None) };
            let message = self.message(scene, draw, &picture, quality, Drawer::Cloud, clock)?;
            self.pace(draw, Drawer::Cloud).measured(size, clock.elapsed().as_secs_f64());
            Ok(Some(Sketch { picture, message }))
        })
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
        below: RgbImage,
        go_on: GoOn<'_>,
        out: &Out,
    ) -> Result<Option<Vec<u8>>, String> {
        let size = draw.full_size();
        let Some(turn) = turn(size, Drawer::Scene, go_on) else { return Ok(None) };
        turn.work(|| {
            let clock = Instant::now();
            let (camera, query) = (draw.eye.camera(size), query(scene, draw));
            fits(size, &query)?;
            let mut sent = Instant::now();
            let (depths, range) = (self.depths, self.range(draw.layer));
            // The picture as far as it is shown: `shown` rows of the scene, then what lies below. Rows are coloured once.
            let (mut picture, mut shown) = (below, 0);
            let mut part = |layers: &Layers| {
                let width = size.width.max(1) as usize;
                let rows = (layers.rgb.len() / width) as u32;
                if rows > shown && rows < size.height && sent.elapsed() >= PART_EVERY && out.has_room() {
                    let layers = layers.since(shown as usize * width);
                    let view = Rendered { width: size.width, height: rows - shown, layers };
                    let news = coloured(scene, draw.layer, &view, depths);
                    image::imageops::replace(&mut picture, &news, 0, i64::from(shown));
                    shown = rows;
                    let seconds = clock.elapsed().as_secs_f64();
                    let kind = Kind { range, quality: Quality::Better, drawer: Drawer::Both };
                    let header = header(scene, draw, kind, &picture, seconds);
                    sent = Instant::now();
                    if !jpeg_bytes(&picture).is_ok_and(|file| out.offer(header.before(&file))) {
                        return false;
                    }
                }
                go_on()
            };
            let Some(view) = scene.draw(&camera, &query, &mut part) else { return Ok(None) };
            drop(picture);
            let Some(picture) = self.coloured(scene, draw, &camera, &view, go_on)? else { return Ok(None) };
            self.pace(draw, Drawer::Scene).measured(size, clock.elapsed().as_secs_f64());
            self.message(scene, draw, &picture, Quality::Full, Drawer::Scene, clock).map(Some)
        })
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
        let range = self.range(draw.layer);
        let seconds = clock.elapsed().as_secs_f64();
        Ok(header(scene, draw, Kind { range, quality, drawer }, picture, seconds).before(&file))
    }

    /// What the colours of a layer reach from and to; zero where they have no scale.
    fn range(&self, layer: Layer) -> [f32; 2] {
        match layer {
            Layer::Depth => self.depths.unwrap_or_default(),
            Layer::Flow => [0.0, self.flow_length.unwrap_or(STILL_LENGTH)],
            _ => [0.0; 2],
        }
    }

    /// A layer of what `camera` sees as a picture; the range of depths and of flow follows slowly. `None` when `go_on` said no.
    ///
    /// # Errors
    /// A sentence for the person: the scene does not have the layer.
    fn coloured(
        &mut self,
        scene: &dyn Scene3d,
        draw: &Draw,
        camera: &Camera,
        view: &Rendered,
        go_on: GoOn<'_>,
    ) -> Result<Option<RgbImage>, String> {
        match draw.layer {
            Layer::Flow => {
                let Some(system) = scene.flow_system() else {
                    return Err("the scene has no layer `flow`: nothing in it says where points go".into());
                };
                let Some(flow) = flow_in_place(system, view, Shot { camera, time: draw.time }, go_on) else {
                    return Ok(None);
                };
                return Ok(Some(self.flow_colours(&flow, draw.full_size().width)));
            }
            Layer::Depth => {
                let [near, far] = picture::depth_range(&[view]);
                let old = self.depths.unwrap_or([near, far]);
                self.depths = Some([followed(old[0], near), followed(old[1], far)]);
            }
            _ => {}
        }
        Ok(Some(coloured(scene, draw.layer, view, self.depths)))
    }

    /// Flow as colours, on a scale of pixels of the best picture, which is so wide; the scale follows slowly.
    fn flow_colours(&mut self, flow: &Flow, full_width: u32) -> RgbImage {
        // What goes as far in a small picture as in a large one has the same colour in both.
        let scale = f64::from(full_width) / f64::from(flow.width.max(1));
        if let Some(length) = full_length(flow, scale) {
            let length = length as f32;
            self.flow_length = Some(self.flow_length.map_or(length, |old| followed(old, length)));
        }
        let [_, full] = self.range(Layer::Flow);
        flow_picture(flow, f64::from(full) / scale)
    }
}

/// The end of a range that follows slowly.
fn followed(old: f32, new: f32) -> f32 {
    old + RANGE_SHARE * (new - old)
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
        // A scene that does not know it shows all of it.
        Layer::Background => picture::behind(view).unwrap_or_else(|| picture::colour(view)),
        // Flow needs a camera and a time; no cloud has it, so that it is never drawn over one.
        Layer::Colour | Layer::Flow | Layer::Photo | Layer::Mask | Layer::Uncertainty => picture::colour(view),
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
    Ok(header(scene, draw, Kind { range: [0.0; 2], quality: Quality::Full, drawer: Drawer::Scene }, &picture, seconds)
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
    // Flow is that of one surface, not of a mean over an edge.
    let median = if draw.layer == Layer::Flow { Median::Compute } else { Median::Skip };
    let behind = if draw.layer == Layer::Background { Behind::Compute } else { Behind::Skip };
    Query {
        layers: LayerRequest { normals, canonical, median, behind },
        appearance: scene.appearance(&draw.appearance),
        time: draw.time,
        ..plain_query(background, ERROR_BUDGET)
    }
}

/// What a header says of a picture besides its size and when it was made.
struct Kind {
    /// See [`Header::range`].
    range: [f32; 2],
    quality: Quality,
    drawer: Drawer,
}

fn header(scene: &dyn Scene3d, draw: &Draw, kind: Kind, picture: &RgbImage, seconds: f64) -> Header {
    let Kind { range, quality, drawer } = kind;
    let side = |n: u32| u16::try_from(n).unwrap_or(u16::MAX);
    let size = (side(picture.width()), side(picture.height()));
    let step = u32::try_from(scene.step()).unwrap_or(u32::MAX);
    Header { id: draw.id, step, ms: (seconds * 1e3) as f32, range, size, quality, drawer }
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
