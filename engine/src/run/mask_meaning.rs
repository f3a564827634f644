//! What masks are meant to say that leave little of the photos.
//!
//! White is what is used, unless something else is said. But masks that come with captures of one object are white on the object
//! and black all around it; taken for ignore masks they leave most of every photo free, and the field fills that with fog. Such
//! masks are of one thing: white is connected, keeps off the rim of the picture, and the masks of all photos agree about where in
//! space it is ([`SamePlace`]). Masks of which all this is true are taken for object masks, and it is said.

use crate::error::RunError;
use crate::same_place::{Marks, SamePlace};
use losses::heuristics::{Extent, take_component};
use rayon::prelude::*;
use scene_io::{BitMask, Frame, MaskPolarity, Scene, SceneError, Split};

/// Longest side of a mask when it is examined, pixels.
const SIDE: u32 = 64;
/// Masks leave so much of the photos at most.
const LEFT: f64 = 0.5;
/// Training photos that have a mask at least, and masks of which the rest has to be true.
const NEARLY_ALL: f64 = 0.9;
const MOST: f64 = 0.8;
/// White that is in one piece, at least.
const ONE_PIECE: f64 = 0.8;
/// The rim of the picture that is white, at most, mean over the photos.
const RIM: f64 = 0.3;
/// White squares of a photo that most of the others have at the same place in space, at least.
const SHARED: f64 = 0.75;

/// What the masks of a scene are taken for.
#[derive(Clone, Debug, PartialEq)]
pub enum MaskMeaning {
    /// What was said, or what they are in general.
    AsRead,
    /// White is an object and nothing is around it; a line that says so and what to do where it is not.
    Object(String),
    /// They ignore most of the photos, and white is not one object: a line of warning.
    Sparse(String),
}

/// What masks that were read as [`MaskPolarity::WhiteIsUsed`] are taken for. `left` is the share of the training photos that they
/// leave, `None` where there are none; `said` is the word of `--mask-white`: where one is given, it holds. Decodes every mask
/// where little is left.
///
/// # Errors
/// [`RunError::Scene`] naming a mask that cannot be read.
pub fn mask_meaning(scene: &Scene, left: Option<f64>, said: Option<&str>) -> Result<MaskMeaning, RunError> {
    let Some(left) = left.filter(|_| said.is_none()) else { return Ok(MaskMeaning::AsRead) };
    let training: Vec<&Frame> = scene.split(Split::Train).map(|i| &scene.frames[i]).collect();
    let masked: Vec<&Frame> =
        training.iter().copied().filter(|f| f.mask.is_some() && f.mask_polarity == MaskPolarity::WhiteIsUsed).collect();
    if left >= LEFT || masked.is_empty() {
        return Ok(MaskMeaning::AsRead);
    }
    let ignored = 100.0 * (1.0 - left);
    let enough = masked.len() >= SamePlace::LEAST_PHOTOS && masked.len() as f64 >= NEARLY_ALL * training.len() as f64;
    let alike = if enough { alike(&masked)? } else { 0 };
    let of = masked.len();
    if alike as f64 >= MOST * of as f64 && enough {
        return Ok(MaskMeaning::Object(format!(
            "masks: taken for an OBJECT with nothing around it (white is one thing at one place in {alike} of {of} photos, and \
             {ignored:.0} % are black): `--mask-white used` where black only means to ignore"
        )));
    }
    Ok(MaskMeaning::Sparse(format!(
        "masks ignore {ignored:.0} % of the photos, and nothing will be known of what is there: `--mask-white object` where white \
         is an object with nothing around it (they show one thing at one place in {alike} of {of} photos), `--masks off` for \
         whole photos, `--mask-white used` where this is meant"
    )))
}

/// Photos whose masks show one thing, which the other masks show at the same place.
fn alike(frames: &[&Frame]) -> Result<usize, SceneError> {
    let read = |frame: &&Frame| -> Result<(Marks, Shape), SceneError> {
        let mask = frame.read_mask()?.unwrap_or_else(|| BitMask::new(1, 1));
        let (w, h) = (frame.camera.width.max(1), frame.camera.height.max(1));
        let small = |side: u32| (u64::from(side) * u64::from(SIDE) / u64::from(w.max(h))).max(1) as u32;
        let camera = frame.camera.resized(small(w), small(h));
        let marks: Vec<bool> = mask.resized(camera.width, camera.height).iter().collect();
        let shape = Shape::of(Extent { width: camera.width as usize, height: camera.height as usize }, &marks);
        let (width, colours) = (camera.width as usize, Vec::new());
        Ok((Marks { frame: 0, camera, stride: 1.0, width, marks, colours, votes: true }, shape))
    };
    let mut read: Vec<(Marks, Shape)> = frames.par_iter().map(read).collect::<Result<_, _>>()?;
    read.iter_mut().enumerate().for_each(|(i, (marks, _))| marks.frame = i);
    let (marks, shapes): (Vec<Marks>, Vec<Shape>) = read.into_iter().unzip();
    let rim = shapes.iter().map(|s| s.rim).sum::<f64>() / shapes.len().max(1) as f64;
    if rim > RIM {
        return Ok(0);
    }
    let places = SamePlace::new(marks, 0.0);
    let is_alike = |(photo, shape): (usize, &Shape)| -> bool {
        let shared = places.shared(photo).into_iter().filter(|s| *s).count();
        shape.white > 0
            && shape.piece as f64 >= ONE_PIECE * shape.white as f64
            && shared as f64 >= SHARED * shape.white as f64
    };
    Ok(shapes.par_iter().enumerate().filter(|(photo, shape)| is_alike((*photo, shape))).count())
}

/// The white of a mask.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape {
    /// Pixels.
    white: usize,
    /// Pixels of its largest piece.
    piece: usize,
    /// Share of the pixels along the rim of the picture that are white.
    rim: f64,
}

impl Shape {
    fn of(extent: Extent, marks: &[bool]) -> Self {
        let Extent { width, height } = extent;
        let (mut waiting, mut piece, mut largest) = (marks.to_vec(), Vec::new(), 0);
        for i in 0..marks.len() {
            // A pixel that does not wait is in no piece, or in one that was taken.
            if waiting[i] && take_component(extent, i, &mut waiting, &mut piece).is_ok() {
                largest = largest.max(piece.len());
            }
        }
        let is_rim = |i: &usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
        let (rim, of) = (0..marks.len()).filter(is_rim).fold((0, 0), |(n, of), i| (n + usize::from(marks[i]), of + 1));
        let white = marks.iter().filter(|m| **m).count();
        Self { white, piece: largest, rim: rim as f64 / f64::from(of.max(1)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_is_its_largest_piece_and_what_touches_the_rim() {
        let rows = ["#...", "#.##", "..##", "...."];
        let marks: Vec<bool> = rows.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect();
        let shape = Shape::of(Extent { width: 4, height: 4 }, &marks);
        assert_eq!((shape.white, shape.piece), (6, 4));
        assert!((shape.rim - 4.0 / 12.0).abs() < 1e-9, "{shape:?}");
    }
}
