//! The contract every reconstruction method keeps, and the plain data that crosses it.
//!
//! One training loop ([`crate::train`]) drives every [`System`]; it knows nothing of fields or samplers. Rays go in and
//! layers come out in the **scene's** frame and units: a system normalises inside.

mod counts;
mod fit;
mod follow;
mod layers;
mod limits;
mod query;

pub use crate::error::SystemError;
pub use crate::tensors::{
    Tensor, TensorData, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_f32, take_numbers, take_u64,
    u64_tensor,
};
pub use counts::{SkipRow, StepStats};
pub use fit::Fit;
pub use follow::{CanonicalPoints, FlowSource, follow_canonical};
pub use layers::{Layers, NOWHERE};
pub use limits::{MOST_LAYERS, MOST_RAYS, MOST_SAMPLES, MOST_UNITS, at_most};
pub use query::{Appearance, Behind, Canonical, EmptyCells, LayerRequest, Median, Normals, Query, Trial};

use crate::data::Dataset;
use render_core::budget::Ledger;
use render_core::camera::Camera;
use render_core::ray::Ray;
use splat_core::{Gaussians, RasterSettings};

/// A cloud of Gaussians as it leaves a training.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    /// In the scene's frame and unit.
    pub gaussians: Gaussians,
    /// What it was trained with; `near` in world units.
    pub rules: RasterSettings,
}

