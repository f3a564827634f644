//! The driver: draws a photo's picture of the clouds, compares it, takes the gradient back, steps the optimisers, controls the density.

use super::cloud::TrainedCloud;
use super::cloud_frame::CloudFrame;
use super::cloud_parameters::CloudParameters;
use super::config::PictureConfig;
use super::density_control::ChangeTime;
use super::drawing::DrawnCloud;
use super::free_space::FreeSpace;
use super::front::ViewLayers;
use super::hooks::{CloudMotion, ColourAppearance, OfAppearance, RenderJudge, SeenPhoto, SurveyJudge};
use super::memory::Pictures;
use super::pass::{LossParts, Outcome, PARTS, PicturePass, StepCamera, StepJudge, ViewSpaceGradient, picture_pass};
use super::photo::{PhotoSet, StepTarget, view};
use super::photo_depth::PhotoDepth;
use super::planes::PlaneLayout;
use super::refusal::refused;
use super::render::{CloudRenderer, RenderBuffers};
use super::skipped::Skipped;
use super::smoothing::Smoothing;
use super::terms::{PictureTerm, TargetPicture};
use super::turn::turn;
use super::weights::{PixelWeight, StepPhoto};
use crate::schedule::{PlannedTime, Position};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::{Query, StepStats, SystemError};
use field_core::rng::Rng;
use float_core::Simd;
use optim::NonFiniteGuard;
use render_core::camera::Camera;
use splat_core::{CameraGradient, View};
use std::borrow::Cow;
use std::sync::Mutex;
use std::time::Instant;

/// Streams of random numbers.
const EPOCHS: u64 = 0x6570_6f63;
const BACKGROUNDS: u64 = 0x6261_636b;
/// Steps after which pictures are within 0.3 dB of the best before, once Gaussians came or photos were shown larger; with changes that
/// are more often, this share of the steps between two of them.
const SETTLE: u64 = 75;
const SETTLE_SHARE: f64 = 0.75;
/// Timed besides the parts of the pass.
pub(super) const OWN: [&str; 4] = ["optimiser", "density control", "motion", "surveys"];

/// What a system of Gaussians is made of.
pub(crate) struct ViewParts {
    /// Name of the system.
    pub(crate) name: &'static str,
    /// The frame that its clouds are trained in.
    pub(crate) frame: CloudFrame,
    pub(crate) pictures: PictureConfig,
    /// The clouds of a picture, in the order of their numbers.
    pub(crate) clouds: Vec<TrainedCloud>,
    /// The loss is their sum.
    pub(crate) terms: Vec<Box<dyn PictureTerm>>,
    /// A pixel's weight is their product.
    pub(crate) weights: Vec<Box<dyn PixelWeight>>,
    /// Colours in the appearance of a photo; `None`: as the spherical harmonics are.
    pub(crate) appearance: Option<Box<dyn ColourAppearance>>,
    /// Says which pixels of a photo show the scene, by its render; `None`: all do.
    pub(crate) judge: Option<Box<dyn RenderJudge>>,
    /// Says it by the renders of all photos, from time to time; `None`: all do.
    pub(crate) surveys: Option<Box<dyn SurveyJudge>>,
    /// Two clouds that are put together; `None`: all are drawn together.
    pub(crate) layers: Option<ViewLayers>,
    /// Clouds at a time; `None`: they stand still.
    pub(crate) motion: Option<Box<dyn CloudMotion>>,
    pub(crate) times: PhotoTimes,
    /// Which view-space gradients the density control is given.
    pub(crate) view_space: ViewSpaceGradient,
    pub(crate) background: Background,
    /// What the schedule takes of its time; `None`: it is not corrected by what the steps took.
    pub(crate) time: Option<PlannedTime>,
    pub(crate) seed: u64,
}

/// The times of photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PhotoTimes {
    /// Their own.
    Own,
    /// Each has one of its own, in their order: what moves is another thing in each of them.
    Order,
}

impl PhotoTimes {
    pub(crate) fn of(self, data: &Dataset, view: usize) -> f64 {
        match self {
            Self::Own => data.view(view).time,
            Self::Order => view as f64 / data.len().saturating_sub(1).max(1) as f64,
        }
    }
}

