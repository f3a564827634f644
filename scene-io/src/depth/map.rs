//! A depth map in memory, and where one is.

use glam::DVec2;
use render_core::camera::Camera;
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
    /// In a file, decoded when asked for: `.npy`, `.png`, `.exr`; see the table of the module.
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

    /// The same numbers in units of `unit` world units each.
    #[must_use]
    pub fn in_units_of(mut self, unit: f64) -> Self {
        self.unit = unit;
        self
    }

    /// The file, for messages.
    pub(crate) fn path(&self) -> &Path {
        match &self.place {
            DepthPlace::File(path) => path,
            DepthPlace::Memory(_) => Path::new("depth in memory"),
        }
    }
}

impl DepthMap {
    /// A map of z depths; `None` if `z` does not hold `width * height` values.
    #[must_use]
    pub fn new(width: u32, height: u32, z: Vec<f32>) -> Option<Self> {
        (z.len() as u64 == u64::from(width) * u64::from(height)).then_some(Self { width, height, z })
    }

    /// Number of pixels whose depth is not known.
    #[must_use]
    pub fn holes(&self) -> usize {
        self.z.iter().filter(|z| !is_known(**z)).count()
    }

    /// Smallest and largest depth that is known; `None` where none is.
    #[must_use]
    pub fn range(&self) -> Option<[f32; 2]> {
        let known = self.z.iter().copied().filter(|z| is_known(*z));
        known.fold(None, |range, z| {
            let [low, high] = range.unwrap_or([z, z]);
            Some([z.min(low), z.max(high)])
        })
    }

    /// Distances along the rays of a camera to depths along its optical axis: `z = distance * cos(angle to the axis)`. The
    /// camera is taken at the map's size. Pixels without a ray, or with one that leads backwards, become holes.
    #[must_use]
    pub fn z_from_distance(mut self, camera: &Camera) -> Self {
        let camera = camera.resized(self.width, self.height).prepare();
        let width = self.width.max(1) as usize;
        for (i, z) in self.z.iter_mut().enumerate() {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let cosine = camera.direction(pixel).map_or(0.0, |d| d.z);
            // Below 1e-6 the ray runs along the image plane, and z means nothing.
            *z = if cosine > 1e-6 { (f64::from(*z) * cosine) as f32 } else { 0.0 };
        }
        self
    }
}

/// Holes are 0 in a map that was read; maps made by hand may hold anything.
pub(crate) fn is_known(z: f32) -> bool {
    z.is_finite() && z > 0.0
}
