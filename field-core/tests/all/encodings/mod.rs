//! Frequency encoding, spherical harmonics, dense grid and embeddings: against naive `f64` twins, differences, and the
//! properties of their definitions.

mod dense_grid;
mod embedding;
mod frequency;
mod properties;
mod spherical_harmonics;

use field_core::rng::Rng;

fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    (0..len).map(|i| low + (high - low) * Rng::new(seed, 0).uniform_at(i as u64)).collect()
}

fn f32s(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}
