//! From a path to a [`Scene`].

use crate::assemble::{Assembled, assemble};
use crate::detect::{Found, detect};
use crate::error::one_line;
use crate::reading::{Need, Reading};
use crate::validation;
use crate::{
    Dialect, ErrorKind, LayoutHint, LoadOptions, Problem, Scene, SceneError, Severity, blender, colmap, endonerf,
    given_priors, instant_ngp, llff, naming, nerfies, nerfstudio, nr_nerf, splits, time,
};
use std::path::Path;

/// Reads a dataset from its folder or main file, in whatever dialect it is.
///
/// Image headers are read, pixels are not (but the tool masks of EndoNeRF's form are): see [`crate::ImageStore`]. Warnings
/// are among [`Scene::notes`].
///
/// # Errors
/// The first thing that makes training impossible, and how many more there are; [`crate::check`] lists all.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene, SceneError> {
    let (scene, problems) = load_all(path, options, Need::Images)?;
    without_errors(scene, problems)
}

/// As [`load`], for datasets whose images are not at hand: cameras, times and splits are those of the files, and
/// [`crate::ImageSource`] says where the images should be. Masks, depth maps and other files are named, not opened.
///
/// # Errors
/// As [`load`], except for missing images. Where files do not say how large the images are (Blender's form), those are
/// needed all the same.
pub fn load_cameras(path: &Path, options: &LoadOptions) -> Result<Scene, SceneError> {
    let (scene, problems) = load_all(path, options, Need::Cameras)?;
    without_errors(scene, problems)
}

fn without_errors(mut scene: Scene, problems: Vec<Problem>) -> Result<Scene, SceneError> {
    let (errors, warnings): (Vec<Problem>, Vec<Problem>) =
        problems.into_iter().partition(|p| p.severity == Severity::Error);
    let mut errors = errors.into_iter();
    match errors.next() {
        None => {
            scene.notes.extend(warnings.iter().map(|warning| format!("warning: {warning}")));
            Ok(scene)
        }
        Some(first) => Err(SceneError::new(kind_of(&first), first).and_more(errors.count())),
    }
}

/// Problems collected while reading were checked values, except those of image files.
fn kind_of(problem: &Problem) -> ErrorKind {
    if crate::files::is_image(&problem.file) { ErrorKind::Image } else { ErrorKind::Value }
}

/// The scene as far as it could be read, and all problems met. Where problems leave no frame to train on, they are
/// the error.
pub(crate) fn load_all(path: &Path, options: &LoadOptions, need: Need) -> Result<(Scene, Vec<Problem>), SceneError> {
    let (found, mut notes) = detect(path, options)?;
    let dialect = found.dialect();
    let mut reading = read(found, options, need)?;
    reading.need = need;
    naming::apply(&mut reading, dialect, options)?;
    time::apply(&mut reading, dialect);
    let Assembled { mut frames, notes: more_notes, problems: more_problems, has_alpha } = assemble(&reading, options);
    let Reading {
        root,
        points,
        mut layout,
        layout_needs_alpha,
        bounds,
        splits,
        notes: reading_notes,
        mut problems,
        ..
    } = reading;
    notes.extend(reading_notes);
    notes.extend(more_notes);
    problems.extend(more_problems);
    if layout_needs_alpha && !has_alpha {
        layout = LayoutHint::Unknown;
        notes.push("no alpha, and no near and far in the file: not taken for an object on an empty background".into());
    }
    let split = splits::apply(&root, &mut frames, splits, options.holdout.as_ref(), &mut notes).and_then(|()| {
        options.validation.as_ref().map_or(Ok(()), |v| validation::apply(&root, &mut frames, v, &mut notes))
    });
    // Told as an empty split is: the photos that have priors may be among the broken frames, which are named first.
    let split = split
        .and_then(|()| options.priors.as_ref().map_or(Ok(()), |folder| given_priors::refuse_nothing(&frames, folder)));
    time::tell(&frames, &mut notes);
    // Names in files may hold line ends, and what terminals obey.
    notes.iter_mut().for_each(|note| *note = one_line(note).into_owned());
    if let Err(error) = split {
        // With broken frames left out, an empty split may only be their consequence: they are named first.
        let mut errors = problems.iter().filter(|p| p.severity == Severity::Error).cloned();
        let Some(first) = errors.next() else { return Err(error) };
        problems.retain(|p| *p != first);
        let scene = Scene { name: name_of(&root), root, dialect, frames, points, layout, bounds, notes };
        let mut all = vec![first];
        all.extend(problems);
        all.push(error.into_problem());
        return Ok((scene, all));
    }
    Ok((Scene { name: name_of(&root), root, dialect, frames, points, layout, bounds, notes }, problems))
}

fn read(found: Found, options: &LoadOptions, need: Need) -> Result<Reading, SceneError> {
    match found {
        Found::Blender(train) => blender::read(&train, options),
        Found::Transforms(Dialect::Nerfstudio, document) => nerfstudio::read(&document),
        Found::Transforms(_, document) => instant_ngp::read(&document),
        Found::Colmap(root, models) => colmap::read(&root, &models, options),
        Found::Llff(file) => llff::read(&file, options, need),
        Found::NrNerf(file) => nr_nerf::read(&file, options, need),
        Found::Nerfies(file) => nerfies::read(&file, options, need),
        Found::EndoNerf(file) => endonerf::read(&file, options, need),
    }
}

/// The folder's name, also for `.` and `..`.
fn name_of(root: &Path) -> String {
    let full = root.canonicalize().unwrap_or_else(|_| root.to_path_buf());
    full.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}
