//! Features of the photos of a data set: arrays of a self-supervised network, in files beside them.

use crate::limits::refuse;
use engine::data::Dataset;
use engine::system::SystemError;
use scene_io::{Features, Scene};
use std::collections::HashMap;
use std::sync::Arc;

/// The setting that asks for features, for errors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AskedBy {
    pub(crate) field: &'static str,
    /// As it is written.
    pub(crate) value: &'static str,
    /// The value with which none are needed, as it is written on the command line.
    pub(crate) without: &'static str,
}

/// The features of all training views, or none at all.
///
/// # Errors
/// [`SystemError::Scene`] for a file that cannot be read, [`SystemError::Config`] naming a photo that has none where others have, or the
/// file of one whose vectors have another length.
pub(crate) fn read_features(scene: &Scene, data: &Dataset, asked: AskedBy) -> Result<Vec<Arc<Features>>, SystemError> {
    let mut known: HashMap<usize, Arc<Features>> = HashMap::new();
    let (mut out, mut without) = (Vec::new(), None);
    for view in data.views() {
        let frame = &scene.frames[view.frame];
        let features = match known.get(&view.frame) {
            Some(features) => features.clone(),
            None => match frame.read_features()? {
                Some(features) => Arc::new(features),
                None => {
                    without = without.or(Some(&view.name));
                    continue;
                }
            },
        };
        known.insert(view.frame, features.clone());
        out.push((features, &frame.priors.features));
    }
    let refuse = |problem: String| refuse(asked.field, asked.value, problem);
    let Some((first, first_path)) = out.first() else { return Ok(Vec::new()) };
    let name = |path: &Option<std::path::PathBuf>| path.as_ref().map_or(String::new(), |p| p.display().to_string());
    if let Some((features, path)) = out.iter().find(|(f, _)| f.channels != first.channels) {
        let (path, channels) = (name(path), features.channels);
        let (first_path, wanted) = (name(first_path), first.channels);
        let problem = format!("{path}: holds {channels} channels, and {first_path} {wanted}: make all of them alike");
        return refuse(problem);
    }
    if let Some(photo) = without {
        let problem = format!(
            "photo `{photo}` has no `.features.npy` beside it, others have: make it, or go without any (`--set {}`)",
            asked.without
        );
        return refuse(problem);
    }
    Ok(out.into_iter().map(|(features, _)| features).collect())
}

/// Whether any photo of the training views has a file of features.
pub(crate) fn has_features(scene: &Scene, data: &Dataset) -> bool {
    data.views().iter().any(|view| scene.frames[view.frame].priors.features.is_some())
}
