//! Renders clouds: the layers of a picture, through any lens.

use super::cloud_frame::CloudFrame;
use super::drawing::{DrawnCloud, Projections};
use super::front::ViewLayers;
use super::hooks::OfAppearance;
use super::photo::view;
use super::planes::PlaneLayout;
use super::skipped::Skipped;
use super::undistortion::DistortedPicture;
use engine::system::{Canonical, Layers, Median, Normals, Query};
use float_core::Simd;
use glam::{DMat3, DVec2};
use rayon::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use splat_core::{Gaussians, Raster, RasterSettings, SplatError, View};
use std::sync::Mutex;

/// Colour and depth.
const FEATURES: usize = 4;
const LAYOUT: PlaneLayout = PlaneLayout { depth: true, extras: 0, plain: false };

/// Radius of the cone of a single ray at distance 1, where nothing is known of its pixel.
pub(crate) const RAY_RADIUS: f32 = 5e-4;

/// The camera whose only pixel is a cone around a ray; `radius` is that of the cone at distance 1.
pub(crate) fn one_pixel(ray: &Ray, radius: f32) -> Camera {
    let z = ray.d.normalize();
    let x = z.any_orthonormal_vector();
    let pose = Pose { r: DMat3::from_cols(x, z.cross(x), z), c: ray.o };
    // The radius of a pixel's cone is its half width times 2 / sqrt(12).
    let f = 1.0 / (f64::from(radius.max(1e-7)) * 3.0_f64.sqrt());
    Camera::pinhole(1, 1, f, f, 0.5, 0.5, pose)
}

/// What is drawn, and how.
#[derive(Clone, Copy)]
pub(crate) struct CloudRenderer<'a> {
    pub(crate) clouds: &'a [DrawnCloud<'a>],
    pub(crate) frame: &'a CloudFrame,
    /// They are drawn one by one and put together.
    pub(crate) layers: Option<&'a ViewLayers>,
    pub(crate) settings: RasterSettings,
    /// Colours are turned into those of an appearance.
    pub(crate) appearance: Option<OfAppearance<'a>>,
    pub(crate) simd: Simd,
}

/// Buffers of a picture.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    pub(super) projections: Projections,
    colours: Vec<[f32; 3]>,
    features: Vec<[f32; FEATURES]>,
    raster: Raster<FEATURES>,
    planes: Vec<f32>,
    medians: Vec<f32>,
}

/// Pixels of the largest picture whose buffers are kept, two of them where several are drawn at once: those of a larger one take hundreds
/// of megabytes, and far less time to make than the picture does.
const MOST_KEPT: usize = 1 << 21;

/// Buffers that one picture leaves to the next.
#[derive(Debug, Default)]
pub(crate) struct RenderBuffers(Mutex<Vec<Buffers>>);

impl RenderBuffers {
    fn take(&self) -> Buffers {
        self.0.lock().ok().and_then(|mut kept| kept.pop()).unwrap_or_default()
    }

    fn give(&self, buffers: Buffers) {
        if buffers.planes.capacity() > (FEATURES + 1) * MOST_KEPT {
            return;
        }
        if let Ok(mut kept) = self.0.lock() {
            kept.truncate(1);
            kept.push(buffers);
        }
    }
}

