//! Segments of a frame's photo.

use crate::bit_mask::BitMask;
use crate::picture::{Plan, decode_labels, same_shape, with_mask};
use crate::priors::{LabelMap, PromptedSegment, Segments};
use crate::{DecodeMemory, ErrorKind, Frame, Place, Problem, SceneError, Size, files};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Most segments of one photo: what a 16-bit label map can hold.
const MOST_SEGMENTS: usize = 65_535;

impl Frame {
    /// The segments of the photo at their files' size; `None` where there are no files.
    ///
    /// # Errors
    /// Names the file that cannot be decoded, has another shape than the photo or is not a label map.
    pub fn read_segments(&self) -> Result<Option<Segments>, SceneError> {
        let Some(path) = &self.priors.segments else { return Ok(None) };
        let segments = if path.is_dir() {
            read_stack(path, self.size()).map(Segments::Stack)
        } else {
            read_labels(path, self.size()).map(Segments::Labels)
        };
        segments.map(Some).map_err(|e| e.in_frame(&self.name))
    }

    /// The segments around the photo's feature points; `None` where there is no folder of them.
    ///
    /// # Errors
    /// As [`Frame::read_segments`]; or the list of scores is none, or has not one line for each segment.
    pub fn read_prompted(&self) -> Result<Option<Vec<PromptedSegment>>, SceneError> {
        let Some(folder) = &self.priors.prompted else { return Ok(None) };
        read_prompted(folder, self.size()).map(Some).map_err(|e| e.in_frame(&self.name))
    }
}

fn fits(path: &Path, is: Size, photo: Size) -> Result<(), SceneError> {
    if same_shape(is, photo) {
        return Ok(());
    }
    let what = format!("is {is} and its photo {photo}");
    let remedy = "make it from the photo that stands beside it";
    Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, remedy)))
}

fn read_labels(path: &Path, photo: Size) -> Result<LabelMap, SceneError> {
    let (labels, size) = decode_labels(path)?;
    fits(path, size, photo)?;
    Ok(LabelMap { width: size.width, height: size.height, labels })
}

/// The black and white pictures of a folder in the order of their names.
fn read_stack(folder: &Path, photo: Size) -> Result<Vec<BitMask>, SceneError> {
    let paths = files::images_in(folder)?;
    if paths.len() > MOST_SEGMENTS {
        let what = format!("holds {} segments, and a photo has at most {MOST_SEGMENTS}", paths.len());
        return Err(SceneError::new(ErrorKind::Value, Problem::new(folder, what, "leave the smallest ones out")));
    }
    let read = |path: &PathBuf| {
        with_mask(path, |grey, size| {
            fits(path, size, photo)?;
            Ok(BitMask::from_grey(size.width, size.height, &grey))
        })?
    };
    // One bit a pixel, of all segments together.
    let bytes = |path: &PathBuf| Plan::of(path).map_or(0, |plan| plan.pixels().div_ceil(8));
    let all = paths.par_iter().map(bytes).reduce(|| 0, u64::saturating_add);
    DecodeMemory::of_process().check(folder, &format!("its {} segments", paths.len()), all)?;
    paths.par_iter().map(read).collect()
}

fn read_prompted(folder: &Path, photo: Size) -> Result<Vec<PromptedSegment>, SceneError> {
    let masks = read_stack(folder, photo)?;
    let list = folder.join("scores.txt");
    let scores = if list.is_file() { read_scores(&list, masks.len())? } else { vec![(None, None); masks.len()] };
    let whole = |(mask, (score, stability))| PromptedSegment { mask, score, stability };
    Ok(masks.into_iter().zip(scores).map(whole).collect())
}

type Score = (Option<f32>, Option<f32>);

/// Lines of a score and perhaps a stability.
fn read_scores(path: &Path, segments: usize) -> Result<Vec<Score>, SceneError> {
    let text = files::read_text(path)?;
    let wrong = |line: usize, value: &str, what: String| {
        let problem = Problem::new(path, what, "write `SCORE` or `SCORE STABILITY` for each picture, in name order");
        SceneError::new(ErrorKind::Format, problem.at(Place::Line(line)).field("score").value(value))
    };
    let mut scores = Vec::with_capacity(segments);
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#')) {
        let mut numbers = [None; 2];
        for (k, word) in line.split([' ', '\t', ',']).filter(|w| !w.is_empty()).enumerate() {
            let number = word.parse::<f32>().ok().filter(|x| x.is_finite());
            match (number, numbers.get_mut(k)) {
                (Some(x), Some(slot)) => *slot = Some(x),
                (None, _) => return Err(wrong(i + 1, word, "is not a finite number".into())),
                (_, None) => return Err(wrong(i + 1, line, "holds more than two numbers".into())),
            }
        }
        scores.push((numbers[0], numbers[1]));
    }
    if scores.len() != segments {
        let what = format!("holds {} scores for {segments} pictures", scores.len());
        let problem = Problem::new(path, what, "write one line for each picture, in name order");
        return Err(SceneError::new(ErrorKind::Format, problem));
    }
    Ok(scores)
}
