//! Stages that are done once: each leaves a marker with the hash of what it was made from.

use crate::error::PrepareError;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Where the markers of a scene lie.
#[derive(Clone, Debug)]
pub(crate) struct Stages {
    pub(crate) folder: PathBuf,
}

/// How far a stage was taken by an earlier call with the same inputs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum State {
    /// Not at all, or with other inputs.
    New,
    /// Begun and not finished.
    Begun,
    /// Finished, with what it found out.
    Done(Value),
}

#[derive(Debug, Serialize, Deserialize)]
struct Marker {
    /// Hash of everything the result depends on.
    inputs: String,
    done: bool,
    #[serde(default)]
    facts: Value,
}

impl Stages {
    fn file(&self, stage: &str) -> PathBuf {
        self.folder.join(format!("{stage}.json"))
    }

    /// How far the stage is, for these inputs. An unreadable marker counts as none.
    pub(crate) fn state(&self, stage: &str, inputs: &str) -> State {
        let bytes = std::fs::read(self.file(stage)).unwrap_or_default();
        match serde_json::from_slice::<Marker>(&bytes) {
            Ok(marker) if marker.inputs != inputs => State::New,
            Ok(marker) if marker.done => State::Done(marker.facts),
            Ok(_) => State::Begun,
            Err(_) => State::New,
        }
    }

    pub(crate) fn begin(&self, stage: &str, inputs: &str) -> Result<(), PrepareError> {
        self.write(stage, &Marker { inputs: inputs.into(), done: false, facts: Value::Null })
    }

    pub(crate) fn finish(&self, stage: &str, inputs: &str, facts: Value) -> Result<(), PrepareError> {
        self.write(stage, &Marker { inputs: inputs.into(), done: true, facts })
    }

    /// The stage has to be done again: what it was made from is not there any more.
    pub(crate) fn forget(&self, stage: &str) -> Result<(), PrepareError> {
        let file = self.file(stage);
        match std::fs::remove_file(&file) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(PrepareError::io(file, "remove the marker")(e)),
            _ => Ok(()),
        }
    }

    fn write(&self, stage: &str, marker: &Marker) -> Result<(), PrepareError> {
        let text = serde_json::to_string_pretty(marker).unwrap_or_default();
        Ok(scene_io::export::write_atomically(&self.file(stage), |out| out.write_all(text.as_bytes()))?)
    }
}

/// SHA-256, in hex, of some texts; each is told apart from its neighbours.
pub(crate) fn hash<S: AsRef<str>>(texts: impl IntoIterator<Item = S>) -> String {
    let mut hash = Sha256::new();
    for text in texts {
        let text = text.as_ref();
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text.as_bytes());
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256, in hex, of bytes.
pub(crate) fn hash_bytes(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What tells a file from its later versions without reading it: path, size and time of change.
pub(crate) fn stamp(path: &Path) -> String {
    let (size, time) = path.metadata().map_or((0, None), |m| (m.len(), m.modified().ok()));
    let nanoseconds = time.and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok()).map_or(0, |d| d.as_nanos());
    format!("{} {size} {nanoseconds}", path.display())
}

/// Removes a folder and what is in it; one that is not there is fine.
pub(crate) fn remove_folder(path: &Path) -> Result<(), PrepareError> {
    match std::fs::remove_dir_all(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(PrepareError::io(path, "remove the folder")(e)),
        _ => Ok(()),
    }
}

/// An empty folder, whatever was there.
pub(crate) fn fresh_folder(path: &Path) -> Result<(), PrepareError> {
    remove_folder(path)?;
    std::fs::create_dir_all(path).map_err(PrepareError::io(path, "make the folder"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_is_done_for_its_inputs_only() {
        let folder = tempfile::tempdir().unwrap();
        let stages = Stages { folder: folder.path().join("deep") };
        assert_eq!(stages.state("match", "a"), State::New);
        stages.begin("match", "a").unwrap();
        assert_eq!(stages.state("match", "a"), State::Begun);
        stages.finish("match", "a", serde_json::json!(3)).unwrap();
        assert_eq!(stages.state("match", "a"), State::Done(serde_json::json!(3)));
        assert_eq!(stages.state("match", "b"), State::New);
        std::fs::write(stages.file("match"), "{").unwrap();
        assert_eq!(stages.state("match", "a"), State::New);
    }

    #[test]
    fn hashes_tell_texts_apart() {
        assert_eq!(hash(["a", "b"]), hash(["a", "b"]));
        assert_ne!(hash(["ab"]), hash(["a", "b"]));
    }
}
