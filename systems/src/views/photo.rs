//! A photo as training sees it: a pinhole camera in the internal frame, planes of colour, and how much each pixel counts.

use super::cloud_frame::CloudFrame;
use super::memory::keeps_copies;
use super::undistortion::UndistortedPlane;
use super::weights::Weights;
use engine::data::Dataset;
use rayon::prelude::*;
use render_core::camera::{Camera, Pose};
use scene_io::{Image, SceneError};
use splat_core::View;
use std::borrow::Cow;
use std::sync::Arc;

/// Planes that are kept where copies of photos are not.
const PLANES: usize = 4;
/// Rows that one task converts.
const ROWS: usize = 16;

/// What the picture of a step is compared with.
#[derive(Debug)]
pub(super) struct StepTarget {
    /// Of the photo, without a lens.
    pub(super) camera: Camera,
    /// `[3][rows][columns]`, on the step's background.
    pub(super) colour: Vec<f32>,
    /// `[rows][columns]`, how much of the background is seen; empty where the photo has no alpha.
    behind: Vec<f32>,
    background: [f32; 3],
    pub(super) weights: Weights,
}

/// A camera of the scene's frame as the rasteriser takes it.
pub(super) fn view(camera: &Camera, frame: &CloudFrame) -> View {
    let r = camera.pose.r.transpose().to_cols_array_2d();
    let size = [camera.width as usize, camera.height as usize];
    let o = frame.to_internal(camera.pose.c).to_array();
    View::from_c2w(r, o, [camera.fx, camera.fy], [camera.cx, camera.cy], size)
}

/// No photo yet.
impl Default for StepTarget {
    fn default() -> Self {
        let camera = Camera::pinhole(1, 1, 1.0, 1.0, 0.5, 0.5, Pose::IDENTITY);
        Self { camera, colour: Vec::new(), behind: Vec::new(), background: [0.0; 3], weights: Weights::default() }
    }
}

impl StepTarget {
    /// Fill in the colours of a photo; all pixels count alike.
    pub(super) fn fill(&mut self, image: &Image, camera: &Camera, background: [f32; 3]) {
        self.camera = *camera;
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
        self.background = background;
        self.behind.clear();
        if channels == 4 {
            self.behind.extend(image.data.chunks_exact(channels).map(|p| 1.0 - f32::from(p[3]) * UNIT));
        }
        self.weights.begin();
    }

    /// The colours on another background.
    pub(super) fn on(&self, background: [f32; 3]) -> Cow<'_, [f32]> {
        if self.behind.is_empty() || self.background == background {
            return Cow::Borrowed(&self.colour);
        }
        let mut colour = self.colour.clone();
        for (c, plane) in colour.chunks_exact_mut(self.behind.len()).enumerate() {
            let other = background[c] - self.background[c];
            plane.iter_mut().zip(&self.behind).for_each(|(x, behind)| *x += behind * other);
        }
        Cow::Owned(colour)
    }
}

/// One of the values of a byte, as a share.
const UNIT: f32 = 1.0 / 255.0;