impl CloudRenderer<'_> {
    /// What `camera`, of the scene's frame, sees. Depths are distances along rays, world units.
    ///
    /// # Errors
    /// [`SplatError`] for a camera that cannot see, or more pairs than can be counted.
    pub(crate) fn layers(
        &self,
        camera: &Camera,
        query: &Query,
        pool: &RenderBuffers,
    ) -> Result<(Layers, Skipped), SplatError> {
        let mut buffers = pool.take();
        let result = if camera.lens.is_pinhole() {
            self.pinhole(camera, query, &mut buffers)
        } else {
            let picture = DistortedPicture::new(camera);
            // What is widened is widened to a pixel of the picture, as in training.
            let blur = self.settings.blur * (picture.finer * picture.finer) as f32;
            let finer = CloudRenderer { settings: self.settings.with_blur(blur), ..*self };
            finer
                .pinhole(&picture.camera, query, &mut buffers)
                .map(|(layers, skipped)| (distorted(&picture, &layers, query), skipped))
        };
        pool.give(buffers);
        result
    }

    /// The same of a pinhole camera.
    pub(super) fn pinhole(
        &self,
        camera: &Camera,
        query: &Query,
        buffers: &mut Buffers,
    ) -> Result<(Layers, Skipped), SplatError> {
        if let Some(layers) = self.layers {
            return self.layered(layers, camera, query, buffers);
        }
        let view = view(camera, self.frame);
        let Buffers { projections, colours, features, raster, planes, medians } = buffers;
        projections.project(self.simd, self.clouds, &view, &self.settings)?;
        projections.colours(colours);
        if let Some(of_appearance) = self.appearance {
            projections.of_appearance(self.clouds, of_appearance, colours);
        }
        projections.features(self.clouds, LAYOUT, colours, features);
        let settings = self.settings.with_transmittance_stop(transmittance_stop(query, colours));
        let gaussians = projections.gaussians();
        let drawn = raster.draw(self.simd, gaussians, features, view.size, &settings)?;
        let pixels = view.size[0] * view.size[1];
        planes.resize((FEATURES + 1) * pixels, 0.0);
        raster.planes(planes)?;
        let is_median = query.layers.median == Median::Compute || query.layers.canonical == Canonical::Compute;
        if is_median {
            medians.resize(pixels, 0.0);
            raster.median_depth(self.simd, gaussians, features, &settings, medians)?;
        }
        let mut skipped = Skipped::default();
        skipped.count(self.clouds.iter().map(|cloud| cloud.gaussians.len()).sum(), gaussians.len(), &drawn);
        let medians = is_median.then_some(&medians[..]);
        let mut layers = self.composited(&view, query, planes, medians);
        if query.layers.normals == Normals::Compute {
            self.normals(&view, projections, &mut layers)?;
        }
        if query.layers.canonical == Canonical::Compute {
            for (i, point) in
                layers.canonical.iter_mut().enumerate().filter(|(i, _)| layers.median_depth[*i].is_finite())
            {
                let at = DVec2::new((i % view.size[0]) as f64 + 0.5, (i / view.size[0]) as f64 + 0.5);
                if let Some(ray) = camera.ray(at) {
                    *point = ray.at(f64::from(layers.median_depth[i])).to_array();
                }
            }
        }
        Ok((layers, skipped))
    }

    /// Layers from the planes of a picture, and from its median depths where they are wanted.
    fn composited(&self, view: &View, query: &Query, planes: &[f32], medians: Option<&[f32]>) -> Layers {
        let pixels = view.size[0] * view.size[1];
        let mut layers = Layers::nothing(pixels, query);
        let (colour, rest) = planes.split_at(3 * pixels);
        let (depth, transmittance) = rest.split_at(pixels);
        let scale = self.frame.scale as f32;
        let width = view.size[0];
        let rows = (
            layers.rgb.par_chunks_mut(width),
            layers.opacity.par_chunks_mut(width),
            layers.depth.par_chunks_mut(width),
            layers.median_depth.par_chunks_mut(width),
        );
        rows.into_par_iter().enumerate().for_each(|(y, (rgb, opacity, distance, median))| {
            let down = (y as f32 + 0.5 - view.c[1]) / view.f[1];
            for x in 0..width {
                let i = y * width + x;
                let t = transmittance[i];
                rgb[x] = [0, 1, 2].map(|c| colour[c * pixels + i] + t * query.background[c]);
                opacity[x] = 1.0 - t;
                let aside = (x as f32 + 0.5 - view.c[0]) / view.f[0];
                let along = scale * (1.0 + aside * aside + down * down).sqrt();
                if t < 1.0 {
                    distance[x] = depth[i] / (1.0 - t) * along;
                }
                median[x] = medians.map_or(distance[x], |medians| medians[i] * along);
            }
        });
        layers
    }

    /// Normals: the shortest axis of each Gaussian, turned to the camera, composited as colours are.
    fn normals(&self, view: &View, projections: &Projections, layers: &mut Layers) -> Result<(), SplatError> {
        let o = view.centre();
        let mut features = Vec::with_capacity(projections.gaussians().len());
        for ((_, projection), cloud) in projections.each().zip(self.clouds) {
            let (cloud, n) = (cloud.gaussians, cloud.gaussians.len());
            features.extend(projection.gaussians.iter().map(|f| {
                let i = f.index as usize;
                let axis = shortest_axis(cloud, i);
                let way: f32 = (0..3).map(|k| axis[k] * (cloud.mean[k * n + i] - o[k])).sum();
                if way > 0.0 { axis.map(|a| -a) } else { axis }
            }));
        }
        let mut raster = Raster::<3>::default();
        raster.draw(self.simd, projections.gaussians(), &features, view.size, &self.settings)?;
        let pixels = view.size[0] * view.size[1];
        let mut planes = vec![0.0; 4 * pixels];
        raster.planes(&mut planes)?;
        for (i, normal) in layers.normal.iter_mut().enumerate() {
            let sum = glam::Vec3::new(planes[i], planes[pixels + i], planes[2 * pixels + i]);
            *normal = sum.normalize_or_zero().to_array();
        }
        Ok(())
    }
}

