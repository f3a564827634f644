//! A small cloud before a camera, for tests of appearances from a reference photo.

use super::{PhotoCode, ReferenceAppearance};
use crate::views::{ColourAppearance, ColourBars, DrawnCloud, PlaceCodes, VisibleCloud};
use engine::system::Appearance;
use field_core::rng::Rng;
use splat_core::{Gaussians, ProjectedGaussian, View};
use std::sync::Arc;
use testkit::gradient::central_difference;
use testkit::reference::network::{Bias, Network};

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
    // [`view`] is not turned.
    VisibleCloud { cloud, gaussians: visible, eye: Some(view().t.map(|x| -x)) }
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
fn worst<T: Clone>(twin: &T, value: impl Fn(&T) -> f64, got: &[f32], part: impl Fn(&mut T) -> &mut [f64]) -> f64 {
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

/// Units of each layer of the network of tones, and the factor of what it gives.
pub(crate) const WIDTH: usize = 5;
pub(crate) const SCALE: f32 = 0.7;

/// Parameters of the network of tones that no test begins without.
pub(crate) fn random_tones<C: PhotoCode>(appearance: &mut ReferenceAppearance<C>) {
    let mut params = vec![0.0; appearance.tone_parameters().len()];
    Rng::new(8, 1).fill_uniform(0, &mut params);
    params.iter_mut().for_each(|p| *p = 1.4 * (*p - 0.45));
    appearance.set_tone_parameters(params);
}

/// The value at a place in pixels of a square of `side`, between pixel centres; the border's value holds beyond them: plainly.
pub(crate) fn bilinear(map: &[f64], side: usize, [x, y]: [f64; 2]) -> f64 {
    let [x, y] = [x, y].map(|x| (x - 0.5).clamp(0.0, side as f64 - 1.0));
    let weight = |i: usize, x: f64| (1.0 - (x - i as f64).abs()).max(0.0);
    (0..side * side).map(|i| map[i] * weight(i % side, x) * weight(i / side, y)).sum()
}

/// Everything that a toned colour depends on, in `f64`.
#[derive(Clone)]
pub(crate) struct Twin {
    pub(crate) network: Vec<f64>,
    pub(crate) code: Vec<f64>,
    /// `[3][n]`, `[ROWS][n]`.
    pub(crate) base: Vec<f64>,
    pub(crate) extra: Vec<f64>,
    pub(crate) rgb: Vec<f64>,
    /// What Gaussian `i` reads of the code.
    pub(crate) features: fn(&Self, usize) -> Vec<f64>,
}

impl Twin {
    fn toned(&self) -> Vec<f64> {
        let inputs = 3 + PlaceCodes::ROWS + (self.features)(self, 0).len();
        let network = Network { widths: &[inputs, WIDTH, WIDTH, 6], skips: &[], bias: Bias::Each };
        assert_eq!(self.network.len(), network.param_count());
        let mut out = Vec::new();
        for (k, gaussian) in visible().iter().enumerate() {
            let i = gaussian.index as usize;
            let mut x: Vec<f64> = (0..3).map(|c| self.base[c * N + i]).collect();
            x.extend((0..PlaceCodes::ROWS).map(|row| self.extra[row * N + i]));
            x.extend((self.features)(self, i));
            let y = network.forward(&self.network, &x);
            let scale = f64::from(SCALE);
            out.extend((0..3).map(|c| (1.0 + scale * y[3 + c]) * self.rgb[3 * k + c] + scale * y[c]));
        }
        out
    }

    /// Weighted sum of the toned colours.
    pub(crate) fn value(&self, weights: &[[f32; 3]]) -> f64 {
        self.toned().iter().zip(weights.as_flattened()).map(|(x, w)| x * f64::from(*w)).sum()
    }
}

/// Gradients as an appearance gives them.
pub(crate) struct Found {
    pub(crate) twin: Twin,
    /// Of the toned colours in [`Twin::value`].
    pub(crate) weights: Vec<[f32; 3]>,
    /// With respect to `extra` and `code`.
    pub(crate) extra: Vec<f32>,
    pub(crate) code: Vec<f32>,
}

impl Found {
    /// How far the gradient with respect to a part of the twin is off: see [`worst`].
    pub(crate) fn worst(&self, got: &[f32], part: impl Fn(&mut Twin) -> &mut [f64]) -> f64 {
        worst(&self.twin, |twin| twin.value(&self.weights), got, part)
    }
}

/// Colours in the appearance of a code, and their gradients with respect to colours, base colours and the network, are those of the
/// definition.
pub(crate) fn check_definition<C: PhotoCode>(
    appearance: &mut ReferenceAppearance<C>,
    extra: &[f32],
    code: &[f32],
    features: fn(&Twin, usize) -> Vec<f64>,
) -> Found {
    let (cloud, visible) = (cloud(), visible());
    let seen = seen(&cloud, extra, &visible);
    let of_code = Appearance::Code(Arc::from(code));
    let (rgb, weights) = (colours(1), colours(2));
    let twin = Twin {
        network: wide(appearance.tone_parameters()),
        code: wide(code),
        base: wide(&cloud.dc),
        extra: wide(extra),
        rgb: wide(rgb.as_flattened()),
        features,
    };
    let mut toned = rgb.clone();
    appearance.forward(&of_code, seen, &mut toned);
    for (got, want) in toned.as_flattened().iter().zip(twin.toned()) {
        assert!((f64::from(*got) - want).abs() < 1e-5, "{got} {want}");
    }
    let mut bar = weights.clone();
    let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
    let bars = ColourBars { rgb: &mut bar, base: &mut base, extra: &mut extra_bar };
    appearance.backward(&of_code, seen, &rgb, bars);
    let mut base_bar = vec![0.0; 3 * N];
    for (gaussian, base) in visible.iter().zip(&base) {
        (0..3).for_each(|c| base_bar[c * N + gaussian.index as usize] = base[c]);
    }
    let (network_bar, code_bar) = appearance.gradients();
    assert_eq!(appearance.code_bar(code, seen, &rgb, &mut weights.clone()), code_bar);
    let found = Found { twin, weights, extra: extra_bar, code: code_bar };
    for (name, error) in [
        ("colours", found.worst(bar.as_flattened(), |twin| &mut twin.rgb)),
        ("base", found.worst(&base_bar, |twin| &mut twin.base)),
        ("network", found.worst(&network_bar, |twin| &mut twin.network)),
    ] {
        assert!(error < 1e-4, "{name}: {error}");
    }
    found
}
