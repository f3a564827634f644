//! When a training will stop, for whoever watches it from outside: `schedule.json`. No part of what determines the result.

use crate::output::{Storage, write_file};
use crate::train::Stop;
use serde_json::{Value, json};
use std::path::Path;

const FILE: &str = "schedule.json";

/// Write down when the training that starts now will stop. No training fails over it: where this cannot be written, what
/// matters soon cannot either, and says so.
pub(super) fn write(storage: &dyn Storage, folder: &Path, stop: Stop) {
    let text = match stop {
        Stop::Steps(n) => json!({ "steps": n }),
        Stop::Seconds(s) => json!({ "seconds": s }),
    };
    let _ = write_file(storage, &folder.join(FILE), text.to_string().as_bytes());
}

/// When the last training in a run folder was to stop; `None` where nothing says so.
#[must_use]
pub fn planned_stop(folder: &Path) -> Option<Stop> {
    let said: Value = serde_json::from_slice(&std::fs::read(folder.join(FILE)).ok()?).ok()?;
    let steps = said.get("steps").and_then(Value::as_u64).map(Stop::Steps);
    steps.or_else(|| said.get("seconds").and_then(Value::as_f64).map(Stop::Seconds))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Disk;

    #[test]
    fn a_stop_is_read_as_it_was_written_and_nonsense_is_none() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(planned_stop(folder.path()), None);
        for stop in [Stop::Steps(2000), Stop::Seconds(90.5)] {
            write(&Disk, folder.path(), stop);
            assert_eq!(planned_stop(folder.path()), Some(stop));
        }
        for nonsense in ["", "[]", r#"{"steps": "many"}"#] {
            std::fs::write(folder.path().join(FILE), nonsense).unwrap();
            assert_eq!(planned_stop(folder.path()), None, "{nonsense}");
        }
    }
}
