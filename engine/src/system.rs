//! The contract every reconstruction method keeps, and the plain data that crosses it.
//!
//! One training loop ([`crate::train`]) drives every [`System`]; it knows nothing of fields or samplers. Rays go in and
//! layers come out in the **scene's** frame and units: a system normalises inside.

use crate::data::Dataset;
use crate::halt::Halt;
use optim::Adam;
use render_core::budget::{Ledger, SkipSet};
use render_core::camera::Camera;
use render_core::ray::Ray;
use splat_core::{Gaussians, RasterSettings};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepStats {
    /// Mean training loss of the batch.
    pub loss: f64,
    /// Mean squared colour error of the batch, for the running training PSNR.
    pub mse: f64,
    /// Rays cast.
    pub rays: u64,
    /// Samples the field was evaluated at.
    pub samples: u64,
    /// Mean weight of what one photo alone shows, over the pixels that count; 0 without a transient part.
    pub transient: f64,
    /// Gradient entries that were NaN or infinite and were set to 0.
    pub nonfinite: u64,
}

/// Which layers a render should hold; colour, opacity and depth always come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerRequest {
    /// Surface normals, `-grad sigma` weighted along the ray and normalised. Costs about one more field evaluation.
    pub normals: Normals,
    /// Which point of the canonical scene is seen. Costs one evaluation of the deformation a ray.
    pub canonical: Canonical,
    /// Median depths of Gaussians. They cost a second walk through what was drawn; fields have them in any case.
    pub median: Median,
}

/// Whether normals are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// Not computed.
    #[default]
    Skip,
    /// Computed.
    Compute,
}

/// Whether canonical points are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Canonical {
    /// Not computed.
    #[default]
    Skip,
    /// Computed.
    Compute,
}

/// Whether the median depth of Gaussians is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Median {
    /// The expected depth stands for it: enough for colours.
    Skip,
    /// Computed.
    #[default]
    Compute,
}

/// Canonical point of a ray that hit nothing; infinite, as its depth is.
pub const NOWHERE: [f64; 3] = [f64::INFINITY; 3];

/// Rendered layers of a batch of rays, one entry a ray. Colours are not clamped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Colour, composited on the query's background.
    pub rgb: Vec<[f32; 3]>,
    /// Accumulated opacity in `[0, 1]`.
    pub opacity: Vec<f32>,
    /// Expected distance along the ray, world units; `f32::INFINITY` where nothing was hit.
    pub depth: Vec<f32>,
    /// Distance at which the transmittance passes one half; `f32::INFINITY` where it never does. As `depth` for Gaussians where
    /// [`Median::Skip`] was asked for.
    pub median_depth: Vec<f32>,
    /// Unit normals, empty unless asked for; zero where nothing was hit.
    pub normal: Vec<[f32; 3]>,
    /// Canonical point of what is seen at `median_depth`, the scene's frame, world units (see
    /// [`canonical`](crate::canonical)). Empty unless asked for; infinite where nothing was hit.
    pub canonical: Vec<[f64; 3]>,
}

impl Layers {
    /// `n` rays that hit nothing.
    #[must_use]
    pub fn nothing(n: usize, query: &Query) -> Self {
        Self {
            rgb: vec![query.background; n],
            opacity: vec![0.0; n],
            depth: vec![f32::INFINITY; n],
            median_depth: vec![f32::INFINITY; n],
            normal: if query.layers.normals == Normals::Compute { vec![[0.0; 3]; n] } else { Vec::new() },
            canonical: if query.layers.canonical == Canonical::Compute { vec![NOWHERE; n] } else { Vec::new() },
        }
    }

    /// Append another batch's layers.
    pub fn extend(&mut self, more: Self) {
        self.rgb.extend(more.rgb);
        self.opacity.extend(more.opacity);
        self.depth.extend(more.depth);
        self.median_depth.extend(more.median_depth);
        self.normal.extend(more.normal);
        self.canonical.extend(more.canonical);
    }
}

/// A cloud of Gaussians as it leaves a training.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    /// In the scene's frame and unit.
    pub gaussians: Gaussians,
    /// What it was trained with; `near` in world units.
    pub rules: RasterSettings,
}

/// In which photo's light a picture is rendered. Systems without appearance know one light only.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Appearance {
    /// The mean of all training photos.
    #[default]
    Mean,
    /// That of a training view.
    View(usize),
    /// A code: fitted to a photo, or between two others.
    Code(Arc<[f32]>),
}

