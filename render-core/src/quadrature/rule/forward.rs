//! Optical depths and values of intervals.

use super::centroid::{DENSEST, centroid};
use super::{PIECE, Piece, Points, Rule, Walk};
use crate::quadrature::check_strided;
use float_core::{Simd, Task, Vector};

/// Optical depths and values of intervals from densities and values at points. See the [table](super::Rule) and the module.
///
/// # Shapes and units
/// * `tau`    `[n]` out, dimensionless, `>= 0`
/// * `values` `[channels][stride]` out, stride and unit of `points.values`; between the values at the ends of the interval
///
/// Both are written; samples that belong to no ray are left alone.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn intervals(simd: Simd, rule: Rule, points: Points<'_>, tau: &mut [f32], values: &mut [f32]) {
    points.check();
    let n = points.sigma.len();
    assert_eq!(tau.len(), n, "tau and sigma differ in length");
    check_strided(values.len(), points.values.stride, points.values.channels, n, "values of the intervals");
    simd.run(Intervals { rule, points, tau, values });
}

struct Intervals<'a> {
    rule: Rule,
    points: Points<'a>,
    tau: &'a mut [f32],
    values: &'a mut [f32],
}

impl Task for Intervals<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { rule, points, tau, values } = self;
        let span = points.span();
        let mut here: [Piece; 3] = [[0.0; PIECE]; 3];
        for start in span.clone().step_by(PIECE) {
            let walk = Walk::at(points.offsets, &span, start);
            let n = walk.len;
            let [dt, a, b] = &mut here;
            walk.own(points.dt, dt);
            walk.own(points.sigma, a);
            if rule == Rule::PiecewiseConstant {
                for i in (0..n).step_by(V::LANES) {
                    optical::<V>(&dt[i..], &a[i..]).store(&mut b[i..]);
                }
                tau[start..][..n].copy_from_slice(&b[..n]);
                copy(points, start, n, values);
                continue;
            }
            walk.next(points.sigma, b);
            let mut mu = [0.5; PIECE];
            for i in (0..n).step_by(V::LANES) {
                depth_and_centroid::<V>(rule, &mut dt[i..], &a[i..], &b[i..], &mut mu[i..]);
            }
            tau[start..][..n].copy_from_slice(&dt[..n]);
            for c in 0..points.values.channels {
                let channel = c * points.values.stride;
                walk.own(&points.values.data[channel..], a);
                walk.next(&points.values.data[channel..], b);
                for i in (0..n).step_by(V::LANES) {
                    let v = V::load(&a[i..]);
                    (V::load(&b[i..]) - v).mul_add(V::load(&mu[i..]), v).store(&mut a[i..]);
                }
                values[channel + start..][..n].copy_from_slice(&a[..n]);
            }
        }
    }
}

#[inline(always)]
fn copy(points: Points<'_>, start: usize, n: usize, values: &mut [f32]) {
    for c in 0..points.values.channels {
        let from = c * points.values.stride + start;
        values[from..][..n].copy_from_slice(&points.values.data[from..][..n]);
    }
}

/// `sigma * dt`; an infinite density without length is nothing.
#[inline(always)]
pub(super) fn optical<V: Vector>(dt: &[f32], sigma: &[f32]) -> V {
    // `max` takes the second operand where the first is not a number.
    (V::load(sigma) * V::load(dt)).max(V::splat(0.0))
}

/// Optical depth of intervals of linear density, in place of their length, and their mean position of absorption.
#[inline(always)]
fn depth_and_centroid<V: Vector>(rule: Rule, dt: &mut [f32], sigma: &[f32], next: &[f32], mu: &mut [f32]) {
    let (a, b) = (optical::<V>(dt, sigma), optical::<V>(dt, next));
    let half = V::splat(0.5);
    // Halves first: the sum of two large numbers may not be a number.
    let tau = half.mul_add(a, half * b);
    tau.store(dt);
    if rule == Rule::PiecewiseLinear {
        // Empty intervals have 1/2, which is already there: most of space is empty.
        if tau.sum() > 0.0 {
            let most = V::splat(DENSEST);
            let (a, b) = (a.min(most), b.min(most));
            centroid(a, half.mul_add(a, half * b)).store(mu);
        }
    }
}
