//! Priors of motion in a folder that the caller names, in the place of those beside the photos.

use crate::priors::MotionFiles;
use crate::{ErrorKind, Frame, Problem, Scene, SceneError, Split, is_photo};
use std::path::{Path, PathBuf};

/// The word on the command line for [`crate::LoadOptions::priors`].
const PRIORS: &str = "--priors";

impl Scene {
    /// Take optical flow, disparities and motion masks from a folder as [`crate::LoadOptions::priors`] does while reading, in the place of
    /// those that are known. Photos in memory are found by their names.
    ///
    /// # Errors
    /// [`ErrorKind::Value`] where it holds nothing of any training photo; the scene stays as it is then.
    pub fn take_priors(&mut self, folder: &Path) -> Result<(), SceneError> {
        let mut frames = self.frames.clone();
        put(&self.root, &mut frames, folder);
        refuse_nothing(&frames, folder)?;
        self.frames = frames;
        Ok(())
    }
}

/// Name the files in `folder` in each frame of the dataset in the folder `root`.
pub(crate) fn put(root: &Path, frames: &mut [Frame], folder: &Path) {
    for frame in frames {
        frame.priors.motion = MotionFiles::within(folder, &without_ending(frame.path_within(root)));
    }
}

fn without_ending(photo: &Path) -> PathBuf {
    if is_photo(photo) { photo.with_extension("") } else { photo.to_path_buf() }
}

/// Refuses a folder that holds nothing of any training photo: almost surely another one was meant.
pub(crate) fn refuse_nothing(frames: &[Frame], folder: &Path) -> Result<(), SceneError> {
    let photos: Vec<&Frame> = frames.iter().filter(|frame| frame.split == Split::Train).collect();
    let Some(first) = photos.first() else { return Ok(()) };
    if photos.iter().any(|frame| frame.priors.motion != MotionFiles::default()) {
        return Ok(());
    }
    let what = "holds no flow, disparity or motion mask of any training photo";
    let name = without_ending(Path::new(&first.name));
    let remedy = format!(
        "name the folder in which `flow`, `disp` and `motion_masks` lie, as in `flow/{}_fwd.flo`",
        name.display()
    );
    Err(SceneError::new(ErrorKind::Value, Problem::new(folder, what, remedy).field(PRIORS)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{OrbitOptions, orbit, write_orbit};
    use crate::{LoadOptions, load};

    fn options() -> OrbitOptions {
        OrbitOptions { width: 8, height: 8, train: 3, test: 1, rays: 1, ..OrbitOptions::default() }
    }

    fn touch(path: &Path) -> PathBuf {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "").unwrap();
        path.to_path_buf()
    }

    #[test]
    fn photos_in_memory_and_in_files_are_found_in_the_folder() {
        let outside = tempfile::tempdir().unwrap();
        let [data, priors] = ["data", "priors"].map(|name| outside.path().join(name));
        write_orbit(&options(), &data).unwrap();
        // What lies beside the photos does not count any more.
        touch(&data.join("flow/r_001_fwd.flo"));
        let forward = touch(&priors.join("flow/train/r_000_fwd.flo"));
        let disparity = touch(&priors.join("disp/train/r_001.npy"));
        let mask = touch(&priors.join("motion_masks/r_002.png"));
        let mut drawn = orbit(&options());
        drawn.take_priors(&priors).unwrap();
        let read = load(&data, &LoadOptions::default().with_priors(priors.clone())).unwrap();
        assert!(read.notes.iter().any(|note| note == "1 of 4 frames have disparity"), "{:?}", read.notes);
        for scene in [drawn, read] {
            let found: Vec<MotionFiles> =
                scene.split(Split::Train).map(|i| scene.frames[i].priors.motion.clone()).collect();
            let wanted = [
                MotionFiles { forward: Some(forward.clone()), ..MotionFiles::default() },
                MotionFiles { disparity: Some(disparity.clone()), ..MotionFiles::default() },
                MotionFiles { mask: Some(mask.clone()), ..MotionFiles::default() },
            ];
            assert_eq!(found, wanted);
        }
    }

    #[test]
    fn a_folder_of_nothing_is_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        write_orbit(&options(), &data).unwrap();
        let nowhere = folder.path().join("nowhere");
        let drawn = orbit(&options()).take_priors(&nowhere).unwrap_err();
        let read = load(&data, &LoadOptions::default().with_priors(nowhere)).unwrap_err();
        for error in [drawn, read].map(|error| error.to_string()) {
            let said = error.contains("nowhere: `--priors`") && error.contains("holds no flow");
            assert!(said && !error.contains('\n'), "{error}");
        }
        let mut none = orbit(&OrbitOptions { train: 0, ..options() });
        assert!(none.take_priors(folder.path()).is_ok(), "who has no training photos is told so elsewhere");
    }
}
