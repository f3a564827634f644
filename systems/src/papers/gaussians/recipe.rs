//! A system of one cloud: what it is made of, what a scene makes of that, and the system that comes out.

use super::layers::{AskedLayers, LayerParts};
use super::photos::{AskedPhotos, PhotoParts, Seen};
use super::sky::{BeforeSky, SkyPlan};
use super::start::{AskedStart, FieldBefore, Seeing, StartConfig, StartKind, field_steps, with_field};
use crate::claims::Claim;
use crate::cloud_motion::{DeformationField, MotionParts, MotionSettings, UnitBox};
use crate::fields::{FeatureSource, view_times};
use crate::free_space::{AlsoFree, free_space_line};
use crate::layout::Layout;
use crate::plan::{Ask, Built, CloudPace, DepthUse, FieldShare, Ground, check_still_camera, has_alpha};
use crate::proxy::ProxyTerms;
use crate::schedule::PlannedTime;
use crate::settings::Settings;
use crate::views::cloud_frame::CloudFrame;
use crate::views::start::scene_box;
use crate::views::{
    CloudConfig, CloudMotion, CloudRates, CloudTraining, DensityConfig, DensityRules, ExtraRows, L1Dssim,
    L1DssimConfig, MaskWeight, PhotoTimes, PictureConfig, PictureTerm, PlannedDensity, SplitConfig, TrainedCloud,
    UsePruning, ViewParts, ViewSpaceGradient, Views, refused,
};
use engine::data::Dataset;
use engine::options::{Plan, RunOptions, Stop};
use engine::system::SystemError;
use field_core::rng::Rng;
use float_core::Simd;
use glam::DVec3;
use scene_io::{Point, Scene};
use std::sync::Arc;

/// Steps that the schedules are for where no stop is known, and the fewest that they are for.
pub(super) const HORIZON: u64 = 10_000;
const SHORTEST: u64 = 1_000;
/// Stream of random numbers of features.
const STREAM: u64 = 0x666c_6f77;

/// What moves a cloud, by the times of the photos, and whose times these are.
type MotionOf = fn(Arc<[f32]>, PhotoTimes) -> MotionParts;

/// What a system of one cloud is made of, before a scene asks for anything.
pub(super) struct Recipe {
    pub(super) claim: Claim,
    pub(super) start: StartKind,
    pub(super) cloud: CloudConfig,
    pub(super) rates: CloudRates,
    pub(super) density: PlannedDensity,
    pub(super) pictures: PictureConfig,
    /// `None`: the parts have costs of their own.
    pub(super) loss: Option<L1DssimConfig>,
    /// What moves the cloud; `None`: it stands still.
    pub(super) motion: Option<MotionOf>,
    /// What photos differ in; `None`: in nothing but what they see.
    pub(super) photos: Option<PhotoParts>,
    /// A cloud in front, which is what moves; `None`: all is one cloud.
    pub(super) layers: Option<LayerParts>,
}

