//! Density control: ten Gaussians whose fate is known, and what holds for any number.

mod adc;
mod axis_split;
mod guard;
mod mcmc;
mod rows;
mod size_limit;

use float_core::rng::Rng;
use splat_core::Gaussians;

/// Ten Gaussians of degree 1 whose numbers are all different, with these opacities and sizes along all axes.
fn ten(opacity: [f32; 10], scale: [f32; 10]) -> Gaussians {
    let mut g = some(10, 1);
    for i in 0..10 {
        g.logit[i] = (opacity[i] / (1.0 - opacity[i])).ln();
        for k in 0..3 {
            g.log_scale[k * 10 + i] = scale[i].ln();
        }
    }
    g
}

/// Gaussians like any other.
fn some(n: usize, degree: usize) -> Gaussians {
    let mut g = Gaussians::new(n, degree).unwrap();
    for (k, (_, rows)) in g.fields_mut().into_iter().enumerate() {
        Rng::new(11, k as u64).fill_normal(0, rows);
    }
    g
}

/// All numbers of Gaussian `i`.
fn numbers(g: &Gaussians, i: usize) -> Vec<f32> {
    let rows = |x: &[f32]| (0..x.len() / g.len()).map(|k| x[k * g.len() + i]).collect::<Vec<_>>();
    g.fields().into_iter().flat_map(|(_, x)| rows(x)).collect()
}

fn opacity(g: &Gaussians, i: usize) -> f64 {
    1.0 / (1.0 + (-f64::from(g.logit[i])).exp())
}

const STREAM: Rng = Rng::new(5, 6);
