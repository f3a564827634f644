//! Where the priors of a photo lie in their folder, and what is written in them.

use crate::error::PrepareError;
use scene_io::is_photo;
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// The folder, in that of the scene.
pub const PRIORS: &str = "priors";
/// Flow to the neighbours in time, in it.
pub(super) const FLOW: &str = "flow";
/// What moves, in it.
pub(super) const MASKS: &str = "motion_masks";
/// Markers of what is done, in it.
pub(super) const MADE: &str = "made";

/// Grey of a mask: moves, stays, was not judged. The last is below one half, so that programs which know two kinds take it for what stays.
pub(super) const MOVES: u8 = 255;
pub(super) const STAYS: u8 = 0;
pub(super) const NOT_JUDGED: u8 = 127;

/// Files of one photo, relative to the folder.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Files {
    /// Flow to the next photo.
    pub(super) forward: PathBuf,
    /// Flow to the one before.
    pub(super) backward: PathBuf,
    /// What moves.
    pub(super) mask: PathBuf,
    /// The photo's name as that of a stage.
    pub(super) stage: String,
}

impl Files {
    /// The files of photos by their names, in order.
    ///
    /// # Errors
    /// Two photos whose files would be the same.
    pub(super) fn of(out: &Path, names: &[&str]) -> Result<Vec<Self>, PrepareError> {
        let mut taken: HashMap<String, &str> = HashMap::new();
        let mut all = Vec::with_capacity(names.len());
        for name in names {
            let short = short(name);
            if let Some(other) = taken.insert(short.clone(), *name) {
                let what = format!("the priors of the photos `{other}` and `{name}` would be the same files");
                return Err(PrepareError::input(out, what, "rename one of the photos"));
            }
            all.push(Self {
                forward: Path::new(FLOW).join(format!("{short}_fwd.flo")),
                backward: Path::new(FLOW).join(format!("{short}_bwd.flo")),
                mask: Path::new(MASKS).join(format!("{short}.png")),
                stage: short,
            });
        }
        Ok(all)
    }
}

/// A photo's name without the ending of its file, folders kept, and nothing that leads out of the folder.
fn short(name: &str) -> String {
    let path = Path::new(name);
    let path = if is_photo(path) { path.with_extension("") } else { path.to_path_buf() };
    let parts = path.components().filter_map(|part| match part {
        Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
        _ => None,
    });
    parts.collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_after_photos() {
        let files = Files::of(Path::new("p"), &["images/00001.png", "train/r_000", "a.b/c.1"]).unwrap();
        assert_eq!(files[0].forward, Path::new("flow/images/00001_fwd.flo"));
        assert_eq!(files[1].backward, Path::new("flow/train/r_000_bwd.flo"));
        assert_eq!(files[2].mask, Path::new("motion_masks/a.b/c.1.png"));
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        for name in ["../../x.jpg", "/x.jpg", "./x.png"] {
            assert_eq!(short(name), "x", "{name}");
        }
    }

    #[test]
    fn photos_that_differ_in_their_ending_alone_are_named() {
        let error = Files::of(Path::new("p"), &["x.jpg", "y.jpg", "x.png"]).unwrap_err().to_string();
        assert!(error.contains("`x.jpg` and `x.png`"), "{error}");
    }
}
