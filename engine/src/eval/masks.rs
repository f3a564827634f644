//! Static masks of training photos as a system sees them: pictures, and scores where the truth is known.
//!
//! White (255) is static. A pixel is static where the system's visibility is at least [`THRESHOLD`]. Scores are of two
//! classes: `miou` is the mean of the IoU of what is static and of what is transient, `f1` is that of what is transient. The
//! truth is scaled to training resolution by nearest neighbour. Pixels that an ignore mask takes out do not count.

use crate::data::Dataset;
use crate::error::RunError;
use crate::names::stem;
use crate::output::{Storage, make_folder, read_json, write_file};
use crate::picture::{grey_png_bytes, over_background, side_by_side, write_png};
use crate::progress::{Meter, Observer};
use crate::system::System;
use image::{GrayImage, RgbImage};
use losses::metrics::{Average, Confusion, EmptyClass, SegmentationScores, segmentation};
use scene_io::{Image, Scene};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::Path;

/// Visibility from which on a pixel counts as static.
pub const THRESHOLD: f32 = 0.5;

/// Name of the table in its folder.
pub const FILE: &str = "masks.json";

/// Folder of the pictures that show photo, mask as given (where there is one), mask as found and truth (where it is known)
/// together, below that of the masks.
pub const SIDE_BY_SIDE: &str = "side_by_side";

/// Folder of the masks that came with the photos, at training resolution, white = used or the object; below that of the masks.
pub const GIVEN: &str = "given";

/// Scores of one mask, or means of several; absent where there is no truth or nothing counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Mean of the next two.
    pub miou: Option<f64>,
    /// Intersection over union of what is static.
    pub iou_static: Option<f64>,
    /// Intersection over union of what is transient.
    pub iou_transient: Option<f64>,
    /// F1 of what is transient.
    pub f1: Option<f64>,
}

impl From<SegmentationScores> for Scores {
    fn from(s: SegmentationScores) -> Self {
        Self { miou: s.miou, iou_static: s.iou_static, iou_transient: s.iou_transient, f1: s.f1 }
    }
}

/// One photo's mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotoMask {
    /// Name of the frame.
    pub name: String,
    /// The mask's file, and that of the picture below [`SIDE_BY_SIDE`].
    pub file: String,
    /// Share of pixels that are static.
    pub static_share: f64,
    /// Share of pixels that are white in the mask that came with the photo, which lies below [`GIVEN`] under the same name; absent
    /// where none came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub given_share: Option<f64>,
    /// Against the truth.
    #[serde(flatten)]
    pub scores: Scores,
}

/// All that were made: the content of `masks.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaskTable {
    /// Name of the system.
    pub system: String,
    /// Steps trained.
    pub steps: u64,
    /// Photos trained on; `views` may be some of them.
    pub training_views: usize,
    /// Photos among `views` whose truth is known.
    pub with_truth: usize,
    /// Visibility from which on a pixel counts as static.
    pub threshold: f64,
    /// What a class scores in a photo where neither mask has a pixel of it: `one`, `zero` or `left-out`.
    pub empty_class: String,
    /// Means over photos: every photo counts alike.
    pub per_image: Scores,
    /// Of all photos' pixels together: every pixel counts alike.
    pub pooled: Scores,
    /// Each photo, in the order of the dataset.
    pub views: Vec<PhotoMask>,
}

/// Training photos, with the truth that the scene has of them.
#[derive(Clone, Copy)]
pub struct PhotosOf<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Views trained on.
    pub data: &'a Dataset,
}

/// Which photos, and how they are scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskOptions {
    /// Every n-th training photo, from the first.
    pub every: usize,
    /// What an empty class scores.
    pub empty: EmptyClass,
}

/// The word for an empty class on the command line and in `masks.json`.
#[must_use]
pub fn empty_class_name(empty: EmptyClass) -> &'static str {
    match empty {
        EmptyClass::One => "one",
        EmptyClass::Zero => "zero",
        EmptyClass::LeftOut => "left-out",
    }
}

