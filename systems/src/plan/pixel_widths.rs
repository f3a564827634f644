//! How much the widths of pixels differ at what photos show.

use engine::data::{Dataset, View};
use render_core::bounds::percentile;

/// Pixels of most photos differ less than this, as a factor: a level of detail.
const ALIKE: f64 = 2.0;

/// The ratio of wide pixels to fine ones, the 90th percentile of photos to the 10th, where it is above [`ALIKE`]. The width is that at
/// the median depth of the points that a photo shows. Where no photo shows any, all are taken to be as far from what they show.
pub(crate) fn differing_widths(data: &Dataset) -> Option<f64> {
    let of_points = sorted(data.views().iter().filter_map(|view| Some(median_depth(view)? / focal(view))));
    let widths =
        if of_points.is_empty() { sorted(data.views().iter().map(|view| 1.0 / focal(view))) } else { of_points };
    let ratio = percentile(&widths, 0.9)? / percentile(&widths, 0.1)?;
    (ratio > ALIKE && ratio.is_finite()).then_some(ratio)
}

/// Focal length, pixels.
fn focal(view: &View) -> f64 {
    view.camera.fx.max(view.camera.fy)
}

/// Depth of half of the points that a photo shows.
fn median_depth(view: &View) -> Option<f64> {
    percentile(&sorted(view.points.iter().map(|point| view.camera.pose.to_camera(*point).z)), 0.5)
}

/// Those that are positive.
fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = numbers.filter(|x| *x > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use scene_io::Point;

    #[test]
    fn a_photo_from_nearby_or_of_a_longer_lens_has_finer_pixels() {
        let of = |zoom: f64, points: &[Point]| {
            let mut frames = made::frames(4, |_, _, _| [9, 9, 9, 255]);
            for frame in frames.iter_mut().step_by(2) {
                frame.camera.fx *= zoom;
                frame.camera.fy *= zoom;
            }
            differing_widths(&made::scene(frames, points.to_vec()).1)
        };
        let points = made::capture(made::Points::WithoutTracks).0.points;
        for points in [&[], &points[..]] {
            assert_eq!([1.0, 1.5].map(|zoom| of(zoom, points)), [None; 2]);
            let ratio = of(4.0, points).unwrap();
            assert!((ratio - 4.0).abs() < 0.5, "{ratio}");
        }
    }
}
