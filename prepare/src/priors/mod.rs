//! Priors of a scene that moves and has none: flow to the neighbours in time, and what moves; of a drawn scene exactly, with disparities.

mod exact;
mod film;
mod mask;
mod names;
mod neighbours;
mod pairs;
mod sequence;
mod summary;

pub use film::Film;
pub use sequence::Sequence;
pub use summary::{FitSummary, PriorsSummary};

use crate::error::PrepareError;
use crate::motion::{Fit, Motion, Neighbour, motion, motion_without_cameras};
use crate::stage::{Stages, State, hash, hash_bytes, stamp};
use crate::watch::{Event, Meter, Watch};
use exact::Exact;
use names::{DISPARITY, EXACT, FLOW, Files, MADE, MASKS};
use neighbours::Place;
use pairs::{Pair, Pairs};
use scene_io::synthetic::Drawn;
use scene_io::{Flow, Frame, ImageSource, ImageStore, Size, StoreOptions, write_disparity, write_flo};
use std::path::{Path, PathBuf};
use summary::Found;

/// Bytes of decoded photos that are kept: each is needed twice, one after the other.
const PHOTO_BYTES: u64 = 256 << 20;
/// What is made, and how: another version is made anew.
const VERSION: &str = "flow and masks 1";
const EXACT_VERSION: &str = "exact flow, masks and disparities 1";
/// Hashed besides [`VERSION`] for photos without cameras: how their masks are made. Another version makes flow and masks anew.
const WITHOUT_CAMERAS: &str = "without cameras 1";

/// Which priors are to be made.
#[derive(Clone, Debug)]
pub struct PriorsRequest<'a> {
    /// The photos, in the order of time.
    pub sequence: Sequence<'a>,
    /// What the scene was drawn from: priors are exact then, and there are disparities; a film has none. `None`: they are what the photos tell.
    pub exact: Option<&'a Drawn>,
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
/// moves, 0 stays, 127 was not judged) into a folder; where priors are exact, disparities as well (`disp/NAME.npy`). What is there and was made from
/// the same photos and cameras is kept. Photos of a film without cameras are training photos, all of them.
///
/// # Errors
/// [`PrepareError`], with what to do about it.
pub fn priors(request: &PriorsRequest<'_>, watch: &mut dyn Watch) -> Result<PriorsSummary, PrepareError> {
    let sequence = request.sequence;
    let places = neighbours::in_time(sequence.frames(), request.frames);
    if places.len() < 2 {
        let what = format!("has {} training photos", places.len());
        return Err(PrepareError::input(sequence.root(), what, "flow needs two at least"));
    }
    if request.exact.is_some() && !sequence.has_cameras() {
        let remedy = "only drawn scenes have exact priors: leave out --exact";
        return Err(PrepareError::input(sequence.root(), "holds photos alone", remedy));
    }
    let kind = Kind::of(request);
    let stages = Stages { folder: request.out.join(kind.markers) };
    claim(&request.out, kind)?;
    let options = StoreOptions::default().with_longest_side(request.longest_side).with_budget_bytes(PHOTO_BYTES);
    let photos = ImageStore::new(sequence.frames(), options)?;
    photos.check_sizes()?;
    let jobs = jobs(request, &photos, &places)?;
    let mut found: Vec<Option<Found>> = jobs.iter().map(|job| done(job, request, &stages)).collect();
    if !sequence.has_cameras() {
        let plan = "no cameras: what moves is what leaves the fundamental matrix of the flow between two photos, or their homography where GRIC \
                    prefers it";
        watch.event(Event::Note(plan));
    }
    let kept = found.iter().flatten().count();
    if kept > 0 {
        watch.event(Event::Note(&format!("priors: {kept} of {} photos done before", jobs.len())));
    }
    let mut meter = Meter::new(kind.stage, jobs.len() - kept);
    let exact = request.exact.map(|drawn| Exact::new(drawn, sequence.frames(), &photos));
    let (mut pairs, mut made) = (Pairs::new(&photos, exact), 0);
    for (job, found) in jobs.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
        if watch.stop_asked() {
            return Err(PrepareError::Stopped);
        }
        *found = Some(make(job, request, &stages, &mut pairs)?);
        made += 1;
        meter.reach(made, watch);
    }
    let photos: Vec<(&str, Found)> =
        jobs.iter().zip(found).map(|(job, found)| (job.frame.name.as_str(), found.unwrap_or_default())).collect();
    Ok(PriorsSummary::of(&photos, kept, request.exact.is_some()))
}

/// Where priors come from: a folder holds those of one kind.
#[derive(Clone, Copy)]
struct Kind {
    /// The command that makes them.
    words: &'static str,
    /// Folder of the markers.
    markers: &'static str,
    /// Folders of the files.
    folders: &'static [&'static str],
    version: &'static str,
    /// In lines of progress.
    stage: &'static str,
}

/// From the photos.
const OF_PHOTOS: Kind =
    Kind { words: "priors", markers: MADE, folders: &[FLOW, MASKS], version: VERSION, stage: "flow and masks" };
/// From what the scene was drawn from.
const OF_DRAWN: Kind = Kind {
    words: "priors --exact",
    markers: EXACT,
    folders: &[FLOW, MASKS, DISPARITY],
    version: EXACT_VERSION,
    stage: "exact priors",
};

