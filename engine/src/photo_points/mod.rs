//! Sparse points from photos whose cameras are known, for datasets that come without any.
//!
//! ```text
//! photos      grey, at most `longest_side` pixels a side, two levels
//! corners     places with texture in two directions, spread over each photo
//! neighbours  photos that show the same from an angle that tells depth: from a first, coarse round of matches
//! matches     corners of two photos in one plane with both cameras, alike, each the other's best
//! depth       along the ray of a corner: where its patch agrees with the patches of several photos
//! points      one for each place, with the photos that show it; what too few of those agree on is dropped
//! ```
//!
//! Letters: `x` a pixel, `d` a unit direction in the world, `phi` the angle of the plane through the baseline, `theta` the
//! parallax: the angle between two rays to the same point, `ncc` normalised correlation of two patches, `[-1, 1]`.
//!
//! All patches are compared after their mean and contrast are taken out, so exposure and white balance may differ. The result
//! is a function of photos and cameras alone: the same bits for any number of threads.
//!
//! # Source
//! Corners: Shi and Tomasi, "Good features to track", 1994. Agreement along a ray: Goesele et al., "Multi-view stereo for
//! community photo collections", 2007; Furukawa and Ponce, "Accurate, dense, and robust multiview stereopsis", 2010.

mod corners;
mod depth;
mod matching;
mod merge;
mod neighbours;
mod options;
mod patch;
mod photo;
pub mod provide;
#[cfg(test)]
mod tests;
mod triangulate;

pub use options::Options;
pub use triangulate::{along_ray, nearest_to_rays};

use crate::data::Dataset;
use matching::{Corner, Links};
use photo::Photo;
use rayon::prelude::*;
use scene_io::{Point, SceneError};

/// Points, and who sees them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// World frame, colours as the photos show them.
    pub points: Vec<Point>,
    /// For each view of the dataset the points it shows, ascending, each with its pixel at the size of the view's camera.
    pub tracks: Vec<Vec<Sighting>>,
}

/// A point in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Index into [`Found::points`].
    pub point: u32,
    /// Column and row in the view.
    pub pixel: [f32; 2],
}

/// Points that the photos of `data` agree on. Empty where there are fewer than two photos at different places, or nothing to
/// recognise. Views of other levels than 0 are left out.
///
/// # Errors
/// [`SceneError`] of a photo that cannot be read.
pub fn photo_points(data: &Dataset, options: &Options) -> Result<Found, SceneError> {
    let mut found = Found { points: Vec::new(), tracks: vec![Vec::new(); data.len()] };
    let views: Vec<usize> = (0..data.len()).filter(|i| data.view(*i).level == 0).collect();
    let count = views.len().min(options.photos);
    let views: Vec<usize> = (0..count).map(|k| views[k * views.len() / count]).collect();
    if count < 2 {
        return Ok(found);
    }
    let photos = views.par_iter().map(|i| Photo::new(data, *i, options.longest_side));
    let photos: Vec<Photo> = photos.collect::<Result<_, _>>()?;
    let most = options.corners.min(options.corners_in_all / count);
    let corners: Vec<Vec<Corner>> = photos.par_iter().map(|photo| matching::describe(photo, most)).collect();
    let pairs = neighbours::choose(&photos, &corners, options.neighbours);
    let links = Links::new(&photos, &corners, &pairs);
    let estimates = depth::estimates(&photos, &corners, &links, &pairs, options);
    let merged = merge::merge(&photos, &estimates);
    for (k, point) in merged.iter().enumerate() {
        found.points.push(Point { xyz: point.x, rgb: point.rgb });
        for &(photo, pixel) in &point.seen {
            let view = data.view(views[photo]);
            let scale = f64::from(view.camera.width) / f64::from(photos[photo].camera().width);
            let pixel = (pixel * scale).as_vec2().to_array();
            found.tracks[views[photo]].push(Sighting { point: k as u32, pixel });
        }
    }
    Ok(found)
}
