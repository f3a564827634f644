//! A field as a cloud, for pictures while the camera moves: baked in the background, kept in the run folder.
//!
//! | what is looked at | cloud |
//! | --- | --- |
//! | the mean appearance, the first time step | baked when a page opens; from the run folder where it was baked before |
//! | another appearance | the colours of that cloud fitted to it, once it has been wanted for a while |
//! | another time | baked anew, once the time has been wanted for a while |
//! | a training that goes on | the cloud of an older checkpoint; baked only while the camera moves |
//!
//! Until a cloud is there the field itself is drawn, small.

use super::cropped::Cropped;
use engine::data::Dataset;
use engine::output::Disk;
use engine::render::plain_query;
use engine::system::{Appearance, Query, System};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};
use systems::bake::{BakeOptions, Baked, bake, load, recolour, store};
use systems::splats::Cloud;

/// An appearance or a time is baked once it has been wanted for this long without a change.
const SETTLED: Duration = Duration::from_millis(500);
/// Pictures wanted in a row before the cloud of a training that goes on is baked: a camera that moves.
const MOVES: u32 = 4;
/// Clouds that are kept.
const KEPT: usize = 6;

/// Takes what changes, as the message `fast`.
pub(crate) type Tell = dyn Fn(&str) + Send + Sync;

/// What a cloud was baked for.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Key {
    /// Bits of the appearance code; empty where there is one appearance, and for the mean of all.
    appearance: Vec<u32>,
    /// Bits of the time; 0 where nothing moves.
    time: u64,
}

impl Key {
    const FIRST: Self = Self { appearance: Vec::new(), time: 0 };
}

/// A cloud that is ready.
#[derive(Clone)]
struct Ready {
    key: Key,
    cloud: Arc<Cropped>,
    baked: Arc<Baked>,
    /// Of the checkpoint that is shown, not of one before it.
    is_new: bool,
}

#[derive(Default)]
struct State {
    ready: Vec<Ready>,
    /// What is wanted and not there, since when, and in what it is to be drawn.
    wanted: Option<(Key, Instant, Query)>,
    asked: u32,
    failed: Vec<Key>,
    works: bool,
}

/// What a bake needs of a run.
pub(crate) struct Source {
    pub(crate) folder: PathBuf,
    pub(crate) step: u64,
    pub(crate) system: Arc<dyn System>,
    pub(crate) data: Arc<Dataset>,
    pub(crate) background: [f32; 3],
    pub(crate) moves: bool,
}

/// The clouds of a run at a checkpoint.
pub(crate) struct Fast {
    source: Source,
    tell: Arc<Tell>,
    state: Mutex<State>,
    bell: Condvar,
    is_its_own: bool,
}

impl Fast {
    /// Those of `before` stand in for what is not baked yet. A thread of its own bakes until this value is gone.
    pub(crate) fn start(source: Source, before: Option<&Self>, tell: Arc<Tell>) -> Arc<Self> {
        let old = before.map(|fast| fast.lock().ready.clone()).unwrap_or_default();
        let ready = old.into_iter().map(|ready| Ready { is_new: false, ..ready }).collect();
        let is_its_own = source.system.is_cloud();
        let fast = Arc::new(Self {
            is_its_own,
            source,
            tell,
            state: Mutex::new(State { ready, ..State::default() }),
            bell: Condvar::new(),
        });
        if is_its_own {
            // Its own cloud: cropped it is drawn from here.
            fast.add_own(&plain_query(fast.source.background, 1.0 / 255.0));
            return fast;
        }
        let weak = Arc::downgrade(&fast);
        if std::thread::Builder::new().name("bake".into()).spawn(move || work(&weak)).is_err() {
            fast.say(json!({ "type": "fast", "state": "failed" }));
        }
        fast
    }

    /// The cloud for a picture; where there is none it is wanted from now on.
    pub(crate) fn cloud(&self, query: &Query) -> Option<Arc<Cropped>> {
        let key = self.key(query);
        if self.is_its_own && !self.lock().ready.iter().any(|ready| ready.key == key && ready.is_new) {
            self.add_own(query);
        }
        let mut state = self.lock();
        let found = state.ready.iter().find(|ready| ready.key == key).cloned();
        if found.as_ref().is_none_or(|ready| !ready.is_new) && !state.failed.contains(&key) {
            state.asked += 1;
            let is_same = state.wanted.as_ref().is_some_and(|(wanted, ..)| *wanted == key);
            if !is_same {
                state.wanted = Some((key, Instant::now(), query.clone()));
            }
            self.bell.notify_all();
        }
        found.map(|ready| ready.cloud)
    }

    /// Whether the system is a cloud itself: nothing is baked.
    pub(crate) fn is_its_own(&self) -> bool {
        self.is_its_own
    }

