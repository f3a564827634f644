//! The three products of a layer over one panel, register-blocked, generic over the vector level.
//!
//! A block keeps `R x C` vectors of the result in registers: `R` rows (samples, or outputs for the weight gradient) times
//! `C` vectors of features. With 32 registers (AVX-512) that is 6 x 4, 12 x 2 or 24 x 1; with 16, 6 x 2 and 12 x 1.
//! Per step of the inner loop it loads `C` vectors, broadcasts `R` numbers and does `R * C` fused multiply-adds.

use super::{PANEL, reaches};
use float_core::Vector;

/// What happens to a result of [`product`] before it leaves the registers.
#[derive(Clone, Copy)]
pub(super) enum Finish<'a> {
    /// Nothing.
    Keep,
    /// `max(y, 0)`.
    Relu,
    /// `y` where the number at the same place of a panel with rows of the same length is positive, else 0: the
    /// derivative of [`Finish::Relu`], given its outputs.
    Gate(&'a [f32]),
}

/// `y[s][j] = finish(init[j] + sum_k x[s][k] * w[k][j])` for the panel's samples: `x` `[PANEL][xs]`, `w` `[k][ws]`, `y` `[PANEL][ys]`,
/// `j < width`, a multiple of 16. `init` holds `width` numbers. This is the forward product (`w` = weights by input, `init` =
/// biases) and the input gradient (`w` = weights by output, `init` = zeros) alike.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "a kernel: matrices with strides")]
pub(super) fn product<V: Vector>(
    x: &[f32],
    xs: usize,
    depth: usize,
    w: &[f32],
    ws: usize,
    init: Option<&[f32]>,
    finish: Finish<'_>,
    y: &mut [f32],
    ys: usize,
    width: usize,
) {
    assert!(width.is_multiple_of(16) && width <= ys && width <= ws && depth <= xs);
    assert!(reaches(PANEL, xs, xs, x.len()) && reaches(PANEL, ys, width, y.len()) && reaches(depth, ws, ws, w.len()));
    assert!(init.is_none_or(|b| b.len() >= width));
    if let Finish::Gate(gate) = finish {
        assert!(reaches(PANEL, ys, ys, gate.len()));
    }
    let (xp, wp, yp) = (x.as_ptr(), w.as_ptr(), y.as_mut_ptr());
    let init = init.map(<[f32]>::as_ptr);
    let mut j = 0;
    while j < width {
        let left = (width - j) / V::LANES;
        // SAFETY: columns j..j + C * LANES are below `width`, rows below PANEL; the asserts above cover all three buffers.
        j += V::LANES
            * unsafe {
                if V::LANES == 16 && left >= 4 {
                    columns::<V, 6, 4>(xp, xs, depth, wp, ws, init, finish, yp, ys, j)
                } else if left >= 2 {
                    if V::LANES == 16 {
                        columns::<V, 12, 2>(xp, xs, depth, wp, ws, init, finish, yp, ys, j)
                    } else {
                        columns::<V, 6, 2>(xp, xs, depth, wp, ws, init, finish, yp, ys, j)
                    }
                } else {
                    columns::<V, 12, 1>(xp, xs, depth, wp, ws, init, finish, yp, ys, j)
                }
            };
    }
}

/// All rows of the panel for `C` vectors of columns from `j`; returns `C`.
///
/// # Safety
/// As checked by [`product`].
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "a kernel: pointers and strides")]
#[expect(clippy::needless_range_loop, reason = "`r` counts registers and rows of memory alike")]
unsafe fn columns<V: Vector, const R: usize, const C: usize>(
    x: *const f32,
    xs: usize,
    depth: usize,
    w: *const f32,
    ws: usize,
    init: Option<*const f32>,
    finish: Finish<'_>,
    y: *mut f32,
    ys: usize,
    j: usize,
) -> usize {
    let mut s = 0;
    while s < PANEL {
        let mut acc = [[V::splat(0.0); C]; R];
        // SAFETY: the caller vouches for rows s..s + R < PANEL (R divides it) and columns j..j + C * LANES.
        unsafe {
            if let Some(init) = init {
                for c in 0..C {
                    let b = V::load_ptr(init.add(j + c * V::LANES));
                    for row in &mut acc {
                        row[c] = b;
                    }
                }
            }
            let x = x.add(s * xs);
            let mut wk = w.add(j);
            for k in 0..depth {
                let mut wv = [V::splat(0.0); C];
                for (c, wv) in wv.iter_mut().enumerate() {
                    *wv = V::load_ptr(wk.add(c * V::LANES));
                }
                for r in 0..R {
                    let xv = V::splat(*x.add(r * xs + k));
                    for c in 0..C {
                        acc[r][c] = xv.mul_add(wv[c], acc[r][c]);
                    }
                }
                // Wrapping: after the last row it lies past the end of the buffer, and is not read.
                wk = wk.wrapping_add(ws);
            }
            match finish {
                Finish::Keep => {}
                Finish::Relu => {
                    for v in acc.as_flattened_mut() {
                        *v = v.max(V::splat(0.0));
                    }
                }
                Finish::Gate(gate) => {
                    for (r, row) in acc.iter_mut().enumerate() {
                        for (c, v) in row.iter_mut().enumerate() {
                            let gate = V::load_ptr(gate.as_ptr().add((s + r) * ys + j + c * V::LANES));
                            *v = gate.select_positive(*v, V::splat(0.0));
                        }
                    }
                }
            }
            for (r, row) in acc.iter().enumerate() {
                for (c, v) in row.iter().enumerate() {
                    v.store_ptr(y.add((s + r) * ys + j + c * V::LANES));
                }
            }
        }
        s += R;
    }
    C
}

