//! How far away is what a photo shows, as the clouds have it: in a small square picture, to be encoded with the photo.

use super::drawing::{DrawnCloud, Projections};
use super::driver::Views;
use super::hooks::SeenDepth;
use float_core::Simd;
use splat_core::{Raster, RasterSettings, SplatError, View};

/// What a pixel shows is opaque from here on: below, its depth is one of nothing.
const SHOWS: f32 = 0.5;

/// Depths, as [`SeenDepth`] has them.
pub(super) struct PhotoDepth {
    side: usize,
    z: Vec<f32>,
}

impl PhotoDepth {
    /// Of what `view` sees of clouds; pixels of the photo, of the size of the view, that have no weight do not count.
    ///
    /// # Errors
    /// [`SplatError`] for a camera that cannot see.
    fn of(
        simd: Simd,
        clouds: &[DrawnCloud<'_>],
        view: &View,
        settings: &RasterSettings,
        side: usize,
        weights: Option<&[f32]>,
    ) -> Result<Self, SplatError> {
        let small = squared(view, side);
        let mut projections = Projections::default();
        projections.project(simd, clouds, &small, settings)?;
        let features: Vec<[f32; 1]> = projections.gaussians().iter().map(|gaussian| [gaussian.z]).collect();
        let mut raster = Raster::<1>::default();
        raster.draw(simd, projections.gaussians(), &features, small.size, settings)?;
        let pixels = side * side;
        let mut planes = vec![0.0; 2 * pixels];
        raster.planes(&mut planes)?;
        let (depth, transmittance) = planes.split_at(pixels);
        let of = |(depth, t): (&f32, &f32)| if 1.0 - t > SHOWS { depth / (1.0 - t) } else { 0.0 };
        let mut z: Vec<f32> = depth.iter().zip(transmittance).map(of).collect();
        if let Some(weights) = weights {
            let used = counting(weights, view.size, side);
            z.iter_mut().zip(used).filter(|(_, used)| !used).for_each(|(z, _)| *z = 0.0);
        }
        Ok(Self { side, z })
    }

    pub(super) fn seen(&self) -> SeenDepth<'_> {
        SeenDepth { size: [self.side; 2], z: &self.z }
    }
}

/// The same view in a square picture.
fn squared(view: &View, side: usize) -> View {
    let share = view.size.map(|n| side as f32 / n.max(1) as f32);
    let scaled = |x: [f32; 2]| [x[0] * share[0], x[1] * share[1]];
    View { f: scaled(view.f), c: scaled(view.c), size: [side; 2], ..*view }
}

/// Which pixels of a square hold more of a photo that counts than of one that does not.
fn counting(weights: &[f32], size: [usize; 2], side: usize) -> Vec<bool> {
    // Those of the photo within each pixel, one at least.
    let within = |i: usize, n: usize| {
        let first = i * n / side;
        first..((i + 1) * n / side).max(first + 1).min(n)
    };
    let pixels = (0..side).flat_map(|y| (0..side).map(move |x| [x, y]));
    let counts = pixels.map(|[x, y]| {
        let (columns, rows) = (within(x, size[0]), within(y, size[1]));
        let all = columns.len() * rows.len();
        let used: usize = rows
            .map(|row| weights[row * size[0]..][columns.clone()].iter().filter(|weight| **weight > 0.5).count())
            .sum();
        2 * used > all
    });
    counts.collect()
}

impl Views {
    /// Depths of the photo of `view` at a time, where the appearance asks for them in the next step.
    pub(super) fn photo_depth(&self, view: &View, time: f64, weights: Option<&[f32]>) -> Option<PhotoDepth> {
        let part = self.parts.appearance.as_deref()?;
        let side = part.depth_side(self.position.of(self.steps))?;
        let clouds = self.clouds_at(time);
        let settings = self.parts.pictures.raster();
        // A camera that cannot see has no depths.
        PhotoDepth::of(self.simd, &self.drawn(&clouds), view, &settings, side, weights).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splat_core::Gaussians;

    /// A wall of large opaque Gaussians two units before the origin; `right` is how far it is on the right.
    fn wall(right: f32) -> Gaussians {
        let n = 41 * 41;
        let mut cloud = Gaussians::new(n, 0).unwrap();
        for i in 0..n {
            let [x, y] = [i % 41, i / 41].map(|k| 0.1 * (k as f32 - 20.0));
            let z = if x > 0.0 { right } else { 2.0 };
            (cloud.mean[i], cloud.mean[n + i], cloud.mean[2 * n + i]) = (x * z / 2.0, y * z / 2.0, z);
            (cloud.logit[i], cloud.wxyz[i]) = (6.0, 1.0);
            (0..3).for_each(|k| cloud.log_scale[k * n + i] = (0.1_f32).ln());
        }
        cloud
    }

    #[test]
    fn depths_are_those_of_the_walls_and_not_known_where_nothing_counts() {
        let view = View { f: [40.0, 40.0], c: [20.0, 15.0], ..View::at_origin([40, 30]) };
        let cloud = wall(3.0);
        let of = |cloud: &Gaussians, weights: Option<&[f32]>| {
            let clouds = [DrawnCloud::alone(cloud)];
            PhotoDepth::of(Simd::best(), &clouds, &view, &RasterSettings::DEFAULT, 16, weights).unwrap().z
        };
        let z = of(&cloud, None);
        for y in 0..16 {
            assert!(
                (z[y * 16 + 3] - 2.0).abs() < 0.05 && (z[y * 16 + 13] - 3.0).abs() < 0.05,
                "{:?}",
                &z[y * 16..][..16]
            );
        }
        // The upper half of the photo does not count.
        let weights: Vec<f32> = (0..1200).map(|i| if i < 600 { 0.0 } else { 1.0 }).collect();
        let half = of(&cloud, Some(&weights));
        assert!(half[..128].iter().all(|z| *z == 0.0) && half[128..] == z[128..]);
        assert!(of(&Gaussians::new(0, 0).unwrap(), None).iter().all(|z| *z == 0.0));
    }

    #[test]
    fn photos_smaller_than_the_square_are_counted_too() {
        assert_eq!(counting(&[1.0, 0.0], [2, 1], 4), [[true, true, false, false]; 4].concat());
        assert_eq!(counting(&[1.0, 1.0, 0.0, 0.0], [2, 2], 1), [false]);
    }
}
