//! Gaussians from a file: drawn without photos and without training.

use super::upright;
use crate::views::cloud_frame::CloudFrame;
use crate::views::{CloudRenderer, DrawnCloud, RenderBuffers};
use engine::camera_path::{PathKind, from_file};
use engine::error::RunError;
use engine::memory::{available_bytes, human};
use engine::picture::limited;
use engine::render::{Rendered, plain_query};
use engine::system::{Query, Splats};
use float_core::Simd;
use glam::{DMat3, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::path::Spiral;
use scene_io::read_splats;
use splat_core::density::{Rows, morton_order, opacity};
use splat_core::{Gaussians, RasterSettings, rest_len};
use std::path::Path;

/// Gaussians fainter than this do not say where the scene is.
const SHOWS: f64 = 0.1;
/// Share of the Gaussians that the scene is, by their distance from its middle.
const MOST: f64 = 0.75;
/// Nothing nearer than this part of the scene's radius is drawn: what is that near is in the way.
const NEAR: f64 = 0.01;
/// Pictures where nothing else is said: size, and tangent of half the angle across.
const SIZE: [u32; 2] = [960, 540];
const TANGENT: f64 = 0.6;
/// An orbit's distance in radii of the scene, and its height above the middle as a part of that.
const DISTANCE: f64 = 2.0;
const HEIGHT: f64 = 0.35;
/// Views around the middle that are offered.
const AROUND: usize = 8;
/// Parts of that distance that the first view is sought at.
const CLOSER: [f64; 3] = [1.0, 0.6, 0.35];
/// Longest side of the pictures it is sought with.
const SMALL: u32 = 80;
/// A pixel is opaque from here on: clouds of short trainings are thin everywhere.
const OPAQUE: f32 = 0.5;
/// A camera is inside where this share of a small picture is opaque, little of it nearer than the first of these parts of the
/// scene's radius, and half of it farther than the second.
const ALL_AROUND: f64 = 0.95;
const TOO_NEAR: f64 = 0.05;
const FAR_ENOUGH: f64 = 0.3;
/// The radius of an orbit inside of a room, as a part of the median depth and at most as a part of the smallest: a file of Gaussians
/// does not say how far apart its photos were taken.
const SWAY: f64 = 0.06;
const SWAY_NEAR: f64 = 0.5;
/// Frames of a path where nothing is said.
const FRAMES: usize = 60;

/// A cloud that is drawn as it is.
pub struct Cloud {
    /// In a frame around its middle, so that places far from the origin keep their digits.
    cloud: Gaussians,
    frame: CloudFrame,
    settings: RasterSettings,
    middle: DVec3,
    radius: f64,
    up: DVec3,
    notes: Vec<String>,
    buffers: RenderBuffers,
}

impl Cloud {
    /// Read a `.ply`, `.splat` or `.spz` file.
    ///
    /// # Errors
    /// [`RunError::Scene`] naming the file and what is wrong with it.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let file = read_splats(path)?;
        // Sorting by place makes a second cloud, drawing what is kept of each Gaussian a third; positions and sizes are copied to
        // find its extent.
        let n = file.cloud.len() as u64;
        let more = n * (2 * 4 * (14 + 3 * rest_len(file.cloud.degree()) as u64) + 64);
        if let Some(available) = available_bytes().filter(|available| more > *available) {
            let (more, available) = (human(more), human(available));
            let problem =
                format!("its {n} Gaussians take {more} more to be drawn, and {available} are available; crop it");
            return Err(RunError::Content { path: path.into(), problem });
        }
        let widening = file.widening.unwrap_or_default();
        Ok(Self { notes: file.notes, ..Self::new(file.cloud, RasterSettings::DEFAULT.with_widening(widening)) })
    }

    /// A cloud of the scene's frame.
    ///
    /// # Panics
    /// When fields of the cloud disagree in length.
    #[must_use]
    pub fn new(mut cloud: Gaussians, settings: RasterSettings) -> Self {
        if let Ok(placed) = morton_order(&cloud).and_then(|rows| rows.follow(&cloud)) {
            cloud = placed;
        }
        let (middle, radius) = extent(&cloud);
        let frame = CloudFrame { centre: middle.to_array(), scale: 1.0 };
        frame.cloud_to_internal(&mut cloud);
        let settings = settings.with_near((NEAR * radius) as f32);
        let up = upright::guess(&cloud);
        Self { cloud, frame, settings, middle, radius, up, notes: Vec::new(), buffers: RenderBuffers::default() }
    }

    /// A cloud of a training or a bake, drawn with its own settings.
    ///
    /// # Panics
    /// As [`Cloud::new`].
    #[must_use]
    pub fn exact(splats: Splats) -> Self {
        let settings = splats.rules;
        Self { settings, ..Self::new(splats.gaussians, settings) }
    }

    /// Drawn as a training with these cameras draws its own: what is left out before a camera's nose depends on how far apart the
    /// cameras stand, and not on how far the Gaussians reach.
    #[must_use]
    pub fn photographed_by(self, cameras: &[DVec3]) -> Self {
        let (frame, _) = CloudFrame::around(cameras, &[]);
        let near = f64::from(RasterSettings::DEFAULT.near) * frame.scale;
        Self { settings: self.settings.with_near(near as f32), ..self }
    }

    /// All Gaussians in the scene's frame, in the order that [`part`](Self::part) asks for them.
    #[must_use]
    pub fn gaussians(&self) -> Gaussians {
        let mut cloud = self.cloud.clone();
        self.frame.cloud_to_world(&mut cloud);
        cloud
    }

    /// The Gaussians that stay, with everything else as it is: the same middle, the same views.
    #[must_use]
    pub fn part(&self, stays: impl Fn(usize) -> bool) -> Self {
        let kept = Rows::keep(self.cloud.len(), stays).and_then(|rows| rows.follow(&self.cloud));
        Self {
            cloud: kept.unwrap_or_default(),
            frame: self.frame,
            settings: self.settings,
            middle: self.middle,
            radius: self.radius,
            up: self.up,
            notes: Vec::new(),
            buffers: RenderBuffers::default(),
        }
    }

    /// What was dropped, clamped or ignored while reading, a line each.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// How many Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cloud.len()
    }

    /// Centre of Gaussian `i`, in the scene's frame.
    pub(super) fn place(&self, i: usize) -> DVec3 {
        let n = self.cloud.len();
        self.frame.to_world([0, 1, 2].map(|k| f64::from(self.cloud.mean[k * n + i])).into())
    }

    /// Degree of the spherical harmonics.
    pub(super) fn degree(&self) -> usize {
        self.cloud.degree()
    }

    /// None at all?
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cloud.is_empty()
    }

    /// The middle of what shows, and the distance from it that most of that is within, world units.
    #[must_use]
    pub fn extent(&self) -> (DVec3, f64) {
        (self.middle, self.radius)
    }

    /// Up, a unit vector: guessed from what is flat, or against y where nothing says so (structure from motion has y down).
    #[must_use]
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// What a camera sees.
    ///
    /// # Errors
    /// [`RunError::Option`] for a camera that cannot see.
    pub fn render(&self, camera: &Camera, query: &Query) -> Result<Rendered, RunError> {
        let renderer = CloudRenderer {
            layers: None,
            clouds: &[DrawnCloud::alone(&self.cloud)],
            frame: &self.frame,
            settings: self.settings,
            appearance: None,
            simd: Simd::best(),
        };
        let (layers, _) = renderer
            .layers(camera, query, &self.buffers)
            .map_err(|e| RunError::Option(format!("the picture cannot be drawn: {e}")))?;
        Ok(Rendered { width: camera.width, height: camera.height, layers })
    }

    /// A camera that stands off the middle: `turn` of a full turn around it.
    #[must_use]
    pub fn camera(&self, turn: f64) -> Camera {
        self.at_distance(turn, DISTANCE)
    }

    /// The same, `distance` radii away.
    fn at_distance(&self, turn: f64, distance: f64) -> Camera {
        let (up, angle) = (self.up(), turn * core::f64::consts::TAU);
        let aside = up.any_orthonormal_vector();
        let ahead = up.cross(aside);
        let level = (1.0 - HEIGHT * HEIGHT).sqrt();
        let way = (aside * angle.cos() + ahead * angle.sin()) * level + up * HEIGHT;
        let z = -way.normalize();
        let x = z.cross(up).normalize();
        let pose = Pose { r: DMat3::from_cols(x, z.cross(x), z), c: self.middle + way * distance * self.radius };
        let [w, h] = SIZE.map(f64::from);
        let f = 0.5 * w / TANGENT;
        Camera::pinhole(SIZE[0], SIZE[1], f, f, 0.5 * w, 0.5 * h, pose)
    }

    /// Cameras that show the cloud. The first sees the middle of the cloud best; then those around it, and the one where the frame
    /// of the file begins: structure from motion often puts one of its cameras there. That one is the first where it is inside of the
    /// scene.
    #[must_use]
    pub fn views(&self) -> Vec<Camera> {
        let around =
            |closer: f64| (0..AROUND).map(move |k| self.at_distance(k as f64 / AROUND as f64, closer * DISTANCE));
        let mut views: Vec<Camera> = CLOSER.into_iter().flat_map(around).collect();
        let small: Vec<Camera> = views.iter().map(|camera| limited(camera, Some(SMALL))).collect();
        let best = upright::best(self, &small);
        views.swap(0, best);
        // The far ones are enough to step through.
        views.truncate(1);
        views.extend(around(1.0));
        let origin = self.origin();
        views.push(origin);
        if self.surroundings(&origin).is_some() {
            // A room is nothing from outside.
            views.rotate_right(1);
        }
        views
    }

    /// Depth of the nearest things and of the middle ones in a camera's picture, where the scene is all around it and not before
    /// its nose.
    fn surroundings(&self, camera: &Camera) -> Option<[f64; 2]> {
        let small = limited(camera, Some(SMALL));
        let view = self.render(&small, &plain_query([0.0; 3], 0.0)).ok()?;
        let opaque = view.layers.opacity.iter().filter(|o| **o > OPAQUE).count();
        let mut depths = view.layers.depth.clone();
        depths.sort_by(f32::total_cmp);
        let depth = |share: f64| f64::from(depths[((depths.len() - 1) as f64 * share) as usize]);
        let (near, middle) = (depth(0.05), depth(0.5));
        let inside = opaque as f64 > ALL_AROUND * depths.len() as f64
            && near > TOO_NEAR * self.radius
            && middle > FAR_ENOUGH * self.radius;
        inside.then_some([near, middle])
    }

    /// A camera at the origin of the file whose axis is z.
    fn origin(&self) -> Camera {
        Camera { pose: Pose::IDENTITY, ..self.camera(0.0) }
    }

    /// A circle of `n` cameras, and where it is, in words: around the middle, or a small one inside of a room.
    fn orbit(&self, n: usize) -> (Vec<Camera>, &'static str) {
        let origin = self.origin();
        let Some([near, middle]) = self.surroundings(&origin) else {
            let cameras = (0..n).map(|i| self.camera(i as f64 / n as f64)).collect();
            return (
                cameras,
                "orbit: around the middle of the cloud; a file of Gaussians does not say where its photos were",
            );
        };
        let size = (SWAY * middle).min(SWAY_NEAR * near);
        let radii = DVec3::new(size, 0.5 * size, 0.0);
        let up = -origin.pose.r.y_axis;
        let circle = Spiral { frame: origin.pose, up, radii, focus: middle, turns: 1.0, z_rate: 0.0 };
        let cameras = circle.poses(n).into_iter().map(|pose| Camera { pose, ..origin }).collect();
        (cameras, "orbit: a small circle around the origin of the file, which is inside of the scene")
    }

    /// `frames` cameras along a path (default: 60, or as many as the file holds), and where an orbit goes, in words: a circle
    /// around the middle, a small one where cameras are inside of the scene, or a file.
    ///
    /// # Errors
    /// [`RunError::Option`] for a path that needs photos; [`RunError::Read`], [`RunError::Content`] for files.
    ///
    /// # Panics
    /// If there is no memory for the cameras of all frames.
    pub fn cameras(
        &self,
        kind: &PathKind,
        frames: Option<usize>,
    ) -> Result<(Vec<Camera>, Option<&'static str>), RunError> {
        match kind {
            PathKind::Orbit => {
                let (cameras, line) = self.orbit(frames.unwrap_or(FRAMES));
                Ok((cameras, Some(line)))
            }
            PathKind::File(path) => Ok((from_file(path, &self.camera(0.0), frames)?, None)),
            PathKind::Photos | PathKind::Spiral | PathKind::Hold(_) => Err(RunError::Option(format!(
                "`--path {kind}`: a file of Gaussians has no photos; use `--path orbit` or a file of cameras (`--path \
                 FILE.json`)"
            ))),
        }
    }
}

/// Middle and radius of what shows: medians along the axes, and a percentile of distances from there.
fn extent(cloud: &Gaussians) -> (DVec3, f64) {
    let n = cloud.len();
    let place = |i: usize| DVec3::from([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])));
    let mut shown: Vec<DVec3> = (0..n).filter(|&i| opacity(cloud, i) > SHOWS).map(place).collect();
    if shown.is_empty() {
        shown = (0..n).map(place).collect();
    }
    let at = |sorted: &mut Vec<f64>, share: f64| {
        sorted.sort_by(f64::total_cmp);
        sorted.get(((sorted.len().max(1) - 1) as f64 * share) as usize).copied()
    };
    let middle = [0, 1, 2].map(|k| at(&mut shown.iter().map(|x| x[k]).collect(), 0.5).unwrap_or(0.0));
    let mut distances = shown.iter().map(|x| x.distance(middle.into())).collect();
    let radius = at(&mut distances, MOST).filter(|r| *r > 0.0).unwrap_or(1.0);
    (middle.into(), radius)
}
