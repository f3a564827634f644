//! Where points go that lie on Gaussians: with those that are nearest, the nearer and the more opaque the more.
//!
//! ```text
//! way(x) = sum_k w_k (p_k(to) - p_k(from)) / sum_k w_k,    w_k = o_k / (|x - p_k(from)|^2 + small)       k the nearest that show
//! ```

use super::driver::{Clouds, Views};
use engine::neighbours::Neighbours;
use rayon::prelude::*;
use splat_core::density::opacity;
use std::borrow::Cow;

/// Gaussians that are more transparent than this are on no surface.
const SHOWS: f64 = 0.1;
/// Squared distance, internal units, within which nearer is not better.
const NEAR: f64 = 1e-8;

/// Where Gaussians are at one moment, and how far away they are at another.
struct Ways {
    places: Neighbours,
    ways: Vec<[f64; 3]>,
    opacities: Vec<f64>,
}

impl Ways {
    /// Of the Gaussians that show, internal units.
    fn new(from: &Clouds<'_>, to: &Clouds<'_>) -> Self {
        let (mut places, mut ways, mut opacities) = (Vec::new(), Vec::new(), Vec::new());
        for (from, to) in from.iter().zip(to) {
            let (from, to, n) = (&from.gaussians, &to.gaussians, from.len());
            for i in (0..n).filter(|&i| opacity(from, i) > SHOWS) {
                let [x, y] = [from, to].map(|cloud| [0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])));
                if x.iter().chain(&y).all(|v| v.is_finite()) {
                    places.push(x);
                    ways.push([0, 1, 2].map(|k| y[k] - x[k]));
                    opacities.push(opacity(from, i));
                }
            }
        }
        Self { places: Neighbours::new(&places), ways, opacities }
    }

    /// The way from a place; `None` where nothing shows anywhere.
    fn from(&self, x: &[f64; 3]) -> Option<[f64; 3]> {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for near in self.places.nearest(x) {
            let i = near.index as usize;
            let weight = self.opacities[i] / (near.squared + NEAR);
            (0..3).for_each(|k| sum[k] += weight * self.ways[i][k]);
            weights += weight;
        }
        (weights > 0.0).then(|| sum.map(|s| s / weights))
    }
}

impl Views {
    /// Whether anything moves that pictures show.
    pub(super) fn shows_motion(&self) -> bool {
        self.parts.motion.is_some() && !self.hides_front()
    }

    /// As [`System::scene_flow`](engine::system::System::scene_flow).
    pub(super) fn flow_of_points(&self, points: &[[f64; 3]], from: f64, to: f64, out: &mut [Option<[f64; 3]>]) {
        if !self.shows_motion() {
            out.fill(Some([0.0; 3]));
            return;
        }
        self.follow(&Ways::new(&self.clouds_at(from), &self.clouds_at(to)), points, out);
    }

    /// As [`System::canonical`](engine::system::System::canonical): places that are not finite stay.
    pub(super) fn canonical_points(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        out.copy_from_slice(points);
        if !self.shows_motion() {
            return;
        }
        let still: Clouds<'_> = self.parts.clouds.iter().map(|cloud| Cow::Borrowed(&cloud.parameters)).collect();
        let mut ways = vec![None; points.len()];
        self.follow(&Ways::new(&self.clouds_at(time), &still), points, &mut ways);
        for (x, way) in out.iter_mut().zip(ways) {
            if let Some(way) = way.filter(|_| x.iter().all(|v| v.is_finite())) {
                *x = [0, 1, 2].map(|k| x[k] + way[k]);
            }
        }
    }

    /// The ways of points of the scene's frame, world units.
    fn follow(&self, ways: &Ways, points: &[[f64; 3]], out: &mut [Option<[f64; 3]>]) {
        let frame = &self.parts.frame;
        points.par_iter().zip(out).for_each(|(&x, out)| {
            let way = ways.from(&frame.to_internal(x.into()).to_array());
            *out = way.map(|way| way.map(|v| v * frame.scale));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::gradient_tests::{Shared, noise, system};
    use super::super::pass::ViewSpaceGradient;
    use crate::plan::made;
    use engine::system::{FlowSource, System};
    use glam::DVec3;

    #[test]
    fn points_on_gaussians_go_where_these_go() {
        let (_, data) = made::scene(noise(), Vec::new());
        let mut moving = system(&data, &Shared::default(), ViewSpaceGradient::Plain);
        moving.parts.clouds.iter_mut().for_each(|cloud| cloud.parameters.gaussians.logit.fill(4.0));
        let (from, to) = (0.2, 0.9);
        let centres = |time: f64| -> Vec<[f64; 3]> {
            let clouds = moving.clouds_at(time);
            let of = |cloud: &crate::views::CloudParameters| -> Vec<[f64; 3]> {
                let (mean, n) = (&cloud.gaussians.mean, cloud.len());
                let x = |i: usize| DVec3::from([0, 1, 2].map(|k| f64::from(mean[k * n + i])));
                (0..n).map(|i| moving.parts.frame.to_world(x(i)).to_array()).collect()
            };
            clouds.iter().flat_map(|cloud| of(cloud)).collect()
        };
        let (here, there) = (centres(from), centres(to));
        let mut ways = vec![None; here.len()];
        moving.scene_flow(&here, from, to, &mut ways);
        for ((x, y), way) in here.iter().zip(&there).zip(ways) {
            let end = DVec3::from(*x) + DVec3::from(way.unwrap());
            assert!(end.distance((*y).into()) < 1e-4, "{end} {y:?}");
            assert!(DVec3::from(*x).distance((*y).into()) > 1e-3, "it moves");
        }
        // This motion has no time at which nothing is moved: canonical places are those of the parameters.
        let mut canonical = vec![[0.0; 3]; here.len()];
        moving.canonical(&here, from, &mut canonical);
        let factor = 1.0 + 0.2 * (from + 0.5);
        for (x, at) in here.iter().zip(&canonical) {
            assert!((DVec3::from(*x) / factor).distance((*at).into()) < 1e-4, "{x:?} {at:?}");
        }
        let mut far = [[f64::INFINITY; 3]];
        moving.canonical(&[[f64::INFINITY; 3]], from, &mut far);
        assert_eq!((far, moving.flow_source()), ([[f64::INFINITY; 3]], FlowSource::Canonical));
        moving.parts.motion = None;
        moving.scene_flow(&here[..1], from, to, &mut [None]);
        assert_eq!(moving.flow_source(), FlowSource::Nothing);
        // Where nothing shows, nothing is known.
        let mut clear = system(&data, &Shared::default(), ViewSpaceGradient::Plain);
        clear.parts.clouds.iter_mut().for_each(|cloud| cloud.parameters.gaussians.logit.fill(-9.0));
        let mut way = [Some([1.0; 3])];
        clear.scene_flow(&here[..1], from, to, &mut way);
        assert_eq!(way, [None]);
    }
}
