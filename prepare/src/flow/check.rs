//! Which flow vectors can be relied on.

use super::dense::DenseFlow;
use scene_io::{BitMask, Flow};

/// Least confidence of a flow vector that counts: noise alone would move it by less than a pixel.
const CONFIDENT: f32 = 0.5;

/// Whether the way there and back does not end where it began: `|f + b|^2 > 0.01 (|f|^2 + |b|^2) + 0.5`, `b` being the flow back from where `f`
/// leads, pixels.
///
/// # Source
/// Sundaram, Brox and Keutzer, "Dense point trajectories by GPU-accelerated large displacement optical flow", 2010, equation 5.
#[must_use]
pub fn is_occluded(forward: [f32; 2], backward: [f32; 2]) -> bool {
    let squared = |v: [f32; 2]| v[0] * v[0] + v[1] * v[1];
    let way = [forward[0] + backward[0], forward[1] + backward[1]];
    squared(way) > 0.01 * (squared(forward) + squared(backward)) + 0.5
}

/// The flow with the pixels of which the other picture truly shows the same: both show a surface there (`surfaces`, of this picture and the
/// other), it leads into the other picture, it is confident, and the way back ends where it began.
pub(super) fn checked(flow: &DenseFlow, back: &DenseFlow, surfaces: [&BitMask; 2]) -> Flow {
    let (width, height) = (flow.width(), flow.height());
    let [here, there] = surfaces;
    let is_seen = |column: u32, row: u32| {
        let (x, y) = (column as usize, row as usize);
        let way = flow.at(x, y);
        let place = [x as f32 + way[0], y as f32 + way[1]];
        let [Some(to_column), Some(to_row)] = [pixel(place[0], width), pixel(place[1], height)] else { return false };
        here.get(column, row)
            && there.get(to_column, to_row)
            && flow.confidence(x, y) >= CONFIDENT
            && !is_occluded(way, back.between(place[0], place[1]))
    };
    let seen = BitMask::from_fn(width as u32, height as u32, is_seen);
    Flow { width: width as u32, height: height as u32, vectors: flow.vectors().to_vec(), seen }
}

/// The pixel of `n` that a place along an axis lies on, in index coordinates.
fn pixel(place: f32, n: usize) -> Option<u32> {
    let nearest = (place + 0.5).floor();
    (0.0..n as f32).contains(&nearest).then_some(nearest as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_back_may_be_wrong_by_a_tenth_of_the_way_and_a_little() {
        assert!(!is_occluded([0.0, 0.0], [0.7, 0.0]) && is_occluded([0.0, 0.0], [0.72, 0.0]));
        // 0.01 (100 + 100) + 0.5 = 2.5.
        assert!(!is_occluded([10.0, 0.0], [-10.0, 1.5]) && is_occluded([10.0, 0.0], [-10.0, 1.65]));
    }

    #[test]
    fn places_are_on_the_pixel_whose_centre_is_nearest() {
        assert_eq!([-0.6, -0.5, 0.49, 2.4, 2.5].map(|place| pixel(place, 3)), [None, Some(0), Some(0), Some(2), None]);
        assert_eq!(pixel(f32::NAN, 3), None);
    }
}
