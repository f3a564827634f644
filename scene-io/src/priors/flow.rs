//! Truth about where the points of a photo are in another one, for scoring.

use crate::bit_mask::BitMask;
use std::path::PathBuf;
use std::sync::Arc;

/// Exact flow from one frame to another. For scoring; nothing that trains may read it.
///
/// Read from `flow_path` (`.npy`, `height x width x 2`), `flow_valid_path` (white = truly seen there) and `flow_to` (a
/// frame's name) of a frame in any `transforms*.json`.
#[derive(Clone, Debug)]
pub struct FlowTruth {
    /// Name of the frame it goes to.
    pub to: String,
    /// Where the numbers are.
    pub place: FlowPlace,
}

/// Where a flow is.
#[derive(Clone, Debug)]
pub enum FlowPlace {
    /// In two files.
    Files {
        /// Flow vector of each pixel.
        flow: PathBuf,
        /// Where it is valid.
        valid: PathBuf,
    },
    /// Known already, at the photo's native size.
    Memory(Arc<Flow>),
}

/// Where another picture shows what this one shows: exactly known, or as another program sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]`, flow vector: from a pixel's centre, pixels of the other picture's size, x to the right, y down.
    pub vectors: Vec<[f32; 2]>,
    /// Whether the other picture truly shows it: within its borders, and nothing in front.
    pub seen: BitMask,
}

/// Largest distance between the flow vectors of the pixels that make one of a smaller picture and their mean, its pixels: more is
/// an edge.
const EDGE: f64 = 2.0;

impl Flow {
    /// The same for pictures of another size, both of them: a pixel has the mean flow vector of those that it covers. It counts
    /// as seen where all of them are seen and have the same vector: at an edge it is not known which side it shows.
    ///
    /// # Panics
    /// If `vectors` or `seen` is smaller than the size says.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let (way, seen): (Vec<_>, Vec<_>) = places.map(|(x, y)| self.mean_way([x, y], [width, height])).unzip();
        let seen = BitMask::from_fn(width, height, |x, y| seen[y as usize * width as usize + x as usize]);
        Self { width, height, vectors: way, seen }
    }

    /// Flow vector of pixel `at` of a picture of size `to`, and whether it is seen.
    fn mean_way(&self, at: [u32; 2], to: [u32; 2]) -> ([f32; 2], bool) {
        let size = [self.width, self.height];
        let span = |a: usize| {
            let edge = |i: u32| u64::from(i) * u64::from(size[a]);
            (edge(at[a]) / u64::from(to[a])) as u32..edge(at[a] + 1).div_ceil(u64::from(to[a])) as u32
        };
        let covered = span(1).flat_map(|y| span(0).map(move |x| (x, y)));
        let scale = [0, 1].map(|a| f64::from(to[a]) / f64::from(size[a]));
        let way = |(x, y): (u32, u32)| {
            let way = self.vectors[y as usize * self.width as usize + x as usize];
            [0, 1].map(|a| f64::from(way[a]) * scale[a])
        };
        let n = covered.clone().count().max(1) as f64;
        let mean = [0, 1].map(|a| covered.clone().map(|pixel| way(pixel)[a]).sum::<f64>() / n);
        let together = |pixel| {
            let [x, y] = way(pixel);
            (x - mean[0]).hypot(y - mean[1]) <= EDGE
        };
        let seen = covered.clone().all(|(x, y)| self.seen.get(x, y) && together((x, y)));
        (mean.map(|x| x as f32), seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_flow_is_seen_where_all_of_a_pixel_goes_one_way() {
        let way = (0..8).map(|k| if k % 4 < 2 { [2.0, -1.0] } else { [f32::from(k as u8) * 9.0, 0.0] }).collect();
        let flow = Flow { width: 4, height: 2, vectors: way, seen: BitMask::from_fn(4, 2, |_, _| true) };
        assert_eq!(flow.resized(4, 2), flow);
        let half = flow.resized(2, 1);
        assert_eq!(half.vectors[0], [1.0, -0.5]);
        assert!(half.seen.get(0, 0) && !half.seen.get(1, 0), "the right half is an edge");
        let hidden = Flow { seen: BitMask::from_fn(4, 2, |x, y| (x, y) != (0, 1)), ..flow.clone() };
        assert!(!hidden.resized(2, 1).seen.get(0, 0));
        let double = flow.resized(8, 4);
        assert_eq!((double.vectors[0], double.vectors[3]), ([4.0, -2.0], [4.0, -2.0]));
        assert!(double.seen.get(7, 3));
    }
}
