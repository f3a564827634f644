//! Gradients of densities and values at points.

use super::centroid::{DENSEST, centroid, centroid_gradient};
use super::forward::optical;
use super::{PIECE, Piece, Points, Rule, Walk};
use crate::quadrature::check_strided;
use float_core::{Simd, Task, Vector};

/// Gradients that reach the outputs of [`intervals`](super::intervals): what
/// [`composite_backward`](crate::quadrature::composite_backward) left.
#[derive(Clone, Copy, Debug)]
pub struct IntervalsBar<'a> {
    /// `[n]`
    pub tau: &'a [f32],
    /// `[channels][stride]`, stride of the values of the points.
    pub values: &'a [f32],
}

/// Where [`intervals_backward`] adds its gradients.
#[derive(Debug)]
pub struct PointsBar<'a> {
    /// `[n]`, added to.
    pub sigma: &'a mut [f32],
    /// `[channels][stride]`, stride of the values of the points; added to.
    pub values: &'a mut [f32],
    /// `[n]`, added to; nothing when the distances do not learn.
    pub dt: Option<&'a mut [f32]>,
}

/// Gradient of [`intervals`](super::intervals) with respect to densities, values and lengths, **added**.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn intervals_backward(simd: Simd, rule: Rule, points: Points<'_>, bar: IntervalsBar<'_>, grads: PointsBar<'_>) {
    points.check();
    let (n, values) = (points.sigma.len(), points.values);
    assert_eq!(bar.tau.len(), n, "the gradient of tau and sigma differ in length");
    assert_eq!(grads.sigma.len(), n, "the gradient of sigma and sigma differ in length");
    assert!(grads.dt.as_ref().is_none_or(|x| x.len() == n), "the gradient of dt and dt differ in length");
    check_strided(bar.values.len(), values.stride, values.channels, n, "gradient of the values of intervals");
    check_strided(grads.values.len(), values.stride, values.channels, n, "gradient of the values of points");
    simd.run(IntervalsBackward { rule, points, bar, grads });
}

struct IntervalsBackward<'a> {
    rule: Rule,
    points: Points<'a>,
    bar: IntervalsBar<'a>,
    grads: PointsBar<'a>,
}

/// What one piece works on.
struct Scratch {
    dt: Piece,
    sigma: Piece,
    /// Density of the neighbour.
    next: Piece,
    /// Gradient of the optical depth, then of the length.
    tau_bar: Piece,
    mu: Piece,
    mu_bar: Piece,
    /// Parts of a gradient that belong to the sample and to its neighbour.
    to_own: Piece,
    to_next: Piece,
}

impl Task for IntervalsBackward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let span = self.points.span();
        let zero = [0.0; PIECE];
        let mut s = Scratch {
            dt: zero,
            sigma: zero,
            next: zero,
            tau_bar: zero,
            mu: zero,
            mu_bar: zero,
            to_own: zero,
            to_next: zero,
        };
        // From the back: each sample gets its own part first and its neighbour's second, wherever pieces begin.
        for start in span.clone().step_by(PIECE).rev() {
            let walk = Walk::at(self.points.offsets, &span, start);
            walk.own(self.points.dt, &mut s.dt);
            walk.own(self.points.sigma, &mut s.sigma);
            walk.own(self.bar.tau, &mut s.tau_bar);
            if self.rule == Rule::PiecewiseConstant {
                self.constant(&walk, &s);
            } else {
                walk.next(self.points.sigma, &mut s.next);
                self.linear::<V>(&walk, &mut s);
            }
        }
    }
}

