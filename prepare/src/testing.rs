//! Programs made up for tests.

use std::path::Path;

/// A shell script called `name` in `folder`.
#[cfg(unix)]
pub(crate) fn fake_program(folder: &Path, name: &str, script: &str) {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join(name);
    // Written aside and renamed: a file that is open for writing cannot be run.
    let aside = folder.join(format!("{name}.new"));
    std::fs::write(&aside, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&aside, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::rename(aside, path).unwrap();
}
