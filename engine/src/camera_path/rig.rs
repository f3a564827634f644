//! What the training cameras have in common: optics, up, how far away what they look at is, and where.

use super::sight::Sight;
use crate::data::{Dataset, View};
use crate::names::natural;
use glam::{DMat3, DVec3};
use render_core::bounds::percentile;
use render_core::camera::{Camera, Lens, Pose};
use render_core::rig::{geometric_median, mean_centre, robust_focus_point, up_axis};
use scene_io::{LayoutHint, Scene};
use std::cmp::Ordering;
use std::f64::consts::FRAC_PI_2;

/// Points of a photo from which on their depth counts.
const POINTS: usize = 8;
/// A focus point counts where this share of the cameras has it before them.
const BEFORE: f64 = 0.8;
/// Its distance and that of the surfaces agree within this factor.
const AGREE: f64 = 2.5;
/// Cameras nearer to the vertical than this cosine have no roll.
const STEEP: f64 = 0.9;

/// The training cameras, in the order of time or, where nothing moves, of their names.
#[derive(Clone, Debug)]
pub(super) struct Rig {
    /// A camera with the common optics: a pinhole.
    pub(super) optics: Camera,
    /// Poses, quarter turns of the camera taken off.
    pub(super) poses: Vec<Pose>,
    /// Time of each.
    pub(super) times: Vec<f64>,
    /// Up, as far as the cameras say.
    pub(super) up: Option<DVec3>,
    /// Typical distance from a camera to what it looks at, world units, positive.
    pub(super) scale: f64,
    /// The point most of them look at.
    pub(super) focus: Option<DVec3>,
}

impl Rig {
    /// `None` without training views.
    pub(super) fn of(scene: &Scene, data: &Dataset, sight: Option<&Sight<'_>>) -> Option<Self> {
        let mut views: Vec<(usize, &View)> = data.views().iter().enumerate().filter(|(_, v)| v.level == 0).collect();
        views.sort_by(|(_, a), (_, b)| a.time.total_cmp(&b.time).then_with(|| natural(&a.name, &b.name)));
        let given: Vec<Pose> = views.iter().map(|(_, v)| v.camera.pose).collect();
        let optics = common_optics(&views.iter().map(|(_, v)| v.camera).collect::<Vec<_>>())?;
        let depth = |(i, view): &(usize, &View)| {
            sight.and_then(|s| s.depth_of(*i)).or_else(|| depth_of_points(view)).or_else(|| depth_told(scene, view))
        };
        let depths: Vec<Option<f64>> = views.iter().map(depth).collect();
        let up = up_axis(&given);
        let poses = given.iter().map(|pose| up.map_or(*pose, |up| upright(pose, up))).collect();
        let typical = median(depths.iter().flatten().copied().collect());
        let focus = focus(&given, &depths, typical);
        let scale = typical.or_else(|| {
            let focus = focus?;
            median(given.iter().map(|p| p.c.distance(focus)).collect())
        });
        let extent = || {
            let middle = mean_centre(&given)?;
            median(given.iter().map(|p| p.c.distance(middle)).collect())
        };
        let positive = |x: &f64| *x > 0.0 && x.is_finite();
        let scale = scale.filter(positive).or_else(|| extent().filter(positive)).unwrap_or(1.0);
        let times = views.iter().map(|(_, v)| v.time).collect();
        Some(Self { optics, poses, times, up, scale, focus })
    }

    /// A camera of the common optics.
    pub(super) fn camera(&self, pose: Pose) -> Camera {
        Camera { pose, ..self.optics }
    }
}

/// Size that most photos have, and of those the one with the middle focal length, without its distortion.
fn common_optics(cameras: &[Camera]) -> Option<Camera> {
    let size = |c: &Camera| (c.width, c.height);
    let count = |c: &Camera| cameras.iter().filter(|other| size(other) == size(c)).count();
    let most = cameras.iter().map(count).max()?;
    let common = cameras.iter().find(|c| count(c) == most)?;
    let focal = |c: &Camera| (c.fx + c.fy) / f64::from(c.width.max(c.height));
    let middle = median(cameras.iter().map(focal).collect())?;
    let nearest = |a: &&Camera, b: &&Camera| (focal(a) - middle).abs().total_cmp(&(focal(b) - middle).abs());
    let taken = cameras.iter().filter(|c| size(c) == size(common)).min_by(nearest)?;
    let factor = middle / focal(taken);
    // Photos of one size may all be of another camera than most; and a path of photos of one camera has its optics to the bit.
    let factor = if (factor - 1.0).abs() < 0.02 { 1.0 } else { factor };
    let lens = Lens::Perspective { k: [0.0; 6], p: [0.0; 2] };
    Some(Camera { fx: taken.fx * factor, fy: taken.fy * factor, lens, ..*taken })
}

