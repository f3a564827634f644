//! Matrix products of the linear layer, on feature-major matrices.

use float_core::{Task, Vector};

/// What the product is added to.
pub(super) enum Start<'a> {
    Zero,
    /// One number for each row.
    Bias(&'a [f32]),
    /// What `out` holds.
    Add,
}

/// `out[i][s] = start + sum(a[i * row + k * column] * b[k][s], k)`: strides let `a` be read transposed.
///
/// `a` `[m][k]` by strides, `b` `[k][n]`, `out` `[m][n]`.
pub(super) struct Product<'a> {
    pub(super) a: &'a [f32],
    pub(super) a_row: usize,
    pub(super) a_column: usize,
    pub(super) b: &'a [f32],
    pub(super) m: usize,
    pub(super) k: usize,
    pub(super) n: usize,
    pub(super) start: Start<'a>,
    pub(super) out: &'a mut [f32],
}

impl Task for Product<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let Self { m, k, n, .. } = self;
        if m == 0 || n == 0 {
            return;
        }
        // The `unsafe` in `block` relies on these: no wrapping.
        let reaches = |a: usize, b: usize, len: usize| a.checked_mul(b).is_some_and(|need| need <= len);
        assert!(reaches(k, n, self.b.len()) && reaches(m, n, self.out.len()), "product: buffers are too short");
        let rows = (m - 1).checked_mul(self.a_row);
        let last = k.saturating_sub(1).checked_mul(self.a_column).and_then(|last| rows?.checked_add(last));
        assert!(k == 0 || last.is_some_and(|last| last < self.a.len()), "product: weights too short");
        if let Start::Bias(bias) = self.start {
            assert!(bias.len() >= m, "product: bias is too short");
        }
        // Panels of samples outside, so that one panel of `b` stays in the first cache for all rows of `a`.
        let mut s = 0;
        if V::LANES == 16 {
            while s + 64 <= n {
                self.rows::<V, 4>(s);
                s += 64;
            }
        }
        while s + 2 * V::LANES <= n {
            self.rows::<V, 2>(s);
            s += 2 * V::LANES;
        }
        while s + V::LANES <= n {
            self.rows::<V, 1>(s);
            s += V::LANES;
        }
        self.tail::<V>(s);
    }
}

impl Product<'_> {
    /// All rows of one panel of `W` vectors from sample `s` on; the caller has checked `s + W * LANES <= n`.
    #[inline(always)]
    fn rows<V: Vector, const W: usize>(&mut self, s: usize) {
        let mut i = 0;
        while i + 4 <= self.m {
            self.block::<V, 4, W>(i, s);
            i += 4;
        }
        while i < self.m {
            self.block::<V, 1, W>(i, s);
            i += 1;
        }
    }

    /// `H` rows by `W` vectors, kept in registers.
    #[inline(always)]
    fn block<V: Vector, const H: usize, const W: usize>(&mut self, i: usize, s: usize) {
        let n = self.n;
        let mut acc = [[V::splat(0.0); W]; H];
        match self.start {
            Start::Zero => {}
            Start::Bias(bias) => {
                for (row, &bias) in acc.iter_mut().zip(&bias[i..]) {
                    *row = [V::splat(bias); W];
                }
            }
            Start::Add => {
                for (h, row) in acc.iter_mut().enumerate() {
                    for (w, v) in row.iter_mut().enumerate() {
                        *v = V::load(&self.out[(i + h) * n + s + w * V::LANES..]);
                    }
                }
            }
        }
        let (a, b) = (self.a.as_ptr(), self.b.as_ptr());
        for k in 0..self.k {
            // SAFETY: `run` checked that `b` holds `k * n` numbers and `s + W * LANES <= n`, and that `a` reaches
            // `(m - 1) * a_row + (k - 1) * a_column`; `i + h < m`.
            unsafe {
                let mut x = [V::splat(0.0); W];
                for (w, x) in x.iter_mut().enumerate() {
                    *x = V::load_ptr(b.add(k * n + s + w * V::LANES));
                }
                for (h, row) in acc.iter_mut().enumerate() {
                    let weight = V::splat(*a.add((i + h) * self.a_row + k * self.a_column));
                    for (v, &x) in row.iter_mut().zip(&x) {
                        *v = weight.mul_add(x, *v);
                    }
                }
            }
        }
        for (h, row) in acc.iter().enumerate() {
            for (w, v) in row.iter().enumerate() {
                v.store(&mut self.out[(i + h) * n + s + w * V::LANES..]);
            }
        }
    }

    /// The last samples, fewer than one vector.
    #[inline(always)]
    fn tail<V: Vector>(&mut self, s: usize) {
        if s == self.n {
            return;
        }
        let mut i = 0;
        while i + 4 <= self.m {
            self.tail_block::<V, 4>(i, s);
            i += 4;
        }
        while i < self.m {
            self.tail_block::<V, 1>(i, s);
            i += 1;
        }
    }

    /// `H` rows of the tail. Lanes past the last sample read numbers of the next row and are dropped.
    #[inline(always)]
    fn tail_block<V: Vector, const H: usize>(&mut self, i: usize, s: usize) {
        let (n, len) = (self.n, self.n - s);
        let mut acc = [V::splat(0.0); H];
        for (h, acc) in acc.iter_mut().enumerate() {
            match self.start {
                Start::Zero => {}
                Start::Bias(bias) => *acc = V::splat(bias[i + h]),
                Start::Add => *acc = V::load_part(&self.out[(i + h) * n + s..(i + h + 1) * n]),
            }
        }
        for k in 0..self.k {
            let at = k * n + s;
            let x = if at + V::LANES <= self.b.len() {
                V::load(&self.b[at..])
            } else {
                V::load_part(&self.b[at..at + len])
            };
            for (h, acc) in acc.iter_mut().enumerate() {
                *acc = V::splat(self.a[(i + h) * self.a_row + k * self.a_column]).mul_add(x, *acc);
            }
        }
        for (h, acc) in acc.iter().enumerate() {
            acc.store_part(&mut self.out[(i + h) * n + s..(i + h + 1) * n]);
        }
    }
}

