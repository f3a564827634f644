//! One photo of the square: its camera, light, exposure and passers-by, and how it comes out.

use super::light::Light;
use super::{Paint, Placed, Plaza, PlazaHit, Shape};
use crate::bit_mask::BitMask;
use crate::random::random;
use crate::synthetic::surface::to_srgb;
use crate::{Image, Split};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;

/// Somebody on the square: a body and a head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PasserBy {
    body: (Placed, Paint),
    head: (Placed, Paint),
}

impl PasserBy {
    pub(super) fn parts(&self) -> [&(Placed, Paint); 2] {
        [&self.body, &self.head]
    }

    /// Where on the ground they stand.
    #[must_use]
    pub fn place(&self) -> DVec2 {
        self.body.0.c.truncate()
    }

    /// Is a point inside?
    #[must_use]
    pub fn contains(&self, x: DVec3) -> bool {
        self.parts().iter().any(|(placed, _)| placed.contains(x))
    }

    /// Somebody at a place on the ground, `draw(k)` being random numbers.
    fn at(place: DVec2, draw: impl Fn(u64) -> f64) -> Self {
        let tall = 0.9 + 0.3 * draw(0);
        let radius = 0.13 + 0.07 * draw(1);
        let colour = |k: u64| DVec3::new(draw(k), draw(k + 1), draw(k + 2)) * 0.7 + DVec3::splat(0.03);
        let clothes = Paint::Wave { colours: [colour(2), colour(5)], k: DVec3::new(3.0, 0.0, 14.0) };
        let skin = DVec3::new(0.75, 0.52, 0.40) * (0.3 + 0.7 * draw(8));
        let hair = Paint::Wave { colours: [skin, skin * 0.4], k: DVec3::new(4.0, 4.0, 6.0) };
        let part = |shape, z: f64| Placed { shape, r: DMat3::IDENTITY, c: place.extend(z) };
        let head = 0.62 * radius;
        let half_height = 0.5 * (tall - 2.0 * head);
        Self {
            body: (part(Shape::Cylinder { radius, half_height }, half_height), clothes),
            head: (part(Shape::Sphere { radius: head }, tall - head), hair),
        }
    }
}

/// A photo: who takes it, in which light, and how the camera is set.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// The camera.
    pub camera: Camera,
    /// What the photo is for.
    pub split: Split,
    /// Sun and sky.
    pub light: Light,
    /// Exposure: factor of all linear light.
    pub gain: f64,
    /// Factors of red, green and blue in linear light.
    pub white_balance: DVec3,
    /// Who is in the way.
    pub passers_by: Vec<PasserBy>,
}

/// What a photo shows, exactly, at the pixel centres; `[height * width]` values each.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoTruth {
    /// Distance along the ray (not z depth); infinite where the sky is seen.
    pub distance: Vec<f64>,
    /// Outward normals in the world; zero for the sky.
    pub normal: Vec<DVec3>,
    /// Linear RGB without light; zero for the sky.
    pub albedo: Vec<DVec3>,
    /// What falls on the surface, linear RGB; for the sky, what it shows.
    pub light: Vec<DVec3>,
    /// Whether the sun reaches the surface; true for the sky.
    pub sunlit: Vec<bool>,
    /// Pixels whose centre shows a passer-by.
    pub occluder: BitMask,
}

impl Photo {
    /// Nobody in the way, neutral light, exposure and white balance 1.
    #[must_use]
    pub fn neutral(camera: Camera, split: Split) -> Self {
        let (light, white_balance) = (Light::neutral(), DVec3::ONE);
        Self { camera, split, light, gain: 1.0, white_balance, passers_by: Vec::new() }
    }

    /// Training photo `i`: light of its own, gain 0.6 to 1.5, white balance 0.8 to 1.25, one to three people between the
    /// camera and the monument.
    pub(super) fn drawn(camera: Camera, i: usize, seed: u64) -> Self {
        let draw = |k: u64| random(seed, 40_000 + 64 * i as u64 + k);
        // Even on a logarithmic scale.
        let between = |k: u64, low: f64, high: f64| low * (high / low).powf(draw(k));
        let people = 1 + (3.0 * draw(4)) as u64;
        let eye = camera.pose.c.truncate();
        let passers_by = (0..people).map(|p| {
            let draw = |k: u64| draw(8 + 16 * p + k);
            // From 1.2 before the camera to 1.1 before the monument's middle, across a third of the way to either side.
            let away = 1.2 + (eye.length() - 2.3) * draw(0);
            let aside = away * 0.66 * (draw(1) - 0.5);
            let towards = -eye.normalize();
            PasserBy::at(eye + towards * away + towards.perp() * aside, |k| draw(2 + k))
        });
        Self {
            camera,
            split: Split::Train,
            light: Light::drawn(i, seed),
            gain: between(0, 0.6, 1.5),
            white_balance: DVec3::new(between(1, 0.8, 1.25), between(2, 0.95, 1.05), between(3, 0.8, 1.25)),
            passers_by: passers_by.collect(),
        }
    }

