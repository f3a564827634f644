//! The start of a run.

use super::capture::problems;
use super::datasets::datasets;
use super::keeper::first_files;
use super::mask_meaning::{MaskMeaning, mask_meaning};
use super::writer::take_lock;
use super::{DefaultSystem, Parts, Run};
use crate::checkpoint;
use crate::data::Dataset;
use crate::error::RunError;
use crate::folder::{FolderLock, Home, METRICS, PROBE, refuse_foreign, sweep};
use crate::identity::dataset_hash;
use crate::log::MetricsLog;
use crate::memory::{ExpectedMemory, limit};
use crate::options::{DataOptions, IMAGE_MEMORY_MIB, Request, RunConfig, RunOptions};
use crate::output::{Storage, write_file};
use crate::photo_points::provide;
use crate::progress::{Event, Observer};
use crate::scene_points::keep_training_points;
use scene_io::{Scene, refuse_blank_masks};
use std::path::Path;

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
        let lock = claim(folder, parts.storage, observer)?;
        let mut options = RunOptions {
            seed: request.seed.unwrap_or(0),
            background: request.background,
            error_budget: request.error_budget,
            stop: request.stop.map(|stop| stop.at_speed(request.speed.unwrap_or(1.0))),
            set: request.set.clone(),
        };
        let mut data = DataOptions {
            image_memory: Some(request.data.image_memory.unwrap_or_else(default_image_memory)),
            ..request.data.clone()
        };
        let points = provide::take(&mut options.set)?;
        let mut scene = read_scene(spec, &mut data, parts, observer)?;
        let dataset = dataset_hash(&scene)?;
        keep_training_points(&mut scene);
        let (mut train, mut held_out) = datasets(&scene, &data)?;
        // Said where it was asked for or could be done: a run that says nothing goes on without.
        let points = points.or_else(|| provide::may_help(&scene, &train).then_some(true));
        if points == Some(true) && provide::may_help(&scene, &train) {
            let sets = provide::Sets { train: &mut train, held_out: &mut held_out };
            provide::make(folder, parts.storage, &mut scene, sets, observer)?;
        }
        for problem in problems(&scene, &train)? {
            observer.event(Event::Warning(&problem.to_string()));
        }
        let Named { name, lines, set } = system_of(request, parts, &scene, &train, &options)?;
        // What the user said stays.
        for (key, value) in set {
            options.set.entry(key).or_insert(value);
        }
        let (system, mut plan) = (parts.build)(name, &scene, &train, &options)?;
        let speed = request.speed.map(|speed| {
            format!("this machine is {speed:.2} times as fast as the one that schedules are planned for (measured)")
        });
        plan.lines.splice(0..0, lines.into_iter().chain(speed));
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
        // An appearance that the system does not have is found out now, too.
        run.protocol()?;
        for (name, text) in first_files(&run.config, &run.scene, &run.held_out)? {
            write_file(parts.storage, &folder.join(name), text.as_bytes())?;
        }
        MetricsLog::create(&folder.join(METRICS))?;
        Ok(run)
    }
}

/// Take the folder for a new run: it holds nothing of others and no run, and can be written to.
fn claim(folder: &Path, storage: &dyn Storage, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
    // Before the lock's file is made.
    refuse_foreign(folder)?;
    let lock = take_lock(folder, observer)?;
    if let Some(step) = checkpoint::newest_step(folder) {
        return Err(RunError::RunExists { folder: folder.into(), step });
    }
    sweep(folder);
    // Found out now, not after an hour of training.
    let probe = folder.join(PROBE);
    write_file(storage, &probe, b"yes")?;
    std::fs::remove_file(&probe).map_err(RunError::write(&probe))?;
    Ok(lock)
}

/// The scene, and in `data` what the white of its masks was taken for, where nothing was said.
pub(super) fn read_scene(
    spec: &str,
    data: &mut DataOptions,
    parts: Parts<'_>,
    observer: &mut dyn Observer,
) -> Result<Scene, RunError> {
    let scene = (parts.load)(spec, data)?;
    // No word on it where a run is resumed, or where the user said what white means.
    let left = refuse_blank_masks(&scene.frames)?;
    match mask_meaning(&scene, left, data.mask_white.as_deref())? {
        MaskMeaning::AsRead => Ok(scene),
        MaskMeaning::Sparse(line) => {
            observer.event(Event::Warning(&line));
            Ok(scene)
        }
        MaskMeaning::Object(line) => {
            observer.event(Event::Warning(&line));
            // As if it had been said: the run's configuration has it, and a resumed run reads the same photos.
            data.mask_white = Some("object".into());
            (parts.load)(spec, data)
        }
    }
}

/// The system of a run, the lines that say why it was chosen, and settings that were found with it.
struct Named<'a> {
    name: &'a str,
    lines: Vec<String>,
    set: toml::Table,
}

fn system_of<'a>(
    request: &'a Request,
    parts: Parts<'a>,
    scene: &Scene,
    train: &Dataset,
    options: &RunOptions,
) -> Result<Named<'a>, RunError> {
    match (request.system.as_deref(), parts.default_system) {
        (Some(name), _) | (None, DefaultSystem::Named(name)) => {
            Ok(Named { name, lines: Vec::new(), set: toml::Table::new() })
        }
        (None, DefaultSystem::Chosen(choose)) => {
            let choice = choose(scene, train, options, request.purpose)?;
            let lines = [choice.line].into_iter().chain(choice.lines).collect();
            Ok(Named { name: choice.system, lines, set: choice.set })
        }
    }
}

/// Memory for decoded images where nothing is said, MiB: a third of what the process may hold where that is limited.
pub(super) fn default_image_memory() -> u64 {
    limit().map_or(IMAGE_MEMORY_MIB, |bytes| IMAGE_MEMORY_MIB.min((bytes >> 20) / 3).max(1))
}
