//! One band of one channel, row by row: filter along x, along y, map, and back.
//!
//! A value costs about 230 multiply-adds: 66 and 44 for the moments along x and y, 45 for the map and its derivatives, 33 and 33 for
//! the derivatives' filters, 8 at the end. Rows stream through rings that stay in the second-level cache: 528 bytes a column.

use super::pair::{Derivatives, Pair, Target};
use super::scratch::{BLOCK, DERIVATIVES, MOMENTS, REACH, Scratch, TAPS, padded};
use crate::metrics::{C1, C2};
use core::ops::Range;
use float_core::{Task, Vector};

/// Sums `[g |x - y|, g (1 - s)]` over the band; its gradient is added where one is wanted.
pub(super) struct Band<'a> {
    pub(super) pair: &'a Pair<'a>,
    pub(super) channel: usize,
    pub(super) rows: Range<usize>,
    pub(super) taps: &'a [f32; TAPS],
    /// The gradient of these rows, `[row][column]`.
    pub(super) gradient: Option<(Derivatives, &'a mut [f32])>,
    pub(super) scratch: &'a mut Scratch,
}

impl Task for Band<'_> {
    type Output = [f64; 2];
    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 2] {
        let Self { pair, channel, rows, taps, mut gradient, scratch } = self;
        let (width, height) = (pair.width, pair.height);
        let blocks = width.div_ceil(BLOCK);
        let row_len = padded(blocks);
        scratch.clear(blocks);
        scratch.weights[..width].fill(1.0);

        // Rows of the map: the gradient of a row needs those its windows lie in.
        let beside = if gradient.is_some() { REACH } else { 0 };
        let map = rows.start.saturating_sub(beside)..(rows.end + beside).min(height);
        let mut sums = [0.0; 2];
        for i in map.start.saturating_sub(REACH)..rows.end + beside + REACH {
            let slot = i % TAPS;
            if i < height {
                let halves = &mut scratch.halves[slot * 2 * row_len..][..2 * row_len];
                load(pair, channel, i, halves);
                leave_out(pair, i, halves);
                moments_along_x::<V>(taps, halves, &mut scratch.moments, slot);
            } else {
                clear_slot::<MOMENTS>(&mut scratch.moments, slot);
            }
            let Some(m) = i.checked_sub(REACH) else { continue };
            let slot = m % TAPS;
            if map.contains(&m) {
                weights_of(pair, m, &mut scratch.weights);
                let row = map_row::<V>(&turned(taps, m), scratch, slot);
                if rows.contains(&m) {
                    sums = [sums[0] + f64::from(row[0]), sums[1] + f64::from(row[1])];
                }
                if gradient.is_some() {
                    derivatives_along_x::<V>(taps, &scratch.derivatives, &mut scratch.filtered, slot);
                }
            } else if m >= height {
                clear_slot::<DERIVATIVES>(&mut scratch.filtered, slot);
            }
            let Some(r) = m.checked_sub(REACH).filter(|r| rows.contains(r)) else { continue };
            if let Some((derivatives, x_bar)) = &mut gradient {
                weights_of(pair, r, &mut scratch.weights);
                gradient_row::<V>(&turned(taps, r), *derivatives, scratch, r % TAPS);
                add_where_used(pair, r, &scratch.out, &mut x_bar[(r - rows.start) * width..][..width]);
            }
        }
        sums
    }
}

/// Taps in the order of slots, for the window around `row`.
#[inline(always)]
fn turned(taps: &[f32; TAPS], row: usize) -> [f32; TAPS] {
    let mut out = [0.0; TAPS];
    for (k, &tap) in taps.iter().enumerate() {
        // Row `row + k - REACH`; rows before the picture have slots, too.
        out[(row + TAPS + k - REACH) % TAPS] = tap;
    }
    out
}

/// `[(x + y) / 2, (x - y) / 2]` of a row.
#[inline(always)]
fn load(pair: &Pair<'_>, channel: usize, row: usize, halves: &mut [f32]) {
    let Pair { channels, height, width, x, target, .. } = *pair;
    let start = (channel * height + row) * width;
    let x = &x[start..][..width];
    let (p, q) = halves.split_at_mut(halves.len() / 2);
    let halves = p[REACH..].iter_mut().zip(&mut q[REACH..]).zip(x);
    match target {
        Target::Planes(y) => {
            for (((p, q), &x), &y) in halves.zip(&y[start..][..width]) {
                (*p, *q) = (0.5 * (x + y), 0.5 * (x - y));
            }
        }
        Target::Bytes(y) => {
            let y = y[row * width * channels..][..width * channels].chunks_exact(channels);
            for (((p, q), &x), y) in halves.zip(y) {
                let y = f32::from(y[channel]) / 255.0;
                (*p, *q) = (0.5 * (x + y), 0.5 * (x - y));
            }
        }
    }
}

