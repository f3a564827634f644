//! Moving average of parameters.

use crate::{CHUNK, OptimError};
use alloc::{vec, vec::Vec};
use float_core::{Simd, Task, Vector, m64};

/// Exponential moving average of the parameters, corrected for its start at 0: after one update it equals the
/// parameters. Rendering with it instead of them removes the noise of the last steps (decay 0.95 in instant-ngp).
///
/// `a_t = (decay a'_{t-1} + (1 - decay) p_t) / (1 - decay^t)` with `a'` the sum before the division; stored divided.
#[derive(Clone, Debug, PartialEq)]
pub struct Ema {
    decay: f64,
    average: Vec<f32>,
    updates: u64,
}

impl Ema {
    /// Zeros, before the first update.
    ///
    /// # Panics
    /// If `decay` is not in `[0, 1)`, or there is no memory for `len` numbers.
    #[must_use]
    pub fn new(len: usize, decay: f64) -> Self {
        assert!((0.0..1.0).contains(&decay), "Ema: decay {decay}");
        Self { decay, average: vec![0.0; len], updates: 0 }
    }

    /// Continue from a checkpoint of [`Ema::average`] and [`Ema::updates`].
    ///
    /// # Errors
    /// [`OptimError::Value`] for a non-finite entry.
    ///
    /// # Panics
    /// If `decay` is not in `[0, 1)`.
    pub fn restore(decay: f64, average: Vec<f32>, updates: u64) -> Result<Self, OptimError> {
        assert!((0.0..1.0).contains(&decay), "Ema: decay {decay}");
        match average.iter().position(|a| !a.is_finite()) {
            Some(index) => Err(OptimError::Value { what: "average", index, value: average[index] }),
            None => Ok(Self { decay, average, updates }),
        }
    }

    /// `[len]`; zeros before the first update.
    #[must_use]
    pub fn average(&self) -> &[f32] {
        &self.average
    }

    /// Number of updates.
    #[must_use]
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Add the parameters of one step.
    ///
    /// # Panics
    /// If the length is another.
    pub fn update(&mut self, simd: Simd, params: &[f32]) {
        assert_eq!(params.len(), self.average.len(), "Ema: number of parameters");
        self.updates += 1;
        // The weight of the new value in the normalised average.
        let weight = ((1.0 - self.decay) / (1.0 - m64::powf(self.decay, self.updates as f64))) as f32;
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            self.average
                .par_chunks_mut(CHUNK)
                .zip(params.par_chunks(CHUNK))
                .for_each(|(a, p)| simd.run(Blend { weight, a, p }));
        }
        #[cfg(not(feature = "rayon"))]
        for (a, p) in self.average.chunks_mut(CHUNK).zip(params.chunks(CHUNK)) {
            simd.run(Blend { weight, a, p });
        }
    }
}

/// `a += weight * (p - a)`.
struct Blend<'a> {
    weight: f32,
    a: &'a mut [f32],
    p: &'a [f32],
}

impl Task for Blend<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        // Plain code: the compiler vectorises it for the level this is compiled for.
        for (a, p) in self.a.iter_mut().zip(self.p) {
            *a += self.weight * (p - *a);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_the_definition_and_starts_unbiased() {
        let mut ema = Ema::new(2, 0.9);
        let mut sum = [0.0_f64; 2];
        for t in 1..=50 {
            let p = [f64::from(t), 1.0 / f64::from(t)];
            ema.update(Simd::best(), &p.map(|p| p as f32));
            for i in 0..2 {
                sum[i] = 0.9 * sum[i] + 0.1 * p[i];
                let want = sum[i] / (1.0 - m64::powi(0.9, t));
                assert!((f64::from(ema.average()[i]) - want).abs() < 1e-5 * want.abs().max(1.0), "step {t}");
            }
            if t == 1 {
                assert_eq!(ema.average(), [1.0, 1.0]);
            }
        }
    }

    #[test]
    fn levels_agree_bit_for_bit_and_restore_continues() {
        let params: Vec<f32> = (0..CHUNK + 37).map(|i| (i as f32).sin()).collect();
        let run = |simd| {
            let mut ema = Ema::new(params.len(), 0.95);
            ema.update(simd, &params);
            let mut ema = Ema::restore(0.95, ema.average().to_vec(), ema.updates()).unwrap();
            ema.update(simd, &params.iter().map(|p| p * 0.3).collect::<Vec<_>>());
            ema
        };
        let want = run(Simd::SCALAR);
        assert!(Simd::available().all(|simd| run(simd) == want));
        assert!(matches!(
            Ema::restore(0.9, vec![0.0, f32::NAN], 3),
            Err(OptimError::Value { what: "average", index: 1, .. })
        ));
    }

    #[test]
    fn an_empty_average_stays_empty() {
        let mut ema = Ema::new(0, 0.5);
        ema.update(Simd::best(), &[]);
        assert!(ema.average().is_empty());
    }
}
