//! Dense features of a frame's photo.

use crate::priors::Features;
use crate::{ErrorKind, Frame, Problem, SceneError, npy};
use std::path::Path;

impl Frame {
    /// The dense features of the photo; `None` where there is no file.
    ///
    /// # Errors
    /// Names the file that is not an array of three dimensions or holds a value that is not finite.
    pub fn read_features(&self) -> Result<Option<Features>, SceneError> {
        let Some(path) = &self.priors.features else { return Ok(None) };
        read(path).map(Some).map_err(|e| e.in_frame(&self.name))
    }
}

fn read(path: &Path) -> Result<Features, SceneError> {
    npy::with(path, 4, |array| from_array(path, &array))
}

fn from_array(path: &Path, array: &npy::Array) -> Result<Features, SceneError> {
    let wrong = |problem: Problem| SceneError::new(ErrorKind::Value, problem);
    let &[channels, height, width] = array.shape.as_slice() else {
        let problem = Problem::new(path, "has not three dimensions", "write channels, rows, columns");
        return Err(wrong(problem.field("shape").value(format!("{:?}", array.shape))));
    };
    if array.data.is_empty() {
        let problem = Problem::new(path, "holds no features", "compute them again, or remove the file");
        return Err(wrong(problem.field("shape").value(format!("{:?}", array.shape))));
    }
    let data: Vec<f32> = array.data.iter().map(|x| *x as f32).collect();
    if let Some(at) = data.iter().position(|x| !x.is_finite()) {
        let (c, rest) = (at / (height * width), at % (height * width));
        let problem = Problem::new(path, "is not finite", "compute the features again, or remove the file");
        let field = format!("[{c}][{}][{}]", rest / width, rest % width);
        return Err(wrong(problem.field(field).value(array.data[at])));
    }
    Ok(Features { channels, width, height, data })
}