impl IntervalsBackward<'_> {
    #[inline(always)]
    fn constant(&mut self, walk: &Walk<'_>, s: &Scratch) {
        for k in 0..walk.len {
            self.grads.sigma[walk.start + k] += s.tau_bar[k] * s.dt[k];
        }
        if let Some(dt_bar) = self.grads.dt.as_deref_mut() {
            for k in 0..walk.len {
                dt_bar[walk.start + k] += s.tau_bar[k] * s.sigma[k];
            }
        }
        for c in 0..self.points.values.channels {
            let from = c * self.points.values.stride + walk.start;
            for (out, bar) in self.grads.values[from..][..walk.len].iter_mut().zip(&self.bar.values[from..]) {
                *out += bar;
            }
        }
    }

    #[inline(always)]
    fn linear<V: Vector>(&mut self, walk: &Walk<'_>, s: &mut Scratch) {
        let (n, linear) = (walk.len, self.rule == Rule::PiecewiseLinear);
        (s.mu, s.mu_bar) = ([0.5; PIECE], [0.0; PIECE]);
        if linear {
            for i in (0..n).step_by(V::LANES) {
                let (a, tau) = clamped::<V>(&s.dt[i..], &s.sigma[i..], &s.next[i..]);
                if tau.sum() > 0.0 {
                    centroid(a, tau).store(&mut s.mu[i..]);
                }
            }
        }
        let (mut own, mut next, mut bar) = ([0.0; PIECE], [0.0; PIECE], [0.0; PIECE]);
        for c in 0..self.points.values.channels {
            let channel = c * self.points.values.stride;
            walk.own(&self.points.values.data[channel..], &mut own);
            walk.next(&self.points.values.data[channel..], &mut next);
            walk.own(&self.bar.values[channel..], &mut bar);
            for i in (0..n).step_by(V::LANES) {
                let bar = V::load(&bar[i..]);
                let to_next = bar * V::load(&s.mu[i..]);
                to_next.store(&mut s.to_next[i..]);
                (bar - to_next).store(&mut s.to_own[i..]);
                let step = V::load(&next[i..]) - V::load(&own[i..]);
                bar.mul_add(step, V::load(&s.mu_bar[i..])).store(&mut s.mu_bar[i..]);
            }
            scatter(walk, &s.to_own, &s.to_next, &mut self.grads.values[channel..]);
        }
        for i in (0..n).step_by(V::LANES) {
            let half = V::splat(0.5) * V::load(&s.tau_bar[i..]);
            let (mut a_bar, mut b_bar) = (half, half);
            if linear {
                let (a, tau) = clamped::<V>(&s.dt[i..], &s.sigma[i..], &s.next[i..]);
                if tau.sum() > 0.0 {
                    let (mu_a, mu_b) = centroid_gradient(a, tau);
                    let mu_bar = V::load(&s.mu_bar[i..]);
                    a_bar = mu_bar.mul_add(mu_a, a_bar);
                    b_bar = mu_bar.mul_add(mu_b, b_bar);
                }
            }
            let dt = V::load(&s.dt[i..]);
            (a_bar * dt).store(&mut s.to_own[i..]);
            (b_bar * dt).store(&mut s.to_next[i..]);
            let (of_own, of_next) = (product(a_bar, &s.sigma[i..]), product(b_bar, &s.next[i..]));
            (of_own + of_next).store(&mut s.tau_bar[i..]);
        }
        scatter(walk, &s.to_own, &s.to_next, self.grads.sigma);
        if let Some(dt_bar) = self.grads.dt.as_deref_mut() {
            for (out, bar) in dt_bar[walk.start..][..n].iter_mut().zip(&s.tau_bar) {
                *out += bar;
            }
        }
    }
}

/// Optical density at the near end of each interval and its optical depth, as the centroid takes them.
#[inline(always)]
fn clamped<V: Vector>(dt: &[f32], sigma: &[f32], next: &[f32]) -> (V, V) {
    let most = V::splat(DENSEST);
    let half = V::splat(0.5);
    let (a, b) = (optical::<V>(dt, sigma).min(most), optical::<V>(dt, next).min(most));
    (a, half.mul_add(a, half * b))
}

/// `bar * sigma`, finite where `bar` is: both products of an interval may overflow, and must not meet as `inf - inf`.
#[inline(always)]
fn product<V: Vector>(bar: V, sigma: &[f32]) -> V {
    let most = V::splat(f32::MAX);
    (bar * V::load(sigma).min(most)).min(most).max(-most)
}

/// Add the parts of each sample to it and to its neighbour; the last one of a ray is its own neighbour.
#[inline(always)]
fn scatter(walk: &Walk<'_>, to_own: &Piece, to_next: &Piece, out: &mut [f32]) {
    let (start, n) = (walk.start, walk.len);
    let mut to_next = *to_next;
    for k in walk.lasts() {
        out[start + k] += to_next[k];
        // Said once: rays without samples come by here again.
        to_next[k] = 0.0;
    }
    for (out, part) in out[start..][..n].iter_mut().zip(to_own) {
        *out += part;
    }
    let behind = out.len().saturating_sub(start + 1).min(n);
    for (out, part) in out[start + 1..][..behind].iter_mut().zip(&to_next) {
        *out += part;
    }
}
