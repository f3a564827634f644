//! A sparse model with tracks, in COLMAP's text format.

use crate::error::PrepareError;
use crate::stage::fresh_folder;
use glam::DVec3;
use render_core::camera::Pose;
use scene_io::Size;
use scene_io::export::write_atomically;
use std::fmt::Write as _;
use std::path::Path;

/// A reconstruction. Cameras, images and points are told by where they stand in their list.
#[derive(Clone, Debug, Default)]
pub(crate) struct SparseModel {
    pub(crate) cameras: Vec<SparseCamera>,
    pub(crate) images: Vec<SparseImage>,
    pub(crate) points: Vec<SparsePoint>,
}

/// Two focal lengths and two radial coefficients; pixels count from the corner of the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SparseCamera {
    pub(crate) size: Size,
    pub(crate) focal: [f64; 2],
    pub(crate) centre: [f64; 2],
    pub(crate) k: [f64; 2],
}

#[derive(Clone, Debug)]
pub(crate) struct SparseImage {
    pub(crate) name: String,
    pub(crate) camera: usize,
    pub(crate) pose: Pose,
    /// Where points are seen, and which.
    pub(crate) seen: Vec<([f64; 2], usize)>,
}

#[derive(Clone, Debug)]
pub(crate) struct SparsePoint {
    pub(crate) xyz: DVec3,
    pub(crate) rgb: [u8; 3],
    /// Mean reprojection error, pixels.
    pub(crate) error: f64,
    /// Image, and place in what it sees.
    pub(crate) track: Vec<(usize, usize)>,
}

impl SparseModel {
    /// Makes what images see point at the points again, after some were taken out: tracks are what counts.
    pub(crate) fn renumber(&mut self) {
        let mut seen: Vec<Vec<([f64; 2], usize)>> = vec![Vec::new(); self.images.len()];
        for (point, found) in self.points.iter_mut().enumerate() {
            for (image, place) in &mut found.track {
                let (pixel, _) = self.images[*image].seen[*place];
                *place = seen[*image].len();
                seen[*image].push((pixel, point));
            }
        }
        for (image, seen) in self.images.iter_mut().zip(seen) {
            image.seen = seen;
        }
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt` in place of any model in the folder.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), PrepareError> {
        fresh_folder(folder)?;
        // Writing to a string does not fail. The shortest form of a number reads back exactly.
        let mut cameras = String::from("# CAMERA_ID OPENCV WIDTH HEIGHT FX FY CX CY K1 K2 P1 P2\n");
        for (i, SparseCamera { size, focal, centre, k }) in self.cameras.iter().enumerate() {
            let [fx, fy] = focal;
            let ([cx, cy], [k1, k2]) = (centre, k);
            let _ =
                writeln!(cameras, "{} OPENCV {} {} {fx} {fy} {cx} {cy} {k1} {k2} 0 0", i + 1, size.width, size.height);
        }
        let mut images =
            String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then X Y POINT3D_ID of all points\n");
        for (i, image) in self.images.iter().enumerate() {
            let ([w, x, y, z], [tx, ty, tz]) = image.pose.to_colmap();
            let _ = writeln!(images, "{} {w} {x} {y} {z} {tx} {ty} {tz} {} {}", i + 1, image.camera + 1, image.name);
            let seen: Vec<String> = image.seen.iter().map(|([x, y], point)| format!("{x} {y} {}", point + 1)).collect();
            let _ = writeln!(images, "{}", seen.join(" "));
        }
        let mut points = String::from("# POINT3D_ID X Y Z R G B ERROR, then IMAGE_ID POINT2D_IDX of all photos\n");
        for (i, SparsePoint { xyz, rgb: [r, g, b], error, track }) in self.points.iter().enumerate() {
            let _ = write!(points, "{} {} {} {} {r} {g} {b} {error}", i + 1, xyz.x, xyz.y, xyz.z);
            for (image, place) in track {
                let _ = write!(points, " {} {place}", image + 1);
            }
            points.push('\n');
        }
        for (name, text) in [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)] {
            write_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::colmap::Model;

    #[test]
    fn a_model_reads_back_with_its_tracks() {
        let pose = |x| Pose::look_at(DVec3::new(x, 0.0, -4.0), DVec3::ZERO, DVec3::NEG_Y).unwrap();
        let image = |name: &str, x| SparseImage { name: name.into(), camera: 0, pose: pose(x), seen: Vec::new() };
        let point = |x| SparsePoint { xyz: DVec3::new(x, 0.5, 0.0), rgb: [1, 2, 3], error: 0.5, track: Vec::new() };
        let mut model = SparseModel {
            cameras: vec![SparseCamera {
                size: Size::new(40, 30),
                focal: [50.0, 51.0],
                centre: [20.0, 15.0],
                k: [0.1, -0.2],
            }],
            images: vec![image("a.jpg", 0.0), image("b.jpg", 1.0)],
            points: vec![point(0.0), point(1.0), point(2.0)],
        };
        for (p, i) in [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1)] {
            model.points[p].track.push((i, model.images[i].seen.len()));
            model.images[i].seen.push(([p as f64 + 0.25, i as f64], p));
        }
        model.points.retain(|p| p.track.len() > 1);
        model.renumber();
        let folder = tempfile::tempdir().unwrap();
        model.write(folder.path()).unwrap();
        let read = Model::read(folder.path()).unwrap();
        assert_eq!((read.images.len(), read.points.len(), read.cameras[&1].fy), (2, 2, 51.0));
        assert_eq!(read.images[0].point_ids, [1, 2]);
        assert_eq!(read.images[1].pixels, [[1.25, 1.0], [2.25, 1.0]]);
        assert!((read.images[1].pose.c - DVec3::new(1.0, 0.0, -4.0)).length() < 1e-12);
        assert_eq!(read.points[&2].xyz.x, 2.0);
    }
}