/// `out[s][k] = x[k][s]`, in square tiles so that both sides stay in cache.
pub(super) struct Transpose<'a> {
    pub(super) x: &'a [f32],
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) out: &'a mut [f32],
}

impl Task for Transpose<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        const TILE: usize = 8;
        let Self { x, rows, cols, out } = self;
        let (full_rows, full_cols) = (rows / TILE * TILE, cols / TILE * TILE);
        for r in (0..full_rows).step_by(TILE) {
            for c in (0..full_cols).step_by(TILE) {
                let mut tile = [[0.0_f32; TILE]; TILE];
                for (i, line) in tile.iter_mut().enumerate() {
                    line.copy_from_slice(&x[(r + i) * cols + c..(r + i) * cols + c + TILE]);
                }
                for j in 0..TILE {
                    let line: [f32; TILE] = core::array::from_fn(|i| tile[i][j]);
                    out[(c + j) * rows + r..(c + j) * rows + r + TILE].copy_from_slice(&line);
                }
            }
        }
        for r in 0..rows {
            for c in if r < full_rows { full_cols } else { 0 }..cols {
                out[c * rows + r] = x[r * cols + c];
            }
        }
    }
}

/// Sum of all numbers, in eight `f64` accumulators folded in order.
#[inline(always)]
pub(super) fn sum(x: &[f32]) -> f32 {
    let mut acc = [0.0_f64; 8];
    let chunks = x.chunks_exact(8);
    let tail = chunks.remainder();
    for chunk in chunks {
        for (a, &x) in acc.iter_mut().zip(chunk) {
            *a += f64::from(x);
        }
    }
    let tail: f64 = tail.iter().map(|&x| f64::from(x)).sum();
    (acc.iter().sum::<f64>() + tail) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use float_core::Simd;
    use std::vec;
    use std::vec::Vec;

    fn numbers(len: usize, salt: u64) -> Vec<f32> {
        (0..len as u64).map(|i| crate::rng::Rng::new(salt, 0).uniform_at(i) - 0.5).collect()
    }

    #[test]
    fn every_level_matches_the_definition_for_all_small_shapes() {
        for level in Simd::available() {
            for n in (0..=70).chain([128, 130]) {
                for (m, k) in [(1, 1), (4, 3), (5, 7), (9, 4), (0, 3), (3, 0)] {
                    let (a, b, bias) = (numbers(m * k, 1), numbers(k * n, 2), numbers(m, 3));
                    for transposed in [false, true] {
                        let (a_row, a_column) = if transposed { (1, m) } else { (k, 1) };
                        for start in 0..3 {
                            let before = numbers(m * n, 4);
                            let mut out = before.clone();
                            let how = [Start::Zero, Start::Bias(&bias), Start::Add].into_iter().nth(start).unwrap();
                            level.run(Product { a: &a, a_row, a_column, b: &b, m, k, n, start: how, out: &mut out });
                            for i in 0..m {
                                for s in 0..n {
                                    let from = [0.0, bias[i], before[i * n + s]][start];
                                    let products = (0..k).map(|j| {
                                        f64::from(a[i * a_row + j * a_column] * 1.0) * f64::from(b[j * n + s])
                                    });
                                    let want = f64::from(from) + products.sum::<f64>();
                                    // Seven products of numbers below 1/2: rounding stays below 1e-6.
                                    assert!((f64::from(out[i * n + s]) - want).abs() < 1e-6, "{m}x{k}x{n}");
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn transpose_matches_the_definition() {
        for (rows, cols) in [(0, 5), (1, 1), (8, 8), (9, 17), (16, 3), (3, 16), (24, 40)] {
            let x = numbers(rows * cols, 5);
            let mut out = vec![0.0; rows * cols];
            Simd::best().run(Transpose { x: &x, rows, cols, out: &mut out });
            assert!((0..rows * cols).all(|i| out[i % cols * rows + i / cols] == x[i]), "{rows}x{cols}");
        }
    }

    #[test]
    fn sums_keep_small_addends() {
        let mut x = vec![1e-4_f32; 10_001];
        x[0] = 1e4;
        assert_eq!(sum(&x), 10_001.0);
        assert_eq!(sum(&[]), 0.0);
    }
}
