//! The reference photo: made small and square, with the camera that took it, and how far away is what it shows.

use crate::buffers::shapes_hold;
use crate::views::{SeenDepth, SeenPhoto};
use field_core::conv::{Extent, Size, adaptive_mean};
use splat_core::View;

/// Numbers of a camera.
pub(crate) const CAMERA: usize = 12;
/// Smallest part of a photo, along each side.
const SMALLEST_PART: f32 = 0.5;

/// A photo as it is encoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Reference {
    /// `[3][side][side]`, `2 srgb - 1`: the means of rectangles, of their pixels that count. Grey (0) where none does.
    pub(crate) pixels: Vec<f32>,
    /// `[side][side]`, depths `z` of what the cloud shows at the pixels' centres, internal units; 0 where nothing is known. Empty for
    /// an appearance that reads no depths.
    pub(crate) depth: Vec<f32>,
    /// The camera: see [`camera_rows`]. All 0 where it is not known.
    pub(crate) camera: [f32; CAMERA],
}

/// A camera as three rows `a b c d`: each takes a point of the clouds' frame to `a x + b y + c z + d`. The third is the depth; the
/// first two divided by it are the place on the photo, 0 to 1 along each side.
pub(crate) fn camera_rows(view: &View) -> [f32; CAMERA] {
    let mut rows = [0.0; CAMERA];
    let row = |i: usize| [view.r[i][0], view.r[i][1], view.r[i][2], view.t[i]];
    let depth = row(2);
    for axis in 0..2 {
        let pixels = view.size[axis].max(1) as f32;
        let own = row(axis);
        for k in 0..4 {
            rows[4 * axis + k] = (view.f[axis] * own[k] + view.c[axis] * depth[k]) / pixels;
        }
    }
    rows[8..].copy_from_slice(&depth);
    rows
}

/// A part of a photo: its first and its last column, then row, the last not included.
type Part = [[usize; 2]; 2];

impl Reference {
    /// All of a photo; `None` where there is no pixel.
    pub(crate) fn of(photo: &SeenPhoto<'_>, side: usize) -> Option<Self> {
        Self::of_part(photo, side, photo.size.map(|n| [0, n]))
    }

    /// A part of a photo: of each side a half or more, `u` uniform numbers for its size and place.
    pub(crate) fn of_some_part(photo: &SeenPhoto<'_>, side: usize, u: [f32; 4]) -> Option<Self> {
        let cut = |n: usize, size: f32, at: f32| {
            let share = SMALLEST_PART + (1.0 - SMALLEST_PART) * size;
            let part = ((n as f32 * share) as usize).clamp(1.min(n), n);
            let first = (((n - part + 1) as f32 * at) as usize).min(n - part);
            [first, first + part]
        };
        Self::of_part(photo, side, [cut(photo.size[0], u[0], u[1]), cut(photo.size[1], u[2], u[3])])
    }

    fn of_part(photo: &SeenPhoto<'_>, side: usize, part: Part) -> Option<Self> {
        let [width, height] = part.map(|[first, end]| end - first);
        if width == 0 || height == 0 {
            return None;
        }
        let all = photo.size[0] * photo.size[1];
        let size = Size::one(height, width);
        let places = (part[1][0]..part[1][1]).flat_map(|y| (part[0][0]..part[0][1]).map(move |x| [x, y]));
        let places: Vec<usize> = places.map(|[x, y]| y * photo.size[0] + x).collect();
        let counts = |i: usize| photo.weights.is_none_or(|weights| weights[i] > 0.0);
        let around = |x: f32| if x.is_finite() { 2.0 * x.clamp(0.0, 1.0) - 1.0 } else { 0.0 };
        let planes = photo.colour.chunks_exact(all).take(3);
        let colours: Vec<f32> =
            planes.flat_map(|plane| places.iter().map(|&i| if counts(i) { around(plane[i]) } else { 0.0 })).collect();
        let mut pixels = vec![0.0; 3 * side * side];
        shapes_hold(adaptive_mean(&colours, 3, size, Extent::new(side, side), &mut pixels));
        if photo.weights.is_some() {
            // Means of the pixels that count.
            let used: Vec<f32> = places.iter().map(|&i| f32::from(u8::from(counts(i)))).collect();
            let mut shares = vec![0.0; side * side];
            shapes_hold(adaptive_mean(&used, 1, size, Extent::new(side, side), &mut shares));
            for plane in pixels.chunks_exact_mut(side * side) {
                let each = plane.iter_mut().zip(&shares).filter(|(_, share)| **share > 0.0);
                each.for_each(|(x, share)| *x /= share);
            }
        }
        let mut camera = photo.view.map_or([0.0; CAMERA], camera_rows);
        for (axis, [first, end]) in part.into_iter().enumerate() {
            let [first, end] = [first, end].map(|x| x as f32 / photo.size[axis] as f32);
            for k in 0..4 {
                camera[4 * axis + k] = (camera[4 * axis + k] - first * camera[8 + k]) / (end - first);
            }
        }
        Some(Self { pixels, depth: depth_of(photo, side, part), camera })
    }

