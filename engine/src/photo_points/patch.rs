//! Squares of grey values around a place, compared by normalised correlation.

use super::photo::Level;
use glam::{DMat2, DVec2};

/// Samples along a side, and pixels between them.
pub(super) const SIDE: usize = 8;
pub(super) const STEP: f32 = 1.25;
/// Samples of a patch.
pub(super) const SAMPLES: usize = SIDE * SIDE;
/// Contrast (deviation of grey values) below which a patch shows nothing, grey levels.
const LEAST_CONTRAST: f32 = 1.5;

/// A patch with mean 0 and length 1.
pub(super) type Patch = [f32; SAMPLES];

/// The patch of a level about `x`, a pixel of the photo (full size), its samples placed by `turn`: pixels of the full size for a
/// step of the patch of one pixel. `None` where it leaves the photo or shows nothing.
pub(super) fn patch(level: &Level, scale: f32, x: DVec2, turn: &DMat2) -> Option<Patch> {
    // Of this level, centres at whole numbers.
    let (x, y) = (x.x as f32 * scale - 0.5, x.y as f32 * scale - 0.5);
    let t = turn.to_cols_array().map(|v| v as f32);
    // Steps are pixels of the level: the smaller one shows more around the place.
    let half = 0.5 * (SIDE - 1) as f32 * STEP;
    let reach = half * (t[0].abs() + t[2].abs()).max(t[1].abs() + t[3].abs());
    if !level.surrounds(x, y, reach) {
        return None;
    }
    let mut out = [0.0_f32; SAMPLES];
    let (mut sum, mut square) = (0.0_f32, 0.0_f32);
    for (j, row) in out.chunks_exact_mut(SIDE).enumerate() {
        let v = j as f32 * STEP - half;
        let (x, y) = (x + t[2] * v, y + t[3] * v);
        for (i, value) in row.iter_mut().enumerate() {
            let u = i as f32 * STEP - half;
            *value = level.sample(x + t[0] * u, y + t[1] * u) * (1.0 / 256.0);
            sum += *value;
        }
    }
    let mean = sum / SAMPLES as f32;
    for value in &mut out {
        *value -= mean;
        square += *value * *value;
    }
    if square < LEAST_CONTRAST * LEAST_CONTRAST * SAMPLES as f32 {
        return None;
    }
    let inverse = 1.0 / square.sqrt();
    out.iter_mut().for_each(|v| *v *= inverse);
    Some(out)
}

/// Correlation of two patches.
pub(super) fn ncc(a: &Patch, b: &Patch) -> f32 {
    let mut sums = [0.0_f32; 8];
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::Image;

    #[test]
    fn a_patch_that_ends_at_the_border_up_to_rounding_is_one() {
        let data = (0..640 * 480 * 3).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let level = Level::of(&Image::rgb(640, 480, data).unwrap());
        // The corner lies inside by the sum of the sides, and on the last row by the sum of the places.
        let turn = DMat2::from_cols_array(&[1.0, 0.040_475_770_831_108_09, 0.0, 1.103_980_660_438_537_6]);
        let at = DVec2::new(320.0, 474.492_980_957_031_25);
        let found = patch(&level, 1.0, at, &turn).unwrap();
        assert!(found.iter().all(|v| v.is_finite()));
        assert!(patch(&level, 1.0, at + DVec2::Y, &turn).is_none());
    }
}