/// Black in both pictures where a row's pixels are left out.
#[inline(always)]
fn leave_out(pair: &Pair<'_>, row: usize, halves: &mut [f32]) {
    let Some(weights) = pair.weights else { return };
    let (p, q) = halves.split_at_mut(halves.len() / 2);
    let weights = &weights[row * pair.width..][..pair.width];
    for ((p, q), weight) in p[REACH..].iter_mut().zip(&mut q[REACH..]).zip(weights) {
        if *weight == 0.0 {
            (*p, *q) = (0.0, 0.0);
        }
    }
}

/// Add the gradient of a row, but for pixels that are left out.
#[inline(always)]
fn add_where_used(pair: &Pair<'_>, row: usize, new: &[f32], x_bar: &mut [f32]) {
    match pair.weights {
        None => x_bar.iter_mut().zip(new).for_each(|(bar, new)| *bar += new),
        Some(weights) => {
            let weights = &weights[row * pair.width..][..pair.width];
            for ((bar, new), weight) in x_bar.iter_mut().zip(new).zip(weights) {
                *bar += if *weight == 0.0 { 0.0 } else { *new };
            }
        }
    }
}

/// Weights of a row, where there are any.
#[inline(always)]
fn weights_of(pair: &Pair<'_>, row: usize, out: &mut [f32]) {
    if let Some(weights) = pair.weights {
        out[..pair.width].copy_from_slice(&weights[row * pair.width..][..pair.width]);
    }
}

#[inline(always)]
fn splat_all<V: Vector>(taps: &[f32; TAPS]) -> [V; TAPS] {
    taps.map(V::splat)
}

/// A row beyond the picture.
#[inline(always)]
fn clear_slot<const M: usize>(ring: &mut [f32], slot: usize) {
    for block in ring.chunks_exact_mut(TAPS * M * BLOCK) {
        block[slot * M * BLOCK..][..M * BLOCK].fill(0.0);
    }
}

/// `w * p`, `w * p^2`, `w * q`, `w * q^2` along x, into a slot of the ring.
#[inline(always)]
fn moments_along_x<V: Vector>(taps: &[f32; TAPS], halves: &[f32], ring: &mut [f32], slot: usize) {
    let taps = splat_all::<V>(taps);
    let (p, q) = halves.split_at(halves.len() / 2);
    for (b, block) in ring.chunks_exact_mut(TAPS * MOMENTS * BLOCK).enumerate() {
        let out = &mut block[slot * MOMENTS * BLOCK..][..MOMENTS * BLOCK];
        let (p, q) = (&p[b * BLOCK..][..2 * BLOCK], &q[b * BLOCK..][..2 * BLOCK]);
        for at in (0..BLOCK).step_by(V::LANES) {
            let mut sums = [V::splat(0.0); MOMENTS];
            for (k, &tap) in taps.iter().enumerate() {
                let (p, q) = (V::load(&p[k + at..]), V::load(&q[k + at..]));
                let (tap_p, tap_q) = (tap * p, tap * q);
                sums[0] = sums[0] + tap_p;
                sums[1] = tap_p.mul_add(p, sums[1]);
                sums[2] = sums[2] + tap_q;
                sums[3] = tap_q.mul_add(q, sums[3]);
            }
            for (m, sum) in sums.into_iter().enumerate() {
                sum.store(&mut out[m * BLOCK + at..]);
            }
        }
    }
}

/// The derivatives filtered along x, into a slot of the ring.
#[inline(always)]
fn derivatives_along_x<V: Vector>(taps: &[f32; TAPS], derivatives: &[f32], ring: &mut [f32], slot: usize) {
    let taps = splat_all::<V>(taps);
    let row_len = derivatives.len() / DERIVATIVES;
    for (b, block) in ring.chunks_exact_mut(TAPS * DERIVATIVES * BLOCK).enumerate() {
        let out = &mut block[slot * DERIVATIVES * BLOCK..][..DERIVATIVES * BLOCK];
        for (row, out) in derivatives.chunks_exact(row_len).zip(out.chunks_exact_mut(BLOCK)) {
            let row = &row[b * BLOCK..][..2 * BLOCK];
            for at in (0..BLOCK).step_by(V::LANES) {
                let mut sum = V::splat(0.0);
                for (k, &tap) in taps.iter().enumerate() {
                    sum = V::load(&row[k + at..]).mul_add(tap, sum);
                }
                sum.store(&mut out[at..]);
            }
        }
    }
}

