//! A cloud in one appearance: the coefficients of its colours, turned once, so that any program shows it.
//!
//! An appearance turns a colour `c` into `g c + b`, channel by channel. With `c = Y0 h0 + 1/2 + ...` that is what coefficients
//! `g h_k` and `g h0 + (b + (g - 1) / 2) / Y0` give, but where `c` was cut off at 0 before, or `g c + b` is below 0: programs cut that off.

use super::drawing::{DrawnCloud, VisibleCloud};
use super::driver::{Clouds, Views};
use super::hooks::ColourAppearance;
use engine::system::{Appearance, Query};
use splat_core::{Gaussians, ProjectedGaussian, SH_0};
use std::borrow::Cow;

impl Views {
    /// The Gaussians of clouds in the appearance of a query.
    pub(super) fn in_appearance<'a>(&self, clouds: &'a Clouds<'_>, query: &Query) -> Vec<Cow<'a, Gaussians>> {
        let turned = |cloud: DrawnCloud<'a>| match self.parts.appearance.as_deref() {
            None => Cow::Borrowed(cloud.gaussians),
            Some(part) => Cow::Owned(baked(part, &query.appearance, &cloud)),
        };
        self.drawn(clouds).into_iter().map(turned).collect()
    }
}

/// The Gaussians of a cloud, in an appearance.
fn baked(part: &dyn ColourAppearance, appearance: &Appearance, cloud: &DrawnCloud<'_>) -> Gaussians {
    let n = cloud.gaussians.len();
    let all: Vec<ProjectedGaussian> =
        (0..n as u32).map(|index| ProjectedGaussian { index, ..ProjectedGaussian::default() }).collect();
    let of = |grey: f32| {
        let mut rgb = vec![[grey; 3]; n];
        part.forward(appearance, VisibleCloud { cloud: *cloud, gaussians: &all, eye: None }, &mut rgb);
        rgb
    };
    let (summand, sum) = (of(0.0), of(1.0));
    let mut out = cloud.gaussians.clone();
    for i in 0..n {
        for c in 0..3 {
            let (b, g) = (summand[i][c], sum[i][c] - summand[i][c]);
            let dc = &mut out.dc[c * n + i];
            *dc = g * *dc + (b + 0.5 * (g - 1.0)) / SH_0;
            for rest in out.rest.chunks_exact_mut(n).skip(c).step_by(3) {
                rest[i] *= g;
            }
        }
    }
    out
}
