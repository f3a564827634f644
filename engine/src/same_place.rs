//! Whether what photos mark stands at one place in space.
//!
//! Each photo marks squares of its own. A ray through a marked square is followed from near to far: where at some depth most of
//! the other photos that have this place in the picture mark it too, the marks are of one thing, and that thing is part of the
//! scene. Marks of occluders, each in one photo, meet nowhere. This is the visual hull of the marks (Laurentini, 1994), found by
//! votes: it needs no depth, so that it works where a field knows nothing of the thing.
//!
//! Where everything that photos mark lies in the middle of them, hulls meet there whatever it is. So where colours are given,
//! some of those photos must show the same colour at that place, as those do that see a surface from its side (photo-consistency
//! of Kutulakos and Seitz, 2000); things of a photo's own have colours of their own.

use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Pose, Prepared};
use render_core::rig::{focus_point, mean_centre, rms_distance};
use std::ops::Range;

/// Depths along a ray, evenly in disparity.
const DEPTHS: usize = 40;
/// Between these shares of the distance to what the cameras look at.
const NEAREST: f64 = 0.2;
const FARTHEST: f64 = 12.0;
/// Where all cameras look the same way: that distance, in units of how far they stand apart.
const PARALLEL: f64 = 10.0;
/// Photos that have to have a place in the picture before it says anything.
const LEAST: u32 = 4;
/// Photos that are asked at most.
const ASKED: usize = 32;
/// Photos that have to show the same colour, and their share of those that have the place in the picture.
const LEAST_ALIKE: u32 = 3;
const ALIKE: f64 = 0.15;

/// The marks of one photo.
pub struct Marks {
    /// Index of the frame: views of one frame at several scales are one photo.
    pub frame: usize,
    /// Camera of the photo the squares are of.
    pub camera: Camera,
    /// Pixels along a side of a square.
    pub stride: f64,
    /// Squares in a row.
    pub width: usize,
    /// Which squares are marked, row by row.
    pub marks: Vec<bool>,
    /// The colour of each square in an appearance that all photos share; empty where places alone count.
    pub colours: Vec<[f32; 3]>,
    /// Whether it is asked about the others' marks.
    pub votes: bool,
}

impl Marks {
    fn height(&self) -> usize {
        self.marks.len().checked_div(self.width).unwrap_or(0)
    }

    /// The square at a pixel, and whether it is marked, or one beside it, as depths and squares are coarse; `None` outside of
    /// the picture.
    fn at(&self, pixel: DVec2) -> Option<(usize, bool)> {
        let (w, h) = (f64::from(self.camera.width), f64::from(self.camera.height));
        if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < w && pixel.y < h) || self.marks.is_empty() {
            return None;
        }
        let square = |x: f64, count: usize| ((x / self.stride) as usize).min(count - 1);
        let (x, y) = (square(pixel.x, self.width), square(pixel.y, self.height()));
        let around = |k: usize, count: usize| k.saturating_sub(1)..(k + 2).min(count);
        let mut rows = around(y, self.height());
        let columns = around(x, self.width);
        let marked = rows.any(|y| self.marks[y * self.width..][..self.width][columns.clone()].contains(&true));
        Some((y * self.width + x, marked))
    }
}

/// Marks of all photos.
pub struct SamePlace {
    photos: Vec<(Marks, Prepared)>,
    /// Colours of one surface differ by so much at most, in each channel.
    same_colour: f32,
    /// Those that are asked.
    asked: Vec<usize>,
    /// Typical distance of what a photo shows, world units, for each.
    distance: Vec<f64>,
}

/// Votes of the other photos about a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Votes {
    /// Photos that have it in the picture.
    seen: u32,
    /// Those that mark it.
    marked: u32,
    /// Those that mark it and show the same colour there.
    alike: u32,
}

impl Votes {
    /// More than half of the photos, and one more, mark the place, and enough of them show the same.
    fn is_scene(self) -> bool {
        self.seen >= LEAST
            && 2 * self.marked >= self.seen + 2
            && self.alike >= LEAST_ALIKE
            && f64::from(self.alike) >= ALIKE * f64::from(self.seen)
    }
}

impl SamePlace {
    /// Photos that have to be there before anything can be said.
    pub const LEAST_PHOTOS: usize = LEAST as usize + 1;