    /// Linear light a ray brings: before exposure and white balance.
    fn radiance(&self, hit: Option<&PlazaHit>) -> DVec3 {
        hit.map_or(self.light.sky, |hit| hit.albedo * self.light.on(hit.normal, hit.sunlit))
    }

    /// Linear light to what the photo shows, display-referred sRGB in `[0, 1]`.
    #[must_use]
    pub fn develop(&self, radiance: DVec3) -> DVec3 {
        to_srgb(radiance * self.gain * self.white_balance)
    }
}

impl Plaza {
    /// How a photo comes out, RGB, each pixel from the mean light of `rays * rays` rays on a regular grid; and the pixels
    /// of which any ray met a passer-by.
    ///
    /// # Panics
    /// If `rays` is 0.
    #[must_use]
    pub fn render(&self, photo: &Photo, rays: u32) -> (Image, BitMask) {
        assert!(rays > 0, "a pixel needs at least one ray");
        let camera = &photo.camera;
        let prepared = camera.prepare();
        let step = 1.0 / f64::from(rays);
        let pixel = |column: u32, row: u32| {
            let (mut sum, mut hidden) = (DVec3::ZERO, false);
            for (a, b) in (0..rays).flat_map(|b| (0..rays).map(move |a| (a, b))) {
                let inside = DVec2::new(f64::from(a) + 0.5, f64::from(b) + 0.5) * step;
                let ray = prepared.ray(DVec2::new(f64::from(column), f64::from(row)) + inside);
                let hit = ray.and_then(|ray| self.trace(&ray, photo));
                hidden |= hit.is_some_and(|hit| hit.passer_by);
                sum += photo.radiance(hit.as_ref());
            }
            (photo.develop(sum * (step * step)) * 255.0, hidden)
        };
        let rows: Vec<Vec<(DVec3, bool)>> =
            (0..camera.height).into_par_iter().map(|row| (0..camera.width).map(|c| pixel(c, row)).collect()).collect();
        let flat = rows.iter().flatten();
        let data = flat.flat_map(|(rgb, _)| [rgb.x, rgb.y, rgb.z].map(|v| (v + 0.5) as u8)).collect();
        let hidden = BitMask::from_fn(camera.width, camera.height, |c, r| rows[r as usize][c as usize].1);
        (Image { width: camera.width, height: camera.height, channels: 3, data, mask: None }, hidden)
    }

    /// Exact albedo, normals, light, shadows and passers-by of a photo. For the square without people, empty
    /// [`Photo::passers_by`] first.
    #[must_use]
    pub fn truth(&self, photo: &Photo) -> PhotoTruth {
        let camera = &photo.camera;
        let prepared = camera.prepare();
        let (w, h) = (u64::from(camera.width), u64::from(camera.height));
        let centre = |i: u64| {
            let ray: Option<Ray> = prepared.ray(DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5));
            ray.and_then(|ray| self.trace(&ray, photo))
        };
        let hits: Vec<Option<PlazaHit>> = (0..w * h).into_par_iter().map(centre).collect();
        let each =
            |f: &dyn Fn(&PlazaHit) -> DVec3, sky: DVec3| hits.iter().map(|h| h.as_ref().map_or(sky, f)).collect();
        PhotoTruth {
            distance: hits.iter().map(|h| h.map_or(f64::INFINITY, |h| h.t)).collect(),
            normal: each(&|h| h.normal, DVec3::ZERO),
            albedo: each(&|h| h.albedo, DVec3::ZERO),
            light: each(&|h| photo.light.on(h.normal, h.sunlit), photo.light.sky),
            sunlit: hits.iter().map(|h| h.is_none_or(|h| h.sunlit)).collect(),
            occluder: BitMask::from_fn(camera.width, camera.height, |c, r| {
                hits[(u64::from(r) * w + u64::from(c)) as usize].is_some_and(|h| h.passer_by)
            }),
        }
    }
}
