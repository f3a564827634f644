//! A histogram whose density is the largest within a window.

use alloc::vec::Vec;

/// Intervals of the dilated histogram of `n` intervals: fenceposts of `n` widened intervals, both ends, and the old ones, less
/// the outermost two.
#[must_use]
pub fn dilated_len(n: usize) -> usize {
    if n == 0 { 0 } else { 3 * n - 2 }
}

/// Memory of [`dilate`].
#[derive(Clone, Debug, Default)]
pub struct DilateScratch {
    posts: Vec<f32>,
    density: Vec<f32>,
    /// Intervals that may be the largest of the window, densities decreasing.
    queue: Vec<u32>,
}

/// Weights whose density at a point is the largest density of the histogram within `half_width` of it, summing to 1 (or to
/// 0 where there is no weight).
///
/// Every interval is widened by `half_width` on both sides; the fenceposts are those of the widened intervals and of the
/// histogram itself, within `[0, 1]`, less the outermost two.
///
/// # Shapes and units
/// * `s` `[n + 1]` fenceposts in `[0, 1]`, non-decreasing; `w` `[n]`, `>= 0`
/// * `out_s` `[dilated_len(n) + 1]`, `out_w` `[dilated_len(n)]`, written
///
/// # Numerics
/// An interval without length has no density: its weight is lost, unless it is all there is. Linear time: fenceposts by a
/// merge of three sorted lists, the window's maximum by a queue of candidates.
///
/// # Panics
/// When the lengths disagree, or `half_width` is negative or NaN.
///
/// # Source
/// Mip-NeRF 360, appendix C.
pub fn dilate(
    s: &[f32],
    w: &[f32],
    half_width: f32,
    out_s: &mut [f32],
    out_w: &mut [f32],
    scratch: &mut DilateScratch,
) {
    let n = w.len();
    assert_eq!(s.len(), n + 1, "fenceposts are one more than weights");
    assert_eq!(out_w.len(), dilated_len(n), "dilated weights");
    assert_eq!(out_s.len(), dilated_len(n) + 1, "dilated fenceposts");
    assert!(half_width >= 0.0, "half width {half_width}");
    if n == 0 {
        return;
    }
    let DilateScratch { posts, density, queue } = scratch;
    density.clear();
    density.extend(w.iter().zip(s.windows(2)).map(|(&w, s)| if s[1] > s[0] { w / (s[1] - s[0]) } else { 0.0 }));

    // Beginnings, ends and old fenceposts are sorted by themselves.
    let from = |i: usize| (s[i] - half_width).clamp(0.0, 1.0);
    let to = |i: usize| (s[i + 1] + half_width).clamp(0.0, 1.0);
    posts.clear();
    let (mut a, mut b, mut c) = (0, 0, 0);
    for _ in 0..3 * n + 1 {
        let next = [
            if a < n { from(a) } else { f32::INFINITY },
            if b < n { to(b) } else { f32::INFINITY },
            if c <= n { s[c] } else { f32::INFINITY },
        ];
        let least = next[0].min(next[1]).min(next[2]);
        if next[0] == least && a < n {
            a += 1;
        } else if next[1] == least && b < n {
            b += 1;
        } else {
            c += 1;
        }
        posts.push(least);
    }

    // The interval from post k on lies inside of the widened intervals from(i) <= post k < to(i): a window that only moves
    // forward.
    out_s.copy_from_slice(&posts[1..3 * n]);
    queue.clear();
    let (mut entered, mut head, mut sum) = (0, 0, 0.0_f64);
    for (k, pair) in posts[..3 * n].windows(2).enumerate() {
        while entered < n && from(entered) <= pair[0] {
            while queue.len() > head && density[queue[queue.len() - 1] as usize] <= density[entered] {
                queue.pop();
            }
            queue.push(entered as u32);
            entered += 1;
        }
        while head < queue.len() && to(queue[head] as usize) <= pair[0] {
            head += 1;
        }
        if k > 0 {
            let largest = if head < queue.len() { density[queue[head] as usize] } else { 0.0 };
            out_w[k - 1] = largest * (pair[1] - pair[0]);
            sum += f64::from(out_w[k - 1]);
        }
    }
    if sum > 0.0 {
        for w in out_w {
            *w = (f64::from(*w) / sum) as f32;
        }
    }
}
