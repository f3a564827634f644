//! A free code for each training photo, learnt with everything else (generative latent optimisation; NeRF in the Wild,
//! section 4.1).

use crate::photo_model::Codes;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::init::Init;
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};

/// Stream of the initial codes.
const INIT: u64 = 0x636f_6465;

/// Deviation of initial codes: small, so that all photos begin with nearly the same.
const DEVIATION: f32 = 0.1;

/// Uniform codes begin in `0..UNIFORM` (Nerfies and HyperNeRF, as released).
const UNIFORM: f32 = 0.05;

/// Fill initial codes uniformly from `0..0.05`.
pub(crate) fn fill_uniform(rng: Rng, codes: &mut [f32]) {
    rng.fill_uniform(0, codes);
    codes.iter_mut().for_each(|c| *c *= UNIFORM);
}

/// Random numbers of the initial codes of a table.
fn initial(name: &str, seed: u64) -> Rng {
    let stream = name.bytes().fold(0, |sum: u64, b| sum.wrapping_mul(31).wrapping_add(b.into()));
    Rng::new(seed, INIT).substream(stream)
}

/// The codes, their gradient and the moments of Adam.
pub(crate) struct CodeTable {
    name: &'static str,
    dims: usize,
    rows: Vec<f32>,
    grad: Vec<f32>,
    adam: Adam,
}

impl CodeTable {
    /// Codes of `views` photos; `name` distinguishes the tables of a checkpoint.
    pub(crate) fn new(name: &'static str, views: usize, dims: usize, seed: u64) -> Self {
        let mut rows = vec![0.0; views * dims];
        Init::Normal(DEVIATION).fill(initial(name, seed), dims, dims, &mut rows);
        Self::of_rows(name, dims, rows)
    }

    /// Codes that begin in `0..0.05`.
    pub(crate) fn uniform(name: &'static str, count: usize, dims: usize, seed: u64) -> Self {
        let mut rows = vec![0.0; count * dims];
        fill_uniform(initial(name, seed), &mut rows);
        Self::of_rows(name, dims, rows)
    }

    /// Codes that begin at 0.
    pub(crate) fn zeros(name: &'static str, views: usize, dims: usize) -> Self {
        Self::of_rows(name, dims, vec![0.0; views * dims])
    }

    fn of_rows(name: &'static str, dims: usize, rows: Vec<f32>) -> Self {
        let (grad, adam) = (vec![0.0; rows.len()], Adam::new(rows.len(), AdamConfig::DEFAULT));
        Self { name, dims, rows, grad, adam }
    }

    pub(crate) fn codes(&self) -> Codes<'_> {
        Codes { dims: self.dims, rows: &self.rows }
    }

    /// One step from the gradients of the pixels' codes, `[pixels][dims]`, whose codes are these of the table, and the loss `size`
    /// times the mean square of all codes. Only codes of photos in the batch move. Returns the count of non-finite gradients.
    pub(crate) fn learn(&mut self, simd: Simd, lr: f64, of_pixels: &[u32], bars: &[f32], size: f32) -> usize {
        self.grad.fill(0.0);
        for (bars, &code) in bars.chunks_exact(self.dims).zip(of_pixels) {
            let at = code as usize * self.dims;
            for (sum, bar) in self.grad[at..at + self.dims].iter_mut().zip(bars) {
                *sum += bar;
            }
        }
        // The mean of squares over all codes, for those that are here.
        let factor = 2.0 * size / self.rows.len().max(1) as f32;
        for (grad, value) in self.grad.iter_mut().zip(&self.rows).filter(|(grad, _)| **grad != 0.0) {
            *grad += factor * value;
        }
        self.adam.step_nonzero(simd, lr, &mut self.rows, &self.grad)
    }

    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Bytes of codes, gradient and moments of Adam.
    pub(crate) fn bytes(&self) -> usize {
        16 * self.rows.len()
    }

    pub(crate) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(format!("{}.codes", self.name), &self.rows));
        push_adam(out, self.name, &self.adam);
    }

    pub(crate) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let rows = take_numbers(state, &format!("{}.codes", self.name), self.rows.len())?;
        self.adam = take_adam(state, self.name, &self.adam)?;
        self.rows = rows;
        Ok(())
    }
}