/// A system of Gaussians.
pub(crate) struct Views {
    pub(super) parts: ViewParts,
    pub(super) simd: Simd,
    pub(super) guard: NonFiniteGuard,
    /// Steps made.
    pub(super) steps: u64,
    /// The number of steps after which pictures have settled. Not part of the state: it says when a training may stop, not what it does.
    pub(super) settled_at: u64,
    /// Where they are in the schedule.
    pub(super) position: Position,
    /// Photos at the size that steps are at.
    photos: Option<(u32, PhotoSet)>,
    /// Where photos were taken, of the frame of training.
    cameras: Vec<[f32; 3]>,
    /// What is drawn is no smaller than what photos show, where that is asked for.
    pub(super) smoothing: Option<Smoothing>,
    /// Where photos show that nothing is, as soon as it is asked for.
    free_space: Option<FreeSpace>,
    pub(super) sizes: Pictures,
    pub(super) target: StepTarget,
    pub(super) pass: Box<dyn PicturePass>,
    pub(super) buffers: RenderBuffers,
    pub(super) skipped: Mutex<Skipped>,
    pub(super) seconds: [f64; PARTS.len() + OWN.len()],
}

/// What is rendered of a cloud that stands still, or moved.
pub(super) type Clouds<'a> = Vec<Cow<'a, CloudParameters>>;

/// The photo of a step.
pub(super) struct Shown {
    /// Index of its view.
    pub(super) view: usize,
    time: f64,
    /// Without a lens, at the size of the step.
    pub(super) camera: Camera,
    background: [f32; 3],
}

impl Views {
    /// A system at its start.
    ///
    /// # Errors
    /// [`SystemError::Config`] for more features than pictures have room for.
    pub(crate) fn new(parts: ViewParts, data: &Dataset) -> Result<Self, SystemError> {
        let simd = Simd::best();
        let layout = PlaneLayout {
            depth: parts.terms.iter().any(|term| term.reads_depth()),
            extras: parts.clouds.iter().map(|cloud| cloud.training.extra.composited).max().unwrap_or(0),
            plain: parts.appearance.is_some() && parts.terms.iter().any(|term| term.reads_plain()),
        };
        let pass = match &parts.layers {
            Some(layers) => layers.part.pass(simd),
            None => picture_pass(simd, layout).ok_or_else(|| SystemError::Config {
                field: "system",
                value: parts.name.into(),
                problem: format!("pictures of {} features are not drawn", layout.features()),
            })?,
        };
        let frame = parts.frame;
        let smoothing = Smoothing::new(&parts.pictures, data, &frame, &parts.clouds).map_err(refused)?;
        let cameras = data.views().iter().map(|v| frame.to_internal(v.camera.pose.c).as_vec3().to_array()).collect();
        Ok(Self {
            parts,
            simd,
            guard: NonFiniteGuard::default(),
            steps: 0,
            settled_at: 0,
            position: Position::default(),
            photos: None,
            cameras,
            smoothing,
            free_space: None,
            sizes: Pictures::of(data),
            target: StepTarget::default(),
            pass,
            buffers: RenderBuffers::default(),
            skipped: Mutex::default(),
            seconds: [0.0; PARTS.len() + OWN.len()],
        })
    }

    /// The photo of a step: all of them, in an order of their own, before any comes again; its camera, and what is behind it.
    fn show(&mut self, data: &Dataset, step: u64) -> Result<Shown, SystemError> {
        let rng = Rng::new(self.parts.seed, EPOCHS);
        let shown = self.show_one(data, step, |photos| turn(rng, step, photos))?;
        if let Some((_, photos)) = &self.photos {
            photos.read_ahead(data, || turn(rng, step + 1, photos.len(data)));
        }
        Ok(shown)
    }

    /// One of the photos, as step `step` would show it: `which` chooses among so many.
    pub(super) fn show_one(
        &mut self,
        data: &Dataset,
        step: u64,
        which: impl FnOnce(usize) -> usize,
    ) -> Result<Shown, SystemError> {
        let clock = Instant::now();
        let level = self.parts.pictures.level(self.position.of(step));
        let mut photos = match self.photos.take() {
            Some((at, photos)) if at == level => photos,
            before => {
                if before.is_some() {
                    self.unsettle(step, SETTLE);
                }
                // Those of another level go before new ones come.
                drop(before);
                PhotoSet::new(data, level)?
            }
        };
        let view = which(photos.len(data));
        let shown = photos.get(data, view);
        self.photos = Some((level, photos));
        let (image, camera) = shown?;
        let rng = Rng::new(self.parts.seed, BACKGROUNDS).substream(step);
        let background = self.parts.background.of_ray(&rng, 0);
        self.target.fill(&image, &camera, background);
        let photo = StepPhoto { view, image: &image };
        for part in &self.parts.weights {
            part.weigh(&photo, &mut self.target.weights);
        }
        if let Some(surveys) = &self.parts.surveys {
            surveys.weigh(&photo, &mut self.target.weights);
        }
        self.seconds[0] += clock.elapsed().as_secs_f64();
        Ok(Shown { view, time: self.parts.times.of(data, view), camera, background })
    }