/// The filter along y of one block of a ring.
#[inline(always)]
fn along_y<V: Vector, const M: usize>(taps: &[V; TAPS], block: &[f32], at: usize) -> [V; M] {
    let block = &block[..TAPS * M * BLOCK];
    let mut sums = [V::splat(0.0); M];
    for (slot, &tap) in taps.iter().enumerate() {
        for (m, sum) in sums.iter_mut().enumerate() {
            *sum = V::load(&block[(slot * M + m) * BLOCK + at..]).mul_add(tap, *sum);
        }
    }
    sums
}

/// One row of the map: its derivatives to `scratch.derivatives`, and the sums `[g |x - y|, g (1 - s)]`.
#[inline(always)]
fn map_row<V: Vector>(taps: &[f32; TAPS], scratch: &mut Scratch, slot: usize) -> [f32; 2] {
    let Scratch { halves, moments, derivatives, weights, .. } = scratch;
    let taps = splat_all::<V>(taps);
    let row_len = derivatives.len() / DERIVATIVES;
    let q_row = &halves[(2 * slot + 1) * row_len..][..row_len];
    let (derivative_1, rest) = derivatives.split_at_mut(row_len);
    let (derivative_pp, derivative_qq) = rest.split_at_mut(row_len);
    let (zero, two, four) = (V::splat(0.0), V::splat(2.0), V::splat(4.0));
    let (c1, c2) = (V::splat(C1 as f32), V::splat(C2 as f32));
    let (mut sum_l1, mut sum_dssim) = (zero, zero);
    for (b, block) in moments.chunks_exact(TAPS * MOMENTS * BLOCK).enumerate() {
        for at in (0..BLOCK).step_by(V::LANES) {
            let column = b * BLOCK + at;
            let [mu_p, e_pp, mu_q, e_qq] = along_y::<V, MOMENTS>(&taps, block, at);
            let (mu_pp, mu_qq) = (mu_p * mu_p, mu_q * mu_q);
            // The second operand is kept where one is NaN.
            let (var_p, var_q) = (zero.max(e_pp - mu_pp), zero.max(e_qq - mu_qq));
            let r1 = V::splat(1.0) / two.mul_add(mu_pp + mu_qq, c1);
            let r2 = V::splat(1.0) / two.mul_add(var_p + var_q, c2);
            let (a, b) = (four * mu_qq * r1, four * var_q * r2);
            let (rest_a, rest_b) = (V::splat(1.0) - a, V::splat(1.0) - b);
            let weight = V::load(&weights[column..]);

            sum_dssim = weight.mul_add(b.mul_add(rest_a, a), sum_dssim);
            let q = V::load(&q_row[column + REACH..]);
            sum_l1 = weight.mul_add(q.max(-q), sum_l1);

            let of_var = two * rest_a * r2;
            let (of_pp, of_qq) = (-(of_var * b), of_var * (two - b));
            let of_mu = four * rest_b * r1;
            let of_p = -(mu_p * of_mu.mul_add(a, two * of_pp));
            let of_q = mu_q * of_mu.mul_add(two - a, -(two * of_qq));
            (weight * (of_p + of_q)).store(&mut derivative_1[column + REACH..]);
            (weight * of_pp).store(&mut derivative_pp[column + REACH..]);
            (weight * of_qq).store(&mut derivative_qq[column + REACH..]);
        }
    }
    // |x - y| is twice |q|.
    [2.0 * sum_l1.sum(), sum_dssim.sum()]
}

/// The gradient of one row into `scratch.out`.
#[inline(always)]
fn gradient_row<V: Vector>(taps: &[f32; TAPS], derivatives: Derivatives, scratch: &mut Scratch, slot: usize) {
    let Scratch { halves, filtered, weights, out, .. } = scratch;
    let taps = splat_all::<V>(taps);
    let row_len = halves.len() / (2 * TAPS);
    let (p_row, q_row) = halves[2 * slot * row_len..][..2 * row_len].split_at(row_len);
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    for (b, block) in filtered.chunks_exact(TAPS * DERIVATIVES * BLOCK).enumerate() {
        for at in (0..BLOCK).step_by(V::LANES) {
            let column = b * BLOCK + at;
            let [of_1, of_pp, of_qq] = along_y::<V, DERIVATIVES>(&taps, block, at);
            let (p, q) = (V::load(&p_row[column + REACH..]), V::load(&q_row[column + REACH..]));
            let of_dssim = p.mul_add(of_pp, q.mul_add(of_qq, V::splat(0.5) * of_1));
            let sign = q.select_positive(one, (-q).select_positive(-one, zero));
            let of_l1 = V::load(&weights[column..]) * sign * V::splat(derivatives.l1);
            V::splat(derivatives.dssim).mul_add(of_dssim, of_l1).store(&mut out[column..]);
        }
    }
}
