//! Gaussians of the sky: on a sphere far around the scene, where photos may show it.
//!
//! ```text
//! latitude asin(2 i / (2 M + 1)),  longitude pi (3 - sqrt 5) i,  i = -M .. M       about the scene's vertical axis
//! ```
//!
//! A point is kept where some camera has it in the upper part of its photo, and it lies above the horizon.
//!
//! # Source
//! Kulhanek et al., "WildGaussians: 3D Gaussian Splatting in the Wild", 2024, released code. That they lie above the horizon is asked for
//! here besides.

use super::cloud_frame::CloudFrame;
use super::start::{NewGaussian, round};
use engine::data::Dataset;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Prepared};
use render_core::ray::Ray;
use render_core::rig::up_axis;
use scene_io::SceneError;
use splat_core::density::logit;
use splat_core::{Gaussians, SplatError};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// The sphere is so much larger than the scene.
const FARTHER: f64 = 10.0;
/// Share of the places that the scene reaches as far as.
const WITHIN: f64 = 0.97;
/// The upper part of a photo, of its height.
const UPPER: f64 = 2.0 / 3.0;
/// Photos that are asked, at most.
const PHOTOS: usize = 128;
/// Opacity of all.
const OPACITY: f64 = 0.99;
/// No Gaussian farther from the frame's centre than this is too large, internal units: the sphere is at least twice as far.
pub(super) const FAR: f32 = 5.0;

/// A sphere of points, of the scene's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SkySphere {
    centre: DVec3,
    radius: f64,
    /// The direction that is up, of unit length; `None`: not known.
    up: Option<DVec3>,
    /// Number of points, odd.
    count: usize,
}

/// A point of the sphere, and what photos show there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SkyPoint {
    pub(crate) x: DVec3,
    pub(crate) pixels: Vec<SkyPixel>,
}

/// A place of the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SkyPlace {
    pub(crate) x: DVec3,
    pub(crate) rgb: [f32; 3],
    /// Whether a photo shows nothing before it.
    pub(crate) is_free: bool,
}

/// What a photo shows in the direction of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SkyPixel {
    /// Index of the view.
    pub(crate) view: usize,
    /// Column and row.
    pub(crate) at: [u32; 2],
}

impl SkySphere {
    /// About `count` points around places of a scene, ten times as far as most of them reach, and as the cameras of `frame` do; around the
    /// cameras where there is no place.
    pub(crate) fn around(places: &[DVec3], frame: &CloudFrame, data: &Dataset, count: usize) -> Self {
        let finite = || places.iter().copied().filter(|x| x.is_finite());
        let n = finite().count();
        let centre = match n {
            0 => DVec3::from(frame.centre),
            _ => finite().sum::<DVec3>() / n as f64,
        };
        let mut far: Vec<f64> = finite().map(|x| x.distance(centre)).collect();
        far.sort_unstable_by(f64::total_cmp);
        let reach = far.get((WITHIN * n as f64) as usize).copied().unwrap_or(0.0);
        let poses: Vec<_> = data.views().iter().map(|view| view.camera.pose).collect();
        let radius = FARTHER * reach.max(frame.scale);
        Self { centre, radius, up: up_axis(&poses), count: Self::odd(count) }
    }

    /// The number of points that is taken for `count`.
    pub(crate) fn odd(count: usize) -> usize {
        count / 2 * 2 + 1
    }

    /// How far the scene reaches, or its cameras do; world units.
    pub(crate) fn reach(&self) -> f64 {
        self.radius / FARTHER
    }

    /// Point `i` of `count`.
    fn point(&self, i: usize) -> DVec3 {
        let k = i as f64 - (self.count / 2) as f64;
        let height = 2.0 * k / self.count as f64;
        let turn = PI * (3.0 - 5.0_f64.sqrt()) * k;
        let z = self.up.unwrap_or(DVec3::Z);
        let x = z.any_orthonormal_vector();
        let flat = (1.0 - height * height).max(0.0).sqrt();
        self.centre + self.radius * (flat * (turn.cos() * x + turn.sin() * z.cross(x)) + height * z)
    }

    /// The points that photos may show the sky at, and where.
    pub(crate) fn points(&self, data: &Dataset) -> Vec<SkyPoint> {
        let asked = data.len().min(PHOTOS);
        let views = (0..asked).map(|k| k * data.len() / asked.max(1));
        let cameras: Vec<(usize, Prepared)> = views.map(|view| (view, data.view(view).camera.prepare())).collect();
        let seen = |i: usize| {
            let x = self.point(i);
            if self.up.is_some_and(|up| (x - self.centre).dot(up) < 0.0) {
                return None;
            }
            let pixel = |(view, camera): &(usize, Prepared)| {
                Some(SkyPixel { view: *view, at: upper_pixel(camera.camera(), camera.project(x)?.to_array())? })
            };
            let pixels: Vec<SkyPixel> = cameras.iter().filter_map(pixel).collect();
            (!pixels.is_empty()).then_some(SkyPoint { x, pixels })
        };
        (0..self.count).into_par_iter().filter_map(seen).collect()
    }

