//! Disparity to files that are read as those of other programs: `.npy`.

use crate::npy_writer::write_npy;
use crate::priors::Disparity;
use crate::{ErrorKind, Problem, SceneError, Size};
use std::path::Path;

/// Writes a disparity as a `.npy` file of `f32`, `[rows][columns]`, whole or not at all. Pixels that are not known are written as NaN.
///
/// # Errors
/// Names the file and what the system said; [`ErrorKind::Value`] where the disparity does not hold what its size says.
pub fn write_disparity(path: &Path, disparity: &Disparity) -> Result<(), SceneError> {
    let Disparity { width, height, values, known } = disparity;
    let size = Size::new(*width, *height);
    if values.len() as u64 != size.pixels() || (known.width(), known.height()) != (*width, *height) {
        let what = format!("the disparity to write is {size} and holds {} values", values.len());
        let problem = Problem::new(path, what, "give one value and one pixel of the mask for each pixel");
        return Err(SceneError::new(ErrorKind::Value, problem));
    }
    let written = values.iter().zip(known.iter()).map(|(value, known)| if known { *value } else { f32::NAN });
    write_npy(path, &[*height, *width], &written.collect::<Vec<f32>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::read_file;

    #[test]
    fn what_was_written_is_read_and_what_is_not_known_stays_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("disp/train/a.npy");
        let disparity = Disparity::new(3, 2, vec![0.25, f32::NAN, 1e-30, 0.0, -7.5, f32::INFINITY]).unwrap();
        write_disparity(&path, &disparity).unwrap();
        let map = read_file(&path).unwrap();
        assert_eq!((map.width, map.height), (3, 2));
        assert_eq!(Disparity::new(map.width, map.height, map.z).unwrap(), disparity);
        let short = Disparity { values: vec![1.0; 5], ..disparity };
        let error = write_disparity(&path, &short).unwrap_err().to_string();
        assert!(error.contains("a.npy") && error.contains("is 3x2 and holds 5 values"), "{error}");
    }
}