impl Recipe {
    /// A cloud at its start, and why it is as it is.
    pub(super) fn build(&'static self, mut ask: Ask<'_>) -> Built {
        let (scene, data, run) = (ask.scene, ask.data, ask.run);
        if self.motion.is_some() {
            check_still_camera(self.claim.name, data, run, DepthUse::None)?;
        }
        let mut ground = Ground::of_clouds(scene, data, run)?;
        let planned = Planned::of(self, scene, data, run.stop, &mut ask.settings, &mut ground.lines)?;
        let asked = planned.asked(&scene.points, &mut ask.settings, run.seed)?;
        let all = ask.settings.all()?;
        let Ground { layout, mut lines, background, error_budget, .. } = ground;
        lines.extend(planned.free_space.filter(|_| asked.training.density.schedule.free_space));
        let cloud = &asked.training.cloud;
        let time = planned.pace.map(|pace| asked.time(&pace));
        let moving = |motion: &AskedMotion| motion.moving(&asked, &layout, data, run.seed);
        let motion = asked.motion.as_ref().map(moving).transpose()?;
        let horizon = asked.training.rates.horizon;
        let photos =
            asked.photos.as_ref().map(|photos| photos.parts(scene, data, background, horizon, run.seed)).transpose()?;
        lines.extend(asked.photos.iter().flat_map(|photos| photos.lines(horizon)));
        lines.extend(asked.motion.as_ref().map(|motion| motion.line(&asked)));
        let seeing = if motion.is_some() { Seeing::ManyTimes } else { Seeing::OneTime };
        let times = planned.photo_times;
        let layers = asked.layers.map(|layers| layers.parts(&asked, &layout, data, times, run.seed)).transpose()?;
        lines.extend(asked.layers.iter().map(|layers| layers.line(times)));
        let AskedStart { at, field } = asked.start;
        let refill = asked.training.density.refill();
        let of_photos = asked.photos.as_ref().map(AskedPhotos::before).unwrap_or_default();
        let before = BeforeSky {
            frame: &asked.frame,
            points: &scene.points,
            data,
            cut_out: planned.seen.cut_out,
            field: field.is_some_and(|terms| terms.seeds.is_some()),
        };
        let sky = asked.photos.as_ref().map(|photos| photos.sky(&before));
        lines.extend(sky.as_ref().and_then(|sky| sky.line.clone()));
        let of_field = sky.as_ref().and_then(SkyPlan::of_field);
        let field = field.map(|terms| FieldBefore {
            terms: ProxyTerms { sky: of_field, ..terms },
            refill,
            seeing,
            photos: of_photos,
        });
        let mut start = at.start(cloud, &layout, &asked.frame, data, seeing, run.seed)?;
        sky.map_or(Ok(()), |sky| sky.add_to(&mut start, &before, cloud.max_splats))?;
        let mut training = asked.training;
        let (mut appearance, mut judge, mut surveys, mut of_photos) = (None, None, None, Vec::new());
        let mut loss = asked.loss.as_ref().map(|loss| L1Dssim::new(Simd::best(), loss));
        if let Some(photos) = photos {
            training.extra = photos.rows(&start.cloud);
            loss = loss.map(|loss| loss.with_structure(photos.structure));
            (appearance, judge, surveys, of_photos) = (photos.appearance, photos.judge, photos.surveys, photos.terms);
        }
        let begin = if field.as_ref().is_some_and(|field| field.terms.seeds.is_some()) {
            "start, should the field see nothing"
        } else {
            "start"
        };
        lines.extend(start.notes.iter().map(|note| format!("{begin}: {note}")));
        lines.push(format!("at most {} Gaussians", training.cloud.max_splats));
        let bent = data.views().iter().filter(|v| !v.camera.lens.is_pinhole()).count();
        if bent > 0 {
            lines.push(format!("lenses: {bent} photos are drawn onto a plane for training, and pictures from it"));
        }
        let view_space = match training.density.schedule.densify_absolute {
            true => ViewSpaceGradient::Absolute,
            false => ViewSpaceGradient::Plain,
        };
        let behind = TrainedCloud::new(training, 0, &start.cloud).map_err(refused)?;
        let (front, layers) = layers.unzip();
        let parts = ViewParts {
            name: self.claim.name,
            frame: asked.frame,
            pictures: asked.pictures,
            clouds: [behind].into_iter().chain(front).collect(),
            terms: loss.into_iter().map(|loss| Box::new(loss) as Box<dyn PictureTerm>).chain(of_photos).collect(),
            weights: vec![Box::new(MaskWeight)],
            appearance,
            judge,
            surveys,
            layers,
            motion,
            times,
            view_space,
            background,
            time,
            seed: run.seed,
        };
        let cloud = Views::new(parts, data)?;
        lines.extend(ask.claim.line());
        let system = with_field(cloud, field, scene, data, run, &mut lines)?;
        Ok((system, Plan { lines, background, error_budget, config: all }))
    }

    /// The settings of no scene, after `--set`.
    pub(super) fn of_nothing(
        &'static self,
        points: &[Point],
        settings: &mut Settings<'_>,
    ) -> Result<AskedParts, SystemError> {
        let StartConfig { start } = settings.of(&StartConfig { start: self.start })?;
        Planned { start, ..Planned::of_nothing(self) }.asked(points, settings, 0)
    }

    /// All settings by name, whatever is chosen; values are of no scene.
    pub(super) fn names(&'static self) -> toml::Table {
        let run = |set| RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
        let mut names = toml::Table::new();
        let mut words = vec![None, Some(("density", "adc")), Some(("density", "mcmc"))];
        if self.photos.is_some() {
            let of_photos = [
                ("occluders", "residual"),
                ("occluders", "errors"),
                ("occluders", "visibility"),
                ("occluders", "visibility_head"),
                ("appearance", "maps"),
                ("appearance", "triplane"),
            ];
            words.extend(of_photos.map(Some));
        }
        for word in words {
            let mut set = toml::toml! { start = "field" };
            set.extend(word.map(|(key, word)| (key.to_owned(), word.into())));
            let run = run(set);
            let mut settings = Settings::new(&run);
            self.of_nothing(&[], &mut settings).expect("settings as published");
            names.extend(settings.all().expect("words of its own"));
        }
        names
    }
}

