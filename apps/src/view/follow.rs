//! A run folder as it changes: the newest checkpoint is what is shown, and the page shows the training. Files are only read.

use super::run_scene::{RunScene, title};
use super::stage::{Shown, Stage};
use super::tail::Tail;
use super::training;
use crate::app::App;
use crate::session::Failure;
use crate::show;
use engine::RunError;
use engine::checkpoint::{load_newest, newest_step};
use engine::options::Request;
use engine::progress::{Observer, Silent};
use engine::run::{Run, disk_parts};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Time between two looks at the folder.
const EVERY: Duration = Duration::from_secs(1);

/// Follows a run folder.
pub(crate) struct Follower {
    app: &'static App,
    folder: PathBuf,
    stage: Arc<Stage>,
    current: Option<Arc<RunScene>>,
    /// Newest step there was at the last attempt to read it, good or not.
    tried: Option<u64>,
    tail: Tail,
}

/// Whether a folder is that of a run, with or without a checkpoint. One without any visible file is: a training reads its
/// photos before it writes anything that stays.
pub(crate) fn is_run(folder: &Path) -> bool {
    let is_hidden = |entry: std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with('.');
    let is_empty =
        || std::fs::read_dir(folder).is_ok_and(|mut entries| entries.all(|entry| entry.is_ok_and(is_hidden)));
    folder.join("config.toml").is_file() || newest_step(folder).is_some() || is_empty()
}

impl Follower {
    /// Open the newest checkpoint, if there is one.
    ///
    /// # Errors
    /// As [`Run::open`].
    pub(crate) fn open(app: &'static App, folder: &Path, observer: &mut dyn Observer) -> Result<Self, RunError> {
        let tried = newest_step(folder);
        let stage = Arc::new(Stage::new(waiting(
            folder,
            "There is no checkpoint yet. The first one is shown as soon as it is written.",
        )));
        let current = match tried {
            Some(_) => Some(Arc::new(read(app, folder, &stage, observer)?)),
            None => None,
        };
        if let Some(scene) = &current {
            stage.show(Shown::Scene(scene.clone()));
        }
        let (folder, tail) = (folder.to_path_buf(), Tail::new(folder.join("metrics.csv")));
        Ok(Self { app, folder, stage, current, tried, tail })
    }

    pub(crate) fn stage(&self) -> Arc<Stage> {
        self.stage.clone()
    }

    /// Follow from a thread of its own, to the end of the program.
    ///
    /// # Errors
    /// When a thread cannot be started.
    pub(crate) fn start(mut self) -> Result<(), Failure> {
        let forever = move || {
            loop {
                self.look();
                std::thread::sleep(EVERY);
            }
        };
        std::thread::Builder::new().name("follow".into()).spawn(forever)?;
        Ok(())
    }

    /// Look at the folder once.
    fn look(&mut self) {
        self.tail.read();
        self.stage.tell(&training::message(&self.folder, self.tail.rows()));
        // Where nobody looks the training has the machine for itself.
        if !self.stage.is_watched() {
            return;
        }
        let newest = newest_step(&self.folder);
        if newest.is_none() || newest == self.tried {
            return;
        }
        match self.newest() {
            Ok(scene) => {
                self.tried = newest;
                let scene = Arc::new(scene);
                self.current = Some(scene.clone());
                self.stage.show(Shown::Scene(scene));
            }
            // Removed while it was read, as the next one was written: there will be another look.
            Err(RunError::NoCheckpoint(_) | RunError::AllCheckpointsBroken { .. }) => {}
            Err(e) => {
                self.tried = newest;
                show::error(&e);
                if self.current.is_none() {
                    self.stage.show(waiting(&self.folder, &format!("The checkpoint cannot be shown: {e}")));
                }
            }
        }
    }

    fn newest(&self) -> Result<RunScene, RunError> {
        if let Some(current) = &self.current {
            let checkpoint = load_newest(&self.folder)?;
            if current.is_of(&checkpoint) {
                return Ok(current.at(&checkpoint)?);
            }
        }
        read(self.app, &self.folder, &self.stage, &mut Silent)
    }
}

fn read(
    app: &'static App,
    folder: &Path,
    stage: &Arc<Stage>,
    observer: &mut dyn Observer,
) -> Result<RunScene, RunError> {
    let parts = disk_parts(&app.load, &systems::registry::build, app.default_system);
    let run = Run::open(folder, &Request::default(), parts, observer)?;
    // The stage holds the scene: the scene must not hold the stage.
    let stage = Arc::downgrade(stage);
    let tell = move |message: &str| {
        if let Some(stage) = stage.upgrade() {
            stage.tell_fast(message);
        }
    };
    Ok(RunScene::new(run, Arc::new(tell)))
}

fn waiting(folder: &Path, message: &str) -> Shown {
    Shown::Waiting { title: title(folder), message: message.into() }
}
