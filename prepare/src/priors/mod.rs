//! Priors of a scene that moves and has none: flow to the neighbours in time, and what moves.

mod mask;
mod names;
mod neighbours;
mod pairs;
mod summary;

pub use summary::PriorsSummary;

use crate::error::PrepareError;
use crate::motion::{Motion, Neighbour, motion};
use crate::stage::{Stages, State, hash, hash_bytes, stamp};
use crate::watch::{Event, Meter, Watch};
use names::{FLOW, Files, MADE, MASKS};
use neighbours::Place;
use pairs::{Pair, Pairs};
use scene_io::{Frame, ImageSource, ImageStore, Scene, StoreOptions, write_flo};
use std::path::{Path, PathBuf};
use summary::Found;

/// Bytes of decoded photos that are kept: each is needed twice, one after the other.
const PHOTO_BYTES: u64 = 256 << 20;
/// What is made, and how: another version is made anew.
const VERSION: &str = "flow and masks 1";

/// Which priors are to be made.
#[derive(Clone, Debug)]
pub struct PriorsRequest<'a> {
    /// The scene; its training photos are in the order of time.
    pub scene: &'a Scene,
    /// Folder of the priors.
    pub out: PathBuf,
    /// Only the first training photos in time; `None`: all.
    pub frames: Option<usize>,
    /// Longest side of the photos, and of the priors; `None`: as they are.
    pub longest_side: Option<u32>,
}

/// What one photo needs.
struct Job<'a> {
    frame: &'a Frame,
    place: Place,
    files: Files,
    /// Hash of everything that its priors depend on.
    inputs: String,
}

/// Writes flow between neighbouring training photos (`flow/NAME_fwd.flo`, `flow/NAME_bwd.flo`) and what moves in each (`motion_masks/NAME.png`: 255
/// moves, 0 stays, 127 was not judged) into a folder. What is there and was made from the same photos and cameras is kept.
///
/// # Errors
/// [`PrepareError`], with what to do about it.
pub fn priors(request: &PriorsRequest<'_>, watch: &mut dyn Watch) -> Result<PriorsSummary, PrepareError> {
    let scene = request.scene;
    let places = neighbours::in_time(scene, request.frames);
    if places.len() < 2 {
        let what = format!("has {} training photos", places.len());
        return Err(PrepareError::input(&scene.root, what, "flow needs two at least"));
    }
    let stages = Stages { folder: request.out.join(MADE) };
    claim(&request.out, &stages.folder)?;
    let options = StoreOptions::default().with_longest_side(request.longest_side).with_budget_bytes(PHOTO_BYTES);
    let photos = ImageStore::new(&scene.frames, options)?;
    photos.check_sizes()?;
    let jobs = jobs(request, &photos, &places)?;
    let mut found: Vec<Option<Found>> = jobs.iter().map(|job| done(job, &request.out, &stages)).collect();
    let kept = found.iter().flatten().count();
    if kept > 0 {
        watch.event(Event::Note(&format!("priors: {kept} of {} photos done before", jobs.len())));
    }
    let mut meter = Meter::new("flow and masks", jobs.len() - kept);
    let (mut pairs, mut made) = (Pairs::new(&photos), 0);
    for (job, found) in jobs.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
        if watch.stop_asked() {
            return Err(PrepareError::Stopped);
        }
        *found = Some(make(job, &request.out, &stages, &mut pairs)?);
        made += 1;
        meter.reach(made, watch);
    }
    let photos: Vec<(&str, Found)> =
        jobs.iter().zip(found).map(|(job, found)| (job.frame.name.as_str(), found.unwrap_or_default())).collect();
    Ok(PriorsSummary::of(&photos, kept))
}

/// Priors that other programs made are left alone.
fn claim(out: &Path, made: &Path) -> Result<(), PrepareError> {
    if !made.is_dir() {
        for folder in [FLOW, MASKS].map(|name| out.join(name)) {
            if std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
                let remedy = "give another folder as --out, or move it away";
                return Err(PrepareError::input(folder, "holds files that were not made by `priors`", remedy));
            }
        }
    }
    std::fs::create_dir_all(made).map_err(PrepareError::io(made, "make the folder"))
}

