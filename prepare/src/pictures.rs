//! The first stage: a video's frames, or photos, to the scene's pictures.

use crate::error::PrepareError;
use crate::heic::{Converter, is_heic};
use crate::input::{Input, Photos, names};
use crate::photo::{self, Picture};
use crate::request::Request;
use crate::stage::{Stages, State, fresh_folder, hash, remove_folder, stamp};
use crate::tool::Log;
use crate::video::{Ffmpeg, Wanted};
use crate::watch::{Event, Meter, Watch};
use rayon::prelude::*;
use scene_io::with_photo;
use std::path::{Path, PathBuf};

/// The pictures of the scene.
pub(crate) struct Made {
    /// In order.
    pub(crate) pictures: Vec<Picture>,
    /// Whether the order is that of a video.
    pub(crate) in_order: bool,
    /// Hash of what they were made from.
    pub(crate) hash: String,
}

const STAGE: &str = "pictures";
/// Photos decoded before progress is told.
const CHUNK: usize = 8;
/// Names of a list that are shown.
const SHOWN: usize = 8;

/// Writes the pictures into `images` of the scene, unless they are there.
///
/// # Errors
/// [`PrepareError`] where nothing is left to work with, or a program is missing.
pub(crate) fn pictures(
    request: &Request,
    input: &Input,
    stages: &Stages,
    log: &mut Log,
    watch: &mut dyn Watch,
) -> Result<Made, PrepareError> {
    let inputs = inputs(request, input);
    let in_order = matches!(input, Input::Video(_));
    let folder = request.out.join("images");
    if let State::Done(facts) = stages.state(STAGE, &inputs)
        && let Ok(pictures) = serde_json::from_value::<Vec<Picture>>(facts)
        && pictures.iter().all(|p| folder.join(&p.name).is_file())
    {
        watch.event(Event::Note(&format!("pictures: {} done before", pictures.len())));
        return Ok(Made { pictures, in_order, hash: inputs });
    }
    stages.begin(STAGE, &inputs)?;
    let scratch = stages.folder.join("scratch");
    let pictures = match input {
        Input::Video(video) => of_video(request, video, &folder, &scratch, log, watch)?,
        Input::Photos(photos) => of_photos(request, photos, &folder, &scratch, log, watch)?,
    };
    remove_folder(&scratch)?;
    if pictures.len() < 2 {
        let what = format!("only {} of its pictures can be used", pictures.len());
        return Err(PrepareError::input(&request.input, what, "cameras need at least two, better thirty"));
    }
    let facts = serde_json::to_value(&pictures).unwrap_or_default();
    stages.finish(STAGE, &inputs, facts)?;
    Ok(Made { pictures, in_order, hash: inputs })
}

/// Hash of what pictures depend on.
fn inputs(request: &Request, input: &Input) -> String {
    let longest = format!("{:?}", request.longest_side);
    match input {
        Input::Video(video) => hash(["video".into(), stamp(video), request.frames.to_string(), longest]),
        Input::Photos(photos) => {
            hash(["photos".to_string(), longest].into_iter().chain(photos.files.iter().map(|f| stamp(f))))
        }
    }
}

fn of_video(
    request: &Request,
    video: &Path,
    folder: &Path,
    scratch: &Path,
    log: &mut Log,
    watch: &mut dyn Watch,
) -> Result<Vec<Picture>, PrepareError> {
    let ffmpeg = Ffmpeg::find(&request.tools)?;
    let about = ffmpeg.about(&request.tools, video)?;
    watch.event(Event::Note(&format!(
        "{}: {:.1} s, {}x{}, {:.1} frames a second; ffmpeg {}",
        video.display(),
        about.seconds,
        about.size.0,
        about.size.1,
        about.rate.0 as f64 / about.rate.1 as f64,
        ffmpeg.version(&request.tools)
    )));
    let wanted = Wanted { frames: request.frames, longest: request.longest_side, about, folder, scratch };
    let names = ffmpeg.frames(&request.tools, video, &wanted, log, watch)?;
    let picture = |name: String| {
        let path = folder.join(&name);
        let size = with_photo(&path, 0, |p| (p.width(), p.height()))?;
        Ok(Picture { name, source: video.display().to_string(), size, device: "video".into(), focal: None })
    };
    names.into_par_iter().map(picture).collect()
}

fn of_photos(
    request: &Request,
    photos: &Photos,
    folder: &Path,
    scratch: &Path,
    log: &mut Log,
    watch: &mut dyn Watch,
) -> Result<Vec<Picture>, PrepareError> {
    if !photos.others.is_empty() {
        watch.event(Event::Note(&format!("not photos, left out: {}", listing(&request.input, &photos.others))));
    }
    fresh_folder(folder)?;
    fresh_folder(scratch)?;
    let converter = match photos.files.iter().any(|f| is_heic(f)) {
        true => Some(Converter::find(&request.tools)?),
        false => None,
    };
    let names = names(&request.input, &photos.files, photo::ending);
    let mut meter = Meter::new("read photos", photos.files.len());
    let (mut pictures, mut read) = (Vec::new(), 0);
    let jobs: Vec<(&PathBuf, &String)> = photos.files.iter().zip(&names).collect();
    for chunk in jobs.chunks(CHUNK) {
        let mut ready = Vec::with_capacity(chunk.len());
        for (photo, name) in chunk {
            let pixels = match &converter {
                Some(converter) if is_heic(photo) => {
                    let png = scratch.join(format!("{name}.png"));
                    match converter.convert(&request.tools, photo, &png, log, watch) {
                        Ok(()) => png,
                        Err(PrepareError::Stopped) => return Err(PrepareError::Stopped),
                        Err(error) => {
                            watch.event(Event::Warning(&format!("left out: {}: {error}", photo.display())));
                            continue;
                        }
                    }
                }
                _ => photo.to_path_buf(),
            };
            ready.push((*photo, *name, pixels));
        }
        let written: Vec<Result<Picture, PrepareError>> = ready
            .par_iter()
            .map(|(photo, name, pixels)| photo::write(photo, pixels, folder, name, request.longest_side))
            .collect();
        for result in written {
            match result {
                Ok(picture) => pictures.push(picture),
                // A photo that is broken is left out; a full disk ends everything.
                Err(PrepareError::Scene(error)) if error.kind() == scene_io::ErrorKind::Image => {
                    watch.event(Event::Warning(&format!("left out: {error}")));
                }
                Err(error) => return Err(error),
            }
        }
        read += chunk.len();
        meter.reach(read, watch);
        if watch.stop_asked() {
            return Err(PrepareError::Stopped);
        }
    }
    Ok(pictures)
}

/// The first few names.
fn listing(root: &Path, files: &[PathBuf]) -> String {
    let name = |p: &PathBuf| p.strip_prefix(root).unwrap_or(p).display().to_string();
    let mut names: Vec<String> = files.iter().take(SHOWN).map(name).collect();
    if files.len() > SHOWN {
        names.push(format!("and {} more", files.len() - SHOWN));
    }
    names.join(", ")
}
