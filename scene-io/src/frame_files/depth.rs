//! Depth of a frame.

use crate::depth::{DepthMap, DepthMeaning, DepthPlace, is_known, read_file};
use crate::picture::same_shape;
use crate::{ErrorKind, Frame, Problem, SceneError, Size};

impl Frame {
    /// The frame's depth at the map's own size, as z in world units whatever the file holds ([`DepthSource::unit`](crate::DepthSource::unit),
    /// [`DepthMeaning`]); `None` where there is none. Holes, numbers that are not finite, and negative ones are 0.
    ///
    /// # Errors
    /// Names the file that cannot be decoded, is not a picture of depths, or has another shape than the photo.
    pub fn read_depth(&self) -> Result<Option<DepthMap>, SceneError> {
        let Some(source) = &self.depth else { return Ok(None) };
        let map = match &source.place {
            DepthPlace::Memory(map) => DepthMap::clone(map),
            DepthPlace::File(path) => read_file(path).map_err(|e| e.in_frame(&self.name))?,
        };
        let (width, height) = (map.width, map.height);
        let refuse = |what: String, remedy: &str| {
            let problem = Problem::new(source.path(), what, remedy).frame(&self.name);
            Err(SceneError::new(ErrorKind::Image, problem))
        };
        let Some(mut map) = DepthMap::new(width, height, map.z) else {
            return refuse(format!("does not hold {width} x {height} depths"), "make it anew");
        };
        let (is, photo) = (Size::new(width, height), self.size());
        if !same_shape(is, photo) {
            let what = format!("the depth map is {is} and its photo {photo}");
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
    use glam::{DMat3, DVec2, DVec3};
    use render_core::camera::{Camera, Pose};
    use std::sync::Arc;

    fn frame(map: DepthMap) -> Frame {
        let pose = Pose { r: DMat3::from_rotation_y(0.3), c: DVec3::new(1.0, 2.0, 3.0) };
        let image = Image::rgb(8, 6, vec![0; 144]).unwrap();
        let camera = Camera::pinhole(8, 6, 5.0, 6.0, 4.2, 2.9, pose);
        let mut frame = Frame::new("a", ImageSource::Memory(Arc::new(image)), camera);
        frame.depth = Some(crate::DepthSource::memory(map));
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