/// What a render may vary besides the rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    /// What is behind the scene.
    pub background: [f32; 3],
    /// Layers wanted besides colour, opacity and depth.
    pub layers: LayerRequest,
    /// Error a pixel may have from skipped work, in colour units; 0 skips nothing.
    pub error_budget: f32,
    /// In which light.
    pub appearance: Appearance,
    /// At which time, `0..=1`. Systems of scenes that stand still know one time only.
    pub time: f64,
    /// Ends the work early: layers are those of nothing then, from some ray on.
    pub halt: Halt,
}

/// Pixels an appearance is fitted to.
#[derive(Clone, Copy, Debug)]
pub struct Fit<'a> {
    /// Rays in the scene's frame.
    pub rays: &'a [Ray],
    /// Their colours, on the background.
    pub rgb: &'a [[f32; 3]],
    /// What is behind the scene.
    pub background: [f32; 3],
    /// Steps of the fit.
    pub steps: u64,
    /// Learning rate at the start; a tenth of it after each third.
    pub lr: f64,
    /// Seed of the pixels of each step.
    pub seed: u64,
    /// Ends the fit early, with the code as it is.
    pub halt: &'a Halt,
}

impl Fit<'_> {
    /// Bytes of samples that a fit keeps at most, about.
    const KEPT_BYTES: usize = 1 << 26;

    /// The samples along at most `pixels` of the rays, `numbers` of four bytes each. Where mist has samples everywhere, a fit keeps
    /// those of fewer rays. `keep(every, most)` keeps the samples of every `every`-th ray, or gives `None` where these are more than
    /// `most`; of one ray it must keep them.
    pub fn keep<K>(&self, pixels: usize, numbers: usize, keep: impl Fn(usize, usize) -> Option<K>) -> K {
        let most = Self::KEPT_BYTES / (4 * numbers);
        let mut every = self.rays.len().div_ceil(pixels).max(1);
        loop {
            match keep(every, most) {
                Some(kept) => return kept,
                None => every *= 2,
            }
        }
    }
}

/// A render that takes some of its skips only: what the table of skips compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trial {
    /// Skips it may take, as far as the query's error budget goes.
    pub skips: SkipSet,
    /// What is in cells that count as empty.
    pub empty: EmptyCells,
}

impl Trial {
    /// What [`System::render`] does.
    pub const USUAL: Self = Self { skips: SkipSet::ALL, empty: EmptyCells::Nothing };
}

/// What is in cells of an occupancy grid that count as empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmptyCells {
    /// Nothing: that is the model, as training never looks there.
    Nothing,
    /// What the field holds there, unless the cameras rule the cell out.
    Field,
}

/// A named array of a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor<'a> {
    /// Unique within the system, dotted: `field.grid`, `adam.field.grid.m`.
    pub name: String,
    /// Dimensions, slowest first.
    pub shape: Vec<usize>,
    /// Row-major values.
    pub data: TensorData<'a>,
}

impl Tensor<'_> {
    /// The same, holding its own values.
    #[must_use]
    pub fn into_owned(self) -> Tensor<'static> {
        let data = match self.data {
            TensorData::F32(d) => TensorData::F32(Cow::Owned(d.into_owned())),
            TensorData::U64(d) => TensorData::U64(Cow::Owned(d.into_owned())),
        };
        Tensor { name: self.name, shape: self.shape, data }
    }
}

