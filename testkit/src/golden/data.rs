//! Where the shared data lies, and saying so when it does not.

use std::path::{Path, PathBuf};

/// The folder of real data sets and golden masters: the environment variable `WILDFIELD_DATA`, or `shared/data` beside
/// the repository. Pass `env!("CARGO_MANIFEST_DIR")` of a crate that lies directly in the repository.
///
/// `None` where the folder does not exist: call [`skipped`] then.
#[must_use]
pub fn data_dir(manifest_dir: &str) -> Option<PathBuf> {
    let dir = match std::env::var_os("WILDFIELD_DATA") {
        Some(dir) => PathBuf::from(dir),
        None => Path::new(manifest_dir).join("../../shared/data"),
    };
    dir.is_dir().then_some(dir)
}

/// Say loudly that a test did not run, and why. Call it, then return.
///
/// The line goes past the capture of the test harness, so it is seen without `--nocapture`.
pub fn skipped(test: &str, reason: &str) {
    use std::io::Write;
    // A closed stderr is not a reason to fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: {reason}");
}

/// [`data_dir`] with something in it, or `None` after a `SKIPPED:` line: a scene's folder, for example.
///
/// ```no_run
/// # fn main() {
/// let Some(lego) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), "nerf_synthetic/lego", "reads_lego") else { return };
/// # let _ = lego; }
/// ```
#[must_use]
pub fn data_or_skip(manifest_dir: &str, name: &str, test: &str) -> Option<PathBuf> {
    let Some(dir) = data_dir(manifest_dir) else {
        skipped(test, "no folder `../shared/data` beside the repository, and WILDFIELD_DATA names none");
        return None;
    };
    let path = dir.join(name);
    if !path.exists() {
        skipped(test, &format!("no `{}`", path.display()));
        return None;
    }
    Some(path)
}
