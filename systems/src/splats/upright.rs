//! A file of Gaussians says neither which way is up nor where it is seen from: both are guessed from what shows.
//!
//! Up: floors and tables are large, flat and level, so among the flat Gaussians one of the frame's axes has many of its own. Files
//! come from structure from motion (y points down) unless they clearly do not; files that are drawn by hand or aligned have z up.

use super::cloud::Cloud;
use engine::render::plain_query;
use glam::{DQuat, DVec3};
use render_core::camera::Camera;
use splat_core::Gaussians;
use splat_core::density::opacity;

/// Gaussians fainter than this say nothing.
const SHOWS: f64 = 0.1;
/// A Gaussian is flat where its shortest axis is at most this part of the middle one.
const FLAT: f64 = 0.5;
/// Cosine of the angle within which a normal belongs to an axis, and within which it counts for the direction itself.
const NEAR_AXIS: f64 = 0.82;
const NEAR_UP: f64 = 0.94;
/// Another axis than y is up where it has this many times the weight of y.
const CLEARLY: f64 = 2.0;
/// With less than this share of all flat weight an axis says nothing of the direction itself.
const LEAST: f64 = 0.05;
/// Rounds that the direction is refined in.
const ROUNDS: usize = 4;

/// A unit vector that is likely up.
pub(super) fn guess(cloud: &Gaussians) -> DVec3 {
    let normals = normals(cloud);
    let total: f64 = normals.iter().map(|(_, w)| w).sum();
    let weight =
        |axis: DVec3| -> f64 { normals.iter().filter(|(n, _)| n.dot(axis).abs() > NEAR_AXIS).map(|(_, w)| w).sum() };
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(weight);
    let prior = match () {
        () if z > CLEARLY * y && z >= x => DVec3::Z,
        () if x > CLEARLY * y && x > z => DVec3::X,
        () => DVec3::NEG_Y,
    };
    if weight(prior) < LEAST * total {
        return prior;
    }
    let mut up = prior;
    for round in 0..ROUNDS {
        let near = if round == 0 { NEAR_AXIS } else { NEAR_UP };
        let sum: DVec3 =
            normals.iter().filter(|(n, _)| n.dot(up).abs() > near).map(|(n, w)| *n * n.dot(up).signum() * *w).sum();
        up = sum.try_normalize().unwrap_or(up);
    }
    if up.dot(prior) > NEAR_AXIS { up } else { prior }
}

/// Directions in which flat Gaussians are thin, with their opaque area.
fn normals(cloud: &Gaussians) -> Vec<(DVec3, f64)> {
    let n = cloud.len();
    let mut found: Vec<(DVec3, f64)> = (0..n)
        .filter_map(|i| {
            let shown = opacity(cloud, i);
            let mut scales = [0, 1, 2].map(|k| (f64::from(cloud.log_scale[k * n + i]).exp(), k));
            scales.sort_by(|a, b| a.0.total_cmp(&b.0));
            let [(thin, axis), (middle, _), (long, _)] = scales;
            let area = shown * middle * long;
            if shown <= SHOWS || thin > FLAT * middle || !(area.is_finite() && area > 0.0) {
                return None;
            }
            let [w, x, y, z] = [0, 1, 2, 3].map(|k| f64::from(cloud.wxyz[k * n + i]));
            let q = DQuat::from_xyzw(x, y, z, w);
            let q = (q.length_squared() > 1e-16).then(|| q.normalize())?;
            Some((q * DVec3::AXES[axis], area))
        })
        .collect();
    // A few huge ones must not outvote all others.
    let mut areas: Vec<f64> = found.iter().map(|(_, area)| *area).collect();
    areas.sort_by(f64::total_cmp);
    let most = areas.get(areas.len().saturating_sub(1) * 9 / 10).copied().unwrap_or(0.0);
    found.iter_mut().for_each(|(_, area)| *area = area.min(most));
    found
}

