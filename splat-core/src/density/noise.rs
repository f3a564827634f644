//! Noise that stirs what is nearly transparent.

use alloc::vec::Vec;

use field_core::rng::Rng;
use float_core::m32;

use super::rotation;
use crate::Gaussians;
use crate::chunks::for_each;

/// Rows that one task stirs.
const CHUNK: usize = 1024;
/// Slope of the gate that closes above the opacity of the dead.
const GATE_SLOPE: f32 = 100.0;
/// No normal number is larger ([`Rng::normal_at`]), nor three of them as a vector.
const LONGEST: f32 = 6.7 * 1.733;
/// Less than half the distance between a number and its neighbours, in units of the number.
const UNSEEN: f32 = 1.0 / 67_108_864.0;

/// See [`Mcmc::stir`](super::Mcmc::stir).
pub(super) fn stir(cloud: &mut Gaussians, strength: f64, opacity_dead: f64, rng: Rng) {
    let n = cloud.len();
    if n == 0 {
        return;
    }
    let mut mean = core::mem::take(&mut cloud.mean);
    let mut jobs: Vec<Vec<&mut [f32]>> = (0..n.div_ceil(CHUNK)).map(|_| Vec::with_capacity(3)).collect();
    for row in mean.chunks_exact_mut(n) {
        for (job, part) in jobs.iter_mut().zip(row.chunks_mut(CHUNK)) {
            job.push(part);
        }
    }
    let cloud_ref = &*cloud;
    for_each(&mut jobs, |k, rows| {
        for at in 0..rows[0].len() {
            let i = k * CHUNK + at;
            let p = [rows[0][at], rows[1][at], rows[2][at]];
            if let Some(step) = step(cloud_ref, i, p, (strength as f32, opacity_dead as f32), rng) {
                for (row, step) in rows.iter_mut().zip(step) {
                    row[at] += step;
                }
            }
        }
    });
    cloud.mean = mean;
}

/// What is added to the mean of Gaussian `i`; `None` where it is too little to change any of its numbers.
fn step(cloud: &Gaussians, i: usize, p: [f32; 3], (strength, dead): (f32, f32), rng: Rng) -> Option<[f32; 3]> {
    let n = cloud.len();
    let s2 = [0, 1, 2].map(|k| {
        let s = m32::exp(cloud.log_scale[k * n + i]);
        s * s
    });
    let open = strength * m32::logistic(-GATE_SLOPE * (m32::logistic(cloud.logit[i]) - dead));
    let longest = open * s2.into_iter().fold(0.0, f32::max) * LONGEST;
    // Most are opaque: neither normal numbers nor a rotation for them.
    if p.iter().all(|p| longest < p.abs() * UNSEEN) {
        return None;
    }
    let r = rotation(cloud, i).map(|row| row.map(|x| x as f32));
    let eta = [0, 1, 2].map(|k| rng.normal_at((3 * i + k) as u64));
    // Sigma eta = R diag(s^2) R^T eta.
    let inner = [0, 1, 2].map(|b: usize| open * s2[b] * (0..3).map(|a| r[a][b] * eta[a]).sum::<f32>());
    Some([0, 1, 2].map(|a: usize| (0..3).map(|b| r[a][b] * inner[b]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_would_change_nothing() {
        let mut cloud = Gaussians::new(4000, 0).unwrap();
        let rng = Rng::new(3, 0);
        for (k, (_, rows)) in cloud.fields_mut().into_iter().enumerate() {
            rng.substream(k as u64).fill_normal(0, rows);
        }
        for (i, x) in cloud.log_scale.iter_mut().enumerate() {
            *x = 3.0 * *x - (i % 5) as f32;
        }
        for x in &mut cloud.logit {
            *x *= 4.0;
        }
        let mut left_out = 0;
        for i in 0..cloud.len() {
            let p = [0, 1, 2].map(|k| cloud.mean[k * cloud.len() + i]);
            if step(&cloud, i, p, (80.0, 0.005), rng).is_none() {
                left_out += 1;
                // At the origin nothing is left out.
                let by = step(&cloud, i, [0.0; 3], (80.0, 0.005), rng).unwrap();
                assert_eq!(p, [0, 1, 2].map(|k| p[k] + by[k]), "{i} by {by:?}");
            }
        }
        assert!((100..3900).contains(&left_out), "{left_out}");
    }
}
