//! A run: one folder that holds everything about one training.
//!
//! ```text
//! config.toml        what determines the result, with every setting the plan decided
//! heldout.txt        names of the held-out frames, one a line
//! validation.txt     names of the frames measured in their place, where `--validation` was given
//! schedule.json      when the training stops and is measured: what `--resume` goes on with
//! metrics.csv        a row an interval (see `log`)
//! checkpoint/        see `checkpoint`
//! photo_points.safetensors   points found in the photos, where the dataset has none (see `photo_points`)
//! eval.json eval.csv scores of the held-out views
//! eval_views.json    views measured so far, while an evaluation goes on or was stopped
//! renders/           held-out views: render, truth, error map, depth
//! appearance/        one view in the light of a few training photos, where the system has several
//! masks/             static masks of a few training photos, where the system finds them
//! summary.json       plan, time per part, memory, skip table: what the report is made of
//! report.html        all of it, self-contained
//! finished.json      written last: the step that all of this is of
//! .lock              held by the process that writes here (see `lock`)
//! ```

mod capture;
mod datasets;
mod filmed;
mod home;
mod host;
mod keeper;
mod kept;
mod lock;
mod mask_meaning;
mod measured;
mod memory;
mod patience;
mod place;
mod planned;
mod showcase;
mod whole;

use crate::checkpoint::{self, Checkpoint};
use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::{EvalAppearance, Evaluation, Measures};
use crate::halt::Halt;
use crate::identity::dataset_hash;
use crate::log::MetricsLog;
use crate::memory::{ExpectedMemory, limit};
use crate::options::{Choice, DataOptions, IMAGE_MEMORY_MIB, Plan, Purpose, Request, RunConfig, RunOptions};
use crate::output::{Disk, Storage, read_json, write_file};
use crate::photo_points::provide;
use crate::progress::{Event, Observer};
use crate::report;
use crate::scene_points::keep_training_points;
use crate::summary::{SceneSummary, Summary};
use crate::system::{System, SystemError};
use crate::train::{Ended, Reason, Schedule, Stop, train};
use datasets::datasets;
pub(crate) use home::Home;
use host::RunHost;
use keeper::{Keeper, first_files};
pub use lock::FolderLock;
use losses::metrics::Lpips;
pub use mask_meaning::{MaskMeaning, mask_meaning};
use patience::insist;
pub(crate) use place::refuse_foreign;
pub use place::{BAKED, clear, config};
pub use planned::{planned_schedule, planned_stop};
use scene_io::{Scene, refuse_blank_masks};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Reads the scene a word or path names.
pub type Load<'a> = dyn Fn(&str, &DataOptions) -> Result<Scene, RunError> + 'a;
/// Makes a system for a scene and says what it decided.
pub type Build<'a> = dyn Fn(&str, &Scene, &Dataset, &RunOptions) -> Result<(Box<dyn System>, Plan), SystemError> + 'a;

/// Takes a system for a scene: from the scene, the training data, the options, what the reconstruction is for and when training
/// stops, where that is known.
pub type Choose = fn(&Scene, &Dataset, &RunOptions, Purpose, Option<Stop>) -> Result<Choice, SystemError>;

/// The system of a run where none is named.
#[derive(Clone, Copy, Debug)]
pub enum DefaultSystem<'a> {
    /// Always this one.
    Named(&'a str),
    /// Chosen from the scene.
    Chosen(Choose),
}

/// What a run is made with.
#[derive(Clone, Copy)]
pub struct Parts<'a> {
    /// Reads scenes.
    pub load: &'a Load<'a>,
    /// Makes systems.
    pub build: &'a Build<'a>,
    /// Where files go.
    pub storage: &'a dyn Storage,
    /// System taken when none is named.
    pub default_system: DefaultSystem<'a>,
}

/// An open run.
pub struct Run<'a> {
    parts: Parts<'a>,
    /// The run folder.
    pub folder: PathBuf,
    /// What determines the result.
    pub config: RunConfig,
    /// What the plan decided, a line each.
    pub plan: Vec<String>,
    /// The scene.
    pub scene: Scene,
    /// Views trained on.
    pub train: Dataset,
    /// Views held out.
    pub held_out: Dataset,
    /// The method.
    pub system: Box<dyn System>,
    /// Steps done.
    pub step: u64,
    /// Training seconds.
    pub seconds: f64,
    /// Error budget of renders.
    error_budget: f32,
    /// In which light held-out views are measured.
    eval_appearance: Option<EvalAppearance>,
    /// Step the run was resumed at.
    resumed_at: Option<u64>,
    dataset: String,
    /// Memory it will need.
    expected: ExpectedMemory,
    /// The right to write into the folder, where this run has taken it.
    lock: Option<FolderLock>,
    /// Which folder it is.
    home: Home,
    /// Ends pictures early.
    pub(crate) halt: Halt,
}