impl Kind {
    fn of(request: &PriorsRequest<'_>) -> Self {
        if request.exact.is_some() { OF_DRAWN } else { OF_PHOTOS }
    }

    /// The kind that this is not.
    fn other(self) -> Self {
        if self.markers == EXACT { OF_PHOTOS } else { OF_DRAWN }
    }
}

/// Priors that other programs made are left alone, and so are those of the other kind: files of both would be read together.
fn claim(out: &Path, kind: Kind) -> Result<(), PrepareError> {
    const REMEDY: &str = "give another folder as --out, or move it away";
    let (made, other) = (out.join(kind.markers), kind.other());
    if out.join(other.markers).is_dir() {
        return Err(PrepareError::input(out, format!("holds what `{}` made", other.words), REMEDY));
    }
    if !made.is_dir() {
        for folder in kind.folders.iter().map(|name| out.join(name)) {
            if std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
                let what = format!("holds files that were not made by `{}`", kind.words);
                return Err(PrepareError::input(folder, what, REMEDY));
            }
        }
    }
    std::fs::create_dir_all(&made).map_err(PrepareError::io(&made, "make the folder"))
}

/// What each photo needs, in the order of time.
fn jobs<'a>(request: &PriorsRequest<'a>, photos: &ImageStore, places: &[Place]) -> Result<Vec<Job<'a>>, PrepareError> {
    let sequence = request.sequence;
    let frames = sequence.frames();
    // Of all photos: names depend neither on the split nor on how many are asked for.
    let lies: Vec<PathBuf> = frames.iter().map(|frame| frame.path_within(sequence.root()).to_path_buf()).collect();
    let files = Files::of(&request.out, &lies)?;
    let version = Kind::of(request).version;
    let about = |i: usize| format!("{} {:?}", photo_stamp(&frames[i]), photos.camera(i));
    let job = |place: &Place| {
        let [before, after] = [place.before, place.after].map(|i| i.map_or_else(|| "none".into(), about));
        let judged = (!sequence.has_cameras()).then(|| WITHOUT_CAMERAS.to_owned());
        let inputs = hash([version.to_owned(), about(place.frame), before, after].into_iter().chain(judged));
        Job { frame: &frames[place.frame], place: *place, files: files[place.frame].clone(), inputs }
    };
    Ok(places.iter().map(job).collect())
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
fn done(job: &Job<'_>, request: &PriorsRequest<'_>, stages: &Stages) -> Option<Found> {
    let State::Done(facts) = stages.state(&job.files.stage, &job.inputs) else { return None };
    let Files { forward, backward, mask, disparity, .. } = &job.files;
    let is_there = |file: &Path, is_wanted: bool| !is_wanted || request.out.join(file).is_file();
    let all = is_there(forward, job.place.after.is_some())
        && is_there(backward, job.place.before.is_some())
        && is_there(mask, true)
        && is_there(disparity, request.exact.is_some());
    if all { serde_json::from_value(facts).ok() } else { None }
}

/// Makes the priors of a photo.
fn make(
    job: &Job<'_>,
    request: &PriorsRequest<'_>,
    stages: &Stages,
    pairs: &mut Pairs<'_>,
) -> Result<Found, PrepareError> {
    // Files of other inputs must not be taken for these, should this be stopped half way.
    stages.begin(&job.files.stage, &job.inputs)?;
    let Place { frame, before, after } = job.place;
    let back = before.map(|before| pairs.get(before, frame)).transpose()?;
    let on = after.map(|after| pairs.get(frame, after)).transpose()?;
    let (back, on) = (back.as_ref().map(Pair::backward), on.as_ref().map(Pair::forward));
    for (file, flow) in [(&job.files.backward, back), (&job.files.forward, on)] {
        let path = request.out.join(file);
        match flow {
            Some(flow) => write_flo(&path, flow)?,
            None => remove(&path)?,
        }
    }
    let neighbours: Vec<Neighbour<'_>> = [(before, back), (after, on)]
        .into_iter()
        .filter_map(|(i, flow)| Some(Neighbour { camera: pairs.camera(i?), flow: flow? }))
        .collect();
    let camera = pairs.camera(frame);
    let (moves, fits) = match pairs.exact() {
        Some(exact) => {
            write_disparity(&request.out.join(&job.files.disparity), &exact.disparity(frame)?)?;
            (exact.motion(frame)?, Vec::new())
        }
        None if request.sequence.has_cameras() => (motion(camera, &neighbours), Vec::new()),
        None => {
            let flows: Vec<&Flow> = neighbours.iter().map(|neighbour| neighbour.flow).collect();
            motion_without_cameras(Size::from(camera), &flows)
        }
    };
    mask::write_motion(&request.out.join(&job.files.mask), &moves)?;
    let found = found(&moves, &neighbours, fits);
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

fn found(moves: &Motion, neighbours: &[Neighbour<'_>], fits: Vec<Fit>) -> Found {
    let seen: Vec<f64> = neighbours.iter().map(|neighbour| neighbour.flow.seen.share()).collect();
    Found {
        seen: (!seen.is_empty()).then(|| seen.iter().sum::<f64>() / seen.len() as f64),
        judged: moves.judged.share(),
        moving: moves.moving.share(),
        fits,
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_of_films;
