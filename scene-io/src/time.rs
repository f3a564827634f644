//! One meaning of time: `[0, 1]` over the sequence.
//!
//! | dialect | written | here |
//! | --- | --- | --- |
//! | D-NeRF (Blender form) | `time` of a frame, 0 to 1 | as it is; where no frame has time 0, shifted so that the first has |
//! | HDR-HexPlane (Blender form) | `time` of a frame, a frame number | `(t - first) / (last - first)` |
//! | instant-ngp, nerfstudio | `time` of a frame, if any | as D-NeRF or HDR-HexPlane, whichever its numbers are |
//! | Nerfies, HyperNeRF, DyCheck | `time_id`, else `warp_id`, in `metadata.json` | `(id - first) / (last - first)` |
//! | NR-NeRF, EndoNeRF | nothing: images are in time order | `i / (n - 1)`; 0 where there is one image |
//! | COLMAP, LLFF | nothing | no time |
//!
//! First and last are taken over all listed frames of all splits, whether or not their images are there: order is kept, a
//! test frame keeps its distance to the training frames, and no time leaves `[0, 1]`. What each system makes of it (a
//! latent code a time, `2 t - 1`) is the system's.
//!
//! Degenerate times, each with its line among the notes or problems:
//!
//! | times | what happens |
//! | --- | --- |
//! | one frame, or all the same | legal: time 0 for all, noted, nothing can move |
//! | the same several times, or unsorted | legal: views of one time step; frames keep the order of the file |
//! | missing in some frames of a file | their place in the file's list, `i / (n - 1)`, with a warning |
//! | missing in all frames of a file, but not of the others | the same, noted |
//! | missing in all frames | none: a scene that stands still, unless the caller knows better ([`Scene::time_by_order`]) |
//! | not finite | an error that names frame and field |

use crate::listing::listing;
use crate::reading::Reading;
use crate::{Dialect, Frame, Problem, Scene, Split};
use std::collections::HashMap;
use std::path::PathBuf;

/// Time of the `i`th of `n` frames in time order.
pub(crate) fn by_order(i: usize, n: usize) -> f64 {
    if n > 1 { i as f64 / (n - 1) as f64 } else { 0.0 }
}

impl Scene {
    /// Gives frames their place in the list as time, `i / (n - 1)`, if no frame has a time: for callers who know that the
    /// images of a dataset that says nothing are in time order. Returns whether anything was done.
    pub fn time_by_order(&mut self) -> bool {
        let n = self.frames.len();
        if n == 0 || self.frames.iter().any(|f| f.time.is_some()) {
            return false;
        }
        for (i, frame) in self.frames.iter_mut().enumerate() {
            frame.time = Some(by_order(i, n));
        }
        self.notes.push(format!("no times in the files: the order of the {n} frames is taken for it"));
        true
    }
}

/// Brings the written times of all frames to `[0, 1]` and fills in missing ones. Times are finite.
pub(crate) fn apply(reading: &mut Reading, dialect: Dialect) {
    // By the order of all images, also of those that were left out.
    if matches!(dialect, Dialect::NrNerf | Dialect::EndoNerf) {
        return;
    }
    let written = || reading.frames.iter().filter_map(|f| f.time);
    let Some(first) = written().reduce(f64::min) else { return };
    let last = written().fold(first, f64::max);
    let mut notes = Vec::new();
    if first < 0.0 || last > 1.0 {
        // Halves: the difference of the largest numbers is none.
        let length = 0.5 * last - 0.5 * first;
        let map = |t: f64| if length > 0.0 { ((0.5 * t - 0.5 * first) / length).clamp(0.0, 1.0) } else { 0.0 };
        reading.frames.iter_mut().for_each(|f| f.time = f.time.map(map));
        notes.push(format!("times {first} to {last} were mapped to 0 to 1"));
    } else if first > 0.0 {
        reading.frames.iter_mut().for_each(|f| f.time = f.time.map(|t| t - first));
        notes.push(format!("no frame has time 0: times {first} to {last} were shifted to start there"));
    }
    fill(reading, &mut notes);
    let start = reading.frames.iter().find(|f| f.split == Split::Train).and_then(|f| f.time);
    if let (Dialect::Blender, Some(start)) = (dialect, start.filter(|t| *t > 0.0)) {
        notes.push(format!(
            "the first training frame has time {start}, which D-NeRF's own loader refuses; the canonical time is 0 all \
             the same"
        ));
    }
    reading.notes.extend(notes);
}