    /// `same_colour`: colours of one surface differ by so much at most, in each channel.
    pub fn new(photos: Vec<Marks>, same_colour: f32) -> Self {
        let poses: Vec<Pose> = photos.iter().map(|p| p.camera.pose).collect();
        let focus = focus_point(&poses).filter(|focus| {
            // What is behind most cameras is not what they look at.
            let before = poses.iter().filter(|p| (*focus - p.c).dot(p.r.z_axis) > 0.0).count();
            2 * before > poses.len()
        });
        let apart = PARALLEL * mean_centre(&poses).map_or(0.0, |centre| rms_distance(&poses, centre));
        let distance =
            poses.iter().map(|p| focus.map_or(apart, |focus| (focus - p.c).length()).max(f64::MIN_POSITIVE)).collect();
        let voters: Vec<usize> = (0..photos.len()).filter(|&i| photos[i].votes).collect();
        let asked = voters.iter().copied().step_by(voters.len().div_ceil(ASKED).max(1)).collect();
        let photos = photos
            .into_iter()
            .map(|p| {
                let prepared = p.camera.prepare();
                (p, prepared)
            })
            .collect();
        Self { photos, same_colour, asked, distance }
    }

    /// Whether most photos mark what a square of a photo shows: at some depth along its ray.
    fn is_scene(&self, photo: usize, x: usize, y: usize) -> bool {
        let (own, prepared) = &self.photos[photo];
        let middle = |k: usize| (k as f64 + 0.5) * own.stride;
        let Some(ray) = prepared.ray(DVec2::new(middle(x), middle(y))) else { return false };
        let colour = own.colours.get(y * own.width + x);
        depths(self.distance[photo]).any(|t| self.votes(own.frame, colour, ray.o + ray.d * t).is_scene())
    }

    /// The votes about a place, of all photos but those of a frame, which shows this colour.
    fn votes(&self, frame: usize, colour: Option<&[f32; 3]>, place: DVec3) -> Votes {
        let mut votes = Votes::default();
        for &i in &self.asked {
            let (photo, prepared) = &self.photos[i];
            let at = if photo.frame == frame { None } else { prepared.project(place).and_then(|p| photo.at(p)) };
            let Some((square, marked)) = at else { continue };
            let alike = match (colour, photo.colours.get(square)) {
                (Some(a), Some(b)) => (0..3).all(|c| (a[c] - b[c]).abs() < self.same_colour),
                _ => true,
            };
            votes.seen += 1;
            votes.marked += u32::from(marked);
            votes.alike += u32::from(marked && alike);
        }
        votes
    }

    /// For each square of a photo that is marked and that most others mark at one place, `true`. Squares are asked about on a
    /// lattice of every second row and column, and each goes with most of those within `REACH` squares: one that others mark by
    /// chance is not enough.
    pub fn shared(&self, photo: usize) -> Vec<bool> {
        let (own, _) = &self.photos[photo];
        let (width, height) = (own.width, own.height());
        let mut asked = vec![0_i8; own.marks.len()];
        for y in (0..height).step_by(2) {
            for x in (0..width).step_by(2).filter(|x| own.marks[y * width + x]) {
                asked[y * width + x] = if self.is_scene(photo, x, y) { 1 } else { -1 };
            }
        }
        let window = |k: usize, count: usize| -> Range<usize> { k.saturating_sub(REACH)..(k + REACH + 1).min(count) };
        (0..own.marks.len())
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let sum = || -> i32 {
                    window(y, height)
                        .map(|y| {
                            asked[y * width..][..width][window(x, width)].iter().map(|v| i32::from(*v)).sum::<i32>()
                        })
                        .sum()
                };
                own.marks[i] && sum() > 0
            })
            .collect()
    }
}

/// Squares to each side that a mark goes with.
const REACH: usize = 3;