/// What each photo needs, in the order of time.
fn jobs<'a>(request: &PriorsRequest<'a>, photos: &ImageStore, places: &[Place]) -> Result<Vec<Job<'a>>, PrepareError> {
    let frames = &request.scene.frames;
    // Of all photos: names depend neither on the split nor on how many are asked for.
    let lies: Vec<PathBuf> = frames.iter().map(|frame| lies(&request.scene.root, frame)).collect();
    let files = Files::of(&request.out, &lies)?;
    let about = |i: usize| format!("{} {:?}", photo_stamp(&frames[i]), photos.camera(i));
    let job = |place: &Place| {
        let [before, after] = [place.before, place.after].map(|i| i.map_or_else(|| "none".into(), about));
        let inputs = hash([VERSION.to_owned(), about(place.frame), before, after]);
        Job { frame: &frames[place.frame], place: *place, files: files[place.frame].clone(), inputs }
    };
    Ok(places.iter().map(job).collect())
}

/// Where a photo lies in the folder of the scene; its name where it does not.
fn lies(root: &Path, frame: &Frame) -> PathBuf {
    let inside = match &frame.image {
        ImageSource::File(path) => path.strip_prefix(root).ok(),
        ImageSource::Memory(_) => None,
    };
    inside.unwrap_or(Path::new(&frame.name)).to_path_buf()
}

/// What tells a photo, as it is decoded, from its later versions.
fn photo_stamp(frame: &Frame) -> String {
    let pixels = match &frame.image {
        ImageSource::File(path) => stamp(path),
        ImageSource::Memory(image) => hash_bytes(&image.data),
    };
    let mask = frame.mask.as_deref().map(stamp);
    format!("{pixels} {mask:?} {:?} {:?} {:?}", frame.mask_polarity, frame.alpha, frame.perturbation)
}

/// What an earlier call found out about a photo, if it had the same inputs and its files are there.
fn done(job: &Job<'_>, out: &Path, stages: &Stages) -> Option<Found> {
    let State::Done(facts) = stages.state(&job.files.stage, &job.inputs) else { return None };
    let Files { forward, backward, mask, .. } = &job.files;
    let is_there = |file: &Path, is_wanted: bool| !is_wanted || out.join(file).is_file();
    let all = is_there(forward, job.place.after.is_some())
        && is_there(backward, job.place.before.is_some())
        && is_there(mask, true);
    if all { serde_json::from_value(facts).ok() } else { None }
}

/// Makes the priors of a photo.
fn make(job: &Job<'_>, out: &Path, stages: &Stages, pairs: &mut Pairs<'_>) -> Result<Found, PrepareError> {
    // Files of other inputs must not be taken for these, should this be stopped half way.
    stages.begin(&job.files.stage, &job.inputs)?;
    let Place { frame, before, after } = job.place;
    let back = before.map(|before| pairs.get(before, frame)).transpose()?;
    let on = after.map(|after| pairs.get(frame, after)).transpose()?;
    let (back, on) = (back.as_ref().map(Pair::backward), on.as_ref().map(Pair::forward));
    for (file, flow) in [(&job.files.backward, back), (&job.files.forward, on)] {
        let path = out.join(file);
        match flow {
            Some(flow) => write_flo(&path, flow)?,
            None => remove(&path)?,
        }
    }
    let neighbours: Vec<Neighbour<'_>> = [(before, back), (after, on)]
        .into_iter()
        .filter_map(|(i, flow)| Some(Neighbour { camera: pairs.camera(i?), flow: flow? }))
        .collect();
    let moves = motion(pairs.camera(frame), &neighbours);
    mask::write_motion(&out.join(&job.files.mask), &moves)?;
    let found = found(&moves, &neighbours);
    let facts = serde_json::to_value(&found).unwrap_or_default();
    stages.finish(&job.files.stage, &job.inputs, facts)?;
    Ok(found)
}

/// Removes what an earlier call with other neighbours wrote; where there is nothing that is fine.
fn remove(path: &Path) -> Result<(), PrepareError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(PrepareError::io(path, "remove the file")(e)),
        _ => Ok(()),
    }
}

fn found(moves: &Motion, neighbours: &[Neighbour<'_>]) -> Found {
    let seen: Vec<f64> = neighbours.iter().map(|neighbour| neighbour.flow.seen.share()).collect();
    Found {
        seen: (!seen.is_empty()).then(|| seen.iter().sum::<f64>() / seen.len() as f64),
        judged: moves.judged.share(),
        moving: moves.moving.share(),
    }
}

#[cfg(test)]
mod tests;