/// What a scene asks for, before `--set` but for where the cloud starts: the others depend on that.
struct Planned {
    recipe: &'static Recipe,
    cloud: CloudConfig,
    start: StartKind,
    /// Steps of a field before the cloud, where there is time for one.
    field_steps: Option<u64>,
    rates: CloudRates,
    density: DensityConfig,
    pictures: PictureConfig,
    pace: Option<CloudPace>,
    /// Times of the photos, where the cloud moves.
    times: Arc<[f32]>,
    photo_times: PhotoTimes,
    seen: Seen,
    /// Why places are known to be empty, where they are.
    free_space: Option<String>,
}

impl Planned {
    /// Of no scene.
    fn of_nothing(recipe: &'static Recipe) -> Self {
        Self {
            recipe,
            cloud: recipe.cloud,
            start: recipe.start,
            field_steps: None,
            rates: recipe.rates,
            density: recipe.density.schedule,
            pictures: recipe.pictures,
            pace: None,
            photo_times: PhotoTimes::Own,
            times: Arc::default(),
            seen: Seen::default(),
            free_space: None,
        }
    }

    /// Of a scene; what was decided, and why, is added to `lines`.
    fn of(
        recipe: &'static Recipe,
        scene: &Scene,
        data: &Dataset,
        stop: Option<Stop>,
        settings: &mut Settings<'_>,
        lines: &mut Vec<String>,
    ) -> Result<Self, SystemError> {
        let moves = recipe.motion.is_some();
        let cameras: Vec<DVec3> = data.views().iter().map(|v| v.camera.pose.c).collect();
        let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
        let (frame, note) = CloudFrame::around(&cameras, &points);
        lines.extend(note);
        lines.push(format!("frame: the cameras extend over {:.4} world units", frame.scale));
        let still = CloudPace::of(data)?;
        let pace = if moves { still.moving() } else { still };
        // A cloud behind what moves stands still.
        let of_cloud = if recipe.layers.is_some() { still } else { pace };
        let share =
            if recipe.photos.is_some() || recipe.layers.is_some() { FieldShare::Large } else { FieldShare::Usual };
        let field_steps = field_steps(CloudPace::field_steps(stop, share));
        let planned = match (moves || recipe.photos.is_some()) && has_alpha(data)? {
            true => StartConfig::of_cut_out_thing(scene),
            false => StartConfig::planned(scene, field_steps),
        };
        let StartConfig { start } = settings.of(&planned)?;
        let of_field = field_steps.filter(|_| start == StartKind::Field).unwrap_or(0);
        let stop = CloudPace::after_field(stop, of_field);
        let horizon = pace.steps(stop).map_or(HORIZON, |steps| (steps as u64).max(SHORTEST));
        let (coarse, coarse_steps) = (pace.halvings(), pace.coarse_steps(horizon));
        if coarse > 0 {
            lines.push(format!(
                "pictures begin {} times smaller ({} pixels each), and double after {coarse_steps} steps",
                1 << coarse,
                pace.pixels
            ));
        }
        lines.push(format!("schedule: of {horizon} steps"));
        // What moves is where another photo sees through.
        let free_space = if moves { None } else { free_space_line(data, AlsoFree::WhereOthersStood) };
        let schedule = recipe.density.schedule;
        let (photo_times, times) = times_of(recipe, data);
        Ok(Self {
            cloud: CloudConfig {
                centre: frame.centre,
                radius: frame.scale,
                max_splats: of_cloud.gaussians(horizon as f64),
                sh_every: horizon / 20,
                ..recipe.cloud
            },
            start,
            field_steps,
            rates: CloudRates { horizon, ..recipe.rates },
            density: DensityConfig { free_space: free_space.is_some(), densify_until: horizon / 5 * 4, ..schedule },
            pictures: PictureConfig { coarse, coarse_steps, ..recipe.pictures },
            pace: Some(pace),
            photo_times,
            times,
            seen: Seen::of(scene, data)?,
            free_space,
            recipe,
        })
    }

