//! A small cloud before a camera, for tests of appearances from a reference photo.

use crate::views::{DrawnCloud, VisibleCloud};
use field_core::rng::Rng;
use splat_core::{Gaussians, ProjectedGaussian, View};
use testkit::gradient::central_difference;

pub(crate) const N: usize = 7;

/// Gaussians within a unit of the origin, but the last, which is behind the camera of [`view`].
pub(crate) fn cloud() -> Gaussians {
    let mut cloud = Gaussians::new(N, 1).unwrap();
    for (k, (_, values)) in (0..).zip(cloud.fields_mut()) {
        Rng::new(2, k).fill_uniform(0, values);
        values.iter_mut().for_each(|x| *x -= 0.5);
    }
    cloud.mean[2 * N + N - 1] = -9.0;
    // Far to the side.
    cloud.mean[N - 2] = 8.0;
    cloud
}

/// Two units before the origin, looking at it.
pub(crate) fn view() -> View {
    View { t: [0.02, -0.03, 2.0], c: [20.4, 14.7], f: [44.0, 43.0], ..View::at_origin([40, 30]) }
}

pub(crate) fn seen<'a>(
    gaussians: &'a Gaussians,
    extra: &'a [f32],
    visible: &'a [ProjectedGaussian],
) -> VisibleCloud<'a> {
    let cloud = DrawnCloud { index: 0, gaussians, extra, composited: 0, degree: 1 };
    VisibleCloud { cloud, gaussians: visible }
}

/// All but the second Gaussian, from the last to the first.
pub(crate) fn visible() -> Vec<ProjectedGaussian> {
    let index = (0..N as u32).rev().filter(|i| *i != 1);
    index.map(|index| ProjectedGaussian { index, ..ProjectedGaussian::default() }).collect()
}

pub(crate) fn colours(stream: u64) -> Vec<[f32; 3]> {
    let rng = Rng::new(11, stream);
    (0..N as u64 - 1).map(|i| rng.uniform4_at(i)).map(|u| [u[0], u[1], u[2]]).collect()
}

pub(crate) fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

/// Largest difference between gradients and differences of `value`, relative to the largest gradient.
pub(crate) fn worst<T: Clone>(
    twin: &T,
    value: impl Fn(&T) -> f64,
    got: &[f32],
    part: impl Fn(&mut T) -> &mut [f64],
) -> f64 {
    let want = central_difference(part(&mut twin.clone()), |values| {
        let mut at = twin.clone();
        part(&mut at).copy_from_slice(values);
        value(&at)
    });
    assert_eq!(want.len(), got.len());
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(largest > 1e-3, "nothing depends on it");
    want.iter().zip(got).map(|(want, got)| (want - f64::from(*got)).abs() / largest).fold(0.0, f64::max)
}
