//! Keeps a training on the disk: its folder, its first files, its checkpoints.

use super::datasets::name_files;
use super::patience::insist;
use super::planned;
use crate::checkpoint;
use crate::data::Dataset;
use crate::error::RunError;
use crate::folder::{CONFIG, FolderLock, Home};
use crate::options::{RunConfig, Schedule};
use crate::output::Storage;
use crate::progress::{Event, Observer, Reached};
use crate::system::System;
use scene_io::Scene;
use std::path::Path;

/// What a run writes besides its results, and where.
pub(super) struct Keeper<'r> {
    pub(super) folder: &'r Path,
    pub(super) home: &'r Home,
    pub(super) lock: &'r mut Option<FolderLock>,
    pub(super) storage: &'r dyn Storage,
    pub(super) schedule: &'r Schedule,
    pub(super) config: &'r RunConfig,
    pub(super) dataset: &'r str,
    pub(super) scene: &'r Scene,
    pub(super) held_out: &'r Dataset,
}

/// The first files of a run: names and content.
pub(super) fn first_files(
    config: &RunConfig,
    scene: &Scene,
    held_out: &Dataset,
) -> Result<Vec<(&'static str, String)>, RunError> {
    let text = toml::to_string_pretty(config)
        .map_err(|e| RunError::Option(format!("the configuration cannot be written as TOML: {e}")))?;
    let mut files = vec![(CONFIG, text)];
    files.extend(name_files(scene, &config.data, held_out)?);
    Ok(files)
}

impl Keeper<'_> {
    /// Make the run folder again where it is gone; `true` where that was needed.
    pub(super) fn settle(&mut self, observer: &mut dyn Observer) -> Result<bool, RunError> {
        if self.home.stands() {
            return Ok(false);
        }
        let files = first_files(self.config, self.scene, self.held_out)?;
        let was_gone = self.home.restore(self.lock, self.storage, &files, observer)?;
        if was_gone {
            planned::write(self.storage, self.folder, self.schedule, observer);
        }
        Ok(was_gone)
    }

    /// One try to write a checkpoint.
    pub(super) fn save(
        &mut self,
        system: &dyn System,
        at: Reached,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        self.settle(observer)?;
        let path = checkpoint::save(self.storage, self.folder, system, at, self.config, self.dataset)?;
        observer.event(Event::Saved { step: at.step, path: &path });
        Ok(())
    }

    /// Write a checkpoint, tried again for as long as the schedule waits for a disk.
    pub(super) fn insist(
        &mut self,
        system: &dyn System,
        at: Reached,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        insist(self.schedule.disk_wait, observer, |observer| self.save(system, at, observer))
    }

    /// After work in which the folder may have gone: where it has, what can be is in it again.
    pub(super) fn keep_up(
        &mut self,
        system: &dyn System,
        at: Reached,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        // A run that never wrote a checkpoint has none to lose.
        match !self.home.stands() && at.step > 0 {
            true => self.insist(system, at, observer),
            false => Ok(()),
        }
    }
}
