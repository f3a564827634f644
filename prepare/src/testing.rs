//! Programs made up for tests.

use std::path::Path;

/// A shell script called `name` in `folder`.
#[cfg(unix)]
pub(crate) fn fake_program(folder: &Path, name: &str, script: &str) {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join(name);
    // A file that is open for writing cannot be run, and what another test starts meanwhile has this process's files open: another
    // process writes it, aside, and it is renamed.
    let (text, aside) = (folder.join(format!("{name}.text")), folder.join(format!("{name}.new")));
    std::fs::write(&text, format!("#!/bin/sh\n{script}\n")).unwrap();
    assert!(std::process::Command::new("cp").arg(&text).arg(&aside).status().unwrap().success());
    std::fs::remove_file(text).unwrap();
    std::fs::set_permissions(&aside, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::rename(aside, path).unwrap();
}
