//! The products of a layer on pairs of bf16, for CPUs with `vdpbf16ps`: one instruction takes 16 pairs of each operand
//! and adds their products to 16 f32 sums. Blocked as the f32 kernels ([`super::super::kernel`]).
//!
//! A pair is two neighbours along what is summed over: inputs in the forward product, outputs in the input gradient,
//! samples in the weight gradient. Panels `[sample][feature]` have the first two side by side; for the third,
//! [`interleave`] brings two samples together.

use super::super::{PANEL, reaches};
use core::arch::x86_64::*;

/// Where results of [`product`] go: rows of f32 as they are, or rows of bf16 after a last operation.
pub(super) enum Out<'a> {
    F32(&'a mut [f32]),
    Keep(&'a mut [u16]),
    /// `max(y, 0)`.
    Relu(&'a mut [u16]),
    /// `y` where the number at the same place of the second panel is positive, else 0.
    Gate(&'a mut [u16], &'a [u16]),
}

/// `y[s][j] = init[j] + sum_k x[s][k] * w[k][j]` for the panel's samples, `j < width`, a multiple of 16: `x` `[PANEL][xs]`, `w`
/// `[depth / 2][width][2]`, `y` `[PANEL][ys]`.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
#[expect(clippy::too_many_arguments, reason = "a kernel: matrices with strides")]
pub(super) fn product(
    x: &[u16],
    xs: usize,
    depth: usize,
    w: &[u16],
    width: usize,
    init: Option<&[f32]>,
    mut out: Out<'_>,
    ys: usize,
) {
    let pairs = depth.div_ceil(2);
    assert!(width.is_multiple_of(16) && width <= ys && reaches(pairs, 2 * width, 2 * width, w.len()));
    assert!(reaches(PANEL, xs, 2 * pairs, x.len()) && init.is_none_or(|b| b.len() >= width));
    let fits = |len: usize| reaches(PANEL, ys, width, len);
    assert!(match &out {
        Out::F32(y) => fits(y.len()),
        Out::Keep(y) | Out::Relu(y) => fits(y.len()),
        Out::Gate(y, gate) => fits(y.len()) && fits(gate.len()),
    });
    let mut j = 0;
    while j < width {
        let left = (width - j) / 16;
        // SAFETY: columns j..j + 16 C are below `width`, rows below PANEL; the asserts above cover all buffers.
        j += 16
            * unsafe {
                if left >= 4 {
                    columns::<6, 4>(x, xs, pairs, w, width, init, &mut out, ys, j)
                } else if left >= 2 {
                    columns::<12, 2>(x, xs, pairs, w, width, init, &mut out, ys, j)
                } else {
                    columns::<12, 1>(x, xs, pairs, w, width, init, &mut out, ys, j)
                }
            };
    }
}

/// All rows of the panel for `C` vectors of columns from `j`; returns `C`.
///
/// # Safety
/// As checked by [`product`].
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
#[expect(clippy::too_many_arguments, reason = "a kernel: matrices with strides")]
unsafe fn columns<const R: usize, const C: usize>(
    x: &[u16],
    xs: usize,
    pairs: usize,
    w: &[u16],
    ws: usize,
    init: Option<&[f32]>,
    out: &mut Out<'_>,
    ys: usize,
    j: usize,
) -> usize {
    for s in (0..PANEL).step_by(R) {
        let mut acc = [[_mm512_setzero_ps(); C]; R];
        // SAFETY: the caller vouches for rows s..s + R < PANEL (R divides it) and columns j..j + 16 C.
        unsafe {
            if let Some(init) = init {
                for c in 0..C {
                    let b = _mm512_loadu_ps(init.as_ptr().add(j + 16 * c));
                    for row in &mut acc {
                        row[c] = b;
                    }
                }
            }
            let x = x.as_ptr().add(s * xs);
            let mut wk = w.as_ptr().add(2 * j);
            for k in 0..pairs {
                let mut wv = [_mm512_setzero_si512(); C];
                for (c, wv) in wv.iter_mut().enumerate() {
                    *wv = _mm512_loadu_si512(wk.add(32 * c).cast());
                }
                for (r, row) in acc.iter_mut().enumerate() {
                    let xv = pair(x.add(r * xs + 2 * k));
                    for (acc, w) in row.iter_mut().zip(wv) {
                        *acc = dot(*acc, xv, w);
                    }
                }
                // Wrapping: after the last row it lies past the end of the buffer, and is not read.
                wk = wk.wrapping_add(2 * ws);
            }
            // The choice is made outside of the loops, so that they unroll and the sums stay in registers.
            let at = s * ys + j;
            macro_rules! each {
                ($write:expr, $y:ident, $v:ident, $at:ident => $value:expr) => {
                    for r in 0..R {
                        for c in 0..C {
                            let ($v, $at) = (acc[r][c], at + r * ys + 16 * c);
                            $write($y.as_mut_ptr().add($at).cast(), $value);
                        }
                    }
                };
            }
            match out {
                Out::F32(y) => each!(_mm512_storeu_ps, y, v, at => v),
                Out::Keep(y) => each!(store, y, v, at => v),
                Out::Relu(y) => each!(store, y, v, at => _mm512_max_ps(v, _mm512_setzero_ps())),
                Out::Gate(y, gate) => each!(store, y, v, at => {
                    let gate = _mm256_loadu_si256(gate.as_ptr().add(at).cast());
                    // As integers of 16 bits, positive bf16 numbers are positive.
                    _mm512_maskz_mov_ps(_mm256_cmpgt_epi16_mask(gate, _mm256_setzero_si256()), v)
                }),
            }
        }
    }
    C
}

/// `g[o][i] += sum_s a[s][o] * x[s][i]` over the panel's samples, `o < rows`, `i < width` (a multiple of 16): `a`
/// `[PANEL / 2][a_width][2]`, `x` `[PANEL / 2][width][2]`, `g` `[rows][width]`. Rows are worked on in fours, so `g` has
/// `rows` rounded up to 4 rows, and `a_width` is at least that.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
pub(super) fn outer_product(a: &[u16], a_width: usize, rows: usize, x: &[u16], width: usize, g: &mut [f32]) {
    let rows = rows.div_ceil(4) * 4;
    assert!(width.is_multiple_of(16) && rows <= a_width);
    assert!(
        reaches(PANEL, a_width, a_width, a.len())
            && reaches(PANEL, width, width, x.len())
            && reaches(rows, width, width, g.len())
    );
    for o in (0..rows).step_by(4) {
        let mut i = 0;
        while i < width {
            // SAFETY: rows o..o + 4 <= rows, columns below `width`; the asserts above cover the buffers.
            i += 16
                * unsafe {
                    match (width - i) / 16 {
                        4.. => outer_block::<4>(&a[2 * o..], a_width, &x[2 * i..], &mut g[o * width + i..], width),
                        2.. => outer_block::<2>(&a[2 * o..], a_width, &x[2 * i..], &mut g[o * width + i..], width),
                        _ => outer_block::<1>(&a[2 * o..], a_width, &x[2 * i..], &mut g[o * width + i..], width),
                    }
                };
        }
    }
}

/// Four rows by `C` vectors of the weight gradient; returns `C`.
///
/// # Safety
/// As checked by [`outer_product`].
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
unsafe fn outer_block<const C: usize>(a: &[u16], a_width: usize, x: &[u16], g: &mut [f32], width: usize) -> usize {
    let (mut a, mut x, g) = (a.as_ptr(), x.as_ptr(), g.as_mut_ptr());
    let mut acc = [[_mm512_setzero_ps(); C]; 4];
    // SAFETY: the caller vouches for PANEL / 2 rows of pairs in `a` and `x` and four rows of `g`.
    unsafe {
        for _ in 0..PANEL / 2 {
            let mut xv = [_mm512_setzero_si512(); C];
            for (c, xv) in xv.iter_mut().enumerate() {
                *xv = _mm512_loadu_si512(x.add(32 * c).cast());
            }
            for (r, row) in acc.iter_mut().enumerate() {
                let av = pair(a.add(2 * r));
                for (acc, x) in row.iter_mut().zip(xv) {
                    *acc = dot(*acc, av, x);
                }
            }
            (a, x) = (a.wrapping_add(2 * a_width), x.wrapping_add(2 * width));
        }
        for (r, row) in acc.iter().enumerate() {
            for (c, v) in row.iter().enumerate() {
                let p = g.add(r * width + 16 * c);
                _mm512_storeu_ps(p, _mm512_add_ps(_mm512_loadu_ps(p), *v));
            }
        }
    }
    C
}

/// `g[o] += sum_s a[s][o]`, `o < width`: the bias gradient, from `a` `[PANEL / 2][width][2]`.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
pub(super) fn column_sums(a: &[u16], width: usize, g: &mut [f32]) {
    assert!(width.is_multiple_of(16) && reaches(PANEL, width, width, a.len()) && g.len() >= width);
    let ones = _mm512_set1_epi16(0x3f80);
    for o in (0..width).step_by(16) {
        // SAFETY: rows below PANEL / 2, columns o..o + 16 below `width`: the assert covers both buffers.
        unsafe {
            let g = g.as_mut_ptr().add(o);
            let mut acc = _mm512_loadu_ps(g);
            for s in 0..PANEL / 2 {
                acc = dot(acc, ones, _mm512_loadu_si512(a.as_ptr().add(2 * (s * width + o)).cast()));
            }
            _mm512_storeu_ps(g, acc);
        }
    }
}

/// `out[s / 2][f][s % 2] = x[s][f]` for `f < width`, a multiple of 16: rows of `x` are `xs` apart.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
pub(super) fn interleave(x: &[u16], xs: usize, width: usize, out: &mut [u16]) {
    assert!(width.is_multiple_of(16) && reaches(PANEL, xs, width, x.len()) && reaches(PANEL, width, width, out.len()));
    for s in (0..PANEL).step_by(2) {
        for f in (0..width).step_by(16) {
            // SAFETY: rows s and s + 1 below PANEL, columns f..f + 16 below `width`: the assert covers both buffers.
            unsafe {
                let p = x.as_ptr().add(s * xs + f);
                let even = _mm512_cvtepu16_epi32(_mm256_loadu_si256(p.cast()));
                let odd = _mm512_cvtepu16_epi32(_mm256_loadu_si256(p.add(xs).cast()));
                let pairs = _mm512_or_si512(even, _mm512_slli_epi32::<16>(odd));
                _mm512_storeu_si512(out.as_mut_ptr().add(s * width + 2 * f).cast(), pairs);
            }
        }
    }
}

/// `out[s][f] = x[s][f]`, rounded to bf16, for `f < width`, a multiple of 16: rows are `xs` and `ys` apart.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
pub(super) fn round_panel(x: &[f32], xs: usize, width: usize, out: &mut [u16], ys: usize) {
    assert!(width.is_multiple_of(16) && reaches(PANEL, xs, width, x.len()) && reaches(PANEL, ys, width, out.len()));
    for s in 0..PANEL {
        for f in (0..width).step_by(16) {
            // SAFETY: row s below PANEL, columns f..f + 16 below `width`: the assert covers both buffers.
            unsafe {
                store(out.as_mut_ptr().add(s * ys + f), _mm512_loadu_ps(x.as_ptr().add(s * xs + f)));
            }
        }
    }
}

/// `out[i] = x[i]`, exact.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
pub(super) fn widen(x: &[u16], out: &mut [f32]) {
    for (x, out) in x.iter().zip(out) {
        *out = f32::from_bits(u32::from(*x) << 16);
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512bf16")]
fn dot(acc: __m512, a: __m512i, b: __m512i) -> __m512 {
    // SAFETY: `__m512bh` is 32 numbers of 16 bits, as is `__m512i`; every bit pattern is valid in both.
    let (a, b) =
        unsafe { (core::mem::transmute::<__m512i, __m512bh>(a), core::mem::transmute::<__m512i, __m512bh>(b)) };
    _mm512_dpbf16_ps(acc, a, b)
}

/// The two numbers at `p`, in all lanes.
///
/// # Safety
/// `p` is valid for reading two numbers.
#[inline]
#[target_feature(enable = "avx512f")]
unsafe fn pair(p: *const u16) -> __m512i {
    // SAFETY: the caller vouches for `p`; the read needs no alignment.
    _mm512_set1_epi32(unsafe { p.cast::<i32>().read_unaligned() })
}

/// Round to bf16 and write.
///
/// # Safety
/// `p` is valid for writing 16 numbers.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512bf16")]
unsafe fn store(p: *mut u16, v: __m512) {
    // SAFETY: the caller vouches for `p`; `__m256bh` is 16 numbers of 16 bits.
    unsafe {
        let bits = core::mem::transmute::<__m256bh, __m256i>(_mm512_cvtneps_pbh(v));
        _mm256_storeu_si256(p.cast(), bits);
    }
}
