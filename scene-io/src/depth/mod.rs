//! Depth maps: what a stereo camera, a lidar or a renderer says about how far things are.
//!
//! | file | numbers | unit |
//! | --- | --- | --- |
//! | `.npy`, `[height][width]` (or with a last dimension of 1) | as stored | world units; Nerfies' form: metres or millimetres, by their median |
//! | 16-bit or 8-bit grey `.png` | whole numbers | `transforms*.json`: millimetres, `1e-3`; EndoNeRF: the numbers are the world unit |
//! | `.exr` | channel `Z`, else `Y`, else `R`, else the first | as `.npy` |
//!
//! In memory a depth is always along the optical axis, in world units, and 0 where nothing is known.

mod decode;
mod map;
mod resample;

pub(crate) use decode::read_file;
pub(crate) use map::is_known;
pub use map::{DepthMap, DepthMeaning, DepthPlace, DepthSource};
