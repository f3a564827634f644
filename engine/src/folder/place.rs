//! Whether a folder may become a run folder: it is empty, or it is a run folder already.

use super::layout::{CONFIG, LOCK, OWN, PROBE};
use crate::checkpoint;
use crate::error::RunError;
use crate::options::RunConfig;
use crate::output::temporary_of;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The configuration of the run in a folder; `None` where there is none that can be read.
#[must_use]
pub fn config(folder: &Path) -> Option<RunConfig> {
    toml::from_str(&fs::read_to_string(folder.join(CONFIG)).ok()?).ok()
}

/// Refuse to start a run among files that are not a run's: a `config.toml` of another program, or anything that a run does not write.
/// Hidden files do not count.
///
/// # Errors
/// [`RunError::ForeignFiles`] naming one of them, the first by name.
pub(crate) fn refuse_foreign(folder: &Path) -> Result<(), RunError> {
    if config(folder).is_some() || checkpoint::newest_step(folder).is_some() {
        return Ok(());
    }
    // A folder that is not there is empty; one that cannot be listed fails when it is written to.
    let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_foreign = |name: &OsString| {
        let name = name.to_string_lossy();
        !name.starts_with('.') && (name == CONFIG || !OWN.contains(&name.as_ref()))
    };
    match names.filter(is_foreign).min() {
        Some(name) => Err(RunError::ForeignFiles { folder: folder.into(), name: PathBuf::from(name) }),
        None => Ok(()),
    }
}

/// Remove what a run wrote into its folder, but for its configuration: the folder stays that of a run, so that a new one may
/// begin there. Whatever else lies in it stays, too.
///
/// # Errors
/// [`RunError::Write`] naming what cannot be removed.
pub fn clear(folder: &Path) -> Result<(), RunError> {
    for path in OWN.iter().filter(|name| ![LOCK, CONFIG].contains(*name)).map(|name| folder.join(name)) {
        let removed = match fs::symlink_metadata(&path) {
            Ok(what) if what.is_dir() => fs::remove_dir_all(&path),
            Ok(_) => fs::remove_file(&path),
            Err(_) => Ok(()),
        };
        removed.map_err(RunError::write(&path))?;
    }
    Ok(())
}

/// Remove what [`write_file`](crate::output::write_file) left in a run folder when its process was killed: of files that a run
/// writes, in folders that a run makes. Links are not followed.
pub(crate) fn sweep(run: &Path) {
    let is_own = |name: &str| name == PROBE || OWN.contains(&name);
    for entry in fs::read_dir(run).into_iter().flatten().flatten() {
        let (path, Ok(what)) = (entry.path(), entry.file_type()) else { continue };
        if what.is_file() && temporary_of(&path).is_some_and(is_own) {
            let _ = fs::remove_file(path);
        } else if what.is_dir() && entry.file_name().to_str().is_some_and(is_own) {
            sweep_below(&path);
        }
    }
}

/// The same in a folder of a run, where names come from photos.
fn sweep_below(folder: &Path) {
    let is_own = |name: &str| [".json", ".safetensors", ".png"].iter().any(|ending| name.ends_with(ending));
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, Ok(what)) = (entry.path(), entry.file_type()) else { continue };
        if what.is_file() && temporary_of(&path).is_some_and(is_own) {
            let _ = fs::remove_file(path);
        } else if what.is_dir() {
            sweep_below(&path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_killed_processes_left_is_swept_and_what_others_keep_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let (place, data) = (folder.path().join("run"), folder.path().join("data"));
        let own = [
            "config.toml.tmp",
            "checkpoint/step-00000003.json.tmp",
            "renders/scale_2/a.png.tmp",
            "masks/side_by_side/a.png.tmp",
        ];
        let others = ["letter.tmp", "photos/a.png.tmp", "checkpoint/letter.tmp", "masks/a.png", "metrics.csv"];
        for name in own.iter().chain(&others) {
            let path = place.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"").unwrap();
        }
        fs::create_dir(&data).unwrap();
        fs::write(data.join("a.png.tmp"), b"").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&data, place.join("appearance")).unwrap();
        sweep(&place);
        assert!(own.iter().all(|name| !place.join(name).exists()));
        assert!(others.iter().all(|name| place.join(name).exists()) && data.join("a.png.tmp").exists());
    }

    #[test]
    fn an_empty_folder_and_hidden_files_are_no_obstacle_and_other_files_are() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        refuse_foreign(&place.join("not there")).unwrap();
        fs::write(place.join(".DS_Store"), b"").unwrap();
        refuse_foreign(place).unwrap();
        fs::write(place.join("b.jpg"), b"").unwrap();
        fs::create_dir(place.join("a")).unwrap();
        let error = refuse_foreign(place).unwrap_err().to_string();
        assert!(error.contains("`a`") && error.contains("--out"), "{error}");
    }

    #[test]
    fn what_a_run_left_before_its_first_checkpoint_is_no_obstacle_and_a_configuration_of_another_program_is() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        fs::create_dir(place.join("checkpoint")).unwrap();
        fs::write(place.join("metrics.csv"), "step,seco").unwrap();
        refuse_foreign(place).unwrap();
        fs::write(place.join(CONFIG), "[server]\nport = 1").unwrap();
        assert!(refuse_foreign(place).unwrap_err().to_string().contains("config.toml"));
    }

    #[test]
    fn what_is_cleared_is_what_runs_write() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        fs::create_dir_all(place.join("checkpoint/deep")).unwrap();
        for name in ["report.html", "orbit.gif", ".lock"] {
            fs::write(place.join(name), b"").unwrap();
        }
        clear(place).unwrap();
        let mut left: Vec<_> = fs::read_dir(place).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, [".lock", "orbit.gif"]);
        clear(&place.join("not there")).unwrap();
    }
}