/// Index of the camera that sees the middle of the cloud best: much of its picture's middle is about as far away as the middle of
/// the cloud is, and little is before its nose.
pub(super) fn best(cloud: &Cloud, cameras: &[Camera]) -> usize {
    let (middle, _) = cloud.extent();
    let score = |camera: &Camera| {
        let Ok(view) = cloud.render(camera, &plain_query([0.0; 3], 0.0)) else { return f64::NEG_INFINITY };
        let distance = camera.pose.c.distance(middle);
        let (w, h) = (view.width as usize, view.height as usize);
        let (mut seen, mut close, mut inner) = (0.0, 0.0, 0.0);
        for i in 0..w * h {
            let (column, row) = (i % w, i / w);
            let depth = f64::from(view.layers.depth[i]);
            let opaque = f64::from(view.layers.opacity[i]);
            close += if depth < 0.35 * distance { opaque } else { 0.0 };
            if (w / 4..w - w / 4).contains(&column) && (h / 4..h - h / 4).contains(&row) {
                inner += 1.0;
                seen += if (0.5..1.4).contains(&(depth / distance)) { opaque } else { 0.0 };
            }
        }
        seen / f64::max(inner, 1.0) - 2.0 * close / (w * h).max(1) as f64
    };
    let scores: Vec<f64> = cameras.iter().map(score).collect();
    (0..scores.len()).reduce(|best, k| if scores[k] > scores[best] { k } else { best }).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::camera_path::PathKind;
    use field_core::rng::Rng;
    use splat_core::RasterSettings;

    /// A floor with normals along `up` and a ball on it.
    fn scene(up: DVec3) -> Gaussians {
        let n = 600;
        let mut cloud = Gaussians::new(n, 0).unwrap();
        let turn = DQuat::from_rotation_arc(DVec3::Z, up);
        let rng = Rng::new(5, 1);
        for i in 0..n {
            let u = rng.uniform4_at(i as u64).map(|x| f64::from(x) * 2.0 - 1.0);
            let on_floor = i < 400;
            let local = if on_floor {
                DVec3::new(3.0 * u[0], 3.0 * u[1], 0.0)
            } else {
                DVec3::new(u[0], u[1], u[2] + 1.0) * 0.5
            };
            let x = turn * local;
            let q = if on_floor { turn } else { DQuat::from_xyzw(u[0], u[1], u[2], u[3]).normalize() };
            for (k, v) in [q.w, q.x, q.y, q.z].into_iter().enumerate() {
                cloud.wxyz[k * n + i] = v as f32;
            }
            for k in 0..3 {
                cloud.mean[k * n + i] = x[k] as f32;
                cloud.log_scale[k * n + i] = if k == 2 { -5.0 } else { -2.5 };
            }
            cloud.logit[i] = 3.0;
        }
        cloud
    }

    #[test]
    fn the_floor_says_which_way_is_up() {
        for up in
            [DVec3::NEG_Y, DVec3::Z, DVec3::new(0.3, -0.95, 0.1).normalize(), DVec3::new(0.1, 0.2, 0.97).normalize()]
        {
            let found = guess(&scene(up));
            assert!(found.dot(up) > 0.99, "{up}: {found}");
        }
    }

    #[test]
    fn a_cloud_that_says_nothing_is_of_structure_from_motion() {
        assert_eq!(guess(&Gaussians::new(0, 0).unwrap()), DVec3::NEG_Y);
        assert_eq!(guess(&Gaussians::new(5, 0).unwrap()), DVec3::NEG_Y);
        let mut broken = Gaussians::new(3, 0).unwrap();
        broken.log_scale.fill(f32::NAN);
        broken.wxyz.fill(0.0);
        assert_eq!(guess(&broken), DVec3::NEG_Y);
    }

    #[test]
    fn the_first_view_shows_the_thing_from_where_nothing_is_before_it() {
        let mut gaussians = scene(DVec3::Z);
        let cloud = Cloud::new(gaussians.clone(), RasterSettings::DEFAULT);
        let cameras: Vec<Camera> = cloud.views();
        let (middle, radius) = cloud.extent();
        let to_middle = (middle - cameras[0].pose.c).normalize();
        assert!(cameras[0].optical_axis().dot(to_middle) > 0.99 && cameras[0].pose.c.z > 0.0, "from above");
        // A wall right before the camera that was the best.
        let wall = cameras[0].pose.c.lerp(middle, 0.1);
        for k in 0..3 {
            gaussians.mean[k * 600] = wall[k] as f32;
            gaussians.log_scale[k * 600] = (0.15 * radius).ln() as f32;
        }
        let blocked = Cloud::new(gaussians, RasterSettings::DEFAULT).views();
        assert!(blocked[0].pose.c.distance(cameras[0].pose.c) > 0.2 * radius, "another one is the best now");
    }

    #[test]
    fn an_orbit_goes_around_a_thing_and_stays_inside_of_a_room() {
        let orbit = |cloud: &Cloud| {
            let (cameras, line) = cloud.cameras(&PathKind::Orbit, Some(8)).unwrap();
            (cameras, line.unwrap())
        };
        let thing = Cloud::new(scene(DVec3::Z), RasterSettings::DEFAULT);
        let (middle, radius) = thing.extent();
        let (cameras, line) = orbit(&thing);
        assert!(cameras.iter().all(|c| c.pose.c.distance(middle) > radius) && line.contains("around"));
        // A shell about the place where the frame begins.
        let n = 800;
        let mut shell = Gaussians::new(n, 0).unwrap();
        for i in 0..n {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let (sin, cos) = (2.399_963_229_728_653 * i as f64).sin_cos();
            let (x, y) = ((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin);
            for (k, v) in [x, y, z].into_iter().enumerate() {
                shell.mean[k * n + i] = 5.0 * v as f32;
                shell.log_scale[k * n + i] = -0.7;
            }
            shell.wxyz[i] = 1.0;
            shell.logit[i] = 6.0;
        }
        let room = Cloud::new(shell, RasterSettings::DEFAULT);
        let (cameras, line) = orbit(&room);
        assert!(line.contains("inside"), "{line}");
        assert!(cameras.iter().all(|c| c.pose.c.length() < 0.5 && c.optical_axis().z > 0.99), "{cameras:?}");
        assert!(cameras[0].pose.c.distance(cameras[4].pose.c) > 0.1, "it moves");
    }
}
