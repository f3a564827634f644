//! Where the priors of a photo lie in their folder, and what is written in them.

use crate::error::PrepareError;
use scene_io::is_photo;
use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

/// Flow to the neighbours in time, in the folder of the priors: what [`scene_io::MotionFiles`] looks for.
pub(super) const FLOW: &str = "flow";
/// What moves, in it.
pub(super) const MASKS: &str = "motion_masks";
/// Disparities, in it: exact ones.
pub(super) const DISPARITY: &str = "disp";
/// Markers of what is done, in it: of what photos tell, and of what is exact.
pub(super) const MADE: &str = "made";
pub(super) const EXACT: &str = "exact";

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
    /// Disparity, where it is known.
    pub(super) disparity: PathBuf,
    /// The photo's name as that of a stage.
    pub(super) stage: String,
}

impl Files {
    /// The files of photos, of which is given where each lies in the folder of the scene: after the photos' own names without folders, where these
    /// differ, else with them.
    ///
    /// # Errors
    /// Two photos whose files would be the same.
    pub(super) fn of(out: &Path, photos: &[PathBuf]) -> Result<Vec<Self>, PrepareError> {
        let parts: Vec<Vec<String>> = photos.iter().map(|photo| parts(photo)).collect();
        let stems: HashSet<&String> = parts.iter().filter_map(|parts| parts.last()).collect();
        let begin = |parts: &[String]| if stems.len() == photos.len() { parts.len() - 1 } else { 0 };
        let mut taken: HashMap<String, &PathBuf> = HashMap::new();
        let mut all = Vec::with_capacity(photos.len());
        for (photo, parts) in photos.iter().zip(&parts) {
            let short = parts[begin(parts)..].join("/");
            if let Some(other) = taken.insert(short.clone(), photo) {
                let (one, two) = (other.display(), photo.display());
                let what = format!("the priors of the photos `{one}` and `{two}` would be the same files");
                return Err(PrepareError::input(out, what, "rename one of the photos"));
            }
            all.push(Self {
                forward: Path::new(FLOW).join(format!("{short}_fwd.flo")),
                backward: Path::new(FLOW).join(format!("{short}_bwd.flo")),
                mask: Path::new(MASKS).join(format!("{short}.png")),
                disparity: Path::new(DISPARITY).join(format!("{short}.npy")),
                stage: short,
            });
        }
        Ok(all)
    }
}

/// Folders and name of a photo, without the ending of its file and without anything that leads out of a folder; one at least.
fn parts(photo: &Path) -> Vec<String> {
    let path = if is_photo(photo) { photo.with_extension("") } else { photo.to_path_buf() };
    let normal = path.components().filter_map(|part| match part {
        Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
        _ => None,
    });
    let parts: Vec<String> = normal.collect();
    if parts.is_empty() { vec!["photo".to_owned()] } else { parts }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(photos: &[&str]) -> Result<Vec<Files>, PrepareError> {
        Files::of(Path::new("p"), &photos.iter().map(PathBuf::from).collect::<Vec<_>>())
    }

    #[test]
    fn files_are_named_after_photos() {
        let files = files(&["images/00001.png", "train/r_000", "a.b/c.1"]).unwrap();
        assert_eq!(files[0].forward, Path::new("flow/00001_fwd.flo"));
        assert_eq!(files[1].backward, Path::new("flow/r_000_bwd.flo"));
        assert_eq!(files[2].mask, Path::new("motion_masks/c.1.png"));
        assert_eq!(files[1].disparity, Path::new("disp/r_000.npy"));
    }

    #[test]
    fn folders_are_kept_where_photos_have_one_name() {
        let files = files(&["left/1.png", "right/1.png", "right/2.png"]).unwrap();
        assert_eq!(files[1].forward, Path::new("flow/right/1_fwd.flo"));
        assert_eq!(files[2].stage, "right/2");
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        for name in ["../../x.jpg", "/x.jpg", "./x.png"] {
            assert_eq!(parts(Path::new(name)), ["x"], "{name}");
        }
        assert_eq!(parts(Path::new("..")), ["photo"]);
    }

    #[test]
    fn photos_that_differ_in_their_ending_alone_are_named() {
        let error = files(&["x.jpg", "y.jpg", "x.png"]).unwrap_err().to_string();
        assert!(error.contains("`x.jpg` and `x.png`"), "{error}");
    }
}
