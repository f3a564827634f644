//! Neighbours move alike: what differs in the displacements of two Gaussians that are near one another costs.
//!
//! ```text
//! factor mean_k w_k |d_k - d_(k+1)|^2 / reach^2,    w_k = exp(-|p_k - p_(k+1)|^2 / (2 reach^2))
//! ```
//!
//! `p` are canonical places, `d` displacements, both in internal units. Gaussians lie along a curve through space
//! ([`splat_core::density::morton_order`]): most that follow one another in memory are neighbours, and the weight leaves out the others.

/// How much it costs, and how near neighbours are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coherence {
    /// 0: nothing.
    pub(super) factor: f32,
    /// Internal units.
    pub(super) reach: f32,
}

impl Coherence {
    /// Add the gradient with respect to the displacements, the first three rows of `bar` `[rows][n]`. `places` `[3][n]`, and
    /// displacements the first three rows of `offsets` `[rows][n]`; the sum is divided by `of`.
    pub(super) fn add(&self, places: &[f32], offsets: &[f32], n: usize, of: usize, bar: &mut [f32]) {
        let per_square = 1.0 / (self.reach * self.reach);
        let scale = 2.0 * self.factor * per_square / of.max(1) as f32;
        for k in 1..n {
            let apart = |rows: &[f32]| [0, 1, 2].map(|axis| rows[axis * n + k - 1] - rows[axis * n + k]);
            let squared: f32 = apart(places).iter().map(|x| x * x).sum();
            let weight = scale * (-0.5 * squared * per_square).exp();
            for (axis, d) in apart(offsets).into_iter().enumerate() {
                bar[axis * n + k - 1] += weight * d;
                bar[axis * n + k] -= weight * d;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;

    const N: usize = 6;
    const TERM: Coherence = Coherence { factor: 0.7, reach: 0.4 };

    fn cost(places: &[f32], offsets: &[f64]) -> f64 {
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        let (reach, factor) = (f64::from(TERM.reach), f64::from(TERM.factor));
        let pair = |k: usize| {
            let apart = [0, 1, 2].map(|a| f64::from(places[a * N + k] - places[a * N + k + 1]));
            let moved = [0, 1, 2].map(|a| offsets[a * N + k] - offsets[a * N + k + 1]);
            (-square(apart) / (2.0 * reach * reach)).exp() * square(moved) / (reach * reach)
        };
        factor * (0..N - 1).map(pair).sum::<f64>() / (N - 1) as f64
    }

    #[test]
    fn the_gradient_is_that_of_differences_and_what_moves_as_one_costs_nothing() {
        let noise = |stream: u64, rows: usize| -> Vec<f32> {
            let mut out = vec![0.0; rows * N];
            Rng::new(3, stream).fill_uniform(0, &mut out);
            out
        };
        let (places, offsets) = (noise(0, 3), noise(1, 4));
        let mut bar = vec![0.0; offsets.len()];
        TERM.add(&places, &offsets, N, N - 1, &mut bar);
        for i in 0..3 * N {
            let along = |h: f64| {
                let mut at: Vec<f64> = offsets.iter().map(|&x| f64::from(x)).collect();
                at[i] += h;
                cost(&places, &at)
            };
            let want = (along(1e-5) - along(-1e-5)) / 2e-5;
            assert!((f64::from(bar[i]) - want).abs() < 1e-4 * (1.0 + want.abs()), "{i}: {} {want}", bar[i]);
        }
        assert!(bar[3 * N..].iter().all(|b| *b == 0.0), "other offsets are free");
        let (together, mut none) = (vec![0.25; 3 * N], vec![0.0; 3 * N]);
        TERM.add(&places, &together, N, N - 1, &mut none);
        TERM.add(&[], &[], 0, 0, &mut []);
        assert_eq!(none, vec![0.0; 3 * N]);
        // Who is far away may move otherwise.
        let mut far = places.clone();
        far[N - 1] += 1e3;
        let mut bar = vec![0.0; 3 * N];
        TERM.add(&far, &offsets[..3 * N], N, N - 1, &mut bar);
        assert_eq!(bar[N - 1], 0.0);
    }
}