/// Make and score masks of the training `views`; they and [`FILE`] go to `folder`, `NAME.png` for a photo
/// `NAME.jpg`, and masks that came with the photos to [`GIVEN`] in it. `None` where the system takes every pixel for static and no
/// masks came. An observer that asks to stop gets the masks made so far.
///
/// # Errors
/// [`RunError::Scene`] for photos and truth masks that cannot be read, [`RunError::Write`].
pub fn write_masks(
    storage: &dyn Storage,
    folder: &Path,
    system: &dyn System,
    steps: u64,
    views: PhotosOf<'_>,
    options: MaskOptions,
    observer: &mut dyn Observer,
) -> Result<Option<MaskTable>, RunError> {
    let PhotosOf { scene, data } = views;
    // A view at each scale is one photo.
    let photos: Vec<usize> = (0..data.len()).filter(|&i| data.view(i).level == 0).collect();
    let chosen: Vec<usize> = photos.iter().copied().step_by(options.every.max(1)).collect();
    let (mut rows, mut counts, mut taken) = (Vec::new(), Vec::new(), HashSet::new());
    let mut meter = Meter::new("mask", chosen.len());
    for (done, &i) in chosen.iter().enumerate() {
        if done > 0 && observer.stop_asked() {
            break;
        }
        let (view, photo) = (data.view(i), data.image(i)?);
        let (width, height) = (view.camera.width, view.camera.height);
        let given = given_mask(data, &photo);
        let mask: Vec<u8> = match system.visibility(data, i)? {
            Some(visibility) => visibility.iter().map(|&v| if v >= THRESHOLD { 255 } else { 0 }).collect(),
            // Nothing is left out: worth a picture beside what masks said.
            None if given.is_some() => vec![255; width as usize * height as usize],
            None => return Ok(None),
        };
        if done == 0 {
            make_folder(&folder.join(SIDE_BY_SIDE))?;
        }
        let statics = mask.iter().filter(|&&m| m != 0).count();
        let truth = scene.frames[view.frame].read_transient()?.map(|truth| {
            let transient = truth.resized(width, height);
            transient.iter().map(|t| if t { 0 } else { 255 }).collect::<Vec<u8>>()
        });
        let mut scores = Scores::default();
        if let Some(truth) = &truth {
            let used = |k: &usize| photo.mask.as_ref().is_none_or(|m| m[*k] >= 128);
            let counted: Vec<usize> = (0..truth.len()).filter(used).collect();
            let of = |mask: &[u8]| counted.iter().map(|&k| mask[k]).collect::<Vec<u8>>();
            if let Ok(confusion) = Confusion::of(&of(&mask), &of(truth)) {
                scores = confusion.scores(options.empty).into();
                counts.push(confusion);
            }
        }
        let file = file_name(&view.name, &mut taken);
        let grey = |mask: &[u8]| GrayImage::from_raw(width, height, mask.to_vec()).unwrap_or_default();
        write_file(storage, &folder.join(&file), &grey_png_bytes(&grey(&mask)))?;
        if let Some(given) = &given {
            make_folder(&folder.join(GIVEN))?;
            write_file(storage, &folder.join(GIVEN).join(&file), &grey_png_bytes(&grey(given)))?;
        }
        let shown: Vec<RgbImage> = std::iter::once(over_background(&photo, [1.0; 3]))
            .chain([given.as_ref(), Some(&mask), truth.as_ref()].into_iter().flatten().map(|m| rgb(&grey(m))))
            .collect();
        let shown: Vec<&RgbImage> = shown.iter().collect();
        write_png(storage, &folder.join(SIDE_BY_SIDE).join(&file), &side_by_side(&shown))?;
        let share = |white: usize| white as f64 / mask.len().max(1) as f64;
        let given_share = given.map(|given| share(given.iter().filter(|&&m| m != 0).count()));
        rows.push(PhotoMask { name: view.name.clone(), file, static_share: share(statics), given_share, scores });
        meter.advance(observer);
    }
    let table = MaskTable {
        system: system.name().into(),
        steps,
        training_views: photos.len(),
        with_truth: counts.len(),
        threshold: f64::from(THRESHOLD),
        empty_class: empty_class_name(options.empty).into(),
        per_image: segmentation(&counts, Average::PerImage, options.empty).into(),
        pooled: segmentation(&counts, Average::Pooled, options.empty).into(),
        views: rows,
    };
    write_file(storage, &folder.join(FILE), table.json().as_bytes())?;
    Ok(Some(table))
}

