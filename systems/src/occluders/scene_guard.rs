//! What is part of the scene, however badly a field renders it: it must not be left out.
//!
//! A field that has not learnt a thing yet, or cannot (gloss, lighting that a code does not hold), errs there in all photos, and
//! errors are taken for occluders: left out, the thing is never learnt. So marked squares are compared with the other photos
//! first:
//!
//! * marks of most photos at one place in space, in one colour, show one thing, and it belongs there ([`SamePlace`]);
//! * features that were found in other photos too are not on an occluder: where the marked part of a photo has at least half as
//!   many as the rest, it is the scene.

use engine::data::Dataset;
use engine::same_place::{Marks, SamePlace};
use losses::heuristics::Extent;
use rayon::prelude::*;
use render_core::camera::Camera;

/// Least number of photos, its own included, in which a feature is found that is not on an occluder.
const MATCHED: u32 = 3;
/// Features are counted in a window that reaches this many squares to each side; at least this many make a mark the scene; and
/// at least this share of their density elsewhere in the photo.
const REACH: usize = 5;
const FEWEST: u32 = 2;
const SHARE: f64 = 0.5;

/// With fewer photos nothing can be told.
pub(crate) const LEAST_PHOTOS: usize = SamePlace::LEAST_PHOTOS;

/// Largest difference of colours of one surface: strict in training, where no occluder may be let in; loose for a decision about
/// all photos, which gloss and shadows must not mislead.
pub(crate) const STRICT: f32 = 0.1;
pub(crate) const LOOSE: f32 = 0.2;

/// What is known of a photo besides its colours.
pub(crate) struct PhotoGeometry {
    frame: usize,
    camera: Camera,
    /// Whether it is the photo itself, not the photo at a smaller scale.
    full: bool,
    /// Pixels of features that other photos have, too.
    features: Vec<[f32; 2]>,
}

impl PhotoGeometry {
    pub(crate) fn of(data: &Dataset, view: usize) -> Self {
        let view = data.view(view);
        let native = &view.source.camera;
        let scale = [
            view.camera.width as f32 / native.width.max(1) as f32,
            view.camera.height as f32 / native.height.max(1) as f32,
        ];
        let matched = view.source.tracks.iter().filter(|track| track.length >= MATCHED);
        Self {
            frame: view.frame,
            camera: view.camera,
            full: view.level == 0,
            features: matched.map(|track| [track.pixel[0] * scale[0], track.pixel[1] * scale[1]]).collect(),
        }
    }
}

/// Squares of a photo that are marked.
pub(crate) struct Marked {
    pub(crate) geometry: PhotoGeometry,
    pub(crate) extent: Extent,
    /// Pixels along a side of a square.
    pub(crate) stride: usize,
    /// Row by row.
    pub(crate) marks: Vec<bool>,
    /// The mean colour of each square.
    pub(crate) colours: Vec<[f32; 3]>,
    /// Squares that are evidence: the backdrop and transparent ones are not.
    pub(crate) evidence: Vec<bool>,
}

/// Added to colours before they are divided: dark pixels say little about brightness.
pub(crate) const DARK: f32 = 0.1;

/// Bring the photos' colours to a common brightness and tint: each photo by one factor a channel, so that its median is that of
/// all.
pub(crate) fn even_out(photos: &mut [Marked]) {
    let medians: Vec<[f32; 3]> = photos.par_iter().map(Marked::median).collect();
    let n = medians.len().max(1) as f32;
    let common = [0, 1, 2].map(|c| medians.iter().map(|m| m[c]).sum::<f32>() / n);
    for (photo, median) in photos.iter_mut().zip(medians) {
        let factor = [0, 1, 2].map(|c| (common[c] + DARK) / (median[c] + DARK));
        for colour in &mut photo.colours {
            *colour = [0, 1, 2].map(|c| (colour[c] + DARK) * factor[c] - DARK);
        }
    }
}

impl Marked {
    fn median(&self) -> [f32; 3] {
        [0, 1, 2].map(|c| {
            let evident = self.colours.iter().zip(&self.evidence).filter(|(_, evident)| **evident);
            let mut values: Vec<f32> = evident.map(|(colour, _)| colour[c]).collect();
            let middle = values.len() / 2;
            match values.is_empty() {
                true => 0.5,
                false => *values.select_nth_unstable_by(middle, f32::total_cmp).1,
            }
        })
    }

    /// Colours as means over 3x3 squares: a shift by a square does not matter.
    fn smooth(&self) -> Vec<[f32; 3]> {
        let Extent { width, height } = self.extent;
        let around = |k: usize, count: usize| k.saturating_sub(1)..(k + 2).min(count);
        let mean = |i: usize| {
            let (mut sum, mut of) = ([0.0; 3], 0.0);
            for y in around(i / width, height) {
                for colour in &self.colours[y * width..][..width][around(i % width, width)] {
                    sum.iter_mut().zip(colour).for_each(|(sum, c)| *sum += c);
                    of += 1.0;
                }
            }
            sum.map(|sum| sum / of)
        };
        (0..self.colours.len()).map(mean).collect()
    }
}

