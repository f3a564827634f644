//! The step itself, over vector lanes.

use super::BLOCK;
use float_core::{Task, Vector};

/// Meaning of a gradient of exactly 0.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ZeroGradient {
    /// An ordinary gradient: the moments decay, the parameter keeps moving.
    Decays,
    /// No gradient: the entry stays as it is.
    Untouched,
}

/// The coefficients of a step, the same for all entries.
#[derive(Clone, Copy)]
pub(super) struct Coefficients {
    pub(super) beta1: f32,
    /// `1 - beta1`, rounded once from `f64`.
    pub(super) rest1: f32,
    pub(super) beta2: f32,
    pub(super) rest2: f32,
    /// `lr / (1 - beta1^t)`.
    pub(super) rate: f32,
    /// `1 / sqrt(1 - beta2^t)`.
    pub(super) root: f32,
    pub(super) eps: f32,
    /// Added to the gradient, times the parameter.
    pub(super) l2: f32,
    /// The parameter is multiplied by it: `1 - lr * decay`.
    pub(super) keep: f32,
}

/// Largest gradient whose square is finite, rounded down.
const LARGEST: f32 = 1.8e19;

/// Step every entry of four slices of one length. Returns how many gradients were not finite.
pub(super) struct StepSlice<'a> {
    pub(super) k: Coefficients,
    pub(super) zero: ZeroGradient,
    pub(super) p: &'a mut [f32],
    pub(super) g: &'a [f32],
    pub(super) m: &'a mut [f32],
    pub(super) v: &'a mut [f32],
}

impl Task for StepSlice<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        let Self { k, zero, p, g, m, v } = self;
        match zero {
            ZeroGradient::Decays => step_slice::<V, false>(k, p, g, m, v),
            ZeroGradient::Untouched => step_slice::<V, true>(k, p, g, m, v),
        }
    }
}

/// Step the marked blocks, then clear their gradient and marks.
pub(super) struct StepTouched<'a> {
    pub(super) k: Coefficients,
    pub(super) p: &'a mut [f32],
    pub(super) g: &'a mut [f32],
    pub(super) m: &'a mut [f32],
    pub(super) v: &'a mut [f32],
    pub(super) touched: &'a mut [u64],
}

impl Task for StepTouched<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        let Self { k, p, g, m, v, touched } = self;
        let (mut non_finite, blocks) = (0, p.len().div_ceil(BLOCK));
        for (w, word) in touched.iter_mut().enumerate() {
            let mut marks = core::mem::take(word);
            while marks != 0 {
                // Dense levels are marked throughout: take a run of marked blocks at once.
                let first = marks.trailing_zeros();
                let run = (marks >> first).trailing_ones();
                marks &= !((u64::MAX >> (64 - run)) << first);
                let start = 64 * w + first as usize;
                if start >= blocks {
                    break;
                }
                let entries = start * BLOCK..((start + run as usize) * BLOCK).min(p.len());
                let (p, g) = (&mut p[entries.clone()], &mut g[entries.clone()]);
                let (m, v) = (&mut m[entries.clone()], &mut v[entries]);
                non_finite += step_slice::<V, true>(k, p, g, m, v);
                g.fill(0.0);
            }
        }
        non_finite
    }
}

#[inline(always)]
fn step_slice<V: Vector, const SPARSE: bool>(
    k: Coefficients,
    p: &mut [f32],
    g: &[f32],
    m: &mut [f32],
    v: &mut [f32],
) -> usize {
    let n = p.len();
    assert!(g.len() == n && m.len() == n && v.len() == n, "Adam: lengths differ");
    let body = n / V::LANES * V::LANES;
    // A lane counts at most n / LANES: exact in f32 for the fixed chunks.
    let mut wrong = V::splat(0.0);
    for i in (0..body).step_by(V::LANES) {
        let (p_old, g) = (V::load(&p[i..]), V::load(&g[i..]));
        let (m_old, v_old) = (V::load(&m[i..]), V::load(&v[i..]));
        let (new_p, new_m, new_v, not_finite) = step_lanes::<V, SPARSE>(k, p_old, g, m_old, v_old);
        new_p.store(&mut p[i..]);
        new_m.store(&mut m[i..]);
        new_v.store(&mut v[i..]);
        wrong = wrong + not_finite;
    }
    let mut wrong = wrong.sum();
    if body < n {
        // The tail runs in full lanes of zeros, so that its bits do not depend on where it lies.
        let (p_old, g) = (V::load_part(&p[body..]), V::load_part(&g[body..]));
        let (m_old, v_old) = (V::load_part(&m[body..]), V::load_part(&v[body..]));
        let (new_p, new_m, new_v, not_finite) = step_lanes::<V, SPARSE>(k, p_old, g, m_old, v_old);
        new_p.store_part(&mut p[body..]);
        new_m.store_part(&mut m[body..]);
        new_v.store_part(&mut v[body..]);
        wrong += not_finite.sum();
    }
    wrong as usize
}

/// New parameter, moments, and 1 where the gradient is not finite.
#[inline(always)]
fn step_lanes<V: Vector, const SPARSE: bool>(k: Coefficients, p: V, g: V, m: V, v: V) -> (V, V, V, V) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let size = g.max(-g);
    // inf - |g| is inf for a finite g, else NaN, which is not positive.
    let finite = V::splat(f32::INFINITY) - size;
    let not_finite = finite.select_positive(zero, one);
    let active = if SPARSE { size.select_positive(finite, zero) } else { finite };

    let g = g + V::splat(k.l2) * p;
    let g = g.min(V::splat(LARGEST)).max(V::splat(-LARGEST));
    let new_m = V::splat(k.beta1) * m + V::splat(k.rest1) * g;
    let new_v = V::splat(k.beta2) * v + V::splat(k.rest2) * (g * g);
    let step = V::splat(k.rate) * new_m / (new_v.sqrt() * V::splat(k.root) + V::splat(k.eps));
    // A step may overflow where the learning rate is far too large, but not to NaN: the parameter ends at the largest number.
    let new_p = (V::splat(k.keep) * p - step).min(V::splat(f32::MAX)).max(V::splat(f32::MIN));
    (active.select_positive(new_p, p), active.select_positive(new_m, m), active.select_positive(new_v, v), not_finite)
}
