//! A picture at several sizes, each half of the one before.

use super::plane::{Plane, nearest};

/// Shortest side that is halved no more, pixels: two patches.
const SHORTEST: usize = 16;
/// Taps of the filter at the full size: what is finer than two pixels has no derivative to speak of.
const SMOOTH: [f32; 3] = [0.25, 0.5, 0.25];
/// Taps of the filter before a halving, around the middle of two pixels.
const HALVE: [f32; 4] = [0.125, 0.375, 0.375, 0.125];

/// The picture slightly smoothed, and halves of it, largest first. Pixel `i` of a level covers pixels `2 i` and `2 i + 1` of the one before.
pub(super) fn pyramid(picture: &Plane) -> Vec<Plane> {
    let mut levels = vec![filtered(picture, &SMOOTH, 1)];
    while let Some(last) = levels.last()
        && last.width().min(last.height()) >= 2 * SHORTEST
    {
        let next = filtered(last, &HALVE, 2);
        levels.push(next);
    }
    levels
}

/// Every `step`th sum of the pixels around one with the weights `taps`, across and then down.
fn filtered(picture: &Plane, taps: &[f32], step: usize) -> Plane {
    let (width, height) = (picture.width(), picture.height());
    let sum =
        |begin: isize, at: &dyn Fn(isize) -> f32| -> f32 { (begin..).zip(taps).map(|(i, tap)| tap * at(i)).sum() };
    let begin = |i: usize| (step * i) as isize - 1;
    let across = Plane::from_fn(width.div_ceil(step), height, |x, y| {
        let row = picture.row(y);
        sum(begin(x), &|i| row[nearest(i, width)])
    });
    Plane::from_fn(across.width(), height.div_ceil(step), |x, y| sum(begin(y), &|i| across.at(x, nearest(i, height))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_halves_down_to_two_patches() {
        let sizes = |width, height| -> Vec<(usize, usize)> {
            pyramid(&Plane::from_fn(width, height, |_, _| 7.0)).iter().map(|p| (p.width(), p.height())).collect()
        };
        assert_eq!(sizes(100, 65), [(100, 65), (50, 33), (25, 17)]);
        assert_eq!(sizes(31, 200), [(31, 200)]);
        assert_eq!(sizes(1, 1), [(1, 1)]);
    }

    #[test]
    fn brightness_and_places_are_kept() {
        let levels = pyramid(&Plane::from_fn(64, 64, |x, y| 3.0 * x as f32 - y as f32));
        assert_eq!(levels.len(), 3);
        // Away from the borders a ramp stays one: pixel i of a half has its centre at 2 i + 1/2.
        assert!((levels[0].at(20, 10) - 50.0).abs() < 1e-3);
        assert!((levels[1].at(10, 8) - (3.0 * 20.5 - 16.5)).abs() < 1e-3, "{}", levels[1].at(10, 8));
        assert!((levels[2].at(5, 7) - (3.0 * 21.5 - 29.5)).abs() < 1e-3, "{}", levels[2].at(5, 7));
    }
}
