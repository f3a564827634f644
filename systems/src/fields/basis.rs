//! Colours as features on a basis that a network learns for each direction (K-Planes, section 3.4).
//!
//! The network is asked once a ray, not once a sample.

use field_core::mlp::{Activation, Mlp, Packed};
use float_core::Simd;
use std::ops::Range;

/// Rays whose basis is asked for at one time, where nothing is kept.
const RAYS: usize = 64;

/// The basis: of each channel a coefficient for each feature.
pub(crate) struct ColourBasis {
    /// From what is seen of a ray to `[3][features]` coefficients.
    mlp: Mlp,
    features: usize,
}

/// What [`ColourBasis::forward`] keeps.
struct Kept<'a> {
    /// `[features][n]`
    features: &'a [f32],
    /// `[3][n]`, colours.
    rgb: &'a [f32],
    /// `[3 features][rays]`
    basis: &'a [f32],
    mlp: &'a [f32],
}

/// Which columns of a colour's inputs are of one ray: these have the same direction and code.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Columns<'a> {
    /// Each of a ray of its own.
    Each,
    /// `[rays + 1]`, the first of each ray, from 0.
    Rays(&'a [u32]),
}

impl Columns<'_> {
    /// Rays there are.
    fn rays(self, n: usize) -> usize {
        match self {
            Self::Each => n,
            Self::Rays(first) => first.len().saturating_sub(1),
        }
    }

    /// The columns of a ray.
    fn of(self, ray: usize) -> Range<usize> {
        match self {
            Self::Each => ray..ray + 1,
            Self::Rays(first) => first[ray] as usize..first[ray + 1] as usize,
        }
    }
}

impl ColourBasis {
    /// A basis for this many features.
    pub(super) fn new(mlp: Mlp, features: usize) -> Self {
        debug_assert_eq!(mlp.outputs(), 3 * features, "a coefficient for each channel and feature");
        Self { mlp, features }
    }

    pub(super) fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Rows of what is before directions: the raw log-density, which colours do not depend on, and the features.
    fn before(&self) -> usize {
        1 + self.features
    }

    pub(super) fn inputs(&self) -> usize {
        self.before() + self.mlp.inputs()
    }

    pub(super) fn activations_len(&self, n: usize) -> usize {
        // At most as many rays as columns: those without are not asked for.
        (4 * self.features + 3) * n + self.mlp.activations_len(n)
    }

    pub(super) fn infer_scratch_len(&self) -> usize {
        self.mlp.infer_scratch_len() + (self.mlp.inputs() + 3 * self.features) * RAYS
    }

    /// What the network sees of the rays `rays` that have columns: `out` `[seen][rays]`.
    fn gather(&self, x: &[f32], n: usize, columns: Columns<'_>, rays: &[u32], out: &mut [f32]) {
        for (k, row) in out.chunks_exact_mut(rays.len()).enumerate() {
            let from = &x[(self.before() + k) * n..][..n];
            row.iter_mut().zip(rays).for_each(|(v, &ray)| *v = from[columns.of(ray as usize).start]);
        }
    }

