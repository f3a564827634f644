//! The code of a Gaussian at its start: waves along each axis at the place where it begins.

use splat_core::Gaussians;
use std::f32::consts::TAU;

/// Waves in the length of the scene along an axis.
const WAVES: [f32; 4] = [1.0, 2.0, 4.0, 8.0];
/// Numbers of a code: sine and cosine of each wave along each axis.
const ROWS: usize = 3 * 2 * WAVES.len();
/// The share of the Gaussians that lies within the length of the scene.
const WITHIN: f32 = 0.97;

/// Where waves begin along each axis, and how long the scene is there; internal units.
///
/// # Source
/// Kulhanek et al., "WildGaussians", 2024, section 3.2: Fourier features of the places of the first points, so that neighbours begin with
/// nearly the same code.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PlaceCodes {
    centre: [f32; 3],
    reach: [f32; 3],
}

impl PlaceCodes {
    /// Numbers of a code.
    pub(crate) const ROWS: usize = ROWS;

    /// For a cloud: about its middle, as far as most of it reaches.
    pub(crate) fn of(cloud: &Gaussians) -> Self {
        let n = cloud.len();
        let mut codes = Self { centre: [0.0; 3], reach: [1.0; 3] };
        for (axis, x) in cloud.mean.chunks_exact(n.max(1)).take(3).enumerate() {
            let finite = || x.iter().copied().filter(|x| x.is_finite());
            let count = finite().count();
            if count == 0 {
                continue;
            }
            let centre = (finite().map(f64::from).sum::<f64>() / count as f64) as f32;
            let mut away: Vec<f32> = finite().map(|x| (x - centre).abs()).collect();
            let at = ((WITHIN * count as f32) as usize).min(count - 1);
            let reach = *away.select_nth_unstable_by(at, f32::total_cmp).1;
            codes.centre[axis] = centre;
            // All in one plane: any length will do.
            codes.reach[axis] = if reach > 0.0 { reach } else { 1.0 };
        }
        codes
    }

    /// A coordinate along an axis: -1 to 1 in the length of the scene, and no further; 0 for what is no number.
    pub(super) fn within(&self, axis: usize, x: f32) -> f32 {
        let x = (x - self.centre[axis]) / self.reach[axis];
        if x.is_nan() { 0.0 } else { x.clamp(-1.0, 1.0) }
    }

    /// Codes of a cloud's Gaussians, `[ROWS][n]`.
    pub(crate) fn rows(&self, cloud: &Gaussians) -> Vec<f32> {
        let n = cloud.len();
        let mut rows = vec![0.0; ROWS * n];
        let pairs = rows.chunks_exact_mut(2 * n.max(1));
        let waves = WAVES.iter().flat_map(|wave| (0..3).map(move |axis| (*wave, axis)));
        for ((wave, axis), pair) in waves.zip(pairs) {
            let (sines, cosines) = pair.split_at_mut(n);
            for (i, (sine, cosine)) in sines.iter_mut().zip(cosines).enumerate() {
                let x = 0.5 * (cloud.mean[axis * n + i] - self.centre[axis]) / self.reach[axis] + 0.5;
                (*sine, *cosine) = (TAU * wave * x).sin_cos();
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussians along the first axis.
    fn along(x: &[f32]) -> Gaussians {
        let mut cloud = Gaussians::new(x.len(), 0).unwrap();
        cloud.mean[..x.len()].copy_from_slice(x);
        cloud
    }

    #[test]
    fn codes_are_waves_of_the_place_in_the_scene() {
        let cloud = along(&[-2.0, -1.0, 0.0, 1.0, 2.0]);
        let codes = PlaceCodes::of(&cloud);
        assert_eq!((codes.centre, codes.reach), ([0.0; 3], [2.0, 1.0, 1.0]));
        let rows = codes.rows(&cloud);
        assert_eq!(rows.len(), PlaceCodes::ROWS * 5);
        // The first wave along the first axis is once around from end to end; half way it is at minus one.
        let (sines, cosines) = (&rows[..5], &rows[5..10]);
        for (got, want) in sines.iter().chain(cosines).zip([0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0]) {
            assert!((got - want).abs() < 1e-5, "{rows:?}");
        }
    }

    #[test]
    fn a_few_that_are_far_off_do_not_stretch_the_scene() {
        let mut x: Vec<f32> = (0..100).map(|i| (i % 2) as f32 * 2.0 - 1.0).collect();
        x[0] = -1e6;
        x[1] = 1e6;
        let codes = PlaceCodes::of(&along(&x));
        assert!((codes.reach[0] - 1.0).abs() < 0.1, "{codes:?}");
        assert!(codes.rows(&along(&x)).iter().all(|x| x.is_finite()));
    }

    #[test]
    fn nothing_and_one_point_have_codes() {
        assert!(PlaceCodes::of(&along(&[])).rows(&along(&[])).is_empty());
        let one = along(&[3.0]);
        assert!(PlaceCodes::of(&one).rows(&one).iter().all(|x| x.is_finite()));
        assert_eq!(PlaceCodes::of(&along(&[f32::NAN])), PlaceCodes { centre: [0.0; 3], reach: [1.0; 3] });
    }
}