impl<'a> Run<'a> {
    /// Start a run in `folder`.
    ///
    /// # Errors
    /// [`RunError::RunExists`], [`RunError::Busy`], [`RunError::ForeignFiles`], unreadable scenes, scenes without training
    /// views, unwritable folders, settings that cannot work, too little memory.
    pub fn create(
        folder: &Path,
        request: &Request,
        parts: Parts<'a>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        let spec = request.scene.as_deref().ok_or_else(|| RunError::Option("no scene is given".into()))?;
        // Before the lock's file is made.
        place::refuse_foreign(folder)?;
        let lock = take_lock(folder, observer)?;
        if let Some(step) = checkpoint::newest_step(folder) {
            return Err(RunError::RunExists { folder: folder.into(), step });
        }
        place::sweep(folder);
        // Found out now, not after an hour of training.
        let probe = folder.join(place::PROBE);
        write_file(parts.storage, &probe, b"yes")?;
        std::fs::remove_file(&probe).map_err(RunError::write(&probe))?;

        let mut options = RunOptions {
            seed: request.seed.unwrap_or(0),
            background: request.background,
            error_budget: request.error_budget,
            set: request.set.clone(),
        };
        let mut data = DataOptions {
            image_memory: Some(request.data.image_memory.unwrap_or_else(default_image_memory)),
            ..request.data.clone()
        };
        let points = provide::take(&mut options.set)?;
        let mut scene = (parts.load)(spec, &data)?;
        // Whoever goes on with a run has been told, and whoever says what white means knows.
        let left = refuse_blank_masks(&scene.frames)?;
        match mask_meaning(&scene, left, data.mask_white.as_deref())? {
            MaskMeaning::AsRead => {}
            MaskMeaning::Sparse(line) => observer.event(Event::Warning(&line)),
            MaskMeaning::Object(line) => {
                observer.event(Event::Warning(&line));
                // As if it had been said: the run's configuration has it, and a resumed run reads the same photos.
                data.mask_white = Some("object".into());
                scene = (parts.load)(spec, &data)?;
            }
        }
        let dataset = dataset_hash(&scene)?;
        keep_training_points(&mut scene);
        let (mut train, mut held_out) = datasets(&scene, &data)?;
        // Said where it was asked for or could be done: a run that says nothing goes on without.
        let points = points.or_else(|| provide::may_help(&scene, &train).then_some(true));
        if points == Some(true) && provide::may_help(&scene, &train) {
            provide::make(folder, parts.storage, &mut scene, (&mut train, &mut held_out), observer)?;
        }
        for problem in capture::problems(&scene, &train)? {
            observer.event(Event::Warning(&problem.to_string()));
        }
        let (name, chosen) = match (request.system.as_deref(), parts.default_system) {
            (Some(name), _) | (None, DefaultSystem::Named(name)) => (name, None),
            (None, DefaultSystem::Chosen(choose)) => {
                let choice = choose(&scene, &train, &options, request.purpose, request.stop)?;
                (choice.system, Some(choice.line))
            }
        };
        let (system, mut plan) = (parts.build)(name, &scene, &train, &options)?;
        plan.lines.splice(0..0, chosen);
        plan.config.extend(points.map(|wanted| (provide::SETTING.to_string(), provide::word(wanted))));
        let config = RunConfig {
            scene: spec.into(),
            system: name.into(),
            seed: options.seed,
            background: plan.background,
            error_budget: plan.error_budget,
            eval_appearance: request.eval_appearance.clone(),
            data,
            settings: plan.config,
        };
        let mut run = Self {
            parts,
            folder: folder.into(),
            error_budget: config.error_budget,
            eval_appearance: config.eval_appearance.clone(),
            config,
            plan: plan.lines,
            scene,
            train,
            held_out,
            system,
            step: 0,
            seconds: 0.0,
            resumed_at: None,
            dataset,
            expected: ExpectedMemory::default(),
            lock,
            home: Home::of(folder),
            halt: observer.halt(),
        };
        run.fit_memory(request, observer)?;
        // A light that the system has not is found out now, too.
        run.protocol()?;
        for (name, text) in first_files(&run.config, &run.scene, &run.held_out)? {
            write_file(parts.storage, &folder.join(name), text.as_bytes())?;
        }
        MetricsLog::create(&folder.join("metrics.csv"))?;
        Ok(run)
    }

