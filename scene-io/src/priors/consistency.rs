//! Flow that comes back: where flow to another picture and flow from there agree.

use super::flow::Flow;
use crate::bit_mask::BitMask;

impl Flow {
    /// The same, valid only where the flow of the other picture leads back: for files without a mask (`.flo`). `None` where the two
    /// are of different sizes.
    ///
    /// With `f` the vector of a pixel and `b` that of the other picture where it leads to (bilinear between pixel centres), it is kept
    /// where `|f + b| < (|f| + |b|) / 2 + 1/2` pixels. What leads out of the picture, or to where `back` is not valid, is not.
    ///
    /// Source: Li et al., "Neural scene flow fields", 2021, and Gao et al., "Dynamic view synthesis from dynamic monocular video",
    /// 2021, released code.
    ///
    /// # Panics
    /// If `vectors` or `seen` of either is smaller than the size says.
    #[must_use]
    pub fn consistent_with(&self, back: &Self) -> Option<Self> {
        if (self.width, self.height) != (back.width, back.height) {
            return None;
        }
        let comes_back = |x: u32, y: u32| {
            let [fx, fy] = self.vectors[y as usize * self.width as usize + x as usize].map(f64::from);
            let Some([bx, by]) = back.between(f64::from(x) + fx, f64::from(y) + fy) else { return false };
            (fx + bx).hypot(fy + by) < 0.5 * (fx.hypot(fy) + bx.hypot(by)) + 0.5
        };
        let seen = BitMask::from_fn(self.width, self.height, |x, y| self.seen.get(x, y) && comes_back(x, y));
        Some(Self { seen, ..self.clone() })
    }

    /// The vector at a place in pixels from the centre of the first pixel; `None` outside of the centres, and where a pixel that
    /// counts is not valid.
    fn between(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let (across, share_x) = around(x, self.width)?;
        let (down, share_y) = around(y, self.height)?;
        let mut mean = [0.0; 2];
        for (row, share_y) in down.into_iter().zip(share_y) {
            for (column, share_x) in across.into_iter().zip(share_x) {
                let share = share_x * share_y;
                if share == 0.0 {
                    continue;
                }
                if !self.seen.get(column, row) {
                    return None;
                }
                let vector = self.vectors[row as usize * self.width as usize + column as usize];
                mean = [0, 1].map(|a| mean[a] + share * f64::from(vector[a]));
            }
        }
        Some(mean)
    }
}

/// The two of `n` centres around a place, the first one being at 0, and the share of each; `None` outside of them.
fn around(at: f64, n: u32) -> Option<([u32; 2], [f64; 2])> {
    // False for NaN as well.
    let inside = at >= 0.0 && at <= f64::from(n) - 1.0;
    if !inside {
        return None;
    }
    let low = at as u32;
    let share = at - f64::from(low);
    Some(([low, (low + 1).min(n - 1)], [1.0 - share, share]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow(vector: impl Fn(u32, u32) -> [f32; 2]) -> Flow {
        let vectors = (0..6).flat_map(|y| (0..8).map(move |x| (x, y))).map(|(x, y)| vector(x, y)).collect();
        Flow { width: 8, height: 6, vectors, seen: BitMask::from_fn(8, 6, |_, _| true) }
    }

    #[test]
    fn what_comes_back_is_kept_and_what_leaves_the_picture_is_not() {
        let (there, back) = (flow(|_, _| [2.0, -1.0]), flow(|_, _| [-2.0, 1.0]));
        let kept = there.consistent_with(&back).unwrap();
        assert_eq!(kept.vectors, there.vectors);
        assert!(kept.seen == BitMask::from_fn(8, 6, |x, y| x < 6 && y > 0), "{:?}", kept.seen);
        // Whole pixels need their one neighbour only, halves both.
        let hidden = Flow { seen: BitMask::from_fn(8, 6, |x, _| x != 4), ..back };
        let kept = there.consistent_with(&hidden).unwrap();
        assert_eq!([1, 2, 3].map(|x| kept.seen.get(x, 2)), [true, false, true]);
        let half = flow(|_, _| [1.5, 0.0]).consistent_with(&hidden).unwrap();
        assert_eq!([1, 2, 3, 4].map(|x| half.seen.get(x, 2)), [true, false, false, true]);
    }

    #[test]
    fn what_is_hidden_in_the_other_picture_does_not_come_back() {
        // The left half moves 4 to the right and hides what stands still there.
        let there = flow(|x, _| if x < 4 { [4.0, 0.0] } else { [0.0; 2] });
        let back = flow(|x, _| if x < 4 { [0.0; 2] } else { [-4.0, 0.0] });
        let kept = there.consistent_with(&back).unwrap();
        assert!(kept.seen == BitMask::from_fn(8, 6, |x, _| x < 4), "{:?}", kept.seen);
        let other = Flow { width: 6, height: 8, ..there.clone() };
        assert_eq!(there.consistent_with(&other), None);
        let lost = flow(|_, _| [f32::NAN, 0.0]);
        assert_eq!(lost.consistent_with(&back).unwrap().seen.count(), 0);
    }
}