/// Distances along a ray, world units.
fn depths(distance: f64) -> impl Iterator<Item = f64> {
    let (first, last) = (1.0 / NEAREST, 1.0 / FARTHEST);
    (0..DEPTHS).map(move |k| distance / (first + (last - first) * k as f64 / (DEPTHS - 1) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 32;

    /// Photos all round a ball of radius 1, marked where `marked(photo, ray passes the ball, x, y)`.
    fn photos(marked: impl Fn(usize, bool, usize, usize) -> bool) -> SamePlace {
        let photos = (0..16).map(|i| {
            let angle = i as f64 * std::f64::consts::TAU / 16.0;
            let eye = DVec3::new(5.0 * angle.cos(), 5.0 * angle.sin(), 1.0 + (i % 3) as f64);
            let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
            let half = f64::from(SIDE) / 2.0;
            let camera = Camera::pinhole(SIDE, SIDE, 2.0 * half, 2.0 * half, half, half, pose);
            let mark = |k: usize| {
                let (x, y) = (k % SIDE as usize, k / SIDE as usize);
                let ray = camera.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).unwrap();
                let ball = (ray.o - ray.d * ray.o.dot(ray.d)).length() < 1.0;
                marked(i, ball, x, y)
            };
            let marks = (0..(SIDE * SIDE) as usize).map(mark).collect();
            let colours = Vec::new();
            Marks { frame: i, camera, stride: 1.0, width: SIDE as usize, marks, colours, votes: true }
        });
        SamePlace::new(photos.collect(), 0.1)
    }

    fn share(photos: &SamePlace, photo: usize) -> f64 {
        let marked = photos.photos[photo].0.marks.iter().filter(|m| **m).count();
        photos.shared(photo).iter().filter(|s| **s).count() as f64 / marked.max(1) as f64
    }

    #[test]
    fn what_all_photos_mark_is_one_thing() {
        let all = photos(|_, ball, _, _| ball);
        assert!((0..16).all(|i| share(&all, i) > 0.95), "{}", share(&all, 0));
        // Also where a third of the photos do not mark it.
        let most = photos(|i, ball, _, _| ball && i % 3 != 0);
        assert!((0..16).filter(|i| i % 3 != 0).all(|i| share(&most, i) > 0.9), "{}", share(&most, 1));
    }

    #[test]
    fn what_each_photo_marks_elsewhere_is_not() {
        // A square somewhere in each photo.
        let passers = photos(|i, _, x, y| {
            let (left, top) = (i * 7 % 24, i * 11 % 24);
            (left..left + 8).contains(&x) && (top..top + 8).contains(&y)
        });
        let most = (0..16).map(|i| share(&passers, i)).fold(0.0, f64::max);
        assert!(most < 0.2, "{most}");
        // The ball is known to be the scene where an occluder stands beside it in one photo.
        let both = photos(|i, ball, x, _| ball || i == 4 && x < 6);
        let shared = both.shared(4);
        assert!((0..SIDE as usize).all(|y| !shared[y * SIDE as usize]), "the passer-by stays marked");
        assert!(shared[16 * SIDE as usize + 16], "the ball does not");
    }

    #[test]
    fn what_covers_the_middle_of_every_photo_has_a_colour_of_its_own_in_each() {
        let with_colours = |colour: fn(usize) -> [f32; 3]| {
            let mut all = photos(|_, ball, _, _| ball);
            for (i, (photo, _)) in all.photos.iter_mut().enumerate() {
                photo.colours = vec![colour(i); photo.marks.len()];
            }
            (0..16).map(|i| share(&all, i)).sum::<f64>() / 16.0
        };
        assert!(with_colours(|i| [0.5 + 0.02 * (i % 3) as f32, 0.4, 0.3]) > 0.95, "one thing, nearly");
        let own = with_colours(|i| [1, 3, 7].map(|k| (i * k * 37 % 16) as f32 / 16.0));
        assert!(own < 0.05, "{own}: another thing in each");
    }

    #[test]
    fn few_photos_and_photos_without_marks_say_nothing() {
        let mut few = photos(|_, ball, _, _| ball);
        few.asked.truncate(LEAST as usize);
        assert_eq!(share(&few, 0), 0.0, "three others are too few");
        assert_eq!(SamePlace::new(Vec::new(), 0.1).photos.len(), 0);
        let none = photos(|_, _, _, _| false);
        assert!(none.shared(0).iter().all(|s| !s) && !none.is_scene(0, 5, 5));
    }

    #[test]
    fn depths_go_from_near_to_far() {
        let t: Vec<f64> = depths(2.0).collect();
        assert!((t[0] - 0.4).abs() < 1e-9 && (t[DEPTHS - 1] - 24.0).abs() < 1e-9, "{t:?}");
        assert!(t.windows(2).all(|w| w[0] < w[1]));
    }
}
