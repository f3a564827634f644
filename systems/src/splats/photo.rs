//! A photo as training sees it: a pinhole camera in the internal frame, planes of colour, and which pixels count.

use super::flat::Flat;
use super::frame::Frame;
use engine::data::Dataset;
use rayon::prelude::*;
use render_core::camera::Camera;
use scene_io::{Image, SceneError};
use splat_core::View;
use std::sync::Arc;

/// Rows that one task converts.
const ROWS: usize = 16;

/// The photo of a step.
#[derive(Debug, Default)]
pub(super) struct Photo {
    /// `[3][rows][columns]`, on the step's background.
    pub(super) truth: Vec<f32>,
    /// `[rows][columns]`, 1 where a pixel counts and 0 where not; empty: all do.
    pub(super) weight: Vec<f32>,
}

/// A camera of the scene's frame as the rasteriser takes it.
pub(super) fn view(camera: &Camera, frame: &Frame) -> View {
    let r = camera.pose.r.transpose().to_cols_array_2d();
    let size = [camera.width as usize, camera.height as usize];
    let o = frame.to_internal(camera.pose.c).to_array();
    View::from_c2w(r, o, [camera.fx, camera.fy], [camera.cx, camera.cy], size)
}

impl Photo {
    /// Fill in a photo.
    pub(super) fn fill(&mut self, image: &Image, background: [f32; 3]) {
        let (w, h) = (image.width as usize, image.height as usize);
        let channels = usize::from(image.channels);
        self.truth.resize(3 * w * h, 0.0);
        let (r, rest) = self.truth.split_at_mut(w * h);
        let (g, b) = rest.split_at_mut(w * h);
        let n = (w * ROWS).max(1);
        (r.par_chunks_mut(n), g.par_chunks_mut(n), b.par_chunks_mut(n), image.data.par_chunks(n * channels))
            .into_par_iter()
            .for_each(|(r, g, b, data)| {
                for (i, p) in data.chunks_exact(channels).enumerate() {
                    let rgb = over(p, background);
                    (r[i], g[i], b[i]) = (rgb[0], rgb[1], rgb[2]);
                }
            });
        self.weight.clear();
        if let Some(mask) = &image.mask {
            self.weight.extend(mask.iter().map(|&m| if m >= 128 { 1.0 } else { 0.0 }));
        }
    }

    /// Take a picture `[3][rows][columns]`; all of it counts.
    pub(super) fn show(&mut self, rgb: &[f32]) {
        self.truth.clear();
        self.truth.extend_from_slice(rgb);
        self.weight.clear();
    }

    /// Whether no pixel counts.
    pub(super) fn is_blank(&self) -> bool {
        !self.weight.is_empty() && self.weight.iter().all(|w| *w == 0.0)
    }
}

/// A pixel over a background.
fn over(p: &[u8], background: [f32; 3]) -> [f32; 3] {
    const UNIT: f32 = 1.0 / 255.0;
    match *p {
        [r, g, b, a] => {
            let a = f32::from(a) * UNIT;
            let on = |c: u8, back: f32| f32::from(c) * UNIT * a + back * (1.0 - a);
            [on(r, background[0]), on(g, background[1]), on(b, background[2])]
        }
        [r, g, b] => [r, g, b].map(|c| f32::from(c) * UNIT),
        _ => background,
    }
}

/// Photos of one size, drawn onto the plane where their lenses bend light.
pub(super) struct Photos {
    /// Those that are smaller than the dataset's own.
    smaller: Option<Dataset>,
    flat: Vec<Option<(Arc<Flat>, Arc<Image>)>>,
}

impl Photos {
    /// Those of `data`, halved so often, all decoded where they fit.
    pub(super) fn new(data: &Dataset, halvings: u32) -> Result<Self, SceneError> {
        let smaller = (halvings > 0).then(|| data.at_level(halvings));
        let data = smaller.as_ref().unwrap_or(data);
        data.decode()?;
        let mut known: Vec<Arc<Flat>> = Vec::new();
        let mut flat = Vec::with_capacity(data.len());
        for (i, view) in data.views().iter().enumerate() {
            flat.push(match view.camera.lens.is_pinhole() {
                true => None,
                false => {
                    let lens = known.iter().find(|f| f.is_of(&view.camera)).cloned().unwrap_or_else(|| {
                        let new = Arc::new(Flat::new(&view.camera));
                        known.push(new.clone());
                        new
                    });
                    let image = lens.photo(&*data.image(i)?);
                    Some((lens, Arc::new(image)))
                }
            });
        }
        Ok(Self { smaller, flat })
    }

    pub(super) fn len(&self) -> usize {
        self.flat.len()
    }

    /// A photo and its camera without lens; `data` are those that [`new`](Self::new) was given.
    pub(super) fn get(&self, data: &Dataset, i: usize) -> Result<(Arc<Image>, Camera), SceneError> {
        let data = self.smaller.as_ref().unwrap_or(data);
        let camera = &data.view(i).camera;
        match &self.flat[i] {
            Some((flat, image)) => Ok((image.clone(), flat.camera(camera))),
            None => Ok((data.image(i)?, *camera)),
        }
    }
}