/// Values of a tensor.
#[derive(Clone, Debug, PartialEq)]
pub enum TensorData<'a> {
    /// 32-bit floats.
    F32(Cow<'a, [f32]>),
    /// 64-bit unsigned integers: counters, bit sets.
    U64(Cow<'a, [u64]>),
}

/// Tensors of a checkpoint by name.
pub type TensorMap = BTreeMap<String, Tensor<'static>>;

/// One row of the skip table: work that was not done, and what that may cost.
#[derive(Clone, Debug, PartialEq)]
pub struct SkipRow {
    /// What is skipped: `empty space`, `early termination`, …
    pub what: &'static str,
    /// Units of work skipped.
    pub skipped: u64,
    /// Units of work there would have been.
    pub total: u64,
    /// Unit of the two counts: `samples`, `rays`, …
    pub unit: &'static str,
    /// Bound on the error of a pixel, colour units, as a sentence: `<= 1e-4 per pixel`.
    pub bound: String,
    /// Seconds that were saved, where somebody measured.
    pub seconds_saved: Option<f64>,
    /// Largest and mean error over pixels, colour units, where somebody measured.
    pub error: Option<[f64; 2]>,
}

impl SkipRow {
    /// A row that nobody has measured yet.
    #[must_use]
    pub fn counted(what: &'static str, (skipped, total): (u64, u64), unit: &'static str, bound: String) -> Self {
        Self { what, skipped, total, unit, bound, seconds_saved: None, error: None }
    }
}

/// A failure inside a system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// More steps had non-finite gradients than a run may have.
    #[error(
        "{bad} of {steps} steps had NaN or infinite gradients, more than the {share_percent} % a run may have: \
         lower the learning rate (`--set lr=...`) or check the images for NaN pixels"
    )]
    NonFinite {
        /// Steps with non-finite gradients.
        bad: u64,
        /// Steps so far.
        steps: u64,
        /// Share allowed, in percent.
        share_percent: f64,
    },
    /// A checkpoint lacks an array or holds one of another shape.
    #[error("checkpoint: `{name}`: {problem}")]
    State {
        /// The array.
        name: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A configuration value that cannot work.
    #[error("`{field}` = {value}: {problem}")]
    Config {
        /// The field as the user writes it in `--set`.
        field: &'static str,
        /// What it holds.
        value: String,
        /// Why that cannot work, and what would.
        problem: String,
    },
    /// Reading an image failed.
    #[error(transparent)]
    Scene(#[from] scene_io::SceneError),
}

impl From<optim::TooManyNonFinite> for SystemError {
    fn from(e: optim::TooManyNonFinite) -> Self {
        Self::NonFinite { bad: e.bad_steps, steps: e.steps, share_percent: 100.0 * e.allowed as f64 / e.steps as f64 }
    }
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
    /// ([`Prepared::cone_radius`](render_core::camera::Prepared::cone_radius)). Systems that do not look at the footprint
    /// of a pixel need not know of it.
    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let _ = radii;
        self.render(rays, query)
    }

    /// Render the whole picture of a camera of the scene's frame, row by row; `None` for a system that renders ray by ray.
    fn render_view(&self, _camera: &Camera, _query: &Query) -> Option<Layers> {
        None
    }

    /// The cloud of Gaussians that the scene is, in its frame and unit; `None` for a system that is none.
    fn splats(&self) -> Option<Splats> {
        None
    }

    /// The code of an appearance; `None` for a system that knows one light only.
    fn appearance_code(&self, _appearance: &Appearance) -> Option<Vec<f32>> {
        None
    }

    /// The appearance code that explains pixels best, everything else as it is; `None` for a system that knows one light
    /// only.
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

    /// Look at a training view as it will be looked at between steps and for masks, one ray for each square of `stride` pixels a
    /// side, and forget what was seen. False for a system that never looks. For rehearsals: what it takes is to be seen.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when the image cannot be read.
    fn look(&self, _data: &Dataset, _view: usize, _stride: u32) -> Result<bool, SystemError> {
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
    /// point. A system that warps nothing has them stay where they are; what else a density sees of a moment (ambient
    /// coordinates, codes) moves no point.
    fn canonical(&self, points: &[[f64; 3]], _time: f64, out: &mut [[f64; 3]]) {
        out.copy_from_slice(points);
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

    /// Trainable numbers.
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

/// Refuse settings above what any machine can use: `limits` are names, values and the most of each. What a setting multiplies is
/// allocated before anything else could be said about it.
///
/// # Errors
/// [`SystemError::Config`] naming the setting.
pub fn at_most(limits: &[(&'static str, usize, usize)]) -> Result<(), SystemError> {
    match limits.iter().find(|(_, value, most)| value > most) {
        None => Ok(()),
        Some((field, value, most)) => {
            Err(SystemError::Config { field, value: value.to_string(), problem: format!("must be at most {most}") })
        }
    }
}

/// The most of settings that networks and batches of all fields have: units of a layer, layers, rays and samples of a step.
pub const MOST_UNITS: usize = 4096;
/// See [`MOST_UNITS`].
pub const MOST_LAYERS: usize = 64;
/// See [`MOST_UNITS`].
pub const MOST_RAYS: usize = 1 << 20;
/// See [`MOST_UNITS`].
pub const MOST_SAMPLES: usize = 1 << 24;

/// A tensor of one dimension.
pub fn f32_tensor<'a>(name: impl Into<String>, data: &'a [f32]) -> Tensor<'a> {
    Tensor { name: name.into(), shape: vec![data.len()], data: TensorData::F32(Cow::Borrowed(data)) }
}

/// Counters of one dimension.
pub fn u64_tensor<'a>(name: impl Into<String>, data: Vec<u64>) -> Tensor<'a> {
    Tensor { name: name.into(), shape: vec![data.len()], data: TensorData::U64(Cow::Owned(data)) }
}

/// The floats of an array of a checkpoint.
///
/// # Errors
/// [`SystemError::State`] where it is missing, of another type, or not `len` long.
pub fn take_f32(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<f32>, SystemError> {
    match tensors.get(name).map(|t| &t.data) {
        Some(TensorData::F32(data)) if data.len() == len => Ok(data.to_vec()),
        found => Err(refused(name, "32-bit floats", len, found)),
    }
}

/// The counters of an array of a checkpoint.
///
/// # Errors
/// As [`take_f32`].
pub fn take_u64(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<u64>, SystemError> {
    match tensors.get(name).map(|t| &t.data) {
        Some(TensorData::U64(data)) if data.len() == len => Ok(data.to_vec()),
        found => Err(refused(name, "64-bit integers", len, found)),
    }
}

/// Counters a run may have: whatever is counted is counted exactly, and one more is no overflow.
pub(crate) const MOST_COUNTED: u64 = 1 << 53;

/// Counters of a checkpoint that go on counting: none is larger than a run can count.
///
/// # Errors
/// As [`take_u64`], and for a number that no run has counted to.
pub fn take_counts(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<u64>, SystemError> {
    let counts = take_u64(tensors, name, len)?;
    match counts.iter().position(|&count| count > MOST_COUNTED) {
        Some(i) => {
            let problem = format!("entry {i} is {}; no run counts that far", counts[i]);
            Err(SystemError::State { name: name.into(), problem })
        }
        None => Ok(counts),
    }
}

/// Floats of a checkpoint that are numbers: neither NaN nor infinite.
///
/// # Errors
/// As [`take_f32`], and for an entry that is no number.
pub fn take_numbers(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<f32>, SystemError> {
    let numbers = take_f32(tensors, name, len)?;
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(i) => {
            let problem = format!("entry {i} is {}; a number is expected", numbers[i]);
            Err(SystemError::State { name: name.into(), problem })
        }
        None => Ok(numbers),
    }
}

/// The moments of a part, to a checkpoint.
pub fn push_adam<'a>(out: &mut Vec<Tensor<'a>>, name: &str, adam: &'a Adam) {
    out.push(f32_tensor(format!("adam.{name}.m"), adam.first_moment()));
    out.push(f32_tensor(format!("adam.{name}.v"), adam.second_moment()));
    out.push(u64_tensor(format!("adam.{name}.steps"), vec![adam.steps()]));
}

/// What [`push_adam`] wrote, for a part like `old`.
///
/// # Errors
/// [`SystemError::State`] for arrays that are missing or do not fit `old`.
pub fn take_adam(state: &TensorMap, name: &str, old: &Adam) -> Result<Adam, SystemError> {
    let m = take_f32(state, &format!("adam.{name}.m"), old.len())?;
    let v = take_f32(state, &format!("adam.{name}.v"), old.len())?;
    let steps = take_counts(state, &format!("adam.{name}.steps"), 1)?[0];
    Adam::restore(old.config(), m, v, steps)
        .map_err(|e| SystemError::State { name: format!("adam.{name}"), problem: e.to_string() })
}

fn refused(name: &str, kind: &str, len: usize, found: Option<&TensorData<'_>>) -> SystemError {
    let found = match found {
        None => "it is missing".into(),
        Some(TensorData::F32(d)) => format!("it holds {} 32-bit floats", d.len()),
        Some(TensorData::U64(d)) => format!("it holds {} 64-bit integers", d.len()),
    };
    SystemError::State { name: name.into(), problem: format!("{len} {kind} expected, {found}") }
}
