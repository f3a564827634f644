//! Undistortion. Gaussians are drawn by pinhole cameras: photos of lenses that bend light are resampled onto the plane of one before
//! training, and pictures of such lenses from it after rendering.

use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::{Camera, Lens, Pose, Prepared};
use scene_io::Image;

/// Directions whose tangent to the axis is more than this are on no plane of a reasonable size.
const STEEPEST: f64 = 4.0;
/// Pixels of the plane to one of the picture along each side, so that resampling it costs no sharpness,
const FINER: f64 = 2.0;
/// and no side longer than this.
const LONGEST: f64 = 8192.0;

/// The plane of a pinhole camera that photos of a lens are resampled onto.
#[derive(Debug)]
pub(super) struct UndistortedPlane {
    lens: Camera,
    plane: Camera,
    /// Where in the photo each pixel of the plane is, pixels; NaN where it is not.
    sources: Vec<[f32; 2]>,
}

/// Where in the photo of a lens a place on its plane is, pixels; `None` where it is not.
pub(crate) fn source(seen: &Prepared, plane: &Camera, at: DVec2) -> Option<DVec2> {
    let tangent = (at - DVec2::new(plane.cx, plane.cy)) / DVec2::new(plane.fx, plane.fy);
    seen.project_from_camera(tangent.extend(1.0))
}

impl UndistortedPlane {
    /// The plane has the photo's size and focal lengths.
    pub(super) fn new(camera: &Camera) -> Self {
        let lens = Camera { pose: Pose::IDENTITY, ..*camera };
        let plane = Camera { lens: Lens::PINHOLE, ..lens };
        let (seen, w) = (lens.prepare(), plane.width as usize);
        let sources = (0..w * plane.height as usize)
            .into_par_iter()
            .map(|i| {
                let at = DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
                source(&seen, &plane, at).map_or([f32::NAN; 2], |p| [p.x as f32, p.y as f32])
            })
            .collect();
        Self { lens, plane, sources }
    }

    /// Whether this is the lens of a camera.
    pub(super) fn is_of(&self, camera: &Camera) -> bool {
        self.lens.same_optics(camera)
    }

    /// The plane, standing where the camera stands.
    pub(super) fn camera(&self, camera: &Camera) -> Camera {
        Camera { pose: camera.pose, ..self.plane }
    }

    /// A photo resampled onto the plane; what it does not show is masked.
    pub(super) fn photo(&self, image: &Image) -> Image {
        let channels = usize::from(image.channels);
        let (w, h) = (image.width as usize, image.height as usize);
        let mut data = vec![0; self.sources.len() * channels];
        let mut mask = vec![0; self.sources.len()];
        data.par_chunks_exact_mut(channels).zip(&mut mask).zip(&self.sources).for_each(|((out, used), &[x, y])| {
            // Half a pixel beyond the outermost centres there is nothing to interpolate.
            if !(x >= 0.5 && y >= 0.5 && x <= w as f32 - 0.5 && y <= h as f32 - 0.5) {
                return;
            }
            // Numbers of rows above 2^24 are rounded.
            let nearest = (y as usize).min(h - 1) * w + (x as usize).min(w - 1);
            if image.mask.as_ref().is_some_and(|m| m[nearest] < 128) {
                return;
            }
            *used = 255;
            cubic(image, [x, y], out);
        });
        Image { width: self.plane.width, height: self.plane.height, channels: image.channels, data, mask: Some(mask) }
    }
}

/// Catmull and Rom's cubic through four pixels along each axis: sharper than a linear one, and exact at centres. Colours count as
/// much as they are opaque: what is behind an edge's transparent side is the colour of nothing.
fn cubic(image: &Image, at: [f32; 2], out: &mut [u8]) {
    let channels = usize::from(image.channels);
    let weights = |at: f32| {
        let f = at - at.floor();
        let (f2, f3) = (f * f, f * f * f);
        [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, 0.5 * (f3 - f2)]
    };
    let [x, y] = at.map(|x| x - 0.5);
    let (wx, wy) = (weights(x), weights(y));
    let (left, top) = (x.floor() as i64 - 1, y.floor() as i64 - 1);
    let inside = |at: i64, n: u32| at.clamp(0, i64::from(n) - 1) as usize;
    let mut sums = [0.0_f32; 4];
    for (j, wy) in (0..).zip(wy) {
        let row = inside(top + j, image.height) * image.width as usize;
        for (i, wx) in (0..).zip(wx) {
            let p = &image.data[(row + inside(left + i, image.width)) * channels..][..channels];
            let alpha = p.get(3).map_or(1.0, |&a| f32::from(a));
            for (sum, &c) in sums.iter_mut().zip(&p[..3]) {
                *sum += wx * wy * alpha * f32::from(c);
            }
            sums[3] += wx * wy * alpha;
        }
    }
    // The cubic overshoots: with hardly any alpha there is hardly any colour.
    let opaque = if sums[3] > 0.5 { 1.0 / sums[3] } else { 0.0 };
    for (out, sum) in out.iter_mut().zip(sums.map(|sum| sum * opaque).into_iter().take(3).chain([sums[3]])) {
        *out = (sum + 0.5).clamp(0.0, 255.0) as u8;
    }
}