    /// Open the run in `folder` as [`Run::open`] does, to go on with it: no other process writes into it until this run is
    /// dropped.
    ///
    /// # Errors
    /// [`RunError::Busy`], and as [`Run::open`].
    pub fn open_to_write(
        folder: &Path,
        request: &Request,
        parts: Parts<'a>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        // No lock is left where there is no run; a run before its first checkpoint is in use.
        if checkpoint::newest_step(folder).is_none() && !folder.join(lock::FILE).exists() {
            return Err(RunError::NoCheckpoint(folder.into()));
        }
        let lock = take_lock(folder, observer)?;
        // Left by processes that were killed: whoever holds the lock is alone.
        place::sweep(folder);
        Ok(Self { lock, ..Self::open(folder, request, parts, observer)? })
    }

    /// Open the run in `folder` at its newest usable checkpoint, to read it. What `request` says must agree with the run.
    ///
    /// # Errors
    /// [`RunError::NoCheckpoint`], [`RunError::AllCheckpointsBroken`], [`RunError::ResumeDiffers`],
    /// [`RunError::DatasetChanged`], and what [`Run::create`] fails with.
    pub fn open(
        folder: &Path,
        request: &Request,
        parts: Parts<'a>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        let Checkpoint { mut meta, state, warnings } = checkpoint::load_newest(folder)?;
        for warning in &warnings {
            observer.event(Event::Warning(warning));
        }
        let config = meta.config.clone();
        request.agree_with(&config)?;
        let spec = request.scene.as_deref().unwrap_or(&config.scene);
        let data = datasets::as_named(folder, &config.data);
        let mut scene = (parts.load)(spec, &data)?;
        let dataset = dataset_hash(&scene)?;
        keep_training_points(&mut scene);
        if dataset != meta.dataset {
            return Err(RunError::DatasetChanged { run: short(&meta.dataset), now: short(&dataset) });
        }
        let (mut train, mut held_out) = datasets(&scene, &data)?;
        let mut options = RunOptions {
            seed: config.seed,
            background: Some(config.background),
            error_budget: Some(config.error_budget),
            set: config.settings.clone(),
        };
        if provide::take(&mut options.set)? == Some(true) && provide::may_help(&scene, &train) {
            provide::again(folder, &mut scene, (&mut train, &mut held_out))?;
        }
        let build = || (parts.build)(&config.system, &scene, &train, &options);
        let (mut system, mut plan) = build()?;
        let mut loaded = system.load_state(&state);
        drop(state);
        // Arrays that do not fit the run: the one before may.
        let mut problems = Vec::new();
        while let Err(error) = loaded {
            problems.push(format!("checkpoint step-{:08}: {error}", meta.step));
            let older = checkpoint::load_below(folder, Some(meta.step), problems.clone())?;
            if older.meta.config != config || older.meta.dataset != meta.dataset {
                return Err(RunError::AllCheckpointsBroken { folder: folder.into(), problems });
            }
            let step = older.meta.step;
            observer.event(Event::Warning(&format!("{}; using step {step} instead", problems[problems.len() - 1])));
            (system, plan) = build()?;
            loaded = system.load_state(&older.state);
            meta = older.meta;
        }
        Ok(Self {
            parts,
            folder: folder.into(),
            error_budget: config.error_budget,
            eval_appearance: config.eval_appearance.clone(),
            config,
            plan: plan.lines,
            scene,
            train,
            held_out,
            system,
            step: meta.step,
            seconds: meta.seconds,
            resumed_at: Some(meta.step),
            dataset,
            expected: ExpectedMemory::default(),
            lock: None,
            home: Home::of(folder),
            halt: observer.halt(),
        })
    }

    /// The right to write into the folder for a while, where this run does not have it for good.
    fn write_lock(&self, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
        match self.lock {
            Some(_) => Ok(None),
            None => take_lock(&self.folder, observer),
        }
    }

    /// Whether there is nothing left to do before `stop`: it is reached, the held-out views are measured as of now, and every
    /// file that a run promises is there.
    pub fn is_finished(&self, stop: Stop) -> bool {
        let measured = || read_json::<Evaluation>(&self.folder.join("eval.json")).ok().flatten();
        stop.reached(self.step, self.seconds)
            && (self.held_out.is_empty() || measured().is_some_and(|evaluation| evaluation.steps == self.step))
            && self.is_marked()
            && self.missing().is_empty()
    }