/// `g[o][i] += sum_s a[s][o] * x[s][i]` over the panel's samples, `o < rows`, `i < width` (a multiple of 16): the weight
/// gradient. Rows are worked on in fours, so `g` has `rows` rounded up to 4 rows, and `a` so many columns.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "a kernel: matrices with strides")]
pub(super) fn outer_product<V: Vector>(
    a: &[f32],
    a_stride: usize,
    rows: usize,
    x: &[f32],
    xs: usize,
    width: usize,
    g: &mut [f32],
    gs: usize,
) {
    let rows = rows.div_ceil(4) * 4;
    assert!(width.is_multiple_of(16) && width <= xs && width <= gs && rows <= a_stride);
    assert!(
        reaches(PANEL, a_stride, a_stride, a.len())
            && reaches(PANEL, xs, xs, x.len())
            && reaches(rows, gs, gs, g.len())
    );
    let (a, x, g) = (a.as_ptr(), x.as_ptr(), g.as_mut_ptr());
    for o in (0..rows).step_by(4) {
        let mut i = 0;
        while i < width {
            let left = (width - i) / V::LANES;
            // SAFETY: rows o..o + 4 <= rows, columns below `width`; the asserts above cover the buffers.
            i += V::LANES
                * unsafe {
                    if V::LANES == 16 && left >= 4 {
                        outer_block::<V, 4>(a.add(o), a_stride, x.add(i), xs, g.add(o * gs + i), gs)
                    } else if left >= 2 {
                        outer_block::<V, 2>(a.add(o), a_stride, x.add(i), xs, g.add(o * gs + i), gs)
                    } else {
                        outer_block::<V, 1>(a.add(o), a_stride, x.add(i), xs, g.add(o * gs + i), gs)
                    }
                };
        }
    }
}

/// Four rows by `C` vectors of the weight gradient; returns `C`.
///
/// # Safety
/// As checked by [`outer_product`].
#[inline(always)]
unsafe fn outer_block<V: Vector, const C: usize>(
    a: *const f32,
    a_stride: usize,
    x: *const f32,
    xs: usize,
    g: *mut f32,
    gs: usize,
) -> usize {
    let mut acc = [[V::splat(0.0); C]; 4];
    // SAFETY: the caller vouches for PANEL rows of `a` and `x` and four rows of `g`.
    unsafe {
        for s in 0..PANEL {
            let mut xv = [V::splat(0.0); C];
            for (c, xv) in xv.iter_mut().enumerate() {
                *xv = V::load_ptr(x.add(s * xs + c * V::LANES));
            }
            for (r, row) in acc.iter_mut().enumerate() {
                let av = V::splat(*a.add(s * a_stride + r));
                for c in 0..C {
                    row[c] = av.mul_add(xv[c], row[c]);
                }
            }
        }
        for (r, row) in acc.iter().enumerate() {
            for (c, v) in row.iter().enumerate() {
                let p = g.add(r * gs + c * V::LANES);
                (V::load_ptr(p) + *v).store_ptr(p);
            }
        }
    }
    C
}

/// `g[o] += sum_s a[s][o]` over the panel's samples for `o < width`, a multiple of 16: the bias gradient.
#[inline(always)]
pub(super) fn column_sums<V: Vector>(a: &[f32], a_stride: usize, width: usize, g: &mut [f32]) {
    for (o, g) in g[..width].chunks_exact_mut(16).enumerate() {
        let mut acc = [V::splat(0.0); 2];
        for row in a.chunks(a_stride).take(PANEL) {
            for (c, acc) in acc.iter_mut().enumerate().take(16 / V::LANES) {
                *acc = *acc + V::load(&row[16 * o + c * V::LANES..]);
            }
        }
        for (acc, g) in acc.iter().zip(g.chunks_exact_mut(V::LANES)) {
            (V::load(g) + *acc).store(g);
        }
    }
}
