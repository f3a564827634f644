//! From what a dialect lists to frames: images found, sizes compared, masks matched, names made unique.
//!
//! Every dialect ends here, so that all treat missing, duplicate and wrongly sized images alike.

use crate::files::with_image_extension;
use crate::given_priors;
use crate::limits::{check_camera, is_depth_range};
use crate::listing::listing;
use crate::mask_files::find_mask;
use crate::options::{LoadOptions, MissingImages};
use crate::picture::{Plan, foreign, same_shape, wrong_size};
use crate::pose::Mended;
use crate::priors::{Priors, TrackPoint, TruthMask};
use crate::reading::{Need, RawFrame, Reading};
use crate::{AlphaMeaning, Frame, ImageSource, MaskPolarity, Problem, Size, Split, Truth};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Frames with their images, what was noticed, and what is wrong.
#[derive(Debug, Default)]
pub(crate) struct Assembled {
    pub(crate) frames: Vec<Frame>,
    pub(crate) notes: Vec<String>,
    pub(crate) problems: Vec<Problem>,
    /// Whether any image has alpha.
    pub(crate) has_alpha: bool,
}

/// Looks at every image's header and makes frames of what fits.
pub(crate) fn assemble(reading: &Reading, options: &LoadOptions) -> Assembled {
    let mut out = Assembled::default();
    let unique = without_duplicates(reading, &mut out);
    let inspected: Vec<Inspected> = unique.par_iter().map(|raw| inspect(raw, reading, options)).collect();

    let (mut missing, mut renamed, mut resized, mut masked) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for (raw, inspected) in unique.iter().zip(inspected) {
        match inspected {
            Inspected::Frame { frame, other_name, other_size, has_alpha } => {
                out.has_alpha |= has_alpha;
                if other_name {
                    renamed.push(raw.name.as_str());
                }
                if let (Some(was), ImageSource::File(_)) = (other_size, &frame.image) {
                    resized.push((raw.name.as_str(), was, frame.size()));
                }
                masked += usize::from(frame.mask.is_some());
                out.frames.push(*frame);
            }
            Inspected::Missing => missing.push(*raw),
            Inspected::Bad(problem) => out.problems.push(*problem),
        }
    }
    report_missing(&missing, unique.len(), options.missing_images.unwrap_or(reading.missing), &mut out);
    if !renamed.is_empty() {
        out.notes.push(format!("found under another extension than listed: {}", listing(&renamed)));
    }
    if let Some((_, was, is)) = resized.first() {
        let names: Vec<&str> = resized.iter().map(|r| r.0).collect();
        let whose =
            if names.len() == out.frames.len() { format!("all {} frames", names.len()) } else { listing(&names) };
        out.notes.push(format!(
            "cameras scaled to the images ({was} listed, {is} found{}): {}",
            if resized.iter().all(|r| (r.1, r.2) == (resized[0].1, resized[0].2)) { "" } else { " in the first" },
            whose
        ));
    }
    if masked > 0 {
        let kind = match polarity(reading, options) {
            MaskPolarity::WhiteIsObject => "an object mask: what is around it is empty",
            _ => "an ignore mask",
        };
        out.notes.push(format!("{masked} of {} frames have {kind}", out.frames.len()));
    }
    if let Some(folder) = &options.priors {
        given_priors::put(&reading.root, &mut out.frames, folder);
    }
    note_priors(&mut out);
    note_mended(&unique, &mut out);
    out
}

/// What white means in masks: what the caller says, and where that is the default, what the dialect says.
fn polarity(reading: &Reading, options: &LoadOptions) -> MaskPolarity {
    match options.mask_polarity {
        MaskPolarity::WhiteIsUsed => reading.mask_polarity,
        other => other,
    }
}

enum Inspected {
    Frame { frame: Box<Frame>, other_name: bool, other_size: Option<Size>, has_alpha: bool },
    Missing,
    Bad(Box<Problem>),
}

