//! A table with a few things on it, and cameras around it.

use super::shape::{Placed, Shape};
use super::surface::{Paint, Surface, TO_SUN, to_byte, to_srgb};
use crate::random::random;
use crate::{Bounds, Dialect, Frame, Image, ImageSource, LayoutHint, Scene, Split};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::sync::Arc;

/// Distance of the cameras from what they look at, world units.
const DISTANCE: f64 = 4.0;
/// What the cameras look at: the middle of the scene's ball.
const CENTRE: DVec3 = DVec3::new(0.0, 0.0, 0.3);
/// Radius of a ball around [`CENTRE`] that holds everything: the far corners of the table lie at 1.51.
const RADIUS: f64 = 1.6;
/// Shadow rays start this far from the surface.
const LIFT: f64 = 1e-7;

/// Size, number and seed of the pictures of [`tabletop`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TabletopOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Training views.
    pub train: usize,
    /// Held-out views.
    pub test: usize,
    /// Varies the colours, the turn of the things and where the cameras stand.
    pub seed: u64,
    /// Horizontal angle of view, radians.
    pub angle: f64,
    /// Rays of a pixel along each side: the square of it in all.
    pub rays: u32,
}

impl Default for TabletopOptions {
    /// 60 training and 10 test views of 160 x 160 pixels, 3 x 3 rays each.
    fn default() -> Self {
        Self { width: 160, height: 160, train: 60, test: 10, seed: 0, angle: 0.82, rays: 3 }
    }
}

/// A table with a ball, a block, a cylinder, a ring and a small glossy ball on it: z is up, the table top lies at
/// `z = 0` and reaches to 1 in x and y. One sun, sky light, hard shadows.
#[derive(Clone, Debug)]
pub struct Tabletop {
    things: Vec<(Placed, Surface)>,
}

/// Where a ray first meets the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, world units.
    pub t: f64,
    /// The point.
    pub x: DVec3,
    /// Outward unit normal.
    pub normal: DVec3,
    /// Colour of the surface without light, linear RGB.
    pub albedo: DVec3,
    /// What the eye sees, display-referred sRGB in `[0, 1]`.
    pub rgb: DVec3,
    /// Index of the thing that was hit.
    pub thing: usize,
}

/// Exact depth and normals of one view, at the pixel centres.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewTruth {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Distance along the ray (not z depth), `[height * width]`; infinite where nothing is hit.
    pub distance: Vec<f64>,
    /// Outward normals in the world, `[height * width]`; zero where nothing is hit.
    pub normal: Vec<DVec3>,
}