/// Distance of the points that a photo shows, world units.
fn depth_of_points(view: &View) -> Option<f64> {
    let before = view.points.iter().filter(|p| view.camera.pose.to_camera(**p).z > 0.0);
    let away: Vec<f64> = before.map(|p| p.distance(view.camera.pose.c)).collect();
    if away.len() < POINTS { None } else { median(away) }
}

/// Distance that the dataset itself tells.
fn depth_told(scene: &Scene, view: &View) -> Option<f64> {
    match (scene.frames.get(view.frame).and_then(|f| f.z_bounds), scene.layout) {
        // In the middle in inverse distance.
        (Some([near, far]), _) if near > 0.0 && far >= near => Some(2.0 / (1.0 / near + 1.0 / far)),
        (_, LayoutHint::Object { near, far }) if near >= 0.0 && far > near => Some(0.5 * (near + far)),
        _ => None,
    }
}

/// The point the optical axes agree on, where it is before the cameras and as far away as what they see; else the middle of
/// what they see in their centres, or of the cameras where they look outward.
fn focus(poses: &[Pose], depths: &[Option<f64>], typical: Option<f64>) -> Option<DVec3> {
    let before = |point: DVec3| {
        poses.iter().filter(|p| p.to_camera(point).z > 0.0).count() as f64 >= BEFORE * poses.len() as f64
    };
    let agrees = |point: DVec3| {
        let away = median(poses.iter().map(|p| p.c.distance(point)).collect());
        typical.zip(away).is_none_or(|(typical, away)| away < AGREE * typical && typical < AGREE * away)
    };
    let axes = robust_focus_point(poses).filter(|&p| before(p) && agrees(p));
    axes.or_else(|| {
        let seen = |(pose, depth): (&Pose, &Option<f64>)| depth.map(|t| pose.c + pose.r.z_axis * t);
        let aims: Vec<DVec3> = poses.iter().zip(depths).filter_map(seen).collect();
        let middle = geometric_median(&aims)?;
        if before(middle) { Some(middle) } else { mean_centre(poses) }
    })
}

/// A pose with quarter turns about its axis taken off: photos taken with the camera on its side.
fn upright(pose: &Pose, up: DVec3) -> Pose {
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = pose.r;
    if z.dot(up).abs() > STEEP {
        return *pose;
    }
    let roll = up.dot(x).atan2(-up.dot(y));
    let r = match (roll / FRAC_PI_2).round() as i32 {
        1 => DMat3::from_cols(y, -x, z),
        -1 => DMat3::from_cols(-y, x, z),
        0 => pose.r,
        _ => DMat3::from_cols(-x, -y, z),
    };
    Pose { r, c: pose.c }
}

pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    percentile(&values, 0.5)
}

/// The better of two values of a sequence, the first of equals.
pub(super) fn best<T>(items: impl IntoIterator<Item = T>, value: impl Fn(&T) -> f64) -> Option<T> {
    items.into_iter().reduce(|a, b| if value(&b).total_cmp(&value(&a)) == Ordering::Greater { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_on_its_side_is_set_upright() {
        let level = Pose::look_at(DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        for quarters in 0..4 {
            let turn = DMat3::from_rotation_z(f64::from(quarters) * FRAC_PI_2 + 0.2);
            let turned = Pose { r: level.r * turn, c: level.c };
            let found = upright(&turned, DVec3::Z);
            let want = level.r * DMat3::from_rotation_z(0.2);
            assert!(found.r.abs_diff_eq(want, 1e-12), "{quarters}");
        }
    }

    #[test]
    fn the_common_optics_are_those_of_most_photos() {
        let camera = |w: u32, h: u32, f: f64| {
            Camera::pinhole(w, h, f, f, 0.5 * f64::from(w), 0.5 * f64::from(h), Pose::IDENTITY)
        };
        let photos = [camera(40, 30, 50.0), camera(30, 40, 50.0), camera(40, 30, 52.0), camera(40, 30, 400.0)];
        let found = common_optics(&photos).unwrap();
        assert_eq!((found.width, found.height), (40, 30));
        assert!((found.fx - 51.0).abs() < 1.5, "{}", found.fx);
        assert_eq!(common_optics(&[]), None);
    }
}
