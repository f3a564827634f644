//! Which points of a scene photos have seen.
//!
//! A photo saw a point if the point projects into its image, lies in front of the camera, and is not behind the surface that the
//! photo shows there.

use alloc::vec::Vec;
use glam::{DVec2, DVec3};

use crate::camera::{Camera, Prepared};

/// A point that is farther than a surface by at most this fraction of its distance may still be on it: depths of small pictures are
/// coarse where a surface is seen at a shallow angle.
pub const TOLERANCE: f64 = 0.1;

/// The camera of a photo, with its depth where occlusion counts: tells which points the photo saw.
#[derive(Clone, Debug)]
pub struct Observer {
    camera: Prepared,
    depth: Option<DepthMap>,
}

/// Distances along the rays of a camera, a small picture of them.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row, world units; infinite where nothing was hit.
    pub distance: Vec<f32>,
    /// Largest difference of two inverse distances, 1 / world unit, that counts as none: what is farther than the inverse of this
    /// is at infinity.
    pub disparity_tolerance: f64,
}

impl Observer {
    /// A photo's camera, with its depth map where occlusion counts. A map of another length than its size says is left out.
    #[must_use]
    pub fn new(camera: &Camera, depth: Option<DepthMap>) -> Self {
        let depth = depth.filter(|d| d.width * d.height == d.distance.len() && !d.distance.is_empty());
        Self { camera: camera.prepare(), depth }
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        self.camera.camera()
    }

    /// Whether the photo saw a point, world units.
    #[must_use]
    pub fn saw(&self, point: DVec3) -> bool {
        let Some(share) = self.share(point) else { return false };
        let away = point.distance(self.camera().pose.c);
        self.depth.as_ref().is_none_or(|map| map.reaches(share, away))
    }

    /// Whether the photo's field of view holds a direction: what is infinitely far away there, with nothing before it.
    #[must_use]
    pub fn faced(&self, direction: DVec3) -> bool {
        self.share(self.camera().pose.c + direction).is_some()
    }

    /// Where in the picture a point is, as parts of its width and height; `None` outside.
    fn share(&self, point: DVec3) -> Option<DVec2> {
        let pixel = self.camera.project(point)?;
        let camera = self.camera();
        let share = pixel / DVec2::new(f64::from(camera.width), f64::from(camera.height));
        (share.min_element() >= 0.0 && share.max_element() < 1.0).then_some(share)
    }
}

impl DepthMap {
    /// Whether a distance is no farther than the farthest surface about a place of the picture.
    fn reaches(&self, share: DVec2, away: f64) -> bool {
        let at = |share: f64, n: usize| (share * n as f64) as usize;
        let (x, y) = (at(share.x, self.width), at(share.y, self.height));
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        // The eight neighbours too: an edge of the small picture lies anywhere within a pixel.
        let farthest = rows
            .flat_map(|row| columns.clone().map(move |column| self.distance[row * self.width + column]))
            .fold(0.0_f32, f32::max);
        let farthest = f64::from(farthest);
        away <= farthest * (1.0 + TOLERANCE) || 1.0 / farthest - 1.0 / away < self.disparity_tolerance
    }
}

/// Whether at least `least` photos saw a point, or a direction where there is no point.
#[must_use]
pub fn seen_by<'a>(observers: impl IntoIterator<Item = &'a Observer>, target: Target, least: usize) -> bool {
    let saw = |w: &&Observer| match target {
        Target::Point(point) => w.saw(point),
        Target::Sky(direction) => w.faced(direction),
    };
    least == 0 || observers.into_iter().filter(saw).take(least).count() == least
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A point of a surface, world units.
    Point(DVec3),
    /// Nothing, in this direction.
    Sky(DVec3),
}
