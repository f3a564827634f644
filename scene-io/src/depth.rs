//! Depth maps: what a stereo camera, a lidar or a renderer says about how far things are.

use crate::{ErrorKind, Frame, Problem, SceneError, npy};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Distances of what a photo shows.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height][width]`, z depth (along the optical axis) in world units; 0 where it is not known.
    pub z: Vec<f32>,
}

/// A depth map and what its numbers mean.
#[derive(Clone, Debug)]
pub struct DepthSource {
    /// Where the numbers are.
    pub place: DepthPlace,
    /// World units of a depth of 1 in the file.
    pub unit: f64,
    /// What is measured.
    pub meaning: DepthMeaning,
}

/// Where the numbers of a depth map are.
#[derive(Clone, Debug)]
pub enum DepthPlace {
    /// In a file, decoded when asked for: `.npy`, 16-bit `.png`, `.exr`.
    File(PathBuf),
    /// In memory already.
    Memory(Arc<DepthMap>),
}

/// What the numbers of a depth map measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthMeaning {
    /// Along the optical axis.
    #[default]
    Z,
    /// Along the ray.
    Distance,
}

impl DepthSource {
    /// A file of z depths in world units.
    #[must_use]
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self { place: DepthPlace::File(path.into()), unit: 1.0, meaning: DepthMeaning::Z }
    }

    /// A map in memory.
    #[must_use]
    pub fn memory(map: DepthMap) -> Self {
        Self { place: DepthPlace::Memory(Arc::new(map)), unit: 1.0, meaning: DepthMeaning::Z }
    }
}

impl Frame {
    /// The frame's depth at its own size; `None` where there is none. Holes, numbers that are not finite, and negative ones
    /// are 0.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or is no picture of depths.
    pub fn read_depth(&self) -> Result<Option<DepthMap>, SceneError> {
        let Some(source) = &self.depth else { return Ok(None) };
        match &source.place {
            DepthPlace::Memory(map) => Ok(Some(DepthMap::clone(map))),
            DepthPlace::File(path) => {
                let mut map = read(path).map_err(|e| e.in_frame(&self.name))?;
                for z in &mut map.z {
                    let depth = f64::from(*z) * source.unit;
                    *z = if depth.is_finite() && depth > 0.0 { depth as f32 } else { 0.0 };
                }
                Ok(Some(map))
            }
        }
    }
}

fn read(path: &Path) -> Result<DepthMap, SceneError> {
    let array = npy::read(path)?;
    let &[height, width] = array.shape.as_slice() else {
        let what = format!("has {} dimensions, a depth map has two", array.shape.len());
        return Err(SceneError::new(ErrorKind::Format, Problem::new(path, what, "save it as [height][width]")));
    };
    Ok(DepthMap { width: width as u32, height: height as u32, z: array.data.iter().map(|&z| z as f32).collect() })
}
