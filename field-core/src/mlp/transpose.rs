//! The two ends of a network: feature-major rows `[feature][sample]` to a sample-major panel and back.
//!
//! With AVX-512 in blocks of 16 x 16 in registers: 64 shuffles for 256 numbers. Loads and stores are masked, so
//! that ragged ends cost nothing extra and padding is written as zeros on the way.

use super::{PANEL, reaches};
use float_core::Simd;
#[cfg(target_arch = "x86_64")]
use float_core::SimdLevel;

/// `panel[s][f] = x[f][s]` for `f < rows`, `s < count`; zero for the other `f < width` and `s < PANEL`. `x` begins at the
/// panel's first sample and has rows of `stride`, `panel` rows of `ps >= width`; `width` is a multiple of 16.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "a kernel: matrices with strides")]
pub(super) fn panel_from_rows(
    simd: Simd,
    x: &[f32],
    stride: usize,
    rows: usize,
    count: usize,
    panel: &mut [f32],
    ps: usize,
    width: usize,
) {
    assert!(rows > 0 && rows <= width && width.is_multiple_of(16) && width <= ps && count <= PANEL);
    assert!(reaches(rows, stride, count, x.len()) && reaches(PANEL, ps, ps, panel.len()));
    match simd.level() {
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => {
            // SAFETY: the level proves AVX-512; the asserts above cover both buffers, and masks cut `rows` and `count`.
            unsafe { avx512::panel_from_rows(x.as_ptr(), stride, rows, count, panel.as_mut_ptr(), ps, width) }
        }
        _ => {
            if count < PANEL || width > rows {
                for row in panel.chunks_exact_mut(ps).take(PANEL) {
                    row[..width].fill(0.0);
                }
            }
            for f in 0..rows {
                for (v, p) in x[f * stride..][..count].iter().zip(panel[f..].iter_mut().step_by(ps)) {
                    *p = *v;
                }
            }
        }
    }
}