/// The mask that came with a photo, white = used: its ignore mask, or the alpha that an object mask became.
fn given_mask(data: &Dataset, photo: &Image) -> Option<Vec<u8>> {
    let half = |v: u8| if v >= 128 { 255 } else { 0 };
    if let Some(mask) = &photo.mask {
        return Some(mask.iter().copied().map(half).collect());
    }
    let cut_out = data.is_cut_out() && photo.channels == 4;
    cut_out.then(|| photo.data.chunks_exact(4).map(|pixel| half(pixel[3])).collect())
}

/// `NAME.png`, with a number where two names look the same as files.
fn file_name(name: &str, taken: &mut HashSet<String>) -> String {
    let stem = stem(name);
    let first = format!("{stem}.png");
    let mut names = std::iter::once(first).chain((2..).map(|n| format!("{stem}_{n}.png")));
    // An endless supply: one of them is free.
    names.find(|name| taken.insert(name.clone())).unwrap_or_default()
}

fn rgb(mask: &GrayImage) -> RgbImage {
    image::DynamicImage::ImageLuma8(mask.clone()).into_rgb8()
}

impl MaskTable {
    /// The table in a folder of masks, if there is one.
    ///
    /// # Errors
    /// [`RunError::Content`].
    pub fn read(folder: &Path) -> Result<Option<Self>, RunError> {
        read_json(&folder.join(FILE))
    }

    /// `masks.json`.
    #[expect(clippy::missing_panics_doc, reason = "plain structs always serialise")]
    #[must_use]
    pub fn json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a plain struct serialises");
        text.push('\n');
        text
    }

    /// A row a photo and both means, for a terminal.
    #[must_use]
    pub fn table(&self) -> String {
        let shown = |name: &str| name.chars().count();
        let widest = self.views.iter().map(|v| shown(&v.name)).max().unwrap_or(0).clamp(22, 48);
        let cell = |x: Option<f64>| x.map_or_else(|| "n/a".into(), |x| format!("{x:.4}"));
        let row = |name: &str, share: &str, s: &Scores| {
            let scores = [s.miou, s.f1, s.iou_static, s.iou_transient].map(cell);
            let [miou, f1, statics, transients] = &scores;
            format!("{name:widest$}  {share:>7}  {miou:>7}  {f1:>7}  {statics:>10}  {transients:>13}\n")
        };
        let mut out = format!(
            "{:widest$}  {:>7}  {:>7}  {:>7}  {:>10}  {:>13}\n",
            "photo", "static", "mIoU", "F1", "IoU static", "IoU transient"
        );
        for v in &self.views {
            let name: String = match shown(&v.name) {
                n if n > widest => std::iter::once('…').chain(v.name.chars().skip(n - widest + 1)).collect(),
                _ => v.name.clone(),
            };
            out += &row(&name, &format!("{:.1} %", 100.0 * v.static_share), &v.scores);
        }
        if self.with_truth > 0 {
            out += &row("mean of the photos", "", &self.per_image);
            out += &row("all pixels together", "", &self.pooled);
        }
        out + &self.legend()
    }

    /// How the numbers are meant.
    #[must_use]
    pub fn legend(&self) -> String {
        let photos = format!("{} of {} training photos", self.views.len(), self.training_views);
        match self.with_truth {
            0 => format!("{photos}, no truth to score against\n"),
            n => format!(
                "{photos}, {n} with truth; F1 of what is transient; a class with no pixel in either mask: {}\n",
                self.empty_class
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_look_the_same_as_files_get_numbers() {
        let mut taken = HashSet::new();
        let names: Vec<String> =
            ["a/x.jpg", "a_x.png", "y.jpg", "a/x.jpeg"].iter().map(|n| file_name(n, &mut taken)).collect();
        assert_eq!(names, ["a_x.png", "a_x_2.png", "y.png", "a_x_3.png"]);
    }
}