    /// The settings of the parts that are there, after `--set`.
    fn asked(&self, points: &[Point], settings: &mut Settings<'_>, seed: u64) -> Result<AskedParts, SystemError> {
        let photos = self.recipe.photos.as_ref().map(|parts| parts.asked(self.seen, settings)).transpose()?;
        let sh_degree = photos.as_ref().and_then(AskedPhotos::sh_degree).unwrap_or(self.cloud.sh_degree);
        let cloud = settings.of(&CloudConfig { sh_degree, ..self.cloud })?;
        cloud.check()?;
        let frame = CloudFrame { centre: cloud.centre, scale: cloud.radius };
        // A field that knows no time sees no place of what moves.
        let refill = if self.recipe.motion.is_some() { 0.0 } else { self.start.refill() };
        let split = SplitConfig { refill, ..self.recipe.density.split };
        let density = PlannedDensity { schedule: self.density, split, ..self.recipe.density };
        let motion = self.recipe.motion.map(|motion| motion(self.times.clone(), self.photo_times));
        let motion = motion.map(|motion| AskedMotion::new(motion, settings)).transpose()?;
        // Of two clouds the one in front moves.
        let moves = motion.as_ref().filter(|_| self.recipe.layers.is_none());
        let rows = moves.map_or(0, |motion| motion.settings.rows_at_rest());
        let training = CloudTraining {
            cloud,
            rates: settings.of(&self.rates)?,
            density: DensityRules::asked(&density, settings)?,
            extra: ExtraRows { rows, ..ExtraRows::default() },
            pruning: UsePruning::default(),
        };
        training.rates.check()?;
        training.density.check()?;
        let start = self.start.asked(points, &training, &frame, settings, self.field_steps, seed)?;
        let pictures = settings.of(&self.pictures)?;
        let loss = self.recipe.loss.as_ref().map(|loss| settings.of(loss)).transpose()?;
        pictures.check()?;
        loss.as_ref().map_or(Ok(()), L1DssimConfig::check)?;
        let horizon = self.rates.horizon;
        let layers = self
            .recipe
            .layers
            .map(|layers| layers.asked(self.pace.as_ref(), horizon, self.photo_times, settings))
            .transpose()?;
        Ok(AskedParts { training, frame, pictures, loss, start, motion, photos, layers })
    }
}

/// Settings after `--set`.
pub(super) struct AskedParts {
    pub(super) training: CloudTraining,
    pub(super) frame: CloudFrame,
    pictures: PictureConfig,
    loss: Option<L1DssimConfig>,
    pub(super) start: AskedStart,
    motion: Option<AskedMotion>,
    photos: Option<AskedPhotos>,
    layers: Option<AskedLayers>,
}

impl AskedParts {
    /// Rows that say which Gaussians of what moves rest.
    pub(super) fn rows_at_rest(&self) -> usize {
        self.motion.as_ref().map_or(0, |motion| motion.settings.rows_at_rest())
    }

    /// What the schedule takes of its time.
    fn time(&self, pace: &CloudPace) -> PlannedTime {
        let (rates, density) = (&self.training.rates, &self.training.density.schedule);
        let most = self.training.cloud.max_splats as f64;
        // They come evenly.
        let gaussians = |step: u64| (step as f64 / density.densify_until.max(1) as f64).min(1.0) * most;
        let shares = pace.shares(rates.horizon, |step| self.pictures.level(step), gaussians);
        PlannedTime { shares, horizon: rates.horizon }
    }
}

/// What moves a cloud, after `--set`.
struct AskedMotion {
    settings: MotionSettings,
    features: Arc<dyn FeatureSource>,
}

impl AskedMotion {
    fn new(parts: MotionParts, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let motion = settings.of(&parts.settings)?;
        motion.check()?;
        Ok(Self { settings: motion, features: parts.features.asked(settings)? })
    }

    /// For people.
    fn line(&self, asked: &AskedParts) -> String {
        let still = (self.settings.motion_from * asked.training.rates.horizon as f64) as u64;
        format!("motion: nothing moves in the first {still} steps")
    }

    /// What moves the cloud, over the box that the cameras look at.
    fn moving(
        &self,
        asked: &AskedParts,
        layout: &Layout,
        data: &Dataset,
        seed: u64,
    ) -> Result<Box<dyn CloudMotion>, SystemError> {
        let features = self.features.features(Rng::new(seed, STREAM))?;
        let CloudTraining { cloud, rates, .. } = &asked.training;
        // What moves is in front.
        let index = usize::from(asked.layers.is_some());
        let (cube, degree) = match &asked.layers {
            Some(layers) => (layers.cube(&asked.frame, layout, data), layers.sh_degree(cloud.sh_degree)),
            None => (UnitBox::new(&scene_box(layout, data), &asked.frame), cloud.sh_degree),
        };
        let field = DeformationField::new(self.settings, features, cube, index, degree, rates.horizon, seed)?;
        Ok(Box::new(field))
    }
}

/// The times that something moves by: of a cloud in front photos without times each have one of their own, in their order.
fn times_of(recipe: &Recipe, data: &Dataset) -> (PhotoTimes, Arc<[f32]>) {
    let own = view_times(data);
    match (&recipe.motion, &recipe.layers) {
        (None, _) => (PhotoTimes::Own, Arc::default()),
        (Some(_), Some(_)) if own.is_empty() => {
            let order = PhotoTimes::Order;
            (order, (0..data.len()).map(|view| (2.0 * order.of(data, view) - 1.0) as f32).collect())
        }
        (Some(_), _) => (PhotoTimes::Own, own),
    }
}