impl Tabletop {
    /// The scene of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let draw = |index| random(seed, index);
        let turned = |index: u64| DMat3::from_rotation_z(draw(index) * TAU);
        // Each colour is moved a little, each thing turned at will.
        let colour = |index: u64, r: f64, g: f64, b: f64| {
            let jitter = DVec3::new(draw(index), draw(index + 1), draw(index + 2)) - DVec3::splat(0.5);
            (DVec3::new(r, g, b) + jitter * 0.12).clamp(DVec3::splat(0.02), DVec3::splat(0.9))
        };
        let checker = |a, b, size| Paint::Checker { colours: [a, b], size };
        let wave = |a, b, k| Paint::Wave { colours: [a, b], k };
        let thing = |shape, r, c, paint, gloss| (Placed { shape, r, c }, Surface { paint, gloss });
        let lying = turned(40) * DMat3::from_rotation_x(0.35);
        let things = vec![
            thing(
                Shape::Block { half: DVec3::new(1.0, 1.0, 0.06) },
                DMat3::IDENTITY,
                DVec3::new(0.0, 0.0, -0.06),
                checker(colour(100, 0.55, 0.50, 0.42), colour(103, 0.16, 0.22, 0.30), 0.25),
                0.0,
            ),
            thing(
                Shape::Sphere { radius: 0.34 },
                turned(41),
                DVec3::new(-0.42, -0.30, 0.34),
                wave(colour(106, 0.70, 0.20, 0.14), colour(109, 0.75, 0.52, 0.16), DVec3::new(9.0, 4.0, 14.0)),
                0.15,
            ),
            thing(
                Shape::Block { half: DVec3::new(0.24, 0.20, 0.28) },
                turned(42),
                DVec3::new(0.45, 0.38, 0.28),
                checker(colour(112, 0.20, 0.50, 0.28), colour(115, 0.62, 0.66, 0.40), 0.14),
                0.0,
            ),
            thing(
                Shape::Cylinder { radius: 0.17, half_height: 0.36 },
                turned(43),
                DVec3::new(-0.38, 0.48, 0.36),
                wave(colour(118, 0.18, 0.28, 0.62), colour(121, 0.66, 0.70, 0.76), DVec3::new(6.0, 0.0, 18.0)),
                0.10,
            ),
            // Leans on nothing: it floats a little above the table, so that its shadow parts from it.
            thing(
                Shape::Torus { ring: 0.24, tube: 0.08 },
                lying,
                DVec3::new(0.42, -0.42, 0.22),
                wave(colour(124, 0.58, 0.16, 0.48), colour(127, 0.78, 0.60, 0.70), DVec3::new(10.0, 10.0, 0.0)),
                0.12,
            ),
            thing(
                Shape::Sphere { radius: 0.13 },
                DMat3::IDENTITY,
                DVec3::new(0.02, 0.02, 0.13),
                wave(colour(130, 0.72, 0.72, 0.68), colour(133, 0.60, 0.64, 0.70), DVec3::new(0.0, 0.0, 20.0)),
                0.30,
            ),
        ];
        Self { things }
    }

    /// A box that holds the scene tightly.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(-1.0, -1.0, -0.12), max: DVec3::new(1.0, 1.0, 0.72) }
    }

    /// Where a ray first meets a surface, and how it looks from there.
    #[must_use]
    pub fn trace(&self, ray: &Ray) -> Option<Hit> {
        let (t, normal, local, thing) = self.nearest(ray, 0.0)?;
        let x = ray.at(t);
        let surface = &self.things[thing].1;
        let albedo = surface.paint.at(local);
        let to_sun = Ray { o: x + normal * LIFT, d: TO_SUN };
        let shadow = normal.dot(TO_SUN) <= 0.0 || self.things.iter().any(|(p, _)| p.hit(&to_sun, 0.0).is_some());
        Some(Hit { t, x, normal, albedo, rgb: to_srgb(surface.shade(albedo, normal, ray.d, shadow)), thing })
    }

    /// Is a point inside a thing?
    #[must_use]
    pub fn contains(&self, x: DVec3) -> bool {
        self.things.iter().any(|(placed, _)| placed.contains(x))
    }

    fn nearest(&self, ray: &Ray, after: f64) -> Option<(f64, DVec3, DVec3, usize)> {
        let hits = self.things.iter().enumerate();
        hits.filter_map(|(i, (placed, _))| placed.hit(ray, after).map(|(t, n, local)| (t, n, local, i)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The picture of a camera: RGBA with straight alpha, each pixel the average of `rays * rays` rays on a regular
    /// grid. Averages are taken of display-referred premultiplied values, which is how pictures are composited.
    ///
    /// # Panics
    /// If `rays` is 0.
    #[must_use]
    pub fn render(&self, camera: &Camera, rays: u32) -> Image {
        assert!(rays > 0, "a pixel needs at least one ray");
        let prepared = camera.prepare();
        let width = camera.width as usize;
        let mut data = vec![0_u8; width * camera.height as usize * 4];
        let step = 1.0 / f64::from(rays);
        let pixel = |column: usize, row: usize| {
            let (mut sum, mut covered) = (DVec3::ZERO, 0_u32);
            for (a, b) in (0..rays).flat_map(|b| (0..rays).map(move |a| (a, b))) {
                let inside = DVec2::new(f64::from(a) + 0.5, f64::from(b) + 0.5) * step;
                let ray = prepared.ray(DVec2::new(column as f64, row as f64) + inside);
                if let Some(hit) = ray.and_then(|ray| self.trace(&ray)) {
                    sum += hit.rgb;
                    covered += 1;
                }
            }
            let rgb = if covered > 0 { sum / f64::from(covered) } else { DVec3::ZERO };
            [rgb.x, rgb.y, rgb.z, f64::from(covered) * step * step].map(to_byte)
        };
        data.par_chunks_mut((width * 4).max(1)).enumerate().for_each(|(row, line)| {
            for (column, out) in line.chunks_exact_mut(4).enumerate() {
                out.copy_from_slice(&pixel(column, row));
            }
        });
        Image { width: camera.width, height: camera.height, channels: 4, data, mask: None }
    }

    /// Exact depth and normals of a camera.
    #[must_use]
    pub fn truth(&self, camera: &Camera) -> ViewTruth {
        let prepared = camera.prepare();
        let centre = |i: u64| {
            let (column, row) = (i % u64::from(camera.width), i / u64::from(camera.width));
            let ray = prepared.ray(DVec2::new(column as f64 + 0.5, row as f64 + 0.5));
            match ray.and_then(|ray| self.nearest(&ray, 0.0)) {
                Some((t, normal, ..)) => (t, normal),
                None => (f64::INFINITY, DVec3::ZERO),
            }
        };
        let (distance, normal) =
            (0..u64::from(camera.width) * u64::from(camera.height)).into_par_iter().map(centre).unzip();
        ViewTruth { width: camera.width, height: camera.height, distance, normal }
    }
}

/// Pictures of a [`Tabletop`]: an object on an empty background, cameras on the upper half of a sphere of radius 4.
///
/// Training and test views are spread evenly over the same half sphere and lie between each other. The same options give
/// the same bytes.
///
/// # Panics
/// If `rays` is 0, a side is 0, or the angle is not in `(0, pi)`.
#[must_use]
pub fn tabletop(options: &TabletopOptions) -> Scene {
    let TabletopOptions { width, height, train, test, seed, angle, rays } = *options;
    assert!(width > 0 && height > 0, "tabletop: pictures of {width} x {height} pixels");
    assert!(angle > 0.0 && angle < PI, "tabletop: angle of view {angle}");
    let table = Tabletop::new(seed);
    let view = |split: Split, i: usize, n: usize| {
        let (w, h) = (f64::from(width), f64::from(height));
        let focal = 0.5 * w / (0.5 * angle).tan();
        let camera = Camera::pinhole(width, height, focal, focal, 0.5 * w, 0.5 * h, look_from(split, i, n, seed));
        let image = ImageSource::Memory(Arc::new(table.render(&camera, rays)));
        Frame { split, ..Frame::new(format!("{}/r_{i:03}", split.name()), image, camera) }
    };
    let mut frames: Vec<Frame> = (0..train).map(|i| view(Split::Train, i, train)).collect();
    frames.extend((0..test).map(|i| view(Split::Test, i, test)));
    Scene {
        name: "tabletop".to_owned(),
        root: PathBuf::new(),
        dialect: Dialect::Synthetic,
        frames,
        points: Vec::new(),
        layout: LayoutHint::Object { near: DISTANCE - RADIUS, far: DISTANCE + RADIUS },
        bounds: Some(table.bounds()),
        notes: Vec::new(),
    }
}

/// A pose on the half sphere: view `i` of `n`.
fn look_from(split: Split, i: usize, n: usize, seed: u64) -> Pose {
    // A golden-angle spiral covers the band between 7 and 72 degrees evenly; test views start half a turn apart.
    let (offset, stream) = if split == Split::Test { (0.381_966, 1000) } else { (0.0, 0) };
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let jitter = |index: usize| random(seed, stream + 10_000 + index as u64) - 0.5;
    let (low, high) = (7_f64.to_radians().sin(), 72_f64.to_radians().sin());
    // The jitter of half a step keeps the heights apart.
    let z = low + (high - low) * (i as f64 + 0.5 + 0.5 * jitter(2 * i)) / n as f64;
    let turn = golden * i as f64 + TAU * (offset + random(seed, 7)) + 0.3 * jitter(2 * i + 1);
    let flat = (1.0 - z * z).sqrt();
    let eye = CENTRE + DVec3::new(flat * turn.cos(), flat * turn.sin(), z) * DISTANCE;
    // Never `None`: the eye is 4 units away.
    Pose::look_at(eye, CENTRE, DVec3::Z).unwrap_or(Pose::IDENTITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::snapshot::testing::{on_threads, pixels};
    use proptest::prelude::*;
    use testkit::strategies::any_unit_vector;

    fn small(seed: u64) -> TabletopOptions {
        TabletopOptions { width: 40, height: 30, train: 5, test: 3, seed, rays: 2, ..TabletopOptions::default() }
    }

    #[test]
    fn the_same_options_give_the_same_bytes_and_other_seeds_do_not() {
        let (a, b, c) = (tabletop(&small(3)), tabletop(&small(3)), tabletop(&small(4)));
        assert_eq!(pixels(&a), pixels(&b));
        assert_ne!(pixels(&a), pixels(&c));
        assert!(a.frames.iter().zip(&b.frames).all(|(a, b)| a.camera == b.camera && a.name == b.name));
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bytes() {
        let run = |threads| on_threads(threads, || tabletop(&small(0)));
        assert_eq!(pixels(&run(1)), pixels(&run(3)));
    }

    #[test]
    fn a_scene_has_what_was_asked_for() {
        let scene = tabletop(&small(0));
        assert_eq!((scene.count(Split::Train), scene.count(Split::Test), scene.frames.len()), (5, 3, 8));
        let names: std::collections::HashSet<_> = scene.frames.iter().map(|f| &f.name).collect();
        assert_eq!(names.len(), 8);
        for data in pixels(&scene) {
            assert_eq!(data.len(), 40 * 30 * 4);
            let alpha: Vec<u8> = data.iter().skip(3).step_by(4).copied().collect();
            let share = |wanted: u8| alpha.iter().filter(|a| **a == wanted).count() as f64 / alpha.len() as f64;
            assert!(share(0) > 0.2 && share(255) > 0.1, "empty {}, full {}", share(0), share(255));
            assert!(share(0) + share(255) < 1.0, "no antialiased edge");
        }
        let nothing = tabletop(&TabletopOptions { train: 0, test: 0, ..small(0) });
        assert!(nothing.frames.is_empty());
    }

    #[test]
    fn cameras_stand_above_the_table_look_at_it_and_differ() {
        let scene = tabletop(&TabletopOptions { width: 2, height: 2, train: 40, test: 12, rays: 1, ..small(1) });
        for (i, frame) in scene.frames.iter().enumerate() {
            let camera = &frame.camera;
            assert!(((camera.pose.c - CENTRE).length() - DISTANCE).abs() < 1e-12);
            assert!((camera.optical_axis() - (CENTRE - camera.pose.c) / DISTANCE).length() < 1e-12);
            // Upright: the image's down axis has a component along world down.
            assert!(camera.pose.r.y_axis.z < 0.0 && camera.pose.c.z > 0.6);
            for other in &scene.frames[..i] {
                let apart = if other.split == frame.split { 0.2 } else { 1e-3 };
                let distance = other.camera.pose.c.distance(camera.pose.c);
                assert!(distance > apart, "{} is {distance} from {}", frame.name, other.name);
            }
        }
    }

    #[test]
    fn everything_lies_within_near_far_and_the_bounds() {
        let table = Tabletop::new(5);
        let scene = tabletop(&small(5));
        let LayoutHint::Object { near, far } = scene.layout else { panic!("{:?}", scene.layout) };
        let bounds = scene.bounds.unwrap();
        for frame in &scene.frames {
            let truth = table.truth(&frame.camera);
            let seen: Vec<f64> = truth.distance.iter().copied().filter(|t| t.is_finite()).collect();
            assert!(!seen.is_empty() && seen.iter().all(|t| *t > near && *t < far));
        }
        for i in 0..20_000 {
            let p = DVec3::new(random(9, 3 * i), random(9, 3 * i + 1), random(9, 3 * i + 2)) * 4.0 - DVec3::splat(2.0);
            let inside = p.cmpge(bounds.min).all() && p.cmple(bounds.max).all();
            assert!(inside || !table.contains(p), "{p} is solid and outside of the bounds");
        }
    }

    #[test]
    fn truth_agrees_with_the_picture() {
        let table = Tabletop::new(2);
        let camera = tabletop(&small(2)).frames[0].camera;
        let (truth, image) = (table.truth(&camera), table.render(&camera, 1));
        for row in 0..30 {
            for column in 0..40 {
                let i = (row * 40 + column) as usize;
                let ray = camera.ray(DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5)).unwrap();
                match table.trace(&ray) {
                    None => {
                        assert_eq!((truth.distance[i], truth.normal[i]), (f64::INFINITY, DVec3::ZERO));
                        assert_eq!(image.pixel(column, row), [0; 4]);
                    }
                    Some(hit) => {
                        assert_eq!((truth.distance[i], truth.normal[i]), (hit.t, hit.normal));
                        let rgb = hit.rgb * 255.0;
                        let want = [rgb.x, rgb.y, rgb.z].map(|x| (x + 0.5) as u8);
                        assert_eq!((&image.pixel(column, row)[..3], image.pixel(column, row)[3]), (&want[..], 255));
                    }
                }
            }
        }
    }

    #[test]
    fn shadows_fall_away_from_the_sun() {
        let table = Tabletop::new(0);
        let above = |x: f64, y: f64| {
            let ray = Ray { o: DVec3::new(x, y, 3.0), d: -DVec3::Z };
            table.trace(&ray).unwrap()
        };
        // Behind the cylinder, seen from the sun, the table is darker than the same paint in the light.
        let foot = DVec3::new(-0.38, 0.48, 0.0) - (TO_SUN * DVec3::new(1.0, 1.0, 0.0)).normalize() * 0.3;
        let dark = above(foot.x, foot.y);
        assert_eq!(dark.thing, 0);
        let lit = (0..400).map(|i| above(-0.95 + 0.1 * f64::from(i % 20), -0.95 + 0.1 * f64::from(i / 20)));
        let same_paint = lit.filter(|h| h.thing == 0 && h.albedo == dark.albedo);
        assert!(same_paint.map(|h| h.rgb.x).fold(0.0, f64::max) > 1.3 * dark.rgb.x);
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn hits_are_on_the_surface(o in [-2.0..2.0, -2.0..2.0, 0.9..3.0_f64], d in any_unit_vector(), seed in 0..4_u64) {
            let table = Tabletop::new(seed);
            let ray = Ray { o: DVec3::from(o), d: DVec3::from(d) };
            if let Some(hit) = table.trace(&ray) {
                prop_assert!(table.contains(hit.x - hit.normal * 1e-6) && !table.contains(hit.x + hit.normal * 1e-6));
                prop_assert!(hit.rgb.cmpge(DVec3::ZERO).all() && hit.rgb.cmple(DVec3::ONE).all());
                // Nothing solid before it.
                prop_assert!((1..200).all(|i| !table.contains(ray.at((hit.t - 1e-6) * f64::from(i) / 200.0))));
            }
        }
    }
}