    /// Gaussians at points with their colours, of the frame of training: as large as the points are apart. There is room for `most`; of
    /// more points every second, third, ... is taken.
    pub(super) fn gaussians(
        &self,
        places: &[SkyPlace],
        frame: &CloudFrame,
        degree: usize,
        most: usize,
    ) -> Result<Gaussians, SplatError> {
        let apart = self.radius * (4.0 * PI / self.count as f64).sqrt();
        let room = places.len().min(most);
        let place = |k: usize| places[k * places.len() / room];
        let one = |SkyPlace { x, rgb, .. }: SkyPlace| NewGaussian {
            x: frame.to_internal(x).to_array(),
            size: apart / frame.scale,
            rgb,
        };
        let new: Vec<NewGaussian> = (0..room).map(|k| one(place(k))).collect();
        let mut cloud = round(&new, degree)?;
        cloud.logit.fill(logit(OPACITY));
        Ok(cloud)
    }
}

/// Points as photos show them: in the mean colour of those that show nothing before them, as `is_free` says of rays, else of all that have
/// them in the picture.
///
/// # Errors
/// [`SceneError`] for a photo that cannot be read.
pub(crate) fn shown(
    data: &Dataset,
    points: &[SkyPoint],
    is_free: impl Fn(&[Ray]) -> Vec<bool>,
) -> Result<Vec<SkyPlace>, SceneError> {
    // Of all photos, and of those with nothing before it: sums of colours, and how many there are.
    let mut sums = vec![[([0.0_f32; 3], 0.0_f32); 2]; points.len()];
    let mut of_view: BTreeMap<usize, Vec<(usize, [u32; 2])>> = BTreeMap::new();
    for (k, point) in points.iter().enumerate() {
        point.pixels.iter().for_each(|pixel| of_view.entry(pixel.view).or_default().push((k, pixel.at)));
    }
    for (view, pixels) in of_view {
        let (camera, image) = (data.view(view).camera.prepare(), data.image(view)?);
        let ray = |(k, [x, y]): (usize, [u32; 2])| {
            let used = x < image.width && y < image.height && image.is_used(x, y);
            let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).filter(|_| used)?;
            Some(((k, [x, y]), ray))
        };
        let (pixels, rays): (Vec<_>, Vec<_>) = pixels.into_iter().filter_map(ray).unzip();
        for ((k, [x, y]), free) in pixels.into_iter().zip(is_free(&rays)) {
            for (sum, count) in &mut sums[k][..1 + usize::from(free)] {
                sum.iter_mut().zip(image.pixel(x, y)).for_each(|(sum, c)| *sum += f32::from(*c) / 255.0);
                *count += 1.0;
            }
        }
    }
    let place = |(point, [all, free]): (&SkyPoint, [([f32; 3], f32); 2])| {
        let is_free = free.1 > 0.0;
        let (sum, count) = if is_free { free } else { all };
        (count > 0.0).then(|| SkyPlace { x: point.x, rgb: sum.map(|x| x / count), is_free })
    };
    Ok(points.iter().zip(sums).filter_map(place).collect())
}

