//! The appearance of a photo that was not trained on: the code that explains some of its pixels best, the clouds as they are.
//!
//! Where the appearance has an encoder, it gives the code at once, without steps.
//!
//! The pixels are gathered in a small picture of a pinhole camera, whatever lens their rays came through. Geometry does not depend on
//! the code, so Gaussians are projected once; a step colours, composites and compares them (WildGaussians, section 3.4).

use super::drawing::Projections;
use super::driver::Views;
use super::hooks::{OfAppearance, SeenPhoto};
use super::photo::{over, view};
use super::photo_depth::PhotoDepth;
use super::planes::{COLOUR, PlaneLayout, add_background};
use engine::system::{Appearance, Fit};
use glam::{DMat3, DVec3};
use losses::dssim::{Dssim, Pair, Target};
use optim::{Adam, AdamConfig};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use scene_io::Image;
use splat_core::{ProjectedGradient, Raster};
use std::sync::Arc;

/// Pixels along the longest side of the small picture.
const LONGEST: f64 = 256.0;
/// A step here compares all pixels, one of a field a sample of them: a third of the steps is enough.
const FEWER: u64 = 3;
/// Share of the structure in what a code costs.
const STRUCTURE: f32 = 0.2;
/// Rays are gathered up to this angle to their middle: its cosine.
const WIDEST: f64 = 0.2;

/// Pixels, gathered in a picture.
struct Gathered {
    camera: Camera,
    /// `[3][pixels]`, means of the colours of the rays that go through each.
    colour: Vec<f32>,
    /// `[pixels]`, 1 where there are any.
    weights: Vec<f32>,
}

impl Gathered {
    /// `None` where there are none.
    fn new(pixels: &Fit<'_>) -> Option<Self> {
        let o = pixels.rays.first()?.o;
        let sum: DVec3 = pixels.rays.iter().map(|ray| ray.d.normalize_or_zero()).sum();
        let z = sum.try_normalize()?;
        let x = right(pixels.rays, z);
        let r = DMat3::from_cols(x, z.cross(x), z);
        let tangent = |d: DVec3| {
            let d = r.transpose() * d.normalize_or_zero();
            (d.z > WIDEST).then(|| [d.x / d.z, d.y / d.z])
        };
        let seen: Vec<([f64; 2], [f32; 3])> =
            pixels.rays.iter().zip(pixels.rgb).filter_map(|(ray, rgb)| Some((tangent(ray.d)?, *rgb))).collect();
        let bound = |k: usize, of: fn(f64, f64) -> f64| seen.iter().map(|(t, _)| t[k]).reduce(of);
        let [low, high] = [[bound(0, f64::min)?, bound(1, f64::min)?], [bound(0, f64::max)?, bound(1, f64::max)?]];
        let extent = [0, 1].map(|k| (high[k] - low[k]).max(1e-6));
        // About a ray to a pixel, if that many fit.
        let f = (seen.len() as f64 / (extent[0] * extent[1])).sqrt().min(LONGEST / extent[0].max(extent[1]));
        let [width, height] = extent.map(|x| (x * f).ceil().clamp(1.0, LONGEST) as usize);
        let n = width * height;
        let (mut colour, mut counts) = (vec![0.0; 3 * n], vec![0.0_f32; n]);
        for (t, rgb) in &seen {
            let at = |k: usize, size: usize| (((t[k] - low[k]) * f) as usize).min(size - 1);
            let i = at(1, height) * width + at(0, width);
            counts[i] += 1.0;
            rgb.iter().enumerate().for_each(|(c, x)| colour[c * n + i] += x);
        }
        for plane in colour.chunks_exact_mut(n) {
            plane.iter_mut().zip(&counts).for_each(|(x, count)| *x /= count.max(1.0));
        }
        let pose = Pose { r, c: o };
        let camera = Camera::pinhole(width as u32, height as u32, f, f, -low[0] * f, -low[1] * f, pose);
        Some(Self { camera, colour, weights: counts.iter().map(|count| count.min(1.0)).collect() })
    }
}

/// Right in the photo, across `z`. Rays come row by row, and neighbours in a row are nearest: each step from ray to ray counts by one over
/// its length.
fn right(rays: &[Ray], z: DVec3) -> DVec3 {
    let steps = rays.windows(2).map(|pair| pair[1].d.normalize_or_zero() - pair[0].d.normalize_or_zero());
    let sum: DVec3 = steps.filter(|step| step.length_squared() > 0.0).map(|step| step / step.length_squared()).sum();
    sum.reject_from_normalized(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector())
}

/// See [`engine::system::System::encode_appearance`]. What a mask leaves out says nothing; the camera is not known.
pub(super) fn encode(system: &Views, photo: &Image) -> Option<Vec<f32>> {
    let part = system.parts.appearance.as_deref()?;
    let size = [photo.width as usize, photo.height as usize];
    let pixels = size[0] * size[1];
    let (mut colour, mut weights) = (vec![0.0; COLOUR * pixels], vec![0.0; pixels]);
    for i in 0..pixels {
        let [x, y] = [i % size[0], i / size[0]].map(|n| n as u32);
        let rgb = over(photo.pixel(x, y), system.parts.background.colour());
        (0..COLOUR).for_each(|c| colour[c * pixels + i] = rgb[c]);
        weights[i] = f32::from(u8::from(photo.is_used(x, y)));
    }
    part.encode(&SeenPhoto { size, colour: &colour, weights: Some(&weights), view: None, depth: None })
}

