//! Proofs of `float-core`, `losses` and `optim`.

use crate::wrong::{Wrong, near};
use float_core::{Simd, Task, Vector, m32, m64, vecmath};
use losses::kernel::Kernel;
use losses::{metrics, photometric};
use optim::{Adam, AdamConfig};

pub(crate) fn float_functions() -> Result<(), Wrong> {
    near("exp 1", m32::exp(1.0), core::f64::consts::E, 1e-7)?;
    near("sqrt 2", m64::sqrt(2.0), core::f64::consts::SQRT_2, 1e-15)
}

/// The sum of `exp` over some numbers.
struct ExpSum<'a>(&'a [f32]);

impl Task for ExpSum<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        self.0.chunks_exact(V::LANES).map(|x| vecmath::exp(V::load(x)).sum()).sum()
    }
}

pub(crate) fn vector_kernels() -> Result<(), Wrong> {
    for level in Simd::available() {
        near("16 exp(-1/2)", level.run(ExpSum(&[-0.5; 16])), 16.0 * m64::exp(-0.5), 1e-6)?;
    }
    Ok(())
}

pub(crate) fn loss() -> Result<(), Wrong> {
    let (prediction, target) = ([[0.5, 0.5, 0.5]], [[0.2, 0.5, 0.5]]);
    let refused = |_| Wrong { what: "loss", got: f64::NAN, want: 0.0 };
    let loss = photometric::mean(Kernel::Squared, &prediction, &target, None).map_err(refused)?;
    let mut bar = [[0.0; 3]];
    photometric::mean_backward(Kernel::Squared, &prediction, &target, None, 1.0, &mut bar).map_err(refused)?;
    near("loss", loss, 0.09 / 3.0, 1e-6)?;
    near("gradient", bar[0][0], 2.0 * 0.3 / 3.0, 1e-6)
}

/// A mean squared error of 0.01 is 20 dB.
pub(crate) fn metric() -> Result<(), Wrong> {
    near("PSNR", metrics::psnr_of_mse(0.01), 20.0, 1e-9)
}

/// The first step goes by the learning rate, against the gradient, whatever its size; a zero gradient moves nothing.
pub(crate) fn adam() -> Result<(), Wrong> {
    let mut params = [1.0, 1.0, 1.0];
    let mut adam = Adam::new(params.len(), AdamConfig::DEFAULT);
    let skipped = adam.step(Simd::best(), 0.1, &mut params, &[5.0, -0.01, 0.0]);
    near("gradients that are not finite", skipped as f64, 0.0, 0.0)?;
    near("parameter 0", params[0], 0.9, 1e-5)?;
    near("parameter 1", params[1], 1.1, 1e-5)?;
    near("parameter 2", params[2], 1.0, 0.0)
}