/// A pixel over a background.
pub(super) fn over(p: &[u8], background: [f32; 3]) -> [f32; 3] {
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

/// A photo drawn onto a plane, with the plane.
type Copy = (Arc<UndistortedPlane>, Arc<Image>);

/// Photos of one size, undistorted where their lenses bend light.
pub(super) struct PhotoSet {
    /// Those that are smaller than the dataset's own.
    smaller: Option<Dataset>,
    /// Of each photo whose lens bends light, where there is memory for all of them.
    copies: Option<Vec<Option<Copy>>>,
    /// Planes of lenses, the newest last: few lenses make all photos of most captures.
    planes: Vec<Arc<UndistortedPlane>>,
}

impl PhotoSet {
    /// Those of `data`, halved so often, all decoded where they fit.
    pub(super) fn new(data: &Dataset, halvings: u32) -> Result<Self, SceneError> {
        let smaller = (halvings > 0).then(|| data.at_level(halvings));
        let mut photos = Self { smaller, copies: None, planes: Vec::new() };
        let size = photos.smaller.as_ref().unwrap_or(data);
        size.decode()?;
        if keeps_copies(size) {
            let copies: Result<Vec<_>, _> = (0..photos.len(data)).map(|i| photos.copy(data, i, usize::MAX)).collect();
            photos.copies = Some(copies?);
        }
        Ok(photos)
    }

    /// How many there are.
    pub(super) fn len(&self, data: &Dataset) -> usize {
        self.smaller.as_ref().unwrap_or(data).len()
    }

    /// Start reading the photo that is asked for next, where photos are not kept.
    pub(super) fn read_ahead(&self, data: &Dataset, next: impl FnOnce() -> usize) {
        let data = self.smaller.as_ref().unwrap_or(data);
        if self.copies.is_none() && !data.fits() {
            data.decode_ahead(next());
        }
    }

    /// A photo and its camera without lens; `data` are those that [`new`](Self::new) was given.
    pub(super) fn get(&mut self, data: &Dataset, i: usize) -> Result<(Arc<Image>, Camera), SceneError> {
        let copy = match &self.copies {
            Some(copies) => copies[i].clone(),
            None => self.copy(data, i, PLANES)?,
        };
        let data = self.smaller.as_ref().unwrap_or(data);
        let camera = &data.view(i).camera;
        match copy {
            Some((plane, image)) => Ok((image, plane.camera(camera))),
            None => Ok((data.image(i)?, *camera)),
        }
    }

    /// The copy of a photo, where its lens bends light; no more than `most` planes are kept for others.
    fn copy(&mut self, data: &Dataset, i: usize, most: usize) -> Result<Option<Copy>, SceneError> {
        let data = self.smaller.as_ref().unwrap_or(data);
        let camera = &data.view(i).camera;
        if camera.lens.is_pinhole() {
            return Ok(None);
        }
        let plane = match self.planes.iter().find(|plane| plane.is_of(camera)) {
            Some(plane) => plane.clone(),
            None => {
                let new = Arc::new(UndistortedPlane::new(camera));
                self.planes.drain(..self.planes.len().saturating_sub(most - 1));
                self.planes.push(new.clone());
                new
            }
        };
        let image = plane.photo(&*data.image(i)?);
        Ok(Some((plane, Arc::new(image))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use render_core::camera::Lens;
    use scene_io::{ImageStore, StoreOptions};

    #[test]
    fn colours_on_another_background_are_those_of_a_photo_that_was_put_on_it() {
        let camera = Camera::pinhole(2, 1, 1.0, 1.0, 1.0, 0.5, Pose::IDENTITY);
        let (grey, white) = ([0.5; 3], [1.0; 3]);
        let photo = Image::rgba(2, 1, vec![10, 20, 30, 255, 100, 150, 200, 51]).unwrap();
        let [mut on_grey, mut on_white] = [StepTarget::default(), StepTarget::default()];
        on_grey.fill(&photo, &camera, grey);
        on_white.fill(&photo, &camera, white);
        assert!(on_grey.colour != on_white.colour);
        for (got, want) in on_grey.on(white).iter().zip(&on_white.colour) {
            assert!((got - want).abs() < 1e-6, "{got} {want}");
        }
        // One without alpha covers everything, whatever was there before.
        on_grey.fill(&Image::rgb(2, 1, vec![9; 6]).unwrap(), &camera, grey);
        assert_eq!(*on_grey.on(white), on_grey.colour[..]);
    }

    #[test]
    fn copies_that_are_not_kept_are_the_same() {
        let mut frames = made::frames(4, |k, x, y| [20 * k as u8, 7 * x as u8, 7 * y as u8, 255]);
        for (k, frame) in frames.iter_mut().enumerate() {
            // Each its own lens, and one without.
            let bent = if k == 2 { 0.0 } else { 0.01 * (k + 1) as f64 };
            frame.camera.lens = Lens::opencv5([bent, 0.0, 0.0, 0.0, 0.0]);
        }
        let (scene, _) = made::scene(frames, Vec::new());
        let of = |budget: u64| {
            let store = ImageStore::new(&scene.frames, StoreOptions::default().with_budget_bytes(budget)).unwrap();
            Dataset::new(&scene, Arc::new(store), (0..scene.frames.len()).collect()).unwrap()
        };
        for halvings in [0, 1] {
            let (much, little, some) = (of(1 << 30), of(1), of(5 * u64::from(made::SIDE * made::SIDE) * 3));
            let mut kept = PhotoSet::new(&much, halvings).unwrap();
            let mut made = PhotoSet::new(&little, halvings).unwrap();
            let mut ahead = PhotoSet::new(&some, halvings).unwrap();
            assert!(kept.copies.is_some() && made.copies.is_none() && ahead.copies.is_none());
            for i in [0, 1, 2, 3, 4, 11, 0, 11] {
                let (one, other) = (kept.get(&much, i).unwrap(), made.get(&little, i).unwrap());
                assert_eq!((&one.0.data, &one.0.mask, one.1), (&other.0.data, &other.0.mask, other.1), "{i}");
                assert_eq!(one.0.mask.is_some(), i != 2);
                ahead.read_ahead(&some, || (i + 1) % 12);
                assert_eq!(ahead.get(&some, i).unwrap(), one, "{i}");
            }
            assert!(made.planes.len() == PLANES && kept.planes.len() == scene.frames.len() - 1);
        }
    }
}