    /// The photo without its camera, and so without places.
    pub(crate) fn without_place(self) -> Self {
        Self { depth: Vec::new(), camera: [0.0; CAMERA], ..self }
    }
}

/// Depths at the centres of the pixels of a part of a photo.
fn depth_of(photo: &SeenPhoto<'_>, side: usize, part: Part) -> Vec<f32> {
    let Some(SeenDepth { size, z }) = photo.depth else { return Vec::new() };
    let at = |axis: usize, i: usize| {
        let [first, end] = part[axis].map(|x| x as f32);
        let place = (first + (i as f32 + 0.5) / side as f32 * (end - first)) / photo.size[axis] as f32;
        ((place * size[axis] as f32) as usize).min(size[axis].saturating_sub(1))
    };
    let pixels = (0..side).flat_map(|y| (0..side).map(move |x| [x, y]));
    pixels.map(|[x, y]| z.get(at(1, y) * size[0] + at(0, x)).copied().unwrap_or(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [12, 8];

    fn view() -> View {
        let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
        View { r: turned, t: [0.1, -0.2, 3.0], f: [11.0, 10.0], c: [6.5, 3.5], size: SIZE }
    }

    fn place(camera: &[f32; CAMERA], p: [f32; 3]) -> [f32; 3] {
        let row = |k: usize| camera[k] * p[0] + camera[k + 1] * p[1] + camera[k + 2] * p[2] + camera[k + 3];
        [row(0) / row(8), row(4) / row(8), row(8)]
    }

    #[test]
    fn rows_of_a_camera_project_as_the_camera_does() {
        let (view, p) = (view(), [0.3, -0.1, 0.5]);
        let rows = camera_rows(&view);
        let x: Vec<f32> = (0..3).map(|i| (0..3).map(|k| view.r[i][k] * p[k]).sum::<f32>() + view.t[i]).collect();
        let want = [(11.0 * x[0] / x[2] + 6.5) / 12.0, (10.0 * x[1] / x[2] + 3.5) / 8.0, x[2]];
        let got = place(&rows, p);
        assert!(got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5), "{got:?} {want:?}");
    }

    #[test]
    fn a_part_is_seen_by_a_camera_of_its_own() {
        let view = view();
        let colour: Vec<f32> = (0..3 * 96).map(|i| (i % 12) as f32 / 12.0).collect();
        let photo = SeenPhoto { size: SIZE, colour: &colour, weights: None, view: Some(&view), depth: None };
        let part = Reference::of_part(&photo, 4, [[6, 12], [2, 6]]).unwrap();
        // Its columns 6 to 11, as they are; the mean of one and a half of them each.
        let shown: Vec<f32> = part.pixels[..4].iter().map(|x| 12.0 * (x + 1.0) / 2.0).collect();
        assert!((shown[0] - 6.5).abs() < 1e-4 && (shown[3] - 10.5).abs() < 1e-4, "{shown:?}");
        let p = [0.5, 0.1, 0.2];
        let ([u, v, _], [x, y, _]) = (place(&camera_rows(&view), p), place(&part.camera, p));
        assert!((x - (u * 12.0 - 6.0) / 6.0).abs() < 1e-5 && (y - (v * 8.0 - 2.0) / 4.0).abs() < 1e-5);
        // Depths of the whole photo, each column another.
        let z: Vec<f32> = (0..6 * 4).map(|i| (i % 6) as f32).collect();
        let depth = Some(SeenDepth { size: [6, 4], z: &z });
        let part = Reference::of_part(&SeenPhoto { depth, ..photo }, 4, [[6, 12], [2, 6]]).unwrap();
        assert_eq!(part.depth[..4], [3.0, 4.0, 4.0, 5.0]);
        assert!(part.without_place().depth.is_empty());
        for u in [[0.0; 4], [0.999; 4], [0.5, 0.0, 0.2, 0.9]] {
            let some = Reference::of_some_part(&photo, 4, u).unwrap();
            assert!(some.pixels.iter().all(|x| (-1.0..=1.0).contains(x)));
        }
    }

    #[test]
    fn small_photos_what_does_not_count_and_what_is_no_number() {
        let colour = [1.0, 0.0, f32::NAN];
        let one = SeenPhoto { size: [1, 1], colour: &colour, weights: None, view: None, depth: None };
        let small = Reference::of(&one, 16).unwrap();
        assert_eq!(small.pixels, [[1.0; 256], [-1.0; 256], [0.0; 256]].concat());
        assert_eq!(small.camera, [0.0; CAMERA]);
        let none = SeenPhoto { weights: Some(&[0.0]), ..one };
        assert!(Reference::of(&none, 16).unwrap().pixels.iter().all(|x| *x == 0.0));
        assert!(Reference::of(&SeenPhoto { size: [0, 4], colour: &[], ..one }, 16).is_none());
    }
}
