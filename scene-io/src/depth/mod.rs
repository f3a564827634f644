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
mod resample;

use crate::picture::same_shape;
use crate::{ErrorKind, Frame, Problem, SceneError};
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
    /// In a file, decoded when asked for: `.npy`, `.png`, `.exr`; see the table above.
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
    fn path(&self) -> &Path {
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

/// A depth file as it is, in its own unit and meaning.
pub(crate) fn read_file(path: &Path) -> Result<DepthMap, SceneError> {
    decode::read(path)
}

/// Holes are 0 in a map that was read; maps made by hand may hold anything.
fn is_known(z: f32) -> bool {
    z.is_finite() && z > 0.0
}

impl Frame {
    /// The frame's depth at the map's own size, as z in world units whatever the file holds ([`DepthSource::unit`],
    /// [`DepthMeaning`]); `None` where there is none. Holes, numbers that are not finite, and negative ones are 0.
    ///
    /// # Errors
    /// Names the file that cannot be decoded, is not a picture of depths, or has another shape than the photo.
    pub fn read_depth(&self) -> Result<Option<DepthMap>, SceneError> {
        let Some(source) = &self.depth else { return Ok(None) };
        let map = match &source.place {
            DepthPlace::Memory(map) => DepthMap::clone(map),
            DepthPlace::File(path) => decode::read(path).map_err(|e| e.in_frame(&self.name))?,
        };
        let (width, height) = (map.width, map.height);
        let refuse = |what: String, remedy: &str| {
            let problem = Problem::new(source.path(), what, remedy).frame(&self.name);
            Err(SceneError::new(ErrorKind::Image, problem))
        };
        let Some(mut map) = DepthMap::new(width, height, map.z) else {
            return refuse(format!("does not hold {width} x {height} depths"), "make it anew");
        };
        let photo = (self.camera.width, self.camera.height);
        if !same_shape((width, height), photo) {
            let what = format!("the depth map is {width}x{height} and its photo {}x{}", photo.0, photo.1);
            return refuse(what, "make it as large as the photo, or remove it");
        }
        for z in &mut map.z {
            let depth = (f64::from(*z) * source.unit) as f32;
            *z = if is_known(depth) { depth } else { 0.0 };
        }
        Ok(Some(match source.meaning {
            DepthMeaning::Z => map,
            DepthMeaning::Distance => map.z_from_distance(&self.camera),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImageSource;
    use crate::picture::Image;
    use glam::{DMat3, DVec3};
    use render_core::camera::Pose;

    fn frame(map: DepthMap) -> Frame {
        let pose = Pose { r: DMat3::from_rotation_y(0.3), c: DVec3::new(1.0, 2.0, 3.0) };
        let image = Image::rgb(8, 6, vec![0; 144]).unwrap();
        let camera = Camera::pinhole(8, 6, 5.0, 6.0, 4.2, 2.9, pose);
        let mut frame = Frame::new("a", ImageSource::Memory(Arc::new(image)), camera);
        frame.depth = Some(DepthSource::memory(map));
        frame
    }

    #[test]
    fn units_and_holes_are_applied_to_maps_in_memory_too() {
        let mut z = vec![4.0; 48];
        (z[0], z[1], z[2], z[3]) = (0.0, f32::NAN, -1.0, f32::INFINITY);
        let mut frame = frame(DepthMap::new(8, 6, z).unwrap());
        frame.depth.as_mut().unwrap().unit = 0.5;
        let map = frame.read_depth().unwrap().unwrap();
        assert_eq!(map.z[..5], [0.0, 0.0, 0.0, 0.0, 2.0]);
        assert_eq!((map.holes(), map.range()), (4, Some([2.0, 2.0])));
        assert_eq!(DepthMap::new(2, 1, vec![0.0; 2]).unwrap().range(), None);
    }

    #[test]
    fn distances_become_depths_of_the_same_points() {
        // Every pixel sees the plane z = 2 before the camera, at half the photo's size.
        let camera = frame(DepthMap::new(8, 6, vec![1.0; 48]).unwrap()).camera.resized(4, 3);
        let pixel = |i: usize| DVec2::new((i % 4) as f64 + 0.5, (i / 4) as f64 + 0.5);
        let distance = (0..12).map(|i| (2.0 / camera.direction_in_camera(pixel(i)).unwrap().z) as f32);
        let mut frame = frame(DepthMap::new(4, 3, distance.collect()).unwrap());
        frame.depth.as_mut().unwrap().meaning = DepthMeaning::Distance;
        let map = frame.read_depth().unwrap().unwrap();
        assert!(map.z.iter().all(|z| (z - 2.0).abs() < 1e-6), "{:?}", map.z);
    }

    #[test]
    fn maps_of_another_shape_are_refused() {
        let error = frame(DepthMap::new(6, 8, vec![1.0; 48]).unwrap()).read_depth().unwrap_err().to_string();
        assert!(error.contains("frame `a`") && error.contains("the depth map is 6x8 and its photo 8x6"), "{error}");
        let error = frame(DepthMap { width: 8, height: 6, z: vec![1.0; 47] }).read_depth().unwrap_err().to_string();
        assert!(error.contains("does not hold 8 x 6 depths"), "{error}");
    }
}
