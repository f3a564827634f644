//! A photo as training sees it: a pinhole camera in the internal frame, planes of colour, and how much each pixel counts.

use super::cloud_frame::CloudFrame;
use super::undistortion::UndistortedPlane;
use super::weights::Weights;
use engine::data::Dataset;
use rayon::prelude::*;
use render_core::camera::Camera;
use scene_io::{Image, SceneError};
use splat_core::View;
use std::sync::Arc;

/// Rows that one task converts.
const ROWS: usize = 16;

/// What the picture of a step is compared with.
#[derive(Debug, Default)]
pub(super) struct StepTarget {
    /// `[3][rows][columns]`, on the step's background.
    pub(super) colour: Vec<f32>,
    pub(super) weights: Weights,
}

/// A camera of the scene's frame as the rasteriser takes it.
pub(super) fn view(camera: &Camera, frame: &CloudFrame) -> View {
    let r = camera.pose.r.transpose().to_cols_array_2d();
    let size = [camera.width as usize, camera.height as usize];
    let o = frame.to_internal(camera.pose.c).to_array();
    View::from_c2w(r, o, [camera.fx, camera.fy], [camera.cx, camera.cy], size)
}

impl StepTarget {
    /// Fill in the colours of a photo; all pixels count alike.
    pub(super) fn fill(&mut self, image: &Image, background: [f32; 3]) {
        let (w, h) = (image.width as usize, image.height as usize);
        let channels = usize::from(image.channels);
        self.colour.resize(3 * w * h, 0.0);
        let (r, rest) = self.colour.split_at_mut(w * h);
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
        self.weights.begin();
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

/// Photos of one size, undistorted where their lenses bend light.
pub(super) struct PhotoSet {
    /// Those that are smaller than the dataset's own.
    smaller: Option<Dataset>,
    undistorted: Vec<Option<(Arc<UndistortedPlane>, Arc<Image>)>>,
}

impl PhotoSet {
    /// Those of `data`, halved so often, all decoded where they fit.
    pub(super) fn new(data: &Dataset, halvings: u32) -> Result<Self, SceneError> {
        let smaller = (halvings > 0).then(|| data.at_level(halvings));
        let data = smaller.as_ref().unwrap_or(data);
        data.decode()?;
        let mut known: Vec<Arc<UndistortedPlane>> = Vec::new();
        let mut undistorted = Vec::with_capacity(data.len());
        for (i, view) in data.views().iter().enumerate() {
            undistorted.push(match view.camera.lens.is_pinhole() {
                true => None,
                false => {
                    let plane = known.iter().find(|plane| plane.is_of(&view.camera)).cloned().unwrap_or_else(|| {
                        let new = Arc::new(UndistortedPlane::new(&view.camera));
                        known.push(new.clone());
                        new
                    });
                    let image = plane.photo(&*data.image(i)?);
                    Some((plane, Arc::new(image)))
                }
            });
        }
        Ok(Self { smaller, undistorted })
    }

    pub(super) fn len(&self) -> usize {
        self.undistorted.len()
    }

    /// A photo and its camera without lens; `data` are those that [`new`](Self::new) was given.
    pub(super) fn get(&self, data: &Dataset, i: usize) -> Result<(Arc<Image>, Camera), SceneError> {
        let data = self.smaller.as_ref().unwrap_or(data);
        let camera = &data.view(i).camera;
        match &self.undistorted[i] {
            Some((plane, image)) => Ok((image.clone(), plane.camera(camera))),
            None => Ok((data.image(i)?, *camera)),
        }
    }
}
