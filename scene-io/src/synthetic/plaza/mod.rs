//! A square with a monument, under many suns, photographed by many cameras, with people walking through.
//!
//! Everything is matt. What reaches a camera from a surface is, in linear light,
//!
//! ```text
//! radiance = albedo * (sky + sun * max(0, n . to_sun) * sunlit)
//! ```
//!
//! and the sky itself where a ray leaves the square; light bounces no further. A photo is
//! `srgb(mean radiance of the pixel * gain * white_balance)`, clipped at 1. So albedo, normals, light, shadows and the
//! people in front are known exactly, for any camera under any light.

mod light;
mod photo;

pub use light::Light;
pub use photo::{PasserBy, Photo, PhotoTruth};

use super::shape::{Placed, Shape};
use super::surface::{Paint, to_byte, to_srgb};
use crate::options::TrainPhotos;
use crate::priors::{TrackPoint, TruthMask};
use crate::random::random;
use crate::{Bounds, Dialect, Frame, ImageSource, LayoutHint, Point, Scene, Split, Truth};
use glam::{DMat3, DVec2, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;

/// Shadow rays start this far from the surface.
const LIFT: f64 = 1e-7;
/// What photographers aim at: the middle of the monument.
const CENTRE: DVec3 = DVec3::new(0.0, 0.0, 0.8);

/// Size, number and seed of the photos of [`plaza`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlazaOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Training photos.
    pub train: usize,
    /// Held-out views: nobody in the way, neutral light, exposure 1.
    pub test: usize,
    /// Varies colours, cameras, light and people.
    pub seed: u64,
    /// Rays of a pixel along each side: the square of it in all.
    pub rays: u32,
    /// Whether training photos have light, exposure and people of their own, or are as clean as the held-out views.
    pub photos: TrainPhotos,
}

impl Default for PlazaOptions {
    /// 48 training photos and 6 held-out views of 192 x 144 pixels, 3 x 3 rays each.
    fn default() -> Self {
        Self { width: 192, height: 144, train: 48, test: 6, seed: 0, rays: 3, photos: TrainPhotos::Clutter }
    }
}

/// The square: z is up, the ground lies at `z = 0`; a monument 1.9 high in the middle, lamps, benches, houses all round
/// between 5 and 7 from the middle.
#[derive(Clone, Debug)]
pub struct Plaza {
    things: Vec<(Placed, Paint)>,
}

/// Where a ray first meets the square or somebody on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlazaHit {
    /// Distance along the ray, world units.
    pub t: f64,
    /// Outward unit normal.
    pub normal: DVec3,
    /// Colour of the surface without light, linear RGB.
    pub albedo: DVec3,
    /// Whether the sun is seen from there: above the surface, and nothing in between.
    pub sunlit: bool,
    /// Whether it is a passer-by.
    pub passer_by: bool,
}

