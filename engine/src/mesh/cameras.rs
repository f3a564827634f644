//! From where depth is rendered: the photos' cameras without their lenses, and some between them where there are few.

use super::depth::Place;
use glam::DVec3;
use render_core::camera::{Camera, Lens, Pose};
use render_core::path::{Ends, through};

/// Pictures at most; more add nothing that these do not show.
const MOST: usize = 150;
/// With fewer, cameras between neighbours are added.
const FEW: usize = 40;
/// Pixels of all pictures, and of the longest side of one, at most.
const PIXELS: f64 = 8e6;
const LONGEST: f64 = 800.0;
/// Cosine of the angle between the axes of neighbours that may have a camera between them.
const TOGETHER: f64 = 0.8;

/// Cameras to render depth from, for photos taken with `photos`.
#[must_use]
pub fn around(photos: &[Camera]) -> Vec<(Camera, Place)> {
    let mut own: Vec<Camera> = Vec::new();
    for camera in photos {
        // A camera that stands still is taken once.
        if !own.iter().any(|c| c.pose == camera.pose && c.width == camera.width && c.fx == camera.fx) {
            own.push(Camera { lens: Lens::PINHOLE, ..*camera });
        }
    }
    if own.len() > MOST {
        own = (0..MOST).map(|k| own[k * own.len() / MOST]).collect();
    }
    let between = if own.len() < FEW { between(&own) } else { Vec::new() };
    let placed = own.into_iter().map(|c| (c, Place::Photo)).chain(between.into_iter().map(|c| (c, Place::Between)));
    let mut all: Vec<(Camera, Place)> = placed.collect();
    let total: f64 = all.iter().map(|(c, _)| f64::from(c.width) * f64::from(c.height)).sum();
    for (camera, _) in &mut all {
        let longest = f64::from(camera.width.max(camera.height));
        let scale = (PIXELS / total).sqrt().min(LONGEST / longest).min(1.0);
        let side = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
        *camera = camera.resized(side(camera.width), side(camera.height));
    }
    all
}

/// A camera half way from each to its nearest neighbour with about the same axis.
fn between(own: &[Camera]) -> Vec<Camera> {
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for (i, camera) in own.iter().enumerate() {
        let near = (0..own.len())
            .filter(|&j| j != i && own[j].optical_axis().dot(camera.optical_axis()) > TOGETHER)
            .min_by(|&a, &b| {
                let away = |j: usize| own[j].pose.c.distance_squared(camera.pose.c);
                away(a).total_cmp(&away(b)).then(a.cmp(&b))
            });
        pairs.extend(near.map(|j| [i.min(j), i.max(j)]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    let middle = |[i, j]: [usize; 2]| {
        let poses: [Pose; 2] = [own[i].pose, own[j].pose];
        through(&poses, 3, Ends::Open).get(1).map(|&pose| Camera { pose, ..own[i] })
    };
    pairs.into_iter().filter_map(middle).collect()
}

/// `n` pinholes like `optics`, evenly on a sphere around `middle`, looking at it: for a cloud without photos.
#[must_use]
pub fn on_a_sphere(optics: &Camera, middle: DVec3, distance: f64, n: usize) -> Vec<Camera> {
    let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let camera = |k: usize| {
        let height = 1.0 - 2.0 * (k as f64 + 0.5) / n as f64;
        let (ring, turn) = ((1.0 - height * height).sqrt(), golden * k as f64);
        let way = DVec3::new(ring * turn.cos(), height, ring * turn.sin());
        // Up is nothing to a depth; any that is not the way itself will do.
        let pose = Pose::look_at(middle + way * distance, middle, way.any_orthonormal_vector())?;
        Some(Camera { pose, lens: Lens::PINHOLE, ..*optics })
    };
    (0..n).filter_map(camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_pinholes_within_the_budget_and_few_have_others_between_them() {
        let optics = Camera::pinhole(1600, 1200, 1500.0, 1500.0, 800.0, 600.0, Pose::IDENTITY);
        let sphere = on_a_sphere(&optics, DVec3::ONE, 3.0, 30);
        assert_eq!(sphere.len(), 30);
        for camera in &sphere {
            assert!((camera.pose.c.distance(DVec3::ONE) - 3.0).abs() < 1e-9);
            assert!(camera.optical_axis().dot((DVec3::ONE - camera.pose.c).normalize()) > 1.0 - 1e-9);
        }
        let again: Vec<Camera> = sphere.iter().chain(&sphere).copied().collect();
        let all = around(&again);
        let own = all.iter().filter(|(_, place)| *place == Place::Photo).count();
        assert!(own == 30 && all.len() > 40, "{own} of {}", all.len());
        let pixels: f64 = all.iter().map(|(c, _)| f64::from(c.width) * f64::from(c.height)).sum();
        assert!(pixels < PIXELS * 1.01 && all.iter().all(|(c, _)| c.width <= 800));
        assert_eq!(around(&on_a_sphere(&optics, DVec3::ZERO, 1.0, 400)).len(), MOST);
        assert!(around(&[]).is_empty());
    }
}