/// The way back: write (`ADD = false`) or add (`ADD = true`) `panel[s][f]` to `out[f][s]` for `f < rows`, `s < count`. Rows of
/// the panel are `ps` long, a multiple of 16.
#[inline(always)]
pub(super) fn rows_from_panel<const ADD: bool>(
    simd: Simd,
    panel: &[f32],
    ps: usize,
    rows: usize,
    out: &mut [f32],
    stride: usize,
    count: usize,
) {
    assert!(rows > 0 && rows <= ps && ps.is_multiple_of(16) && count <= PANEL);
    assert!(reaches(rows, stride, count, out.len()) && reaches(PANEL, ps, ps, panel.len()));
    match simd.level() {
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => {
            // SAFETY: the level proves AVX-512; the asserts above cover both buffers, and masks cut `rows` and `count`.
            unsafe { avx512::rows_from_panel::<ADD>(panel.as_ptr(), ps, rows, out.as_mut_ptr(), stride, count) }
        }
        _ => {
            for f in 0..rows {
                for (v, p) in out[f * stride..][..count].iter_mut().zip(panel[f..].iter().step_by(ps)) {
                    *v = if ADD { *v + *p } else { *p };
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use super::PANEL;
    use core::arch::x86_64::*;

    /// The lowest `n` lanes (all from 16 on).
    #[inline]
    fn mask(n: usize) -> __mmask16 {
        if n >= 16 { !0 } else { (1 << n) - 1 }
    }

    /// # Safety
    /// `x` holds `rows` rows of `count` numbers, `panel` `PANEL` rows of `width`.
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn panel_from_rows(
        x: *const f32,
        stride: usize,
        rows: usize,
        count: usize,
        panel: *mut f32,
        ps: usize,
        width: usize,
    ) {
        for s in (0..PANEL).step_by(16) {
            let lanes = mask(count.saturating_sub(s));
            for f in (0..width).step_by(16) {
                let mut v = [_mm512_setzero_ps(); 16];
                // Sixteen turns whatever `rows`: only a loop that unrolls keeps `v` in registers.
                for (r, v) in v.iter_mut().enumerate() {
                    if f + r < rows {
                        // SAFETY: row `f + r < rows`; lanes past `count` are masked off.
                        *v = unsafe { _mm512_maskz_loadu_ps(lanes, x.wrapping_add((f + r) * stride + s)) };
                    }
                }
                let v = transpose(v);
                for (r, v) in v.iter().enumerate() {
                    // SAFETY: row `s + r < PANEL`, columns `f..f + 16` lie below `width`.
                    unsafe { _mm512_storeu_ps(panel.add((s + r) * ps + f), *v) };
                }
            }
        }
    }

    /// # Safety
    /// `panel` holds `PANEL` rows of `ps` numbers, a multiple of 16, `out` `rows` rows of `count`.
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn rows_from_panel<const ADD: bool>(
        panel: *const f32,
        ps: usize,
        rows: usize,
        out: *mut f32,
        stride: usize,
        count: usize,
    ) {
        for s in (0..count).step_by(16) {
            let lanes = mask(count - s);
            for f in (0..rows).step_by(16) {
                let mut v = [_mm512_setzero_ps(); 16];
                for (r, v) in v.iter_mut().enumerate() {
                    // SAFETY: row `s + r < PANEL`, columns `f..f + 16` lie below `ps`.
                    *v = unsafe { _mm512_loadu_ps(panel.add((s + r) * ps + f)) };
                }
                let v = transpose(v);
                for (r, v) in v.iter().enumerate() {
                    if f + r < rows {
                        let p = out.wrapping_add((f + r) * stride + s);
                        // SAFETY: row `f + r < rows`; lanes past `count` are masked off.
                        unsafe {
                            let v = if ADD { _mm512_add_ps(_mm512_maskz_loadu_ps(lanes, p), *v) } else { *v };
                            _mm512_mask_storeu_ps(p, lanes, v);
                        }
                    }
                }
            }
        }
    }

    /// Rows become columns, in four rounds that each double the distance of what is exchanged.
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn transpose(v: [__m512; 16]) -> [__m512; 16] {
        let mut a = v;
        // Pairs of rows, then of pairs: within 128-bit lanes.
        for i in 0..8 {
            a[2 * i] = _mm512_unpacklo_ps(v[2 * i], v[2 * i + 1]);
            a[2 * i + 1] = _mm512_unpackhi_ps(v[2 * i], v[2 * i + 1]);
        }
        let pd = |x| _mm512_castps_pd(x);
        let mut b = a;
        for i in 0..4 {
            for h in 0..2 {
                let (lo, hi) = (pd(a[4 * i + h]), pd(a[4 * i + 2 + h]));
                b[4 * i + 2 * h] = _mm512_castpd_ps(_mm512_unpacklo_pd(lo, hi));
                b[4 * i + 2 * h + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(lo, hi));
            }
        }
        // b[4 i + c], 128-bit lane l: column 4 l + c of rows 4 i..4 i + 4. Now gather the lanes of four `i`.
        let mut out = b;
        for c in 0..4 {
            let low = _mm512_shuffle_f32x4::<0x88>(b[c], b[4 + c]);
            let high = _mm512_shuffle_f32x4::<0x88>(b[8 + c], b[12 + c]);
            out[c] = _mm512_shuffle_f32x4::<0x88>(low, high);
            out[8 + c] = _mm512_shuffle_f32x4::<0xdd>(low, high);
            let low = _mm512_shuffle_f32x4::<0xdd>(b[c], b[4 + c]);
            let high = _mm512_shuffle_f32x4::<0xdd>(b[8 + c], b[12 + c]);
            out[4 + c] = _mm512_shuffle_f32x4::<0x88>(low, high);
            out[12 + c] = _mm512_shuffle_f32x4::<0xdd>(low, high);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;
    use alloc::vec::Vec;

    #[test]
    fn panels_hold_the_rows_turned_and_come_back() {
        for simd in Simd::available() {
            for (rows, count) in [(1, 1), (3, 48), (16, 16), (17, 47), (33, 5), (64, 48)] {
                let (stride, width) = (count + 3, usize::div_ceil(rows, 16) * 16);
                let ps = width + 16;
                let x: Vec<f32> = (0..(rows - 1) * stride + count).map(|i| i as f32 + 1.0).collect();
                let mut panel = vec![-1.0; PANEL * ps];
                panel_from_rows(simd, &x, stride, rows, count, &mut panel, ps, width);
                for s in 0..PANEL {
                    for f in 0..ps {
                        let want = match (f < rows && s < count, f < width) {
                            (true, _) => x[f * stride + s],
                            (false, true) => 0.0,
                            (false, false) => -1.0,
                        };
                        assert_eq!(panel[s * ps + f], want, "{:?} rows {rows} count {count} [{s}][{f}]", simd.level());
                    }
                }
                let mut back = vec![0.5; x.len()];
                rows_from_panel::<false>(simd, &panel, ps, rows, &mut back, stride, count);
                rows_from_panel::<true>(simd, &panel, ps, rows, &mut back, stride, count);
                for (i, (b, x)) in back.iter().zip(&x).enumerate() {
                    // Between rows nothing is touched.
                    assert_eq!(*b, if i % stride < count { 2.0 * x } else { 0.5 }, "{:?} {i}", simd.level());
                }
            }
        }
    }
}