    /// The clouds as they are drawn at a time.
    pub(super) fn clouds_at(&self, time: f64) -> Clouds<'_> {
        self.filtered(clouds_at(&self.parts, time))
    }

    /// Clouds that were not drawn yet, as they are drawn.
    pub(super) fn filtered<'a>(&self, clouds: Clouds<'a>) -> Clouds<'a> {
        match &self.smoothing {
            None => clouds,
            Some(smoothing) => clouds
                .into_iter()
                .enumerate()
                .map(|(index, cloud)| {
                    let cloud = cloud.into_owned();
                    let gaussians = smoothing.filtered(self.simd, index, cloud.gaussians);
                    Cow::Owned(CloudParameters { gaussians, ..cloud })
                })
                .collect(),
        }
    }

    /// The loss of the photo that is shown, and its gradient: that with respect to the clouds is left beside them, that with respect to
    /// the camera is added to `camera`, where that is asked for.
    pub(super) fn compare(
        &mut self,
        step: u64,
        view: &View,
        shown: &Shown,
        camera_gradient: Option<&mut CameraGradient>,
    ) -> Result<Outcome, SystemError> {
        let settings = self.parts.pictures.raster();
        let depth = self.photo_depth(view, shown.time, self.target.weights.get());
        if let Some(part) = self.parts.appearance.as_mut().filter(|part| part.looks()) {
            // On the one that photos are encoded on wherever no step is made.
            let colour = self.target.on(self.parts.background.colour());
            let depth = depth.as_ref().map(PhotoDepth::seen);
            let photo = SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(view), depth };
            part.look_at(step, shown.view, &photo);
        }
        let step = self.position.of(step);
        let mut seconds = [0.0; PARTS.len()];
        let target =
            TargetPicture { view: shown.view, colour: &self.target.colour, weights: self.target.weights.get() };
        let camera = StepCamera { view, settings: &settings, background: shown.background };
        let ViewParts { clouds, terms, appearance, judge, motion, view_space, .. } = &mut self.parts;
        // Gradients beside the clouds they are of.
        let mut gradients: Vec<CloudParameters> =
            clouds.iter_mut().map(|cloud| std::mem::take(&mut cloud.gradient)).collect();
        let clock = Instant::now();
        let mut moved = motion.as_deref().map(|motion| at_time(motion, clouds, shown.time));
        self.seconds[PARTS.len() + 2] += clock.elapsed().as_secs_f64();
        if let Some(smoothing) = &mut self.smoothing {
            smoothing.apply(self.simd, of_picture(clouds, &mut moved)).map_err(refused)?;
        }
        let drawn: Vec<DrawnCloud<'_>> = match &moved {
            Some(moved) => clouds.iter().zip(moved).map(|(cloud, at)| cloud.drawn(step, at)).collect(),
            None => clouds.iter().map(|cloud| cloud.drawn(step, &cloud.parameters)).collect(),
        };
        let mut parts = LossParts {
            terms,
            appearance: appearance.as_deref_mut(),
            judge: judge.as_deref_mut().map(|judge| StepJudge { judge, step }),
            judged: None,
            view_space: *view_space,
            step,
            camera: camera_gradient,
            seconds: &mut seconds,
        };
        let outcome = self.pass.run(&drawn, &camera, &target, &mut parts, &mut gradients).map_err(refused);
        let judged = parts.judged;
        drop(drawn);
        if let Some(judged) = judged {
            self.target.weights.set(judged);
        }
        if let Some(smoothing) = &mut self.smoothing {
            smoothing.restore(of_picture(clouds, &mut moved));
            for (index, (cloud, bar)) in of_picture(clouds, &mut moved).zip(&mut gradients).enumerate() {
                smoothing.pull_back(self.simd, index, cloud, bar).map_err(refused)?;
            }
        }
        for (cloud, gradient) in clouds.iter_mut().zip(gradients) {
            cloud.gradient = gradient;
        }
        for (sum, more) in self.seconds.iter_mut().zip(seconds) {
            *sum += more;
        }
        outcome
    }

    /// Learn from the photo that is shown.
    fn learn(&mut self, step: u64, view: &View, shown: &Shown) -> Result<StepStats, SystemError> {
        let outcome = self.compare(step, view, shown, None)?;
        let judge_bad = self.parts.judge.as_deref_mut().map_or(0, |part| part.learn(self.simd));
        if self.target.weights.are_zero() {
            // The judge left nothing of the photo: no part has a step, and what it holds is of this one.
            self.parts.appearance.iter_mut().for_each(|part| part.forget());
            self.note(&Skipped { blank: [1, 0], ..Skipped::default() });
            self.guard.record(judge_bad)?;
            return Ok(StepStats { nonfinite: judge_bad as u64, ..StepStats::default() });
        }
        let position = self.position.of(step);
        let ViewParts { clouds, appearance, motion, .. } = &mut self.parts;
        let clock = Instant::now();
        if let Some(motion) = motion {
            for (index, cloud) in clouds.iter_mut().enumerate() {
                motion.pull_back(shown.time, index, &cloud.parameters, &mut cloud.gradient);
            }
        }
        self.seconds[PARTS.len() + 2] += clock.elapsed().as_secs_f64();
        let clock = Instant::now();
        let all: usize = clouds.iter().map(|cloud| cloud.parameters.len()).sum();
        let mut skipped = Skipped::default();
        let mut seen = 0;
        let (mut cost, mut bad) = (0.0, judge_bad);
        for (index, cloud) in clouds.iter_mut().enumerate() {
            let visible = self.pass.seen(index);
            seen += visible.gaussians.len();
            cloud.see(position, view.size, visible).map_err(refused)?;
            cloud.see_uses(self.pass.uses(index));
            cost += cloud.regularise().map_err(refused)?;
            bad += cloud.learn(self.simd, position);
        }
        skipped.count(all, seen, &outcome.drawn);
        bad += appearance.as_deref_mut().map_or(0, |part| part.step(self.simd, position));
        bad += motion.as_deref_mut().map_or(0, |part| part.step(self.simd, position));
        self.note(&skipped);
        self.guard.record(bad)?;
        self.seconds[PARTS.len()] += clock.elapsed().as_secs_f64();
        self.settle();
        Ok(StepStats {
            loss: outcome.loss + cost,
            mse: outcome.mse,
            samples: outcome.drawn.pairs,
            nonfinite: bad as u64,
            ..StepStats::default()
        })
    }

    /// What moves is asked of fewer Gaussians, when it is time for that.
    fn settle(&mut self) {
        let clock = Instant::now();
        let ViewParts { clouds, motion, .. } = &mut self.parts;
        let Some(motion) = motion else { return };
        let mut skipped = Skipped::default();
        for (index, cloud) in clouds.iter_mut().enumerate() {
            skipped.resting[0] += motion.at_rest(index, &cloud.parameters) as u64;
            skipped.resting[1] += cloud.parameters.len() as u64;
            motion.settle(index, &mut cloud.parameters);
        }
        self.note(&skipped);
        self.seconds[PARTS.len() + 2] += clock.elapsed().as_secs_f64();
    }

    /// Gaussians come and go, and what belongs to them with them.
    fn change(&mut self, data: &Dataset, step: u64, non_finite: usize) -> Result<(), SystemError> {
        let clock = Instant::now();
        let mut unsettled = 0;
        let frame = self.parts.frame;
        let position = self.position;
        let steps_done =
            |cloud: &TrainedCloud| position.steps_done(step, cloud.training.density.schedule.densify_every);
        let finds = |cloud: &TrainedCloud| cloud.training.density.finds_floaters(steps_done(cloud));
        if self.free_space.is_none() && self.parts.clouds.iter().any(finds) {
            self.free_space = Some(FreeSpace::new(data, &frame)?);
        }
        for (index, cloud) in self.parts.clouds.iter_mut().enumerate() {
            let free_space = self.free_space.as_ref().filter(|_| finds(cloud));
            let floaters = |cloud: &_| free_space.map_or(Ok(None), |free| free.without_floaters(cloud, &frame));
            let steps_done = steps_done(cloud);
            let fades_done =
                cloud.training.density.fade_every().map_or(steps_done, |every| position.steps_done(step, every));
            let when = ChangeTime { step, position: position.of(step), steps_done, fades_done };
            let change = cloud.change(self.parts.seed, when, non_finite, &self.cameras, data.len(), floaters);
            let changed = change.map_err(refused)?;
            let schedule = &cloud.training.density.schedule;
            // Later ones only take floaters away.
            if changed && when.position < schedule.densify_until {
                unsettled = unsettled.max(SETTLE.min((SETTLE_SHARE * schedule.densify_every as f64) as u64));
            }
            if let Some(smoothing) = self.smoothing.as_mut().filter(|_| changed || Smoothing::is_due(step + 1)) {
                smoothing.measure(index, &cloud.parameters.gaussians).map_err(refused)?;
            }
        }
        self.unsettle(step, unsettled);
        self.seconds[PARTS.len() + 1] += clock.elapsed().as_secs_f64();
        Ok(())
    }

    /// Step `step` changed what pictures are made of: they settle in so many more.
    fn unsettle(&mut self, step: u64, steps: u64) {
        self.settled_at = self.settled_at.max(step + 1 + steps);
    }

    /// A step.
    pub(super) fn train_step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        if data.is_empty() {
            return Ok(StepStats::default());
        }
        self.survey(data, step)?;
        let shown = self.show(data, step)?;
        let view = view(&shown.camera, &self.parts.frame);
        let blank = self.target.weights.are_zero();
        self.note(&Skipped { blank: [u64::from(blank), 1], ..Skipped::default() });
        let stats = if blank { StepStats::default() } else { self.learn(step, &view, &shown)? };
        self.change(data, step, stats.nonfinite as usize)?;
        self.steps = step + 1;
        Ok(StepStats { rays: (view.size[0] * view.size[1]) as u64, ..stats })
    }

    /// The clouds as the next step would draw them, `clouds` at the time of the picture.
    pub(super) fn drawn<'a>(&self, clouds: &'a Clouds<'_>) -> Vec<DrawnCloud<'a>> {
        let all = self.parts.clouds.iter().zip(clouds);
        all.map(|(trained, at)| trained.drawn(self.position.of(self.steps), at)).collect()
    }

    /// Draws clouds as the system is now.
    pub(super) fn renderer<'a>(&'a self, clouds: &'a [DrawnCloud<'a>], query: &'a Query) -> CloudRenderer<'a> {
        CloudRenderer {
            clouds,
            frame: &self.parts.frame,
            layers: self.parts.layers.as_ref(),
            settings: self.parts.pictures.raster(),
            appearance: self
                .parts
                .appearance
                .as_deref()
                .map(|part| OfAppearance { part, appearance: &query.appearance }),
            simd: self.simd,
        }
    }

    /// Count the time of a survey, seconds.
    pub(super) fn count_survey(&mut self, seconds: f64) {
        self.seconds[PARTS.len() + 3] += seconds;
    }

    /// Work was skipped.
    pub(super) fn note(&self, more: &Skipped) {
        if let Ok(mut sum) = self.skipped.lock() {
            sum.add(more);
        }
    }
}

/// The clouds of a picture: those that were `moved` to its time, where they move.
fn of_picture<'a>(
    clouds: &'a mut [TrainedCloud],
    moved: &'a mut Option<Vec<CloudParameters>>,
) -> impl Iterator<Item = &'a mut CloudParameters> {
    let still = moved.is_none().then_some(clouds);
    let still = still.into_iter().flatten().map(|cloud| &mut cloud.parameters);
    moved.iter_mut().flatten().chain(still)
}

/// The clouds of a system at a time.
fn clouds_at(parts: &ViewParts, time: f64) -> Clouds<'_> {
    match parts.motion.as_deref() {
        None => parts.clouds.iter().map(|cloud| Cow::Borrowed(&cloud.parameters)).collect(),
        Some(motion) => at_time(motion, &parts.clouds, time).into_iter().map(Cow::Owned).collect(),
    }
}

/// Clouds that move, at a time.
fn at_time(motion: &dyn CloudMotion, clouds: &[TrainedCloud], time: f64) -> Vec<CloudParameters> {
    clouds.iter().enumerate().map(|(index, cloud)| motion.cloud_at(time, index, &cloud.parameters)).collect()
}