    /// Colours of the rays `rays` from their basis `[3 features][rays]`, written to their columns of `y` `[3][n]`.
    fn colours(&self, x: &[f32], n: usize, columns: Columns<'_>, rays: &[u32], basis: &[f32], y: &mut [f32]) {
        let count = rays.len();
        for (i, &ray) in rays.iter().enumerate() {
            let span = columns.of(ray as usize);
            for c in 0..3 {
                let out = &mut y[c * n..][span.clone()];
                out.fill(0.0);
                for k in 0..self.features {
                    let b = basis[(c * self.features + k) * count + i];
                    let f = &x[(1 + k) * n..][span.clone()];
                    out.iter_mut().zip(f).for_each(|(sum, f)| *sum += b * f);
                }
                out.iter_mut().for_each(|v| *v = Activation::LOGISTIC.value(*v));
            }
        }
    }

    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(super) fn forward(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        n: usize,
        columns: Columns<'_>,
        y: &mut [f32],
        acts: &mut [f32],
    ) {
        let rays = lit(columns, n);
        if rays.is_empty() {
            return;
        }
        let count = rays.len();
        let (features, rest) = acts.split_at_mut(self.features * n);
        let (rgb, rest) = rest.split_at_mut(3 * n);
        let (basis, mlp) = rest.split_at_mut(3 * self.features * count);
        features.copy_from_slice(&x[n..self.before() * n]);
        let mut seen = vec![0.0; self.mlp.inputs() * count];
        self.gather(x, n, columns, &rays, &mut seen);
        self.mlp.forward(simd, packed, &seen, count, count, basis, count, mlp);
        self.colours(x, n, columns, &rays, basis, y);
        rgb.copy_from_slice(&y[..3 * n]);
    }

    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(super) fn infer(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        n: usize,
        columns: Columns<'_>,
        y: &mut [f32],
        scratch: &mut [f32],
    ) {
        let (seen, rest) = scratch.split_at_mut(self.mlp.inputs() * RAYS);
        let (basis, scratch) = rest.split_at_mut(3 * self.features * RAYS);
        for rays in lit(columns, n).chunks(RAYS) {
            let count = rays.len();
            let (seen, basis) = (&mut seen[..self.mlp.inputs() * count], &mut basis[..3 * self.features * count]);
            self.gather(x, n, columns, rays, seen);
            self.mlp.infer(simd, packed, seen, count, count, basis, count, scratch);
            self.colours(x, n, columns, rays, basis, y);
        }
    }

    /// What [`ColourBasis::forward`] kept of `count` rays.
    fn kept<'a>(&self, acts: &'a [f32], n: usize, count: usize) -> Kept<'a> {
        let (features, rest) = acts.split_at(self.features * n);
        let (rgb, rest) = rest.split_at(3 * n);
        let (basis, mlp) = rest.split_at(3 * self.features * count);
        Kept { features, rgb, basis, mlp }
    }

    #[expect(clippy::too_many_arguments, reason = "two matrices and which columns belong together")]
    pub(super) fn backward(
        &self,
        simd: Simd,
        packed: &Packed,
        acts: &[f32],
        y_bar: &[f32],
        n: usize,
        columns: Columns<'_>,
        mut x_bar: Option<&mut [f32]>,
        grad: &mut [f32],
        scratch: &mut [f32],
    ) {
        let rays = lit(columns, n);
        if rays.is_empty() {
            return;
        }
        let count = rays.len();
        let kept = self.kept(acts, n, count);
        // Before the logistic.
        let raw_bar: Vec<f32> = y_bar.iter().zip(kept.rgb).map(|(bar, y)| bar * y * (1.0 - y)).collect();
        let mut basis_bar = vec![0.0; 3 * self.features * count];
        for (i, &ray) in rays.iter().enumerate() {
            let span = columns.of(ray as usize);
            for c in 0..3 {
                let bars = &raw_bar[c * n..][span.clone()];
                for k in 0..self.features {
                    let (at, row) = ((c * self.features + k) * count + i, &kept.features[k * n..][span.clone()]);
                    basis_bar[at] = row.iter().zip(bars).map(|(f, bar)| f * bar).sum();
                    if let Some(x_bar) = &mut x_bar {
                        let out = &mut x_bar[(1 + k) * n..][span.clone()];
                        out.iter_mut().zip(bars).for_each(|(sum, bar)| *sum += kept.basis[at] * bar);
                    }
                }
            }
        }
        let mut seen_bar = vec![0.0; if x_bar.is_some() { self.mlp.inputs() * count } else { 0 }];
        let to_seen = x_bar.is_some().then_some((&mut seen_bar[..], count));
        self.mlp.backward(simd, packed, kept.mlp, &basis_bar, count, count, to_seen, grad, scratch);
        if let Some(x_bar) = x_bar {
            for (k, row) in seen_bar.chunks_exact(count).enumerate() {
                let out = &mut x_bar[(self.before() + k) * n..][..n];
                rays.iter().zip(row).for_each(|(&ray, bar)| out[columns.of(ray as usize).start] += bar);
            }
        }
    }
}

/// Rays that have columns.
fn lit(columns: Columns<'_>, n: usize) -> Vec<u32> {
    (0..columns.rays(n)).filter(|&ray| !columns.of(ray).is_empty()).map(|ray| ray as u32).collect()
}
