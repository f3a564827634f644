//! Views of one split at training resolution, and the random ray batches drawn from them.
//!
//! Images stay 8 bit. A view costs its pixels (3 or 4 bytes each, one more with a mask) while it is decoded; lenses with
//! distortion add 12 bytes a pixel for a table of directions, shared by all views with equal intrinsics. Pinhole
//! directions are computed.

mod batch;
mod errors;
mod guide;
mod patches;
mod view;

pub use batch::{Batch, DrawnFrom};
pub use errors::ErrorMap;
pub use guide::Guide;
pub use patches::{Patches, Shape};
pub use view::View;

use crate::scene_points::visible_points;
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::{Camera, Prepared, RayTable};
use render_core::ray::Ray;
use scene_io::{Frame, Image, ImageStore, Scene, SceneError};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Views of one split at training resolution.
pub struct Dataset {
    views: Vec<View>,
    store: Arc<ImageStore>,
    /// Whether all images fit in the store's memory.
    fits: bool,
    /// All images, decoded at the first draw, where they fit.
    resident: OnceLock<Vec<Arc<Image>>>,
    /// Views a window holds when they do not fit.
    window_views: u64,
    /// `first_pixel[v]` is the number of pixels of the views before `v`; one entry more than views.
    first_pixel: Vec<u64>,
}

/// A frame of a dataset, before it is a view.
struct Listed {
    frame: usize,
    source: Arc<Frame>,
    points: Arc<[DVec3]>,
}

impl Listed {
    fn new(scene: &Scene, frame: usize) -> Self {
        let source = Arc::new(scene.frames[frame].clone());
        let points =
            source.tracks.iter().filter_map(|track| scene.points.get(track.point as usize)).map(|point| point.xyz);
        Self { frame, points: points.collect(), source }
    }
}

impl Dataset {
    /// The frames `frames` of `scene`, to be decoded through `store`, a store of all frames of the scene.
    ///
    /// # Errors
    /// None today; kept so that reading ahead may fail.
    ///
    /// # Panics
    /// When an index in `frames` is not one of `scene.frames`, or `store` has no such frame.
    pub fn new(scene: &Scene, store: Arc<ImageStore>, frames: Vec<usize>) -> Result<Self, SceneError> {
        Self::with_levels(scene, store, frames, 0..1)
    }

    /// The same, each frame once for each level: a view of level `k` is the frame's mean over squares of `2^k` pixels.
    ///
    /// All pixels of all levels are equally likely in a batch, and weigh as much as their area.
    ///
    /// # Errors
    /// As [`Dataset::new`].
    ///
    /// # Panics
    /// As [`Dataset::new`]. In builds that check for overflow also: when a level is 32 or more.
    pub fn with_levels(
        scene: &Scene,
        store: Arc<ImageStore>,
        frames: Vec<usize>,
        levels: Range<u32>,
    ) -> Result<Self, SceneError> {
        let mut frames: Vec<Listed> = frames.into_iter().map(|f| Listed::new(scene, f)).collect();
        if !scene.points.is_empty() && scene.frames.iter().all(|frame| frame.tracks.is_empty()) {
            let points: Vec<DVec3> = scene.points.iter().map(|point| point.xyz).collect();
            frames.par_iter_mut().for_each(|l| l.points = visible_points(store.camera(l.frame), &points).into());
        }
        Ok(Self::of_frames(store, &frames, levels))
    }

    /// The views of this dataset at one level; see [`Dataset::with_levels`].
    ///
    /// # Panics
    /// In builds that check for overflow: when `level` is 32 or more.
    #[must_use]
    pub fn at_level(&self, level: u32) -> Self {
        let listed = |v: &View| Listed { frame: v.frame, source: v.source.clone(), points: v.points.clone() };
        let mut frames: Vec<Listed> = self.views.iter().map(listed).collect();
        let mut seen = std::collections::HashSet::new();
        frames.retain(|listed| seen.insert(listed.frame));
        Self::of_frames(self.store.clone(), &frames, level..level + 1)
    }

    fn of_frames(store: Arc<ImageStore>, frames: &[Listed], levels: Range<u32>) -> Self {
        let mut tables: Vec<(Camera, Arc<RayTable>, Prepared)> = Vec::new();
        let mut views = Vec::with_capacity(frames.len() * levels.len());
        for level in levels {
            for Listed { frame, source, points } in frames {
                let camera = level_camera(store.camera(*frame), level);
                let lens = (!camera.lens.is_pinhole()).then(|| {
                    let known = tables.iter().find(|(c, ..)| c.same_optics(&camera)).map(|(_, t, p)| (t.clone(), *p));
                    known.unwrap_or_else(|| {
                        let (table, prepared) = (Arc::new(RayTable::new(&camera)), camera.prepare());
                        tables.push((camera, table.clone(), prepared));
                        (table, prepared)
                    })
                });
                let (table, prepared) = lens.unzip();
                let (name, time) = (source.name.clone(), source.time.unwrap_or(0.0));
                let (source, points) = (source.clone(), points.clone());
                views.push(View { frame: *frame, source, name, time, camera, points, level, table, prepared });
            }
        }
        let mut first_pixel = vec![0];
        for view in &views {
            let pixels = u64::from(view.camera.width) * u64::from(view.camera.height);
            first_pixel.push(first_pixel[first_pixel.len() - 1] + pixels);
        }
        let bytes = views.iter().map(|view| view_bytes(&store, view));
        let (total, largest) = bytes.fold((0, 0), |(total, largest), size| (total + size, size.max(largest)));
        let fits = total <= store.budget_bytes();
        let window = store.budget_bytes().checked_div(largest).unwrap_or(0).clamp(1, views.len().max(1) as u64);
        Self { views, store, fits, resident: OnceLock::new(), window_views: window, first_pixel }
    }