impl Plaza {
    /// The square of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let colour = |index: u64, r: f64, g: f64, b: f64| {
            let jitter = |k: u64| 0.1 * (random(seed, 5_000 + 3 * index + k) - 0.5);
            (DVec3::new(r, g, b) + DVec3::new(jitter(0), jitter(1), jitter(2)))
                .clamp(DVec3::splat(0.03), DVec3::splat(0.8))
        };
        let checker = |a, b, size| Paint::Checker { colours: [a, b], size };
        let wave = |a, b, k| Paint::Wave { colours: [a, b], k };
        let thing = |shape, turn: f64, c, paint| (Placed { shape, r: DMat3::from_rotation_z(turn), c }, paint);
        let block = |x, y, z| Shape::Block { half: DVec3::new(x, y, z) };
        let mut things = vec![
            thing(
                block(9.0, 9.0, 0.05),
                0.0,
                DVec3::new(0.0, 0.0, -0.05),
                checker(colour(0, 0.46, 0.43, 0.40), colour(1, 0.34, 0.33, 0.33), 0.75),
            ),
            // The monument: a step, a plinth, a column, a ring about it and a ball on top.
            thing(
                block(0.80, 0.80, 0.10),
                0.3,
                DVec3::new(0.0, 0.0, 0.10),
                checker(colour(2, 0.60, 0.56, 0.48), colour(3, 0.46, 0.42, 0.36), 0.37),
            ),
            thing(
                block(0.42, 0.42, 0.30),
                0.3,
                DVec3::new(0.0, 0.0, 0.50),
                checker(colour(4, 0.55, 0.30, 0.22), colour(5, 0.66, 0.56, 0.40), 0.23),
            ),
            thing(
                Shape::Cylinder { radius: 0.20, half_height: 0.35 },
                0.0,
                DVec3::new(0.0, 0.0, 1.15),
                wave(colour(6, 0.30, 0.42, 0.36), colour(7, 0.55, 0.62, 0.50), DVec3::new(9.0, 5.0, 12.0)),
            ),
            thing(
                Shape::Torus { ring: 0.33, tube: 0.07 },
                0.0,
                DVec3::new(0.0, 0.0, 1.05),
                wave(colour(8, 0.70, 0.52, 0.16), colour(9, 0.50, 0.34, 0.10), DVec3::new(8.0, 8.0, 0.0)),
            ),
            thing(
                Shape::Sphere { radius: 0.24 },
                0.0,
                DVec3::new(0.0, 0.0, 1.68),
                wave(colour(10, 0.22, 0.34, 0.58), colour(11, 0.62, 0.66, 0.70), DVec3::new(5.0, 11.0, 7.0)),
            ),
        ];
        for i in 0..4_u32 {
            let around = DVec2::from_angle(TAU * (0.125 + 0.25 * f64::from(i)));
            let (lamp, bench) = (around * 1.9, around.perp() * 1.7);
            let index = 20 + 4 * u64::from(i);
            things.push(thing(
                Shape::Cylinder { radius: 0.05, half_height: 0.60 },
                0.0,
                lamp.extend(0.60),
                wave(colour(index, 0.16, 0.18, 0.20), colour(index + 1, 0.30, 0.32, 0.34), DVec3::new(0.0, 0.0, 9.0)),
            ));
            things.push(thing(
                block(0.32, 0.13, 0.14),
                around.to_angle(),
                bench.extend(0.14),
                wave(
                    colour(index + 2, 0.50, 0.32, 0.18),
                    colour(index + 3, 0.36, 0.22, 0.12),
                    DVec3::new(9.0, 4.0, 0.0),
                ),
            ));
        }
        for i in 0..10_u32 {
            let turn = TAU * f64::from(i) / 10.0;
            let index = 40 + 5 * u64::from(i);
            let height = 0.9 + 0.9 * random(seed, 6_000 + u64::from(i));
            let hue = |k: u64| 0.35 + 0.35 * random(seed, 6_100 + 3 * u64::from(i) + k);
            let wall = colour(index, hue(0), hue(1), hue(2));
            things.push(thing(
                block(0.6, 1.7, height),
                turn,
                (DVec2::from_angle(turn) * 6.0).extend(height),
                checker(wall, wall * 0.6, 0.47),
            ));
        }
        Self { things }
    }

    /// A box that holds everything but the ground's outer parts.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(-7.0, -7.0, -0.1), max: DVec3::new(7.0, 7.0, 3.6) }
    }

    /// Is a point inside a thing of the square?
    #[must_use]
    pub fn contains(&self, x: DVec3) -> bool {
        self.things.iter().any(|(placed, _)| placed.contains(x))
    }

    /// Where a ray first meets a surface, passers-by of the photo included, and whether the photo's sun shines there.
    #[must_use]
    pub fn trace(&self, ray: &Ray, photo: &Photo) -> Option<PlazaHit> {
        let still = self.things.iter().map(|(placed, paint)| (placed, paint, false));
        let walking = photo.passers_by.iter().flat_map(PasserBy::parts).map(|(placed, paint)| (placed, paint, true));
        let hits = still.chain(walking).filter_map(|(placed, paint, passer_by)| {
            placed.hit(ray, 0.0).map(|(t, normal, local)| (t, normal, local, paint, passer_by))
        });
        let (t, normal, local, paint, passer_by) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let to_sun = Ray { o: ray.at(t) + normal * LIFT, d: photo.light.to_sun };
        let sunlit = normal.dot(to_sun.d) > 0.0
            && !self.things.iter().any(|(placed, _)| placed.hit(&to_sun, 0.0).is_some())
            && !photo.passers_by.iter().flat_map(PasserBy::parts).any(|(p, _)| p.hit(&to_sun, 0.0).is_some());
        Some(PlazaHit { t, normal, albedo: paint.at(local), sunlit, passer_by })
    }

    /// Surface points as a structure-from-motion program would find them: seen in two photos or more, never on a
    /// passer-by. And for each photo where it sees them.
    fn points(&self, photos: &[Photo], seed: u64) -> (Vec<Point>, Vec<Vec<TrackPoint>>) {
        const TRIES: u64 = 500;
        let (mut points, mut tracks) = (Vec::new(), vec![Vec::new(); photos.len()]);
        let training: Vec<usize> = (0..photos.len()).filter(|i| photos[*i].split == Split::Train).collect();
        if training.is_empty() {
            return (points, tracks);
        }
        for i in 0..TRIES {
            let draw = |k: u64| random(seed, 20_000 + 3 * i + k);
            let photo = &photos[training[i as usize % training.len()]];
            let (w, h) = (f64::from(photo.camera.width), f64::from(photo.camera.height));
            let Some(ray) = photo.camera.ray(DVec2::new(draw(0) * w, draw(1) * h)) else { continue };
            let Some(hit) = self.trace(&ray, photo).filter(|hit| !hit.passer_by) else { continue };
            let x = ray.at(hit.t);
            let seen: Vec<(usize, DVec2)> =
                training.iter().filter_map(|k| self.sees(&photos[*k], x).map(|pixel| (*k, pixel))).collect();
            if seen.len() < 2 {
                continue;
            }
            let (point, length) = (points.len() as u32, seen.len() as u32);
            points.push(Point { xyz: x, rgb: to_srgb(hit.albedo).to_array().map(to_byte) });
            for (k, pixel) in seen {
                tracks[k].push(TrackPoint { pixel: [pixel.x as f32, pixel.y as f32], length, point });
            }
        }
        (points, tracks)
    }

    /// Where a photo shows a surface point, if nothing is in front of it.
    fn sees(&self, photo: &Photo, x: DVec3) -> Option<DVec2> {
        let camera = &photo.camera;
        let pixel = camera.project(x)?;
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        if !(0.0..w).contains(&pixel.x) || !(0.0..h).contains(&pixel.y) {
            return None;
        }
        let away = x - camera.pose.c;
        let ray = Ray { o: camera.pose.c, d: away.normalize() };
        let first = self.trace(&ray, photo)?;
        ((first.t - away.length()).abs() < 1e-6).then_some(pixel)
    }
}