    /// What the page shows now.
    pub(crate) fn message(&self) -> String {
        let state = self.lock();
        let ready = state.ready.iter().find(|ready| ready.key == Key::FIRST);
        let word = match (ready, state.works) {
            (_, true) => "baking",
            (Some(_), _) if self.is_its_own => "own",
            (Some(_), _) => "ready",
            (None, _) if state.failed.contains(&Key::FIRST) => "failed",
            (None, _) => "none",
        };
        let ready = ready.cloned();
        drop(state);
        let mut message = json!({ "type": "fast", "state": word });
        if let Some(ready) = ready {
            message["count"] = ready.baked.splats.gaussians.len().into();
            message["psnr"] = ready.baked.psnr.into();
            message["hints"] = serde_json::to_value(ready.cloud.hints()).unwrap_or_default();
        }
        message.to_string()
    }

    fn key(&self, query: &Query) -> Key {
        let system = self.source.system.as_ref();
        let appearance = match query.appearance {
            Appearance::Mean => Vec::new(),
            _ => system.appearance_code(&query.appearance).unwrap_or_default().iter().map(|x| x.to_bits()).collect(),
        };
        Key { appearance, time: if self.source.moves { query.time.to_bits() } else { 0 } }
    }

    fn say(&self, message: serde_json::Value) {
        (self.tell)(&message.to_string());
    }

    /// What the system itself is at the time of a picture.
    fn add_own(&self, query: &Query) {
        if let Some(splats) = self.source.system.splats(query) {
            self.add(self.key(query), Baked { splats, psnr: None });
        }
    }

    fn add(&self, key: Key, baked: Baked) {
        let cloud = Arc::new(Cropped::new(Cloud::exact(baked.splats.clone())));
        let mut state = self.lock();
        state.ready.retain(|ready| ready.key != key);
        state.ready.push(Ready { key, cloud, baked: Arc::new(baked), is_new: true });
        // The first stays: those of other appearances are made from it.
        if state.ready.len() > KEPT
            && let Some(oldest) = state.ready.iter().position(|ready| ready.key != Key::FIRST)
        {
            state.ready.remove(oldest);
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is to be baked now, if anything is.
    fn due(&self) -> Option<(Key, Query)> {
        let trains = is_training(&self.source.folder);
        let state = self.lock();
        let (key, since, query) = state.wanted.as_ref()?;
        let is_due = match (trains, *key == Key::FIRST) {
            (true, _) => state.asked >= MOVES && since.elapsed() >= SETTLED,
            (false, true) => true,
            (false, false) => since.elapsed() >= SETTLED,
        };
        is_due.then(|| (key.clone(), query.clone()))
    }

    /// Bake for `key` and keep the result.
    fn make(&self, key: &Key, query: &Query, go_on: &dyn Fn() -> bool) {
        let Source { folder, step, system, data, background, .. } = &self.source;
        let trains = is_training(folder);
        let query =
            Query { appearance: query.appearance.clone(), time: query.time, ..plain_query(*background, 1.0 / 255.0) };
        let base = || {
            self.lock()
                .ready
                .iter()
                .find(|r| r.key == Key { appearance: Vec::new(), ..key.clone() } && r.is_new)
                .cloned()
        };
        let is_first = *key == Key::FIRST;
        let kept = if is_first { load(folder, *step) } else { None };
        let was_kept = kept.is_some();
        let made = match (kept, base()) {
            (Some(baked), _) => Ok(Some(baked)),
            (None, Some(base)) if !key.appearance.is_empty() => {
                recolour(&base.baked, system.as_ref(), data, &query, &BakeOptions::QUICK, go_on)
            }
            _ => {
                let options = if is_first && !trains { BakeOptions::DEFAULT } else { BakeOptions::QUICK };
                bake(system.as_ref(), data, &query, &options, go_on)
            }
        };
        match made {
            Ok(Some(baked)) => {
                // A folder that a training writes to is left alone.
                if is_first
                    && !was_kept
                    && !trains
                    && !is_training(folder)
                    && let Err(e) = store(&Disk, folder, *step, &baked)
                {
                    crate::show::note(&format!("the baked cloud is not kept: {e}"));
                }
                self.add(key.clone(), baked);
            }
            Ok(None) => {}
            Err(e) => {
                crate::show::error(&e);
                self.lock().failed.push(key.clone());
            }
        }
    }
}

/// Whether a training seems to be writing to a run folder.
fn is_training(folder: &Path) -> bool {
    super::training::is_running(folder)
}

/// Bake what is wanted until nobody holds the clouds any more.
fn work(weak: &Weak<Fast>) {
    // A pool of its own: tasks of a bake must not stand before those of a picture that a page waits for.
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads()).build() else { return };
    while let Some(fast) = weak.upgrade() {
        let Some((key, query)) = fast.due() else {
            let state = fast.lock();
            let wait = Duration::from_millis(if state.wanted.is_some() { 100 } else { 400 });
            let _ = fast.bell.wait_timeout(state, wait);
            continue;
        };
        fast.lock().works = true;
        (fast.tell)(&fast.message());
        // The thread itself holds one.
        let go_on = || Arc::strong_count(&fast) > 1;
        pool.install(|| fast.make(&key, &query, &go_on));
        {
            let mut state = fast.lock();
            state.works = false;
            state.asked = 0;
            if state.wanted.as_ref().is_some_and(|(wanted, ..)| *wanted == key) {
                state.wanted = None;
            }
        }
        (fast.tell)(&fast.message());
    }
}
