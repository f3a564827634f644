//! A picture cut into bands of rows.

use super::kernel::Band;
use super::pair::{Derivatives, Pair};
use super::scratch::{Scratch, TAPS};
use alloc::vec::Vec;
use core::ops::Range;
use float_core::Simd;

/// Rows of a band, about: what is worked on together. Each band filters up to 20 rows of its neighbours again.
const BAND: usize = 128;

/// Rows of each band: as equal as can be, and no matter of threads.
fn band_rows(height: usize) -> usize {
    height.div_ceil(height.div_ceil(BAND))
}

/// Sums of all bands into `sums`, gradients into the slice beside `Derivatives`. The picture is not empty.
pub(super) fn for_all(
    simd: Simd,
    taps: &[f32; TAPS],
    pool: &mut Vec<Scratch>,
    sums: &mut Vec<[f64; 2]>,
    pair: &Pair<'_>,
    gradient: Option<(Derivatives, &mut [f32])>,
) {
    let rows = band_rows(pair.height);
    let bands = pair.height.div_ceil(rows);
    sums.clear();
    sums.resize(pair.channels * bands, [0.0; 2]);
    let (derivatives, x_bar) = gradient.unzip();
    let of = |channel: usize, band: usize, sum: &mut [f64; 2], x_bar: Option<&mut [f32]>, scratch: &mut Scratch| {
        let rows: Range<usize> = band * rows..((band + 1) * rows).min(pair.height);
        *sum = simd.run(Band { pair, channel, rows, taps, gradient: derivatives.zip(x_bar), scratch });
    };
    for_each(pool, sums, x_bar, [bands, rows * pair.width, pair.height * pair.width], of);
}

/// `of(channel, band, sum, piece of x_bar, scratch)` for all sums; `[bands of a channel, values of a band, values of a channel]`.
#[cfg(feature = "rayon")]
fn for_each(
    pool: &mut Vec<Scratch>,
    sums: &mut [[f64; 2]],
    x_bar: Option<&mut [f32]>,
    [bands, band_len, channel_len]: [usize; 3],
    of: impl Fn(usize, usize, &mut [f64; 2], Option<&mut [f32]>, &mut Scratch) + Sync,
) {
    use rayon::prelude::*;
    use std::sync::{Mutex, PoisonError};
    // Whoever works takes a scratch and gives it back: there are as many as have worked at once.
    let free = Mutex::new(core::mem::take(pool));
    let with_scratch = |channel: usize, band: usize, sum: &mut [f64; 2], x_bar: Option<&mut [f32]>| {
        let mut scratch = free.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        of(channel, band, sum, x_bar, &mut scratch);
        free.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    };
    match x_bar {
        None => sums.par_iter_mut().enumerate().for_each(|(k, sum)| with_scratch(k / bands, k % bands, sum, None)),
        Some(x_bar) => {
            let channels = sums.par_chunks_mut(bands).zip(x_bar.par_chunks_mut(channel_len)).enumerate();
            channels.for_each(|(channel, (sums, x_bar))| {
                let pieces = sums.par_iter_mut().zip(x_bar.par_chunks_mut(band_len)).enumerate();
                pieces.for_each(|(band, (sum, x_bar))| with_scratch(channel, band, sum, Some(x_bar)));
            });
        }
    }
    *pool = free.into_inner().unwrap_or_else(PoisonError::into_inner);
}

/// `of(channel, band, sum, piece of x_bar, scratch)` for all sums; `[bands of a channel, values of a band, values of a channel]`.
#[cfg(not(feature = "rayon"))]
fn for_each(
    pool: &mut Vec<Scratch>,
    sums: &mut [[f64; 2]],
    mut x_bar: Option<&mut [f32]>,
    [bands, band_len, channel_len]: [usize; 3],
    of: impl Fn(usize, usize, &mut [f64; 2], Option<&mut [f32]>, &mut Scratch),
) {
    if pool.is_empty() {
        pool.push(Scratch::default());
    }
    let scratch = &mut pool[0];
    for (k, sum) in sums.iter_mut().enumerate() {
        let (channel, band) = (k / bands, k % bands);
        let end = (channel + 1) * channel_len;
        let first = channel * channel_len + band * band_len;
        let piece = x_bar.as_deref_mut().map(|x_bar| &mut x_bar[first..(first + band_len).min(end)]);
        of(channel, band, sum, piece, scratch);
    }
}
