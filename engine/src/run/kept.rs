//! Held-out views that were measured before an evaluation was stopped or killed: `eval_views.json`.
//!
//! Scores belong to one checkpoint and one way to measure; anything else in the file is ignored. It goes away with the
//! evaluation that needed it.

use crate::checkpoint;
use crate::error::RunError;
use crate::eval::{KnownView, Measures, Terms};
use crate::folder::EVAL_VIEWS;
use crate::output::{Storage, read_json, write_file};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Endings of the pictures of a view.
pub(super) const PICTURES: [&str; 4] = ["", "_truth", "_error", "_depth"];

/// The content of the file.
#[derive(Default, Serialize, Deserialize)]
struct Content {
    /// Which checkpoint, measured how.
    of: String,
    /// By their number among the held-out views.
    views: BTreeMap<usize, KnownView>,
}

/// Views measured so far.
pub(super) struct MeasuredViews {
    path: PathBuf,
    /// Where nothing says which checkpoint it is, nothing is kept.
    content: Option<Content>,
}

impl MeasuredViews {
    /// What is known of the checkpoint of `step` in `folder`, measured as `terms` say.
    pub(super) fn of(folder: &Path, step: u64, terms: &Terms<'_>) -> Self {
        let path = folder.join(EVAL_VIEWS);
        let Some(digest) = checkpoint::digest(folder, step) else { return Self { path, content: None } };
        let of = key(&digest, step, terms);
        let read = read_json::<Content>(&path).ok().flatten().filter(|read| read.of == of);
        Self { path, content: Some(read.unwrap_or(Content { of, views: BTreeMap::new() })) }
    }

    /// A view, where it was measured and its pictures are still there.
    pub(super) fn view(&self, index: usize, renders: &Path, stem: &str) -> Option<KnownView> {
        let known = self.content.as_ref()?.views.get(&index)?;
        let has = |ending: &&str| renders.join(format!("{stem}{ending}.png")).exists();
        PICTURES.iter().all(has).then(|| known.clone())
    }

    /// Keep a view.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub(super) fn keep(&mut self, storage: &dyn Storage, index: usize, known: KnownView) -> Result<(), RunError> {
        let Some(content) = &mut self.content else { return Ok(()) };
        content.views.insert(index, known);
        write_file(storage, &self.path, &serde_json::to_vec(content).expect("a plain struct serialises"))
    }
}

/// Remove the file; an old one that stays is not read, as it is of another evaluation.
pub(super) fn forget(folder: &Path) {
    let _ = fs::remove_file(folder.join(EVAL_VIEWS));
}

/// What decides scores besides the dataset, which a run checks before.
fn key(digest: &str, step: u64, terms: &Terms<'_>) -> String {
    let protocol = serde_json::to_string(terms.protocol).unwrap_or_default();
    let lpips = matches!(terms.measures, Measures::All(Some(_)));
    let (budget, background) = (terms.query.error_budget, terms.query.background);
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "{version} step {step} {digest} {protocol} budget {budget:?} on {background:?} seed {} lpips {lpips}",
        terms.seed
    )
}
