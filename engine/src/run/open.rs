//! A run that has begun, as its newest usable checkpoint left it.

use super::datasets::{as_named, datasets};
use super::writer::take_lock;
use super::{Parts, Run};
use crate::checkpoint::{self, Checkpoint};
use crate::error::RunError;
use crate::folder::{Home, sweep, was_locked};
use crate::identity::dataset_hash;
use crate::memory::ExpectedMemory;
use crate::options::{Request, RunOptions};
use crate::photo_points::provide;
use crate::progress::{Event, Observer};
use crate::scene_points::keep_training_points;
use std::path::Path;

impl<'a> Run<'a> {
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
        if checkpoint::newest_step(folder).is_none() && !was_locked(folder) {
            return Err(RunError::NoCheckpoint(folder.into()));
        }
        let lock = take_lock(folder, observer)?;
        // Left by processes that were killed: whoever holds the lock is alone.
        sweep(folder);
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
        let data = as_named(folder, &config.data);
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
            stop: None,
            set: config.settings.clone(),
        };
        if provide::take(&mut options.set)? == Some(true) && provide::may_help(&scene, &train) {
            provide::again(folder, &mut scene, provide::Sets { train: &mut train, held_out: &mut held_out })?;
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
}

fn short(hash: &str) -> String {
    hash.chars().take(19).collect() // `sha256:` and twelve digits
}