fn inspect(raw: &RawFrame, reading: &Reading, options: &LoadOptions) -> Inspected {
    let found = find_image(&raw.image);
    let (path, other_name, is, channels) = match (found, reading.need, raw.size) {
        (found, Need::Cameras, Some(size)) => {
            let (path, other_name) = found.unwrap_or_else(|| (raw.image.clone(), false));
            (path, other_name, size, 3)
        }
        (None, ..) => return Inspected::Missing,
        (Some((path, other_name)), ..) => match Plan::of(&path) {
            Ok(header) => (path, other_name, header.size, header.channels()),
            Err(error) => return Inspected::Bad(Box::new(error.in_frame(&raw.name).into_problem())),
        },
    };
    let said = raw.size.unwrap_or(is);
    if !same_shape(said, is) {
        return Inspected::Bad(Box::new(wrong_size(&path, is, said).frame(&raw.name)));
    }
    let camera = raw.intrinsics.camera(said.width, said.height, raw.lens, raw.pose);
    let (file, place) = &raw.listed;
    if let Err(problem) = check_camera(&camera, file, place) {
        return Inspected::Bad(Box::new(problem.frame(&raw.name)));
    }
    let camera = camera.resized(is.width, is.height);
    let mask = match find_mask(raw, &path, reading, options) {
        Ok(mask) => mask,
        Err(problem) => return Inspected::Bad(Box::new(problem)),
    };
    if let Some(truth) = raw.transient.as_ref().filter(|truth| !truth.is_file()) {
        let (file, field) = &raw.listed;
        let problem = Problem::new(file, "the truth mask is not there", "add it, or remove the field");
        return Inspected::Bad(Box::new(problem.frame(&raw.name).field(field).value(truth.display())));
    }
    let scale = [f64::from(is.width) / f64::from(said.width), f64::from(is.height) / f64::from(said.height)];
    let scaled = |pixel: [f32; 2]| [0, 1].map(|k| (f64::from(pixel[k]) * scale[k]) as f32);
    let frame = Frame {
        name: raw.name.clone(),
        priors: Priors::beside(&path, &reading.root),
        image: ImageSource::File(path),
        mask,
        mask_polarity: polarity(reading, options),
        depth: raw.depth.clone(),
        truth: Truth {
            transient: raw.transient.clone().map(TruthMask::File),
            moving: raw.moving.clone().map(TruthMask::File),
            covisible: raw.covisible.clone().map(TruthMask::File),
            flow: raw.flow.clone(),
            scene_flow: None,
        },
        ids: raw.ids,
        alpha: reading.alpha,
        tracks: raw.tracks.iter().map(|t| TrackPoint { pixel: scaled(t.pixel), ..*t }).collect(),
        perturbation: None,
        camera,
        split: raw.split,
        time: raw.time,
        z_bounds: raw.z_bounds.filter(|range| is_depth_range(*range)),
        sharpness: raw.sharpness,
    };
    Inspected::Frame {
        frame: Box::new(frame),
        other_name,
        other_size: (said != is).then_some(said),
        has_alpha: channels == 4 && reading.alpha == AlphaMeaning::Opacity,
    }
}

/// The listed file, the same with an extension appended, or the same with another extension (`true`); what was made of a
/// photo that cannot be read before that photo.
fn find_image(listed: &Path) -> Option<(PathBuf, bool)> {
    if let Some(converted) = foreign::converted(listed) {
        return Some((converted, true));
    }
    if let Some(found) = with_image_extension(listed) {
        return Some((found, false));
    }
    let has_image_extension = crate::files::is_image(listed);
    let other = if has_image_extension { with_image_extension(&listed.with_extension("")) } else { None };
    other.map(|found| (found, true))
}

/// Frames whose name was not met before. Twice in one split is an error; the same frame for validation and testing is
/// kept for testing; the same for training and measuring is a warning, and then it is for training only: its score would
/// mean nothing.
fn without_duplicates<'a>(reading: &'a Reading, out: &mut Assembled) -> Vec<&'a RawFrame> {
    let mut seen: HashMap<&str, usize> = HashMap::new();
    let mut kept: Vec<&RawFrame> = Vec::with_capacity(reading.frames.len());
    let (mut shared, mut moved) = (Vec::new(), Vec::new());
    for raw in &reading.frames {
        let Some(&first) = seen.get(raw.name.as_str()) else {
            seen.insert(&raw.name, kept.len());
            kept.push(raw);
            continue;
        };
        let before = kept[first];
        let (file, field) = &raw.listed;
        if before.split == raw.split {
            let what = format!("is listed twice, first as `{}` of {}", before.listed.1, before.listed.0.display());
            out.problems.push(Problem::new(file, what, "remove one of the two").frame(&raw.name).field(field));
        } else if before.split == Split::Train || raw.split == Split::Train {
            let what = format!(
                "is for training and for {} at once",
                if raw.split == Split::Val { "validation" } else { "testing" }
            );
            let problem = Problem::new(file, what, "scores on it mean nothing: remove it from one of the two lists");
            out.problems.push(problem.frame(&raw.name).field(field).warning());
            shared.push(raw.name.as_str());
        } else {
            if raw.split == Split::Test {
                kept[first] = raw;
            }
            moved.push(raw.name.as_str());
        }
    }
    if !shared.is_empty() {
        out.notes.push(format!("listed for training too, so used for training only: {}", listing(&shared)));
    }
    if !moved.is_empty() {
        out.notes.push(format!("listed for validation and testing, used for testing: {}", listing(&moved)));
    }
    kept
}

