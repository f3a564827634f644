//! Exact flow from a frame to another.

use crate::bit_mask::BitMask;
use crate::picture::with_mask;
use crate::priors::{Flow, FlowPlace, FlowTruth};
use crate::{ErrorKind, Frame, Problem, SceneError, Size, npy};
use std::path::PathBuf;

impl Frame {
    /// Where another frame truly shows what this one does, and which one that is; `None` where it is not known.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or does not fit the photo.
    pub fn read_flow(&self) -> Result<Option<(Flow, &str)>, SceneError> {
        let Some(FlowTruth { to, place }) = &self.truth.flow else { return Ok(None) };
        let flow = match place {
            FlowPlace::Memory(flow) => Flow::clone(flow),
            FlowPlace::Files { flow, valid } => self.decode_flow(flow, valid).map_err(|e| e.in_frame(&self.name))?,
        };
        Ok(Some((flow, to)))
    }

    fn decode_flow(&self, flow: &PathBuf, valid: &PathBuf) -> Result<Flow, SceneError> {
        let photo = self.size();
        let Size { width, height } = photo;
        let refuse = |path: &PathBuf, what: String| {
            let remedy =
                "give one flow vector (x, y) and one pixel of the mask for each pixel of the photo, or remove both";
            SceneError::new(ErrorKind::Value, Problem::new(path, what, remedy))
        };
        let way: Vec<[f32; 2]> = npy::with(flow, 4, |array| {
            if array.shape != [height as usize, width as usize, 2] {
                let what = format!("has the shape {:?} and its photo {photo} pixels", array.shape);
                return Err(refuse(flow, what));
            }
            Ok(array.data.as_chunks::<2>().0.iter().map(|way| way.map(|x| x as f32)).collect())
        })?;
        let (seen, is) = with_mask(valid, |grey, is| (BitMask::from_grey(is.width, is.height, &grey), is))?;
        if is != photo {
            return Err(refuse(valid, format!("is {is} and its photo {photo}")));
        }
        let bad = (0..way.len())
            .find(|&k| seen.get(k as u32 % width, k as u32 / width) && way[k].iter().any(|x| !x.is_finite()));
        match bad {
            Some(k) => {
                let (column, row) = (k as u32 % width, k as u32 / width);
                Err(refuse(flow, format!("has no finite flow vector at pixel ({column}, {row}), which counts as seen")))
            }
            None => Ok(Flow { width, height, vectors: way, seen }),
        }
    }
}