/// The pixel at a place of a photo, in its upper part.
fn upper_pixel(camera: &Camera, at: [f64; 2]) -> Option<[u32; 2]> {
    let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] < f64::from(camera.width);
    (inside && at[1] < UPPER * f64::from(camera.height)).then(|| at.map(|x| x as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;

    const PLACES: [DVec3; 3] = [DVec3::new(1.0, 0.0, 0.2), DVec3::new(-1.0, 0.0, 0.2), DVec3::new(0.0, 0.5, 0.2)];

    fn sphere(data: &Dataset, count: usize) -> SkySphere {
        let frame = CloudFrame { centre: [0.0, 0.0, 1.0], scale: 3.3 };
        SkySphere::around(&PLACES, &frame, data, count)
    }

    #[test]
    fn points_are_spread_over_the_sphere_seen_in_the_upper_part_of_a_photo_and_above_the_horizon() {
        let (_, data) = made::capture(made::Points::None);
        let sphere = sphere(&data, 2000);
        assert_eq!((sphere.count, sphere.radius), (2001, 33.0));
        assert!(sphere.up.unwrap().distance(DVec3::Z) < 1e-6);
        let all: Vec<DVec3> = (0..sphere.count).map(|i| sphere.point(i)).collect();
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        assert!(mean.distance(sphere.centre) < 0.01 * sphere.radius, "{mean}");
        assert!(all.iter().all(|x| (x.distance(sphere.centre) - sphere.radius).abs() < 1e-9));
        let points = sphere.points(&data);
        assert!(points.len() > 50, "{}", points.len());
        for point in &points {
            assert!(all.contains(&point.x) && point.x.z > sphere.centre.z - 1e-3);
            for SkyPixel { view, at } in &point.pixels {
                let p = data.view(*view).camera.prepare().project(point.x).unwrap();
                assert!(p.x >= 0.0 && p.y >= 0.0 && p.x < 24.0 && p.y < 16.0, "{p}");
                assert_eq!(*at, [p.x as u32, p.y as u32]);
            }
        }
        // All those that are left out are below the horizon, or no photo has them there.
        let left = all.iter().filter(|x| !points.iter().any(|point| point.x == **x));
        for x in left.filter(|x| x.z > sphere.centre.z + 1e-3) {
            for view in data.views() {
                let p = view.camera.prepare().project(*x);
                assert!(p.is_none_or(|p| p.x < 0.0 || p.y < 0.0 || p.x >= 24.0 || p.y >= 16.0), "{x}");
            }
        }
    }

    #[test]
    fn a_place_of_the_sky_has_the_mean_colour_of_the_photos_that_show_it() {
        let frames = made::frames(3, |k, _, _| [20 * k as u8, 100, 200, 255]);
        let (_, data) = made::scene(frames, Vec::new());
        let sphere = sphere(&data, 500);
        let points = sphere.points(&data);
        let all = shown(&data, &points, |rays| vec![true; rays.len()]).unwrap();
        let none = shown(&data, &points, |rays| vec![false; rays.len()]).unwrap();
        assert!(all.len() == points.len() && all.iter().all(|place| place.is_free));
        for ((place, other), point) in all.iter().zip(&none).zip(&points) {
            let mean =
                point.pixels.iter().map(|pixel| 20.0 * pixel.view as f32).sum::<f32>() / point.pixels.len() as f32;
            assert!((255.0 * place.rgb[0] - mean).abs() < 0.01 && (255.0 * place.rgb[2] - 200.0).abs() < 0.01);
            assert_eq!((place.x, place.rgb, other.is_free), (other.x, other.rgb, false));
        }
        // Something is before it on one side: those of the other have the colours of the photos that see them free.
        let some = shown(&data, &points, |rays| rays.iter().map(|ray| ray.d.x > 0.0).collect()).unwrap();
        assert_eq!(some.len(), points.len());
        for (place, point) in some.iter().zip(&points).filter(|(_, point)| point.x.x.abs() > 6.0) {
            assert_eq!(place.is_free, point.x.x > sphere.centre.x, "{}", point.x);
        }
        assert!(shown(&data, &[], |_| Vec::new()).unwrap().is_empty());
    }

    #[test]
    fn gaussians_are_as_large_as_they_are_apart_and_no_more_than_there_is_room_for() {
        let (_, data) = made::capture(made::Points::None);
        let (sphere, frame) = (sphere(&data, 1000), CloudFrame { centre: [0.0, 0.0, 1.0], scale: 3.3 });
        let places: Vec<SkyPlace> = sphere
            .points(&data)
            .iter()
            .map(|point| SkyPlace { x: point.x, rgb: [0.2, 0.4, 0.6], is_free: true })
            .collect();
        let cloud = sphere.gaussians(&places, &frame, 1, usize::MAX).unwrap();
        cloud.check().unwrap();
        assert_eq!(cloud.len(), places.len());
        let n = cloud.len();
        for (i, place) in places.iter().enumerate() {
            let x = [0, 1, 2].map(|axis| cloud.mean[axis * n + i]);
            assert!(x.iter().map(|x| x * x).sum::<f32>() > FAR * FAR);
            let others = (0..sphere.count).map(|k| sphere.point(k).distance(place.x)).filter(|far| *far > 0.0);
            let nearest = others.fold(f64::MAX, f64::min);
            let size = f64::from(cloud.log_scale[i].exp()) * frame.scale;
            assert!(size > 0.7 * nearest && size < 2.5 * nearest, "{size} {nearest}");
        }
        assert_eq!(sphere.gaussians(&places, &frame, 1, 7).unwrap().len(), 7);
        assert!(sphere.gaussians(&places, &frame, 1, 0).unwrap().is_empty());
        assert!(sphere.gaussians(&[], &frame, 1, 9).unwrap().is_empty());
        let around_cameras = SkySphere::around(&[], &frame, &data, 9);
        assert_eq!((around_cameras.centre, around_cameras.radius), (DVec3::Z, 33.0));
        let nan = SkySphere::around(&[DVec3::NAN, DVec3::ZERO], &frame, &data, 9);
        assert_eq!((nan.centre, nan.radius), (DVec3::ZERO, 33.0));
    }
}
