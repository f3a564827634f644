//! What streams through memory: the frequency encoding and the optimiser.

use super::found::{Found, Row};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, interleaved, worst};
use crate::sections::ceilings::{Big, LARGE_TABLE, read};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use std::hint::black_box;

const OCTAVES: usize = 10;

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let big = Big::new(LARGE_TABLE);
    for threads in bench.pools.one_and_most() {
        frequency(bench, found, threads)?;
        adam(bench, found, threads, &big)?;
    }
    Ok(())
}

fn frequency(bench: &Bench, found: &mut Found, threads: usize) -> Result<(), BenchError> {
    const POINTS: usize = 1024;
    let encoding = Frequency::new(3, OCTAVES, Base::One, Identity::Include).map_err(BenchError::part)?;
    let state = || {
        let mut x = vec![0.0; 3 * POINTS];
        Rng::new(3, 0).fill_uniform(0, &mut x);
        (x, vec![0.0; encoding.out_rows() * POINTS])
    };
    let simd = bench.simd;
    let mut cases = [Case::parallel(&bench.pools, threads, state, |(x, out): &mut (Vec<f32>, Vec<f32>)| {
        let done = encoding.encode(simd, x, None, out);
        debug_assert!(done.is_ok());
    })];
    let seconds = interleaved(bench.effort, &mut cases);
    let (x, mut out) = state();
    encoding.encode(simd, &x, None, &mut out).map_err(BenchError::part)?;
    let mut want: Vec<f64> = x.iter().map(|&x| f64::from(x)).collect();
    for k in 0..OCTAVES {
        let angles: Vec<f64> = x.iter().map(|&x| f64::from(x) * 2_f64.powi(k as i32)).collect();
        want.extend(angles.iter().map(|a| a.sin()));
        want.extend(angles.iter().map(|a| a.cos()));
    }
    found.row(&Row {
        kernel: "frequency encoding 3 -> 63 forward",
        level: level_name(simd.level()),
        threads,
        rate: (POINTS * threads) as f64 / seconds[0],
        unit: "points",
        ceiling: None,
        error: (Some(worst(&out, &want)), None),
    })
}

fn adam(bench: &Bench, found: &mut Found, threads: usize, big: &Big) -> Result<(), BenchError> {
    let n = bench.pick(1 << 22, 1 << 24);
    let (mut params, gradient) = (vec![0.1_f32; n], vec![0.3_f32; n]);
    let mut state = Adam::new(n, AdamConfig::NGP);
    let (pools, simd) = (&bench.pools, bench.simd);
    let (stream, bytes) = read(pools, simd, threads, big);
    let mut cases = [
        stream,
        Case::pooled(pools, threads, || {
            black_box(state.step(simd, 1e-3, &mut params, &gradient));
        }),
    ];
    let seconds = interleaved(bench.effort, &mut cases);
    drop(cases);
    found.row(&Row {
        kernel: &format!("Adam, {:.1} M parameters, dense", n as f64 * 1e-6),
        level: level_name(simd.level()),
        threads,
        rate: n as f64 / seconds[1],
        unit: "parameters",
        // Parameter and two moments in and out, the gradient in.
        ceiling: Some((bytes / seconds[0] / 28.0, "streaming reads")),
        error: (Some(adam_error(simd)), None),
    })
}

/// Error of a parameter after ten steps against the definition in `f64`.
fn adam_error(simd: Simd) -> f64 {
    const N: usize = 256;
    let config = AdamConfig::NGP;
    let numbers = |seed: u64| {
        let mut x = vec![0.0; N];
        Rng::new(seed, 0).fill_uniform(0, &mut x);
        x
    };
    let mut params = numbers(5);
    let mut adam = Adam::new(N, config);
    let mut want: Vec<f64> = params.iter().map(|&p| f64::from(p)).collect();
    let (mut m, mut v) = (vec![0.0; N], vec![0.0; N]);
    let (b1, b2, eps) = (config.beta1, config.beta2, config.eps);
    for step in 1..=10 {
        let gradient: Vec<f32> = numbers(100 + step).iter().map(|g| g - 0.5).collect();
        if adam.step(simd, 1e-2, &mut params, &gradient) > 0 {
            return f64::NAN;
        }
        for i in 0..N {
            let g = f64::from(gradient[i]);
            m[i] = b1 * m[i] + (1.0 - b1) * g;
            v[i] = b2 * v[i] + (1.0 - b2) * g * g;
            let (m, v) = (m[i] / (1.0 - b1.powi(step as i32)), v[i] / (1.0 - b2.powi(step as i32)));
            want[i] -= 1e-2 * m / (v.sqrt() + eps);
        }
    }
    worst(&params, &want)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adam_is_near_its_definition() {
        for simd in Simd::available() {
            let error = adam_error(simd);
            assert!(error > 0.0 && error < 1e-5, "{simd:?}: {error}");
        }
    }
}
