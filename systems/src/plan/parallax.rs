//! Whether the training cameras see depth by parallax, and what accepts that they do not.

use crate::layout::stands_still;
use crate::settings::NO_PARALLAX;
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::SystemError;
use render_core::pose::Pose;

/// Whether they were accepted.
pub(crate) fn accepts_no_parallax(run: &RunOptions) -> Result<bool, SystemError> {
    match run.set.get(NO_PARALLAX) {
        None => Ok(false),
        Some(toml::Value::Boolean(accepted)) => Ok(*accepted),
        Some(other) => {
            let problem = "must be true or false".into();
            Err(SystemError::Config { field: NO_PARALLAX, value: other.to_string(), problem })
        }
    }
}

/// Whether two or more training cameras all have the same place and direction, which says nothing about depth.
pub(crate) fn has_no_parallax(data: &Dataset) -> bool {
    let [first, rest @ ..] = data.views() else { return false };
    let poses: Vec<Pose> = data.views().iter().map(|view| view.camera.pose).collect();
    // The same view at several scales is one view.
    rest.iter().any(|view| view.frame != first.frame) && stands_still(&poses)
}

/// The error of training cameras that are all the same: `and` what that means, and what is to be done.
pub(crate) fn no_parallax(data: &Dataset, and: &str) -> SystemError {
    let problem = format!(
        "all {} training cameras have the same pose: {and}, or set it to true to train all the same",
        data.len()
    );
    SystemError::Config { field: NO_PARALLAX, value: "false".into(), problem }
}

/// Refuse cameras without parallax, unless that was accepted.
pub(super) fn check_parallax(data: &Dataset, run: &RunOptions) -> Result<(), SystemError> {
    if accepts_no_parallax(run)? || !has_no_parallax(data) {
        return Ok(());
    }
    Err(no_parallax(data, "no parallax, so no depth; check the poses"))
}