    /// Take what the frames of `scene` say of points, anew: the scene that the dataset was made of, with points it had not then.
    pub(crate) fn take_points(&mut self, scene: &Scene) {
        for view in &mut self.views {
            let Listed { source, points, .. } = Listed::new(scene, view.frame);
            (view.source, view.points) = (source, points);
        }
    }

    /// Take for each view the points of `scene` that are visible to its camera: for held-out views, which have no tracks.
    pub(crate) fn take_visible_points(&mut self, scene: &Scene) {
        let points: Vec<DVec3> = scene.points.iter().map(|point| point.xyz).collect();
        self.views.par_iter_mut().for_each(|view| view.points = visible_points(&view.camera, &points).into());
    }

    /// Decode all views, in parallel, where they fit in the store's memory; the first [`Dataset::draw`] does it otherwise.
    ///
    /// # Errors
    /// [`SceneError`] of the first image that cannot be read.
    pub fn decode(&self) -> Result<(), SceneError> {
        if self.fits && self.resident.get().is_none() {
            let decoded: Vec<_> = self.views.par_iter().map(|view| self.read(view)).collect();
            // Another thread may have been faster: it has the same pixels.
            let _ = self.resident.set(decoded.into_iter().collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    /// Start decoding image `i` on another thread, so that it is ready when it is asked for. Does nothing where all images are decoded,
    /// or where the store has no room for two. The error of an image that cannot be read comes when it is asked for.
    pub fn decode_ahead(&self, i: usize) {
        if self.resident.get().is_none() && self.window_views > 1 {
            let (store, frame) = (self.store.clone(), self.views[i].frame);
            rayon::spawn(move || drop(store.get(frame)));
        }
    }

    /// Whether all views fit in the store's memory at one time.
    pub fn fits(&self) -> bool {
        self.fits
    }

    /// Bytes of the store's memory that decoded views leave free: others may keep pictures of theirs in it.
    pub fn spare_bytes(&self) -> u64 {
        self.store.budget_bytes().saturating_sub(self.image_bytes())
    }

    /// Bytes of all views, decoded.
    fn image_bytes(&self) -> u64 {
        self.views.iter().map(|view| view_bytes(&self.store, view)).fold(0, u64::saturating_add)
    }

    /// Number of views.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is no view.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Whether alpha comes from masks that cut out an object.
    pub fn is_cut_out(&self) -> bool {
        self.views.iter().any(|view| self.store.is_cut_out(view.frame))
    }

    /// The views, in the order of the frames given.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// View `i`.
    ///
    /// # Panics
    /// When there is no such view.
    pub fn view(&self, i: usize) -> &View {
        &self.views[i]
    }

    /// Pixels of view `i`.
    ///
    /// # Errors
    /// [`SceneError`] when the image cannot be read.
    ///
    /// # Panics
    /// When there is no such view.
    pub fn image(&self, i: usize) -> Result<Arc<Image>, SceneError> {
        match self.resident.get() {
            Some(images) => Ok(images[i].clone()),
            None => self.read(&self.views[i]),
        }
    }

    /// Decode a view's frame, at the view's level.
    fn read(&self, view: &View) -> Result<Arc<Image>, SceneError> {
        let image = self.store.get(view.frame)?;
        Ok(match view.level {
            0 => image,
            _ => Arc::new(image.resized(view.camera.width, view.camera.height)),
        })
    }

    /// Ray through the centre of a pixel of view `i`, or `None` where the lens has no preimage.
    ///
    /// # Panics
    /// When there is no such view or pixel.
    pub fn ray(&self, i: usize, x: u32, y: u32) -> Option<Ray> {
        self.views[i].ray(x, y)
    }

    /// Longest side of any view, pixels; `None` without views.
    pub fn longest_side(&self) -> Option<u32> {
        self.views.iter().map(|v| v.camera.width.max(v.camera.height)).max()
    }

    /// Number of different times of the views.
    pub fn time_steps(&self) -> usize {
        let mut times: Vec<f64> = self.views.iter().map(|v| v.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times.len()
    }

    /// Pixels of all views.
    pub fn pixel_count(&self) -> u64 {
        self.first_pixel[self.views.len()]
    }

    /// Bytes the decoded views may take at one time, with the direction tables.
    pub fn memory_bytes(&self) -> u64 {
        let images = self.image_bytes().min(self.store.budget_bytes());
        let mut tables: Vec<_> = self.views.iter().filter_map(|v| v.table.as_ref()).collect();
        tables.sort_by_key(|t| Arc::as_ptr(t));
        tables.dedup_by_key(|t| Arc::as_ptr(t));
        images + tables.iter().map(|t| t.directions().len() as u64 * 12).sum::<u64>()
    }
}

/// The camera of a level: sides halved so often, rounded down, at least 1.
fn level_camera(camera: &Camera, level: u32) -> Camera {
    match level {
        0 => *camera,
        _ => camera.resized((camera.width >> level).max(1), (camera.height >> level).max(1)),
    }
}

/// Bytes of a decoded view.
fn view_bytes(store: &ImageStore, view: &View) -> u64 {
    let full = store.camera(view.frame);
    // Wider than 64 bits: the product of two sizes of a forged header is.
    let pixels = |c: &Camera| u128::from(c.width) * u128::from(c.height);
    let bytes = (u128::from(store.bytes(view.frame)) * pixels(&view.camera)).div_ceil(pixels(full).max(1));
    u64::try_from(bytes).unwrap_or(u64::MAX)
}