/// A plane large enough for all that a lens sees, and where each pixel of the picture is on it.
#[derive(Debug)]
pub(super) struct DistortedPicture {
    /// The plane, standing where the camera stands.
    pub(super) camera: Camera,
    /// How many of its pixels there are to one of the picture, along each side.
    pub(super) finer: f64,
    /// Pixels of the plane; NaN where the lens has no ray, or a steep one.
    pub(super) places: Vec<[f32; 2]>,
}

impl DistortedPicture {
    pub(super) fn new(camera: &Camera) -> Self {
        let (prepared, w) = (Camera { pose: Pose::IDENTITY, ..*camera }.prepare(), camera.width as usize);
        let tangents: Vec<Option<DVec2>> = (0..w * camera.height as usize)
            .into_par_iter()
            .map(|i| {
                let d = prepared.direction(DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5))?.normalize();
                let tangent = (d / d.z).truncate();
                (d.z > 0.0 && tangent.abs().max_element() <= STEEPEST).then_some(tangent)
            })
            .collect();
        let far =
            tangents.iter().flatten().fold([DVec2::MAX, DVec2::MIN], |[low, high], s| [low.min(*s), high.max(*s)]);
        let [low, high] = if far[0].x <= far[1].x { far } else { [DVec2::ZERO; 2] };
        let f = DVec2::new(camera.fx, camera.fy);
        let finer = FINER.min(LONGEST / ((high - low) * f).max_element().max(1.0));
        let f = f * finer;
        // A pixel more on each side, for interpolation.
        let corner = low * f - 1.0;
        let size = ((high - low) * f + 2.0).ceil();
        let camera = Camera {
            width: size.x as u32,
            height: size.y as u32,
            fx: f.x,
            fy: f.y,
            cx: -corner.x,
            cy: -corner.y,
            lens: Lens::PINHOLE,
            ..*camera
        };
        let places = tangents.iter().map(|s| {
            s.map_or([f32::NAN; 2], |s| {
                let at = s * f - corner;
                [at.x as f32, at.y as f32]
            })
        });
        Self { camera, finer, places: places.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bent() -> Camera {
        let lens = Lens::Perspective { k: [0.1, -0.05, 0.0, 0.0, 0.0, 0.0], p: [1e-3, -2e-3] };
        Camera { lens, ..Camera::pinhole(60, 40, 50.0, 52.0, 30.5, 19.0, Pose::IDENTITY) }
    }

    #[test]
    fn a_photo_of_a_ramp_is_a_ramp_on_the_plane() {
        let camera = bent();
        // Grey grows with the tangent of the ray, so that on the plane it grows along the columns.
        let prepared = camera.prepare();
        let grey = |x: u32, y: u32| {
            let d = prepared.direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
            (128.0 + 150.0 * d.x / d.z).round().clamp(0.0, 255.0) as u8
        };
        let data = (0..40).flat_map(|y| (0..60).flat_map(move |x| [(x, y); 3])).map(|(x, y)| grey(x, y)).collect();
        let flat = UndistortedPlane::new(&camera).photo(&Image::rgb(60, 40, data).unwrap());
        let mask = flat.mask.as_ref().unwrap();
        let mut seen = 0;
        for (i, p) in flat.data.chunks_exact(3).enumerate().filter(|(i, _)| mask[*i] > 0) {
            let want = 128.0 + 150.0 * ((i % 60) as f64 + 0.5 - 30.5) / 50.0;
            assert!((f64::from(p[0]) - want).abs() < 1.6, "pixel {i}: {} for {want}", p[0]);
            seen += 1;
        }
        assert!(seen > 2000, "{seen}");
    }

    #[test]
    fn a_photo_s_edge_to_nothing_keeps_its_colour_on_the_plane() {
        let data = (0..60 * 40).flat_map(|i| if i % 60 < 50 { [200, 100, 50, 255] } else { [0; 4] }).collect();
        let flat = UndistortedPlane::new(&bent()).photo(&Image::rgba(60, 40, data).unwrap());
        let (mut edge, mut clear) = (0, 0);
        for p in flat.data.chunks_exact(4).zip(flat.mask.as_ref().unwrap()).filter(|(_, m)| **m > 0).map(|(p, _)| p) {
            if p[3] > 0 {
                edge += usize::from(p[3] < 250);
                assert!((0..3).all(|c| p[c].abs_diff([200, 100, 50][c]) <= 1), "{p:?}");
            } else {
                clear += 1;
            }
        }
        assert!(edge > 20 && clear > 200, "{edge} at the edge, {clear} clear");
    }

    #[test]
    fn every_pixel_of_a_lens_is_on_its_plane() {
        let camera = bent();
        let picture = DistortedPicture::new(&camera);
        let prepared = camera.prepare();
        let plane = Camera { pose: Pose::IDENTITY, ..picture.camera };
        for (i, &[x, y]) in picture.places.iter().enumerate() {
            assert!(x >= 0.5 && y >= 0.5 && x + 0.5 <= plane.width as f32 && y + 0.5 <= plane.height as f32);
            let want = prepared.direction(DVec2::new((i % 60) as f64 + 0.5, (i / 60) as f64 + 0.5)).unwrap();
            let got = plane.direction_in_camera(DVec2::new(f64::from(x), f64::from(y))).unwrap();
            assert!((want.normalize() - got.normalize()).length() < 1e-6);
        }
    }
}