/// Frames without a time get their place in the list of their file.
fn fill(reading: &mut Reading, notes: &mut Vec<String>) {
    let mut files: HashMap<PathBuf, (usize, usize)> = HashMap::new();
    for frame in &reading.frames {
        let (frames, without) = files.entry(frame.listed.0.clone()).or_default();
        *frames += 1;
        *without += usize::from(frame.time.is_none());
    }
    let mut told: Vec<(&PathBuf, &(usize, usize))> = files.iter().filter(|(_, (_, without))| *without > 0).collect();
    told.sort();
    for (file, (frames, without)) in told {
        if without == frames {
            notes.push(format!(
                "the {frames} frames of {} have no time: their order is taken for it, 0 to 1",
                file.display()
            ));
            continue;
        }
        let names: Vec<&str> = reading
            .frames
            .iter()
            .filter(|f| f.listed.0 == *file && f.time.is_none())
            .map(|f| f.name.as_str())
            .collect();
        let what = format!("{without} of {frames} frames have no time: {}", listing(&names));
        let remedy = "their place in the list is taken for it: write `time` if that is wrong";
        reading.problems.push(Problem::new(file, what, remedy).field("time").warning());
    }
    let mut seen: HashMap<PathBuf, usize> = HashMap::new();
    for frame in &mut reading.frames {
        let i = seen.entry(frame.listed.0.clone()).or_default();
        let n = files.get(&frame.listed.0).map_or(0, |(n, _)| *n);
        frame.time.get_or_insert(by_order(*i, n));
        *i += 1;
    }
}

/// What there is to say about the times of a scene whose splits are known.
pub(crate) fn tell(frames: &[Frame], notes: &mut Vec<String>) {
    let range = |split: &dyn Fn(&Frame) -> bool| {
        let times = frames.iter().filter(|f| split(f)).filter_map(|f| f.time);
        times.fold(None, |range: Option<(f64, f64)>, t| {
            Some(range.map_or((t, t), |(low, high)| (low.min(t), high.max(t))))
        })
    };
    let Some((first, last)) = range(&|_| true) else { return };
    if first == last {
        notes.push(match frames.len() {
            1 => "there is a single time step: nothing can move".into(),
            n => format!("all {n} frames have the same time: nothing can move"),
        });
        return;
    }
    let Some((from, to)) = range(&|f| f.split == Split::Train) else { return };
    let measured: Vec<&Frame> = frames.iter().filter(|f| f.split == Split::Test).collect();
    let outside: Vec<&str> =
        measured.iter().filter(|f| f.time.is_some_and(|t| t < from || t > to)).map(|f| f.name.as_str()).collect();
    if !outside.is_empty() {
        notes.push(format!(
            "{} of {} test frames lie before the first or after the last training time ({from:.4} to {to:.4}), where nothing \
             was seen: {}",
            outside.len(),
            measured.len(),
            listing(&outside)
        ));
    }
}

/// How many frames have a time, how many different ones, and the smallest and largest; `None` without times.
pub(crate) fn summary(frames: &[Frame]) -> Option<(usize, usize, [f64; 2])> {
    let mut times: Vec<f64> = frames.iter().filter_map(|f| f.time).collect();
    times.sort_by(f64::total_cmp);
    let (first, last) = (*times.first()?, *times.last()?);
    let count = times.len();
    times.dedup();
    Some((count, times.len(), [first, last]))
}