    /// Train until the schedule or `interrupt` stops it; at the end measure the held-out views and write the report. Where
    /// the observer asks to stop while that is done, the run ends as [`Reason::Interrupted`] with the views measured so far.
    /// What a full disk refuses is tried again for [`Schedule::disk_wait`]; results that stay unwritten are named in the
    /// evaluation.
    ///
    /// # Errors
    /// [`RunError::Busy`], and see [`train`]; the newest checkpoint stays usable.
    pub fn train(
        &mut self,
        schedule: &Schedule,
        lpips: Option<&Lpips>,
        observer: &mut dyn Observer,
        interrupt: &AtomicBool,
    ) -> Result<(Ended, Option<Evaluation>), RunError> {
        if self.lock.is_none() {
            self.lock = take_lock(&self.folder, observer)?;
        }
        self.halt = observer.halt();
        self.write_lost()?;
        let path = self.folder.join("metrics.csv");
        let mut log = MetricsLog::resume(&path, self.step)?.within(self.home.clone());
        planned::write(self.parts.storage, &self.folder, schedule, observer);
        self.train.decode()?;
        let (protocol, query) = self.protocol()?;
        let terms = self.terms((&protocol, &query), Measures::All(lpips));
        let keeper = Keeper {
            folder: &self.folder,
            home: &self.home,
            lock: &mut self.lock,
            storage: self.parts.storage,
            schedule,
            config: &self.config,
            dataset: &self.dataset,
            scene: &self.scene,
            held_out: &self.held_out,
        };
        let mut host = RunHost { keeper, terms, observer: &mut *observer, evaluation: None, unsaved: false };
        let start = (self.step, self.seconds);
        let mut ended = train(self.system.as_mut(), &self.train, schedule, start, &mut log, &mut host, interrupt)?;
        let mut evaluation = host.evaluation.take();
        let kept = host.keeper.keep_up(self.system.as_ref(), (ended.step, ended.seconds), host.observer);
        if evaluation.as_ref().is_some_and(|evaluation| evaluation.stopped) {
            ended.reason = Reason::Interrupted;
        }
        (self.step, self.seconds) = (ended.step, ended.seconds);
        let written = kept
            .and_then(|()| insist(schedule.disk_wait, observer, |_| log.flush()))
            .and_then(|()| self.write_rest(schedule, &mut ended, observer));
        match (written, &mut evaluation) {
            // The scores are to be seen whatever else is wrong.
            (Err(error @ RunError::Write { .. }), Some(evaluation)) => {
                evaluation.unwritten.push(error.with_reason());
            }
            (written, _) => written?,
        }
        Ok((ended, evaluation))
    }

    /// What comes after scores: summary, showcase, report.
    fn write_rest(&self, schedule: &Schedule, ended: &mut Ended, observer: &mut dyn Observer) -> Result<(), RunError> {
        // A run that had only its end to do over keeps what is known of its training.
        let known =
            Summary::read(&self.folder).is_ok_and(|s| s.steps == self.step && self.resumed_at == Some(self.step));
        if !known {
            insist(schedule.disk_wait, observer, |_| self.write_summary())?;
        }
        if ended.reason != Reason::Interrupted {
            self.write_showcase(observer)?;
            if observer.stop_asked() {
                ended.reason = Reason::Interrupted;
            }
        }
        insist(schedule.disk_wait, observer, |_| report::write(self.parts.storage, &self.folder))
    }

    fn write_summary(&self) -> Result<(), RunError> {
        let summary = Summary::new(
            self.system.as_ref(),
            SceneSummary::new(&self.scene, &self.train, &self.held_out),
            &self.plan,
            (self.step, self.seconds, self.resumed_at),
            self.expected,
        );
        write_file(self.parts.storage, &self.folder.join(Summary::FILE), summary.json().as_bytes())
    }
}

/// Memory for decoded images where nothing is said, MiB: a third of what the process may hold where that is limited.
fn default_image_memory() -> u64 {
    limit().map_or(IMAGE_MEMORY_MIB, |bytes| IMAGE_MEMORY_MIB.min((bytes >> 20) / 3).max(1))
}

/// The lock of a folder; where the file system knows none, that is said.
fn take_lock(folder: &Path, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
    let lock = FolderLock::take(folder)?;
    if lock.is_none() {
        let line = format!(
            "the file system of `{}` knows no locks: see to it that nothing else is trained into this folder",
            folder.display()
        );
        observer.event(Event::Warning(&line));
    }
    Ok(lock)
}

fn short(hash: &str) -> String {
    hash.chars().take(19).collect() // `sha256:` and twelve digits
}

/// Parts that read files and write to the disk; the system is up to `build`.
pub fn disk_parts<'a>(load: &'a Load<'a>, build: &'a Build<'a>, default_system: DefaultSystem<'a>) -> Parts<'a> {
    Parts { load, build, storage: &Disk, default_system }
}