/// The photos of the scene of some options, training photos first: who took them, in which light, with whom in front.
#[must_use]
pub fn plaza_photos(options: &PlazaOptions) -> Vec<Photo> {
    let train = (0..options.train).map(|i| {
        let camera = camera(Split::Train, i, options);
        match options.photos {
            TrainPhotos::Clutter => Photo::drawn(camera, i, options.seed),
            TrainPhotos::Clean => Photo::neutral(camera, Split::Train),
        }
    });
    let test = (0..options.test).map(|i| Photo::neutral(camera(Split::Test, i, options), Split::Test));
    train.chain(test).collect()
}

/// Cameras all round at the height of eyes and windows: view `i` of a split.
fn camera(split: Split, i: usize, options: &PlazaOptions) -> Camera {
    let (n, offset, stream) = match split {
        // Half a step between training photos, so that test views are new.
        Split::Test => (options.test, 0.5 / options.train.max(1) as f64, 9_000),
        _ => (options.train, 0.0, 8_000),
    };
    let draw = |k: u64| random(options.seed, stream + 8 * i as u64 + k);
    // Training photos fill the ranges, test views keep off their ends.
    let range = |k: u64, low: f64, high: f64| {
        let inner = if split == Split::Test { 0.25 + 0.5 * draw(k) } else { draw(k) };
        low + (high - low) * inner
    };
    let turn = TAU * ((i as f64 + 0.2 * (draw(0) - 0.5)) / n as f64 + offset);
    let eye = (DVec2::from_angle(turn) * range(1, 2.9, 3.9)).extend(range(2, 0.7, 1.9));
    let aim = CENTRE + DVec3::new(range(3, -0.2, 0.2), range(4, -0.2, 0.2), range(5, -0.1, 0.1));
    let (w, h) = (f64::from(options.width), f64::from(options.height));
    let focal = range(6, 0.85, 1.15) * w.max(h);
    // Never `None`: the eye is at least 2 units away, and not above.
    let pose = Pose::look_at(eye, aim, DVec3::Z).unwrap_or(Pose::IDENTITY);
    Camera::pinhole(options.width, options.height, focal, focal, 0.5 * w, 0.5 * h, pose)
}

/// Photos of the square with their cameras, truth masks of the passers-by, and points with tracks.
///
/// # Panics
/// If `options.rays` is 0.
#[must_use]
pub fn plaza(options: &PlazaOptions) -> Scene {
    let square = Plaza::new(options.seed);
    let photos = plaza_photos(options);
    let (points, tracks) = square.points(&photos, options.seed);
    let mut counts = [0; 2];
    let frames = photos.iter().zip(tracks).map(|(photo, tracks)| {
        let number = &mut counts[usize::from(photo.split == Split::Test)];
        let name = format!("{}/{number:03}", photo.split.name());
        *number += 1;
        let (image, occluder) = square.render(photo, options.rays);
        let transient = (photo.split == Split::Train).then(|| TruthMask::Memory(Arc::new(occluder)));
        let image = ImageSource::Memory(Arc::new(image));
        let truth = Truth { transient, ..Truth::default() };
        Frame { split: photo.split, truth, tracks, ..Frame::new(name, image, photo.camera) }
    });
    Scene {
        name: "plaza".into(),
        root: PathBuf::new(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points,
        layout: LayoutHint::Unbounded,
        bounds: Some(square.bounds()),
        notes: Vec::new(),
    }
}

#[cfg(test)]
mod tests;
