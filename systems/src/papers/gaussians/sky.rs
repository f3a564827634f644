//! Whether a cloud begins with Gaussians of the sky besides those of the scene.

use crate::views::cloud_frame::CloudFrame;
use crate::views::sky::{SkyPoint, SkySphere, shown};
use crate::views::start::Start;
use crate::views::{MOST, first_of, refused, unless};
use engine::data::Dataset;
use engine::system::SystemError;
use glam::DVec3;
use scene_io::Point;
use serde::{Deserialize, Serialize};

/// Whether there are any.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum SkyChoice {
    /// Where the field before the cloud sees that there is something beyond the scene.
    Auto,
    /// The same; without a field always.
    Yes,
    No,
}

/// Gaussians of the sky.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SkySettings {
    /// Whether there are Gaussians on a sphere far around the scene at the start: `auto`, `yes` or `no`.
    pub(super) sky: SkyChoice,
    /// Points of that sphere; Gaussians begin at those that may be sky.
    pub(super) sky_splats: usize,
}

impl SkySettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub(super) fn check(&self) -> Result<(), SystemError> {
        let count = self.sky_splats;
        first_of([
            unless(count <= MOST, "sky_splats", count, "must be at most 50 million"),
            unless(count > 0, "sky_splats", count, "must be at least 1 (`sky=no` leaves the sky out)"),
        ])
    }
}

/// What a scene asks for.
pub(super) struct SkyPlan {
    by: SkyBy,
    /// For people.
    pub(super) line: Option<String>,
}

/// What says where sky is.
enum SkyBy {
    /// There is none.
    Nothing,
    /// The field before the cloud, of a sphere of about so many points around what it sees.
    Field(usize),
    /// Cameras alone: the points that photos have in their upper part.
    Cameras(SkySphere, Vec<SkyPoint>),
}

/// What is known of a scene before its cloud begins.
#[derive(Clone, Copy)]
pub(super) struct BeforeSky<'a> {
    pub(super) frame: &'a CloudFrame,
    pub(super) points: &'a [Point],
    pub(super) data: &'a Dataset,
    /// Whether photos show a thing that is cut out.
    pub(super) cut_out: bool,
    /// Whether a field says where the cloud begins.
    pub(super) field: bool,
}

impl BeforeSky<'_> {
    /// A sphere around the points, or around the cameras where there are none.
    fn sphere(&self, count: usize) -> SkySphere {
        let points: Vec<DVec3> = self.points.iter().map(|point| point.xyz).collect();
        SkySphere::around(&points, self.frame, self.data, count)
    }
}

impl SkySettings {
    /// Whether a cloud begins with a sky, and why not.
    pub(super) fn plan(&self, scene: &BeforeSky<'_>) -> SkyPlan {
        let none = |why: &str| SkyPlan { by: SkyBy::Nothing, line: Some(format!("sky: no Gaussians, as {why}")) };
        if self.sky == SkyChoice::No {
            return SkyPlan { by: SkyBy::Nothing, line: None };
        }
        if scene.cut_out {
            return none("the thing is cut out");
        }
        if !scene.field && self.sky == SkyChoice::Auto {
            return none("no field says where nothing is in front of it (`--set sky=yes` has them all around)");
        }
        let count = self.sky_splats;
        let sphere = scene.sphere(count);
        let points = sphere.points(scene.data);
        if points.is_empty() {
            return none("no photo has a place above the horizon in its upper part");
        }
        let (seen, of) = (points.len(), SkySphere::odd(count));
        let (by, limit) = match scene.field {
            true => (SkyBy::Field(count), ", unless the field sees surfaces of the scene there"),
            false => (SkyBy::Cameras(sphere, points), ""),
        };
        let line = format!(
            "sky: Gaussians at {seen} of {of} points of a sphere far around the scene, which photos have in their upper part{limit}"
        );
        SkyPlan { by, line: Some(line) }
    }
}

impl SkyPlan {
    /// About so many points of a sphere are asked of the field.
    pub(super) fn of_field(&self) -> Option<usize> {
        match self.by {
            SkyBy::Field(count) => Some(count),
            SkyBy::Nothing | SkyBy::Cameras(..) => None,
        }
    }

    /// Add the sky that cameras alone say to a cloud at its start, as much as there is room for.
    pub(super) fn add_to(&self, start: &mut Start, scene: &BeforeSky<'_>, most: usize) -> Result<(), SystemError> {
        let SkyBy::Cameras(sphere, points) = &self.by else { return Ok(()) };
        let places = shown(scene.data, points, |rays| vec![true; rays.len()])?;
        start.add_sky(sphere, &places, scene.frame, most).map_err(refused)
    }
}