/// See [`engine::system::System::fit_appearance`].
pub(super) fn fit(system: &Views, pixels: &Fit<'_>) -> Option<Vec<f32>> {
    let part = system.parts.appearance.as_deref()?;
    let mut code = part.code(&Appearance::Mean);
    let Some(photo) = Gathered::new(pixels) else { return Some(code) };
    let (view, settings) = (view(&photo.camera, &system.parts.frame), system.parts.pictures.raster());
    let (colour, weights) = (&photo.colour[..], Some(&photo.weights[..]));
    let depth = system.photo_depth(&view, pixels.time, weights);
    let depth = depth.as_ref().map(PhotoDepth::seen);
    if let Some(code) = part.encode(&SeenPhoto { size: view.size, colour, weights, view: Some(&view), depth }) {
        return Some(code);
    }
    let clouds = system.clouds_at(pixels.time);
    let drawn = system.drawn(&clouds);
    let mut projections = Projections::default();
    if projections.project(system.simd, &drawn, &view, &settings).is_err() {
        return Some(code);
    }
    let mut plain = Vec::new();
    projections.colours(&mut plain);
    let n = view.size[0] * view.size[1];
    let (mut raster, mut features, mut planes) = (Raster::<COLOUR>::default(), Vec::new(), vec![0.0; (COLOUR + 1) * n]);
    let (mut dssim, mut gradients) = (Dssim::new(system.simd), Vec::<ProjectedGradient<COLOUR>>::new());
    let mut adam = Adam::new(code.len(), AdamConfig::DEFAULT);
    let steps = pixels.steps.div_ceil(FEWER);
    for step in 0..steps {
        if pixels.halt.raised() {
            break;
        }
        let appearance = Appearance::Code(Arc::from(&code[..]));
        let mut toned = plain.clone();
        projections.of_appearance(&drawn, OfAppearance { part, appearance: &appearance }, &mut toned);
        projections.features(&drawn, PlaneLayout::default(), &toned, &mut features);
        let made = raster.draw(system.simd, projections.gaussians(), &features, view.size, &settings);
        if made.is_err() || raster.planes(&mut planes).is_err() {
            break;
        }
        let (colour, transmittance) = planes.split_at_mut(COLOUR * n);
        add_background(colour, transmittance, pixels.background);
        let pair = Pair {
            channels: COLOUR,
            height: view.size[1],
            width: view.size[0],
            x: colour,
            target: Target::Planes(&photo.colour),
            weights: Some(&photo.weights),
        };
        let mut bars = vec![0.0; (COLOUR + 1) * n];
        if dssim.l1_dssim_backward(&pair, STRUCTURE, 1.0, &mut bars[..COLOUR * n]).is_err()
            || raster
                .backward(system.simd, projections.gaussians(), &features, &settings, &bars, &mut gradients)
                .is_err()
        {
            break;
        }
        let mut bar: Vec<[f32; 3]> = gradients.iter().map(|gradient| gradient.features).collect();
        let mut code_bar = vec![0.0; code.len()];
        for ((range, projection), cloud) in projections.each().zip(&drawn) {
            let seen = projections.seen(cloud, projection);
            let own = part.code_bar(&code, seen, &plain[range.clone()], &mut bar[range]);
            code_bar.iter_mut().zip(own).for_each(|(sum, bar)| *sum += bar);
        }
        let third = (3 * step / steps.max(1)) as i32;
        // Entries that are not finite stay as they are.
        let _ = adam.step(system.simd, pixels.lr * 0.1_f64.powi(third), &mut code, &code_bar);
    }
    Some(code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::halt::Halt;
    use glam::DVec2;

    #[test]
    fn rays_of_a_photo_are_gathered_where_its_camera_sees_them() {
        let pose = Pose { r: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(2.0), c: DVec3::new(1.0, 2.0, 3.0) };
        let camera = Camera::pinhole(40, 30, 50.0, 50.0, 20.0, 15.0, pose);
        let (mut rays, mut rgb) = (Vec::<Ray>::new(), Vec::new());
        for i in 0..20 * 30 {
            // The left half.
            let at = DVec2::new((i % 20) as f64 + 0.5, (i / 20) as f64 + 0.5);
            rays.push(camera.ray(at).unwrap());
            rgb.push([at.x as f32 / 40.0, at.y as f32 / 30.0, 0.5]);
        }
        let halt = Halt::default();
        let fit =
            Fit { rays: &rays, rgb: &rgb, time: 0.0, background: [0.0; 3], steps: 1, lr: 0.1, seed: 0, halt: &halt };
        let photo = Gathered::new(&fit).unwrap();
        assert!(photo.camera.pose.r.col(0).dot(pose.r.col(0)) > 0.9, "it stands upright");
        let n = photo.weights.len();
        let filled = photo.weights.iter().filter(|w| **w == 1.0).count();
        assert!(filled > 300 && photo.weights.iter().all(|w| *w == 0.0 || *w == 1.0), "{filled} of {n}");
        // Each colour is that of the old camera's pixels there.
        let width = photo.camera.width as usize;
        for i in (0..n).filter(|i| photo.weights[*i] == 1.0) {
            let ray = photo.camera.ray(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)).unwrap();
            let at = camera.prepare().project(ray.at(1.0)).unwrap();
            assert!((f64::from(photo.colour[i]) - at.x / 40.0).abs() < 0.05, "{i}");
            assert!((f64::from(photo.colour[n + i]) - at.y / 30.0).abs() < 0.07, "{i}");
        }
        assert!(Gathered::new(&Fit { rays: &[], rgb: &[], ..fit }).is_none());
        assert!(Gathered::new(&Fit { rays: &rays[..1], rgb: &rgb[..1], ..fit }).is_some());
    }
}
