//! How well a place of a picture can be found again.

use super::plane::Plane;

/// Pixels to each side that a place is told by: a window as large as a patch.
const REACH: usize = 3;
/// Noise that photos have, levels of grey.
const NOISE: f32 = 2.0;

/// Of each pixel of a picture a number in `[0, 1)`: `1 / (1 + s^2)`, `s` being the error of a flow vector along the direction in which the window
/// around the pixel says least, pixels, that noise would make. 0 where all is one grey.
///
/// `s^2 = NOISE^2 / l`, `l` being the smaller eigenvalue of the sum over the window of `grad I grad I^T` (Lucas and Kanade, 1981; Shi and Tomasi,
/// "Good features to track", 1994).
pub(super) fn confidence(grey: &Plane) -> Plane {
    let (gx, gy) = (grey.along_x(), grey.along_y());
    let summed = |a: &Plane, b: &Plane| {
        let product = Plane::from_fn(grey.width(), grey.height(), |x, y| a.at(x, y) * b.at(x, y));
        window_sums(&product)
    };
    let (xx, xy, yy) = (summed(&gx, &gx), summed(&gx, &gy), summed(&gy, &gy));
    Plane::from_fn(grey.width(), grey.height(), |x, y| {
        let (xx, xy, yy) = (xx.at(x, y), xy.at(x, y), yy.at(x, y));
        let smaller = 0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy);
        let smaller = smaller.max(0.0);
        smaller / (smaller + NOISE * NOISE)
    })
}

/// Sums over the window around each pixel; what is outside the picture counts as 0.
fn window_sums(plane: &Plane) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let span = |i: usize, n: usize| i.saturating_sub(REACH)..(i + REACH + 1).min(n);
    let across = Plane::from_fn(width, height, |x, y| plane.row(y)[span(x, width)].iter().sum());
    Plane::from_fn(width, height, |x, y| span(y, height).map(|row| across.at(x, row)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_found_again_and_edges_and_walls_are_not() {
        let of = |grey: fn(usize, usize) -> f32| confidence(&Plane::from_fn(40, 30, grey)).at(20, 15);
        assert_eq!(of(|_, _| 99.0), 0.0);
        assert!(of(|x, _| if x < 20 { 20.0 } else { 220.0 }) < 0.01, "an edge may slide along itself");
        assert!(of(|x, y| if x < 20 && y < 15 { 20.0 } else { 220.0 }) > 0.99);
        assert!(of(|x, y| 100.0 + ((x * 7 + y * 3) % 2) as f32) < 0.9, "a pattern that is little more than noise");
    }
}
