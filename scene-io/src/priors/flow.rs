//! Truth about where the points of a photo are in another one, for scoring.

use super::bits::{BitMask, nearest};
use crate::picture::decode_mask;
use crate::{ErrorKind, Frame, Problem, SceneError, npy};
use std::path::PathBuf;
use std::sync::Arc;

/// Exact flow from one frame to another. For scoring; nothing that trains may look at it.
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
        /// The way of each pixel.
        flow: PathBuf,
        /// Where it is valid.
        valid: PathBuf,
    },
    /// Known already, at the photo's native size.
    Memory(Arc<Flow>),
}

/// Where another picture shows what this one shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]`, the way from a pixel's centre, pixels of the other picture's size: x to the right, y down.
    pub way: Vec<[f32; 2]>,
    /// Whether the other picture truly shows it: within its borders, and nothing in front.
    pub seen: BitMask,
}

impl Flow {
    /// The same for pictures of another size, both of them: a pixel has the way of the one that its centre falls into, and
    /// ends where that one does.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let scale = [f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height)];
        let way = |x: u32, y: u32| {
            let from = [nearest(x, width, self.width), nearest(y, height, self.height)];
            let way = self.way[from[1] as usize * self.width as usize + from[0] as usize];
            let axis = |a: usize, to: u32| {
                ((f64::from(from[a]) + 0.5 + f64::from(way[a])) * scale[a] - (f64::from(to) + 0.5)) as f32
            };
            [axis(0, x), axis(1, y)]
        };
        Self {
            width,
            height,
            way: (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| way(x, y)).collect(),
            seen: self.seen.resized(width, height),
        }
    }
}

impl Frame {
    /// Where another frame truly shows what this one does, and which one that is; `None` where it is not known.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or does not fit the photo.
    pub fn read_flow(&self) -> Result<Option<(Flow, &str)>, SceneError> {
        let Some(FlowTruth { to, place }) = &self.flow else { return Ok(None) };
        let flow = match place {
            FlowPlace::Memory(flow) => Flow::clone(flow),
            FlowPlace::Files { flow, valid } => self.decode_flow(flow, valid).map_err(|e| e.in_frame(&self.name))?,
        };
        Ok(Some((flow, to)))
    }

    fn decode_flow(&self, flow: &PathBuf, valid: &PathBuf) -> Result<Flow, SceneError> {
        let (width, height) = self.size();
        let refuse = |path: &PathBuf, what: String| {
            let remedy = "give one way (x, y) and one pixel of the mask for each pixel of the photo, or remove both";
            SceneError::new(ErrorKind::Value, Problem::new(path, what, remedy))
        };
        let array = npy::read(flow)?;
        if array.shape != [height as usize, width as usize, 2] {
            return Err(refuse(flow, format!("has the shape {:?} and its photo {width}x{height} pixels", array.shape)));
        }
        let (grey, (w, h)) = decode_mask(valid)?;
        if (w, h) != (width, height) {
            return Err(refuse(valid, format!("is {w}x{h} and its photo {width}x{height}")));
        }
        let seen = BitMask::from_grey(width, height, &grey);
        let way: Vec<[f32; 2]> = array.data.as_chunks::<2>().0.iter().map(|way| way.map(|x| x as f32)).collect();
        let bad = (0..way.len())
            .find(|&k| seen.get(k as u32 % width, k as u32 / width) && way[k].iter().any(|x| !x.is_finite()));
        match bad {
            Some(k) => {
                let (column, row) = (k as u32 % width, k as u32 / width);
                Err(refuse(flow, format!("has no finite way at pixel ({column}, {row}), which counts as seen")))
            }
            None => Ok(Flow { width, height, way, seen }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flow_of_another_size_ends_at_the_same_places() {
        let way = (0..8).map(|k| [k as f32, 1.0 - k as f32]).collect();
        let flow = Flow { width: 4, height: 2, way, seen: BitMask::from_fn(4, 2, |x, _| x > 1) };
        assert_eq!(flow.resized(4, 2), flow);
        let half = flow.resized(2, 1);
        // Pixel (0, 0) takes (1, 1), whose way is (5, -4): it ends at (6.5, -2.5), here (3.25, -1.25).
        assert_eq!(half.way[0], [2.75, -1.75]);
        assert!(!half.seen.get(0, 0) && half.seen.get(1, 0));
        let double = flow.resized(8, 4);
        assert_eq!(double.way[0], [0.5, 2.5]);
        assert_eq!(double.way[1], [-0.5, 2.5]);
    }
}