/// Where a Gaussian is flattest, world axes.
fn shortest_axis(cloud: &Gaussians, i: usize) -> [f32; 3] {
    let n = cloud.len();
    let k = (0..3).min_by(|&a, &b| cloud.log_scale[a * n + i].total_cmp(&cloud.log_scale[b * n + i])).unwrap_or(0);
    let [w, x, y, z] = [0, 1, 2, 3].map(|c| cloud.wxyz[c * n + i]);
    let q = glam::Quat::from_xyzw(x, y, z, w);
    let q = if q.length_squared() > 1e-16 { q.normalize() } else { glam::Quat::IDENTITY };
    (q * glam::Vec3::AXES[k]).to_array()
}

/// The transmittance from which on what is behind need not be drawn: as much as the error budget affords.
///
/// What is behind adds at most that share, times the brightest colour of the picture or of the background.
fn transmittance_stop(query: &Query, rgb: &[[f32; 3]]) -> f32 {
    let brightest = rgb.iter().chain([&query.background]).flatten().fold(0.0_f32, |most, &c| most.max(c.abs()));
    let share = query.error_budget / brightest.max(f32::MIN_POSITIVE);
    if share.is_finite() { share.clamp(0.0, 0.5) } else { 0.5 }
}

/// A picture through a lens, resampled from the plane that it was drawn onto.
fn distorted(picture: &DistortedPicture, from: &Layers, query: &Query) -> Layers {
    let [w, h] = [picture.camera.width as usize, picture.camera.height as usize];
    let mut out = Layers::nothing(picture.places.len(), query);
    for (i, &[x, y]) in picture.places.iter().enumerate() {
        if !x.is_finite() {
            continue;
        }
        let (x, y) = ((x - 0.5).clamp(0.0, w as f32 - 1.0), (y - 0.5).clamp(0.0, h as f32 - 1.0));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let corners = [
            (y0 * w + x0, (1.0 - fx) * (1.0 - fy)),
            (y0 * w + x1, fx * (1.0 - fy)),
            (y1 * w + x0, (1.0 - fx) * fy),
            (y1 * w + x1, fx * fy),
        ];
        out.rgb[i] = [0, 1, 2].map(|c| corners.iter().map(|&(at, share)| share * from.rgb[at][c]).sum());
        out.opacity[i] = corners.iter().map(|&(at, share)| share * from.opacity[at]).sum();
        // One of them, not a mean over an edge.
        let nearest = corners.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |c| c.0);
        out.depth[i] = from.depth[nearest];
        out.median_depth[i] = from.median_depth[nearest];
        if let (Some(to), false) = (out.behind.get_mut(i), from.behind.is_empty()) {
            *to = [0, 1, 2].map(|c| corners.iter().map(|&(at, share)| share * from.behind[at][c]).sum());
        }
        if let (Some(to), Some(from)) = (out.normal.get_mut(i), from.normal.get(nearest)) {
            *to = *from;
        }
        if let (Some(to), Some(from)) = (out.canonical.get_mut(i), from.canonical.get(nearest)) {
            *to = *from;
        }
    }
    out
}
