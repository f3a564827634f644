//! Points of the surface that cameras see.

use super::depth::{DepthView, Place};
use crate::crop::CropBox;
use crate::surface::inside;
use scene_io::export::PointCloud;

/// About `count` coloured points with normals, inside `crop`: what evenly chosen pixels of the photos' views show, away from
/// edges. Confidence is how straight and how opaque the surface was seen.
#[must_use]
pub fn seen_points(views: &[DepthView], crop: &CropBox, count: usize) -> PointCloud {
    let photos = || views.iter().filter(|v| v.place == Place::Photo);
    let wanted = |view: &DepthView, i: usize| {
        if !view.is_steady(i) {
            return None;
        }
        view.point(i).map(|x| x.to_array()).filter(|x| inside(x, crop))
    };
    let there: usize = photos().map(|view| (0..view.len()).filter(|&i| wanted(view, i).is_some()).count()).sum();
    let mut cloud = PointCloud::default();
    // Every n-th of those that there are, counted through all views.
    let (mut k, count) = (0, count.min(there));
    for view in photos() {
        for i in 0..view.len() {
            let Some(x) = wanted(view, i) else { continue };
            k += 1;
            if k * count / there > (k - 1) * count / there {
                cloud.positions.push(x);
                cloud.colours.push(view.rgb[i]);
                cloud.normals.push(view.world_normal(i).map_or([0.0; 3], |n| n.to_array()));
                cloud.confidence.push(view.weight[i]);
            }
        }
    }
    cloud
}

#[cfg(test)]
mod tests {
    use super::super::tests::{all_around, sphere};
    use super::*;
    use glam::{DVec3, Vec3};

    #[test]
    fn points_lie_on_the_surface_with_their_normals() {
        let views = all_around(&sphere(0.8), 6, 40);
        let cloud = seen_points(&views, &[[-2.0, -2.0, 0.0], [2.0; 3]], 300);
        assert_eq!(cloud.positions.len(), 300);
        for (x, n) in cloud.positions.iter().zip(&cloud.normals) {
            let x = DVec3::from(*x);
            assert!((x.length() - 0.8).abs() < 1e-3 && x.z >= 0.0);
            assert!(Vec3::from(*n).as_dvec3().dot(x.normalize()) > 0.9);
        }
        assert!(seen_points(&[], &[[0.0; 3], [1.0; 3]], 10).positions.is_empty());
    }
}