/// One reconstruction method.
pub trait System: Send + Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// One optimiser step, number `step` (counted from 0 over the whole run, resumed or not). All randomness is a
    /// function of the run's seed and `step`.
    ///
    /// # Errors
    /// [`SystemError::NonFinite`] past the allowed share; [`SystemError::Scene`] when an image cannot be read.
    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError>;

    /// After `step` steps the share `time` of the training's time has passed: a schedule that is ahead of it, or behind, may correct
    /// itself. Said now and then in a training that stops after seconds; what follows from it is part of the state.
    fn keep_up(&mut self, _step: u64, _time: f64) {}

    /// What the last steps found out that people want to know, one line; each is told once.
    fn news(&mut self) -> Option<String> {
        None
    }

    /// How many more steps until pictures are as good again as before the last change of what they are made of; 0 where nothing has
    /// changed lately. A training that is interrupted makes these first.
    fn unsettled(&self) -> u64 {
        0
    }

    /// Rays along each side of a pixel that a picture takes the mean of.
    fn rays_per_side(&self) -> u32 {
        1
    }

    /// Render rays given in the scene's frame.
    fn render(&self, rays: &[Ray], query: &Query) -> Layers;

    /// [`System::render`] with some of its skips only, and what was skipped. `None` for a system whose renders skip nothing.
    fn render_trial(&self, _rays: &[Ray], _query: &Query, _trial: &Trial) -> Option<(Layers, Ledger)> {
        None
    }

    /// Render pixels: rays with the radius of each pixel's cone at distance 1
    /// ([`Prepared::cone_radius`](render_core::camera::Prepared::cone_radius)). Systems that do not use the footprint
    /// of a pixel need not implement it.
    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let _ = radii;
        self.render(rays, query)
    }

    /// Render the whole picture of a camera of the scene's frame, row by row; `None` for a system that renders ray by ray.
    fn render_view(&self, _camera: &Camera, _query: &Query) -> Option<Layers> {
        None
    }

    /// Whether the scene is a cloud of Gaussians: [`System::splats`] gives it.
    fn is_cloud(&self) -> bool {
        false
    }

    /// The cloud of Gaussians that the scene is at the time of `query`, in its frame and unit; `None` for a system of another kind.
    fn splats(&self, _query: &Query) -> Option<Splats> {
        None
    }

    /// Whether it knows what moves from what stands still: pictures have [`Layers::behind`] where a query asks for it.
    fn knows_behind(&self) -> bool {
        false
    }

    /// The code of an appearance; `None` for a system with one appearance only.
    fn appearance_code(&self, _appearance: &Appearance) -> Option<Vec<f32>> {
        None
    }

    /// The appearance code that explains pixels best, everything else as it is; `None` for a system with one
    /// appearance only.
    fn fit_appearance(&self, _pixels: &Fit<'_>) -> Option<Vec<f32>> {
        None
    }

    /// The appearance code of a photo by the system's own encoder; `None` where codes are fitted.
    fn encode_appearance(&self, _photo: &scene_io::Image) -> Option<Vec<f32>> {
        None
    }

    /// Which pixels of a training view show the static scene, row by row: 1 static, 0 transient. `None` for a system that
    /// takes all for static.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when the image cannot be read.
    fn visibility(&self, _data: &Dataset, _view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        Ok(None)
    }

    /// How far the pixels of a training view may be from what the scene says, row by row: standard deviations, colour units.
    /// `None` for a system that gives no such number.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when the image cannot be read.
    fn uncertainty(&self, _data: &Dataset, _view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        Ok(None)
    }

    /// Do the pre-pass of a training view that steps and masks need, with one ray for each square of `stride` pixels a side, and
    /// throw the result away: a rehearsal measures the memory it takes. False for a system without one.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when the image cannot be read.
    fn prepass(&self, _data: &Dataset, _view: usize, _stride: u32) -> Result<bool, SystemError> {
        Ok(false)
    }

    /// Density at points of the scene's frame at a time, 1 / world unit. `out` has one entry a point. A cloud of Gaussians
    /// ([`System::splats`]) has opacity on a picture and no density: 0.
    fn density(&self, points: &[[f64; 3]], time: f64, out: &mut [f32]);

    /// Distance along a ray of the scene's frame at which the system begins to sample, world units: what lies before is never
    /// seen.
    fn first_sample(&self, _ray: &Ray) -> f64 {
        0.0
    }

    /// Opacity of each pixel of a picture, row by row, from what lies before `depth` along the camera's axis, world units. `None`
    /// for a system that has densities, which tell as much.
    fn render_before(&self, _camera: &Camera, _depth: f64, _query: &Query) -> Option<Vec<f32>> {
        None
    }

    /// Colour at points of the scene's frame seen along unit directions `d`, at a time.
    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], time: f64, out: &mut [[f32; 3]]);

    /// Where points of the scene's frame at a time are in the canonical scene, the same frame and units. `out` has one entry a
    /// point. A system that warps nothing has them stay where they are; what else a density sees of a time step (ambient
    /// coordinates, codes) moves no point.
    fn canonical(&self, points: &[[f64; 3]], _time: f64, out: &mut [[f64; 3]]) {
        out.copy_from_slice(points);
    }

    /// What [`System::scene_flow`] comes from. A system that warps points or has learned scene flow says so.
    fn flow_source(&self) -> FlowSource {
        FlowSource::Nothing
    }

    /// Displacements of points of the scene's frame from one time to another, world units. `out` has one entry a point; `None` where
    /// it is not known where the point goes. Without learned scene flow a point goes where its canonical place is then
    /// ([`follow_canonical`]): one that nothing warps stays.
    fn scene_flow(&self, points: &[[f64; 3]], from: f64, to: f64, out: &mut [Option<[f64; 3]>]) {
        let canonical = |x: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]| self.canonical(x, time, out);
        follow_canonical(&canonical, self.bounds(), points, [from, to], out);
    }

    /// The box of the scene's frame outside which nothing is worth exporting: `[min, max]`.
    fn bounds(&self) -> [[f64; 3]; 2];

    /// Everything the next step depends on: parameters, moments, occupancy, counters.
    fn state(&self) -> Vec<Tensor<'_>>;

    /// Put back what [`System::state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError>;

    /// Trainable parameters.
    fn parameter_count(&self) -> usize;

    /// Bytes held now by parameters, moments, gradients and scratch.
    fn memory_bytes(&self) -> usize;

    /// Bytes that it may hold later on top of what it holds after its first steps: a cloud or a grid that grows.
    fn growth_bytes(&self) -> usize {
        0
    }

    /// Work skipped so far.
    fn skips(&self) -> Vec<SkipRow>;

    /// Seconds spent so far in each part of the step and of the render, for the report.
    fn timings(&self) -> Vec<(&'static str, f64)>;
}
