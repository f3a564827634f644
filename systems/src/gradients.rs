//! Gradients with respect to what pictures are seen from: rays, and cameras. For cameras that are parameters.
//!
//! Nothing is trained by asking for them, and a step that does not ask does not pay for them.
//!
//! The chain to a camera: [`RayGradients::to_camera`] for systems of rays, [`CameraGradients`] for systems that draw pictures.

use engine::data::Dataset;
use engine::system::SystemError;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{CameraBar, PoseBar, Prepared};
use render_core::ray::{Ray, RayBar};
use render_core::space_map::SpaceMap;
use splat_core::CameraGradient;
use std::ops::Range;

#[cfg(test)]
pub(crate) mod differences;

/// Rays of one task.
const TASK: usize = 64;

/// Rays and the colours that they should show.
#[derive(Clone, Copy, Debug)]
pub struct RayTargets<'a> {
    /// Rays of the scene's frame, their directions of unit length.
    pub rays: &'a [Ray],
    /// `[rays]`, colours on `background`.
    pub rgb: &'a [[f32; 3]],
    /// `[rays]`, training view of each: whose time and appearance it has.
    pub view: &'a [u32],
    /// `[rays]`, radius of each pixel's cone at distance 1, for systems whose rays are cones; empty: they are lines.
    pub radii: &'a [f32],
    /// What is behind the scene.
    pub background: [f32; 3],
}

/// What rays cost, and the gradient of that with respect to each of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RayGradients {
    /// The loss, mean over the rays.
    pub loss: f64,
    /// `[rays]`, its gradient with respect to origins, per world unit, and directions: through the samples at `o + t d`, and through the
    /// colours that `d` is seen in, whose part is tangent to the sphere.
    pub bars: Vec<RayBar>,
}

impl RayGradients {
    /// The gradient with respect to the camera that all rays are of: those through `pixels`, `[rays]`. That of a twist of the pose is
    /// [`PoseBar::twist`].
    ///
    /// # Panics
    /// When there are not as many pixels as rays.
    #[must_use]
    pub fn to_camera(&self, camera: &Prepared, pixels: &[DVec2]) -> (PoseBar, CameraBar) {
        let (mut pose, mut optics) = (PoseBar::ZERO, CameraBar::default());
        camera.rays_backward(pixels, &self.bars, &mut pose, &mut optics);
        (pose, optics)
    }
}

/// A system of rays that can say how its loss depends on the rays.
pub trait ByRay {
    /// The loss of rays and its gradient with respect to them.
    ///
    /// The loss is the error of the colours as a step measures it, and what whole rays cost besides. It is not that of a method for
    /// photos from the wild, which judges batches of its own; held to measured depth, to an elastic or coherent deformation or to a
    /// background that stands still is nothing here. Codes of appearance are those of the views.
    ///
    /// Held fixed are: the distances of the samples along a ray and the lengths of their intervals, in the units of the space that rays
    /// are marched in; which samples there are, as the occupancy grid, the proposals or a first network place them, and which of them are
    /// left out as faint or hidden; where a ray enters the scene; the radius of a cone. Nothing is random: samples lie in the middle of
    /// their steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for lists of different lengths and views that there are not.
    fn ray_gradients(&mut self, targets: &RayTargets<'_>) -> Result<RayGradients, SystemError>;
}

/// A photo's loss, and the gradient of that with respect to its camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoGradient {
    /// The loss of the photo.
    pub loss: f64,
    /// Its gradient: of a twist that moves the world-to-camera transform from the left, per radian and per world unit of the scene, and
    /// of the focal lengths and the principal point of the photo at its full size.
    pub camera: CameraGradient,
}

/// A system that draws whole pictures and can say how its loss depends on their cameras.
pub trait CameraGradients {
    /// The loss of training photo `view` in step `step`, and its gradient with respect to the camera.
    ///
    /// Held fixed are: which Gaussians are drawn, in which order, and over which pixels each reaches; the degree of the colours. A photo of
    /// a lens is resampled onto the plane of a pinhole camera as before: the gradient is that with respect to this plane's camera, and
    /// coefficients of the lens have none.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when the photo cannot be read, [`SystemError::Config`] for a view that there is not.
    fn camera_gradient(&mut self, data: &Dataset, view: usize, step: u64) -> Result<PhotoGradient, SystemError>;
}

/// Go through `rays` rays in tasks, each with a state of its own: the loss of its rays, and their gradients. The loss is the sum.
pub(crate) fn by_tasks<S: Default>(
    rays: usize,
    task: impl Fn(Range<usize>, &mut S) -> (f64, Vec<RayBar>) + Sync,
) -> RayGradients {
    let of = |state: &mut S, k: usize| task(k * TASK..((k + 1) * TASK).min(rays), state);
    let tasks: Vec<_> = (0..rays.div_ceil(TASK)).into_par_iter().map_init(S::default, of).collect();
    let loss = tasks.iter().map(|(loss, _)| loss).sum();
    RayGradients { loss, bars: tasks.into_iter().flat_map(|(_, bars)| bars).collect() }
}

/// The gradient of a ray from that of the ray in internal coordinates and that of the direction it is seen in, of which the part tangent
/// to the sphere counts: directions have unit length.
pub(crate) fn to_world(map: &SpaceMap, ray: &Ray, internal: &RayBar, view: DVec3) -> RayBar {
    let mut bar = RayBar { o: DVec3::ZERO, d: view - ray.d * ray.d.dot(view) };
    map.internal_ray_backward(ray, internal, &mut bar);
    bar
}

/// Refuse lists that do not belong together.
///
/// # Errors
/// [`SystemError::Config`] naming the list.
pub(crate) fn check(targets: &RayTargets<'_>, views: usize) -> Result<(), SystemError> {
    let n = targets.rays.len();
    let refuse =
        |field, value: usize, problem: String| Err(SystemError::Config { field, value: value.to_string(), problem });
    if targets.rgb.len() != n {
        return refuse("rgb", targets.rgb.len(), format!("there are {n} rays"));
    }
    if targets.view.len() != n {
        return refuse("view", targets.view.len(), format!("there are {n} rays"));
    }
    if !targets.radii.is_empty() && targets.radii.len() != n {
        return refuse("radii", targets.radii.len(), format!("there are {n} rays"));
    }
    match targets.view.iter().find(|view| **view as usize >= views) {
        Some(view) => refuse("view", *view as usize, format!("there are {views} training views")),
        None => Ok(()),
    }
}