/// The marks of each photo that show the scene. Colours of one surface differ by `same_colour` at most.
pub(crate) fn marks_of_the_scene(photos: Vec<Marked>, same_colour: f32) -> Vec<Vec<bool>> {
    let featured: Vec<Vec<bool>> = photos.par_iter().map(has_features).collect();
    let colours: Vec<Vec<[f32; 3]>> = photos.par_iter().map(Marked::smooth).collect();
    let marks = photos.into_iter().zip(colours).map(|(photo, colours)| Marks {
        frame: photo.geometry.frame,
        camera: photo.geometry.camera,
        stride: photo.stride as f64,
        width: photo.extent.width,
        marks: photo.marks,
        colours,
        votes: photo.geometry.full,
    });
    let places = SamePlace::new(marks.collect(), same_colour);
    let join = |(photo, featured): (usize, Vec<bool>)| -> Vec<bool> {
        places.shared(photo).into_iter().zip(featured).map(|(shared, featured)| shared || featured).collect()
    };
    featured.into_par_iter().enumerate().map(join).collect()
}

/// Marked squares around which the marked part of the photo has about as many matched features as the rest of it.
fn has_features(photo: &Marked) -> Vec<bool> {
    let Extent { width, height } = photo.extent;
    let mut features = vec![0_u32; photo.marks.len()];
    for [x, y] in &photo.geometry.features {
        let [x, y] = [x, y].map(|v| (v.max(0.0) as usize) / photo.stride.max(1));
        if x < width && y < height {
            features[y * width + x] += 1;
        }
    }
    let clear = || (0..features.len()).filter(|&i| !photo.marks[i]);
    let elsewhere = clear().map(|i| features[i]).sum::<u32>();
    let density = f64::from(elsewhere) / clear().count().max(1) as f64;
    let window = |k: usize, count: usize| k.saturating_sub(REACH)..(k + REACH + 1).min(count);
    (0..features.len())
        .map(|i| {
            if !photo.marks[i] || photo.geometry.features.is_empty() {
                return false;
            }
            let (mut found, mut of) = (0, 0);
            for y in window(i / width, height) {
                for at in window(i % width, width).map(|x| y * width + x).filter(|&at| photo.marks[at]) {
                    found += features[at];
                    of += 1;
                }
            }
            found >= FEWEST && f64::from(found) >= SHARE * density * f64::from(of)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::camera::Pose;

    #[test]
    fn photos_of_different_brightness_are_brought_to_one() {
        let camera = Camera::pinhole(2, 2, 2.0, 2.0, 1.0, 1.0, Pose::IDENTITY);
        let photo = |gain: f32| Marked {
            geometry: PhotoGeometry { frame: 0, camera, full: true, features: Vec::new() },
            extent: Extent { width: 3, height: 1 },
            stride: 1,
            marks: vec![false; 3],
            colours: [0.1, 0.3, 0.9].map(|x| [(x + DARK) * gain - DARK; 3]).to_vec(),
            evidence: vec![true; 3],
        };
        let mut photos = [photo(0.8), photo(1.2)];
        even_out(&mut photos);
        for (a, b) in photos[0].colours.iter().zip(&photos[1].colours) {
            assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-6), "{a:?} {b:?}");
        }
        assert!((photos[0].colours[1][0] - 0.3).abs() < 1e-6 && (photos[0].smooth()[1][0] - 1.3 / 3.0).abs() < 1e-3);
    }

    #[test]
    fn marks_that_hold_features_are_of_the_scene_and_others_are_not() {
        let (width, height, stride) = (40, 20, 2);
        let camera = Camera::pinhole(80, 40, 80.0, 80.0, 40.0, 20.0, Pose::IDENTITY);
        // A feature every four squares, but for the right end of the photo, where an occluder stands.
        let features = (0..width * height)
            .filter(|i| i % 4 == 0 && i % width < 30)
            .map(|i| [(i % width * stride) as f32 + 0.5, (i / width * stride) as f32 + 0.5])
            .collect();
        let geometry = PhotoGeometry { frame: 0, camera, full: true, features };
        let marks = (0..width * height).map(|i| (5..12).contains(&(i % width)) || i % width > 31).collect();
        let (colours, evidence) = (vec![[0.5; 3]; width * height], vec![true; width * height]);
        let found = marks_of_the_scene(
            vec![Marked { geometry, extent: Extent { width, height }, stride, marks, colours, evidence }],
            STRICT,
        );
        for (i, found) in found[0].iter().enumerate() {
            assert_eq!(*found, (5..12).contains(&(i % width)), "{i}");
        }
    }
}
