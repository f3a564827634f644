//! Position noise of 3DGS-MCMC: it moves Gaussians that are nearly transparent.

use alloc::vec::Vec;

use float_core::m32;
use float_core::rng::Rng;

use super::rotation;
use crate::Gaussians;
use crate::chunks::for_each;

/// Rows per task.
const CHUNK: usize = 1024;
/// Steepness of the logistic gate that closes above the opacity of dead Gaussians.
const GATE_STEEPNESS: f32 = 100.0;
/// Upper bound on the length of a vector of three normal numbers from [`Rng::normal_at`].
const LONGEST: f32 = 6.7 * 1.733;
/// Relative change that rounding absorbs: less than half the distance of an `f32` to its neighbours.
const ABSORBED: f32 = 1.0 / 67_108_864.0;

/// See [`Mcmc::add_noise`](super::Mcmc::add_noise).
pub(super) fn add(cloud: &mut Gaussians, strength: f64, opacity_dead: f64, rng: Rng) {
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
    let (cloud_ref, gate) = (&*cloud, Gate { strength: strength as f32, opacity_dead: opacity_dead as f32 });
    for_each(&mut jobs, |k, rows| {
        for at in 0..rows[0].len() {
            let i = k * CHUNK + at;
            let p = [rows[0][at], rows[1][at], rows[2][at]];
            if let Some(step) = step(cloud_ref, i, p, gate, rng) {
                for (row, step) in rows.iter_mut().zip(step) {
                    row[at] += step;
                }
            }
        }
    });
    cloud.mean = mean;
}

/// How much noise a Gaussian gets, by its opacity.
#[derive(Clone, Copy)]
struct Gate {
    strength: f32,
    opacity_dead: f32,
}

/// The noise added to the mean `p` of Gaussian `i`. `None` if rounding would absorb all of it.
fn step(cloud: &Gaussians, i: usize, p: [f32; 3], gate: Gate, rng: Rng) -> Option<[f32; 3]> {
    let n = cloud.len();
    let s2 = [0, 1, 2].map(|k| {
        let s = m32::exp(cloud.log_scale[k * n + i]);
        s * s
    });
    let open = gate.strength * m32::logistic(-GATE_STEEPNESS * (m32::logistic(cloud.logit[i]) - gate.opacity_dead));
    let longest = open * s2.into_iter().fold(0.0, f32::max) * LONGEST;
    // Most Gaussians are opaque: skip the normal numbers and the rotation.
    if p.iter().all(|p| longest < p.abs() * ABSORBED) {
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
        const GATE: Gate = Gate { strength: 80.0, opacity_dead: 0.005 };
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
            if step(&cloud, i, p, GATE, rng).is_none() {
                left_out += 1;
                // At the origin nothing is left out.
                let by = step(&cloud, i, [0.0; 3], GATE, rng).unwrap();
                assert_eq!(p, [0, 1, 2].map(|k| p[k] + by[k]), "{i} by {by:?}");
            }
        }
        assert!((100..3900).contains(&left_out), "{left_out}");
    }
}