fn report_missing(missing: &[&RawFrame], total: usize, policy: MissingImages, out: &mut Assembled) {
    if missing.is_empty() {
        return;
    }
    let names: Vec<&str> = missing.iter().map(|raw| raw.name.as_str()).collect();
    match policy {
        MissingImages::Skip => {
            let note = format!(
                "{} of {total} listed images are not there and were skipped: {}",
                missing.len(),
                listing(&names)
            );
            out.notes.push(note);
        }
        MissingImages::Refuse => {
            for raw in missing {
                let (file, field) = &raw.listed;
                // A photo in a format that is not read, in place of its JPEG: how to make that.
                let foreign = foreign::in_place_of(&raw.image).and_then(|found| foreign::refusal(&found));
                if let Some(refusal) = foreign {
                    out.problems.push(refusal.in_frame(&raw.name).into_problem());
                    continue;
                }
                let problem = Problem::new(file, "the image is not there", "add the file or remove its frame");
                out.problems.push(problem.frame(&raw.name).field(field).value(raw.image.display()));
            }
        }
    }
}

fn note_priors(out: &mut Assembled) {
    let count = |has: &dyn Fn(&Frame) -> bool| out.frames.iter().filter(|f| has(f)).count();
    let kinds = [
        ("segments", count(&|f| f.priors.segments.is_some())),
        ("segments around feature points", count(&|f| f.priors.prompted.is_some())),
        ("dense features", count(&|f| f.priors.features.is_some())),
        ("optical flow to the next photo", count(&|f| f.priors.motion.forward.is_some())),
        ("optical flow to the photo before", count(&|f| f.priors.motion.backward.is_some())),
        ("disparity", count(&|f| f.priors.motion.disparity.is_some())),
        ("masks of what moves", count(&|f| f.priors.motion.mask.is_some())),
        ("truth masks of what does not belong there (for scoring only)", count(&|f| f.truth.transient.is_some())),
        ("truth masks of what moves (for scoring only)", count(&|f| f.truth.moving.is_some())),
        ("truth masks of what training frames show, too (for scoring only)", count(&|f| f.truth.covisible.is_some())),
        ("exact flow to another frame (for scoring only)", count(&|f| f.truth.flow.is_some())),
    ];
    for (what, n) in kinds.into_iter().filter(|(_, n)| *n > 0) {
        out.notes.push(format!("{n} of {} frames have {what}", out.frames.len()));
    }
}

fn note_mended(frames: &[&RawFrame], out: &mut Assembled) {
    let scaled: Vec<&str> =
        frames.iter().filter(|f| matches!(f.mended, Mended::Scale(_))).map(|f| f.name.as_str()).collect();
    if let Some(Mended::Scale(scale)) = frames.iter().map(|f| f.mended).find(|m| matches!(m, Mended::Scale(_))) {
        let names = listing(&scaled);
        out.notes.push(format!("rotations held a scale ({scale:.6} in the first), divided out: {names}"));
    }
    let deviations = frames.iter().filter_map(|f| match f.mended {
        Mended::Orthonormal(off) => Some((off, f.name.as_str())),
        _ => None,
    });
    let (mut worst, mut names) = (0.0_f64, Vec::new());
    for (off, name) in deviations {
        worst = worst.max(off);
        names.push(name);
    }
    if !names.is_empty() {
        let names = listing(&names);
        out.notes.push(format!("rotations not quite orthonormal (by up to {worst:.1e}), mended: {names}"));
    }
}
