//! A cloud to the layers of a picture.

use super::flat::Canvas;
use super::frame::Frame;
use super::photo::view;
use engine::system::{Canonical, Layers, Median, Normals, Query, SkipRow};
use float_core::Simd;
use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::Camera;
use splat_core::{DrawStats, Gaussians, Projection, Raster, RasterSettings, SplatError, View};
use std::sync::Mutex;

/// Colour and depth.
const LOOKS: usize = 4;

/// What is drawn, and how.
#[derive(Clone, Copy)]
pub(crate) struct Look<'a> {
    pub(crate) cloud: &'a Gaussians,
    pub(crate) frame: &'a Frame,
    pub(crate) rules: RasterSettings,
    pub(crate) degree: usize,
    pub(crate) simd: Simd,
}

/// Buffers of a picture.
#[derive(Debug, Default)]
struct Buffers {
    projection: Projection,
    features: Vec<[f32; LOOKS]>,
    raster: Raster<LOOKS>,
    planes: Vec<f32>,
    middles: Vec<f32>,
}

/// Buffers that one picture leaves to the next.
#[derive(Debug, Default)]
pub(crate) struct Kept(Mutex<Vec<Buffers>>);

impl Kept {
    fn take(&self) -> Buffers {
        self.0.lock().ok().and_then(|mut kept| kept.pop()).unwrap_or_default()
    }

    fn give(&self, buffers: Buffers) {
        if let Ok(mut kept) = self.0.lock() {
            kept.truncate(1);
            kept.push(buffers);
        }
    }
}

/// Work that a picture left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LeftOut {
    /// Gaussians that no pixel can see, of all.
    pub(crate) culled: [u64; 2],
    /// Pairs of Gaussian and tile behind what is finished, of all.
    pub(crate) hidden: [u64; 2],
    /// Tiles with nothing over them, of all.
    pub(crate) empty: [u64; 2],
    /// Photos that masks leave nothing of, of all that were shown.
    pub(crate) blank: [u64; 2],
}

impl LeftOut {
    /// A cloud of which so many were seen was drawn.
    pub(crate) fn count(&mut self, cloud: usize, seen: usize, drawn: &DrawStats) {
        self.add(&Self {
            culled: [(cloud - seen) as u64, cloud as u64],
            hidden: [drawn.hidden, drawn.pairs],
            empty: [drawn.empty_tiles, drawn.tiles],
            blank: [0; 2],
        });
    }

    pub(crate) fn add(&mut self, more: &Self) {
        for (sum, more) in [
            (&mut self.culled, more.culled),
            (&mut self.hidden, more.hidden),
            (&mut self.empty, more.empty),
            (&mut self.blank, more.blank),
        ] {
            *sum = [sum[0] + more[0], sum[1] + more[1]];
        }
    }

    /// Rows of the table of skips, of a training and its pictures.
    pub(crate) fn rows(&self) -> Vec<SkipRow> {
        let row = |what, [skipped, total]: [u64; 2], unit, bound: String| {
            SkipRow::counted(what, (skipped, total), unit, bound)
        };
        vec![
            row("Gaussians that no pixel sees", self.culled, "Gaussians", "0".into()),
            row(
                "Gaussians behind finished tiles",
                self.hidden,
                "pairs",
                "0 in training (part of the model), the budget in pictures".into(),
            ),
            row("tiles with nothing over them", self.empty, "tiles", "0".into()),
            row("photos that masks leave nothing of", self.blank, "photos", "0".into()),
        ]
    }
}

impl Look<'_> {
    /// What `camera`, of the scene's frame, sees. Depths are distances along rays, world units.
    ///
    /// # Errors
    /// [`SplatError`] for a camera that cannot see, or more pairs than can be counted.
    pub(crate) fn layers(&self, camera: &Camera, query: &Query, kept: &Kept) -> Result<(Layers, LeftOut), SplatError> {
        let mut buffers = kept.take();
        let look = *self;
        let result = if camera.lens.is_pinhole() {
            look.plane(camera, query, &mut buffers)
        } else {
            let canvas = Canvas::new(camera);
            let size = [canvas.camera.width as usize, canvas.camera.height as usize];
            // What is widened is widened to a pixel of the picture, as in training.
            let blur = look.rules.blur * (canvas.finer * canvas.finer) as f32;
            let look = Look { rules: look.rules.with_blur(blur), ..look };
            look.plane(&canvas.camera, query, &mut buffers)
                .map(|(layers, left_out)| (through(&canvas, size, &layers, query), left_out))
        };
        kept.give(buffers);
        result
    }

    /// The same of a pinhole camera.
    fn plane(&self, camera: &Camera, query: &Query, buffers: &mut Buffers) -> Result<(Layers, LeftOut), SplatError> {
        let view = view(camera, self.frame);
        let Buffers { projection, features, raster, planes, middles } = buffers;
        projection.project(self.simd, self.cloud, &view, &self.rules, self.degree)?;
        features.clear();
        features.extend(projection.rgb.iter().zip(&projection.gaussians).map(|(c, f)| [c[0], c[1], c[2], f.z]));
        let rules = self.rules.with_transmittance_stop(enough(query, &projection.rgb));
        let drawn = raster.draw(self.simd, &projection.gaussians, features, view.size, &rules)?;
        let pixels = view.size[0] * view.size[1];
        planes.resize((LOOKS + 1) * pixels, 0.0);
        raster.planes(planes)?;
        let is_median = query.layers.median == Median::Compute || query.layers.canonical == Canonical::Compute;
        if is_median {
            middles.resize(pixels, 0.0);
            raster.median_depth(self.simd, &projection.gaussians, features, &rules, middles)?;
        }
        let mut left_out = LeftOut::default();
        left_out.count(self.cloud.len(), projection.gaussians.len(), &drawn);

        let mut layers = Layers::nothing(pixels, query);
        let (colour, rest) = planes.split_at(3 * pixels);
        let (depth, trans) = rest.split_at(pixels);
        let scale = self.frame.scale as f32;
        let width = view.size[0];
        let rows = (
            layers.rgb.par_chunks_mut(width),
            layers.opacity.par_chunks_mut(width),
            layers.depth.par_chunks_mut(width),
            layers.median_depth.par_chunks_mut(width),
        );
        rows.into_par_iter().enumerate().for_each(|(y, (rgb, opacity, distance, middle))| {
            let down = (y as f32 + 0.5 - view.c[1]) / view.f[1];
            for x in 0..width {
                let i = y * width + x;
                let t = trans[i];
                rgb[x] = [0, 1, 2].map(|c| colour[c * pixels + i] + t * query.background[c]);
                opacity[x] = 1.0 - t;
                let aside = (x as f32 + 0.5 - view.c[0]) / view.f[0];
                let along = scale * (1.0 + aside * aside + down * down).sqrt();
                if t < 1.0 {
                    distance[x] = depth[i] / (1.0 - t) * along;
                }
                middle[x] = if is_median { middles[i] * along } else { distance[x] };
            }
        });
        if query.layers.normals == Normals::Compute {
            self.normals(&view, projection, &mut layers)?;
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
        Ok((layers, left_out))
    }

    /// Normals: the shortest axis of each Gaussian, turned to the camera, composited as colours are.
    fn normals(&self, view: &View, projection: &Projection, layers: &mut Layers) -> Result<(), SplatError> {
        let n = self.cloud.len();
        let o = view.centre();
        let features: Vec<[f32; 3]> = projection
            .gaussians
            .iter()
            .map(|f| {
                let i = f.index as usize;
                let axis = shortest_axis(self.cloud, i);
                let way: f32 = (0..3).map(|k| axis[k] * (self.cloud.mean[k * n + i] - o[k])).sum();
                if way > 0.0 { axis.map(|a| -a) } else { axis }
            })
            .collect();
        let mut raster = Raster::<3>::default();
        raster.draw(self.simd, &projection.gaussians, &features, view.size, &self.rules)?;
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

/// How much of a pixel's light may be left without a look at what is behind: as much as the error budget affords.
///
/// Behind there is at most that share of the light, times the brightest colour of the picture or of the background.
fn enough(query: &Query, rgb: &[[f32; 3]]) -> f32 {
    let brightest = rgb.iter().chain([&query.background]).flatten().fold(0.0_f32, |most, &c| most.max(c));
    let share = query.error_budget / brightest.max(f32::MIN_POSITIVE);
    if share.is_finite() { share.clamp(0.0, 0.5) } else { 0.5 }
}

/// A picture through a lens, from the canvas that it was drawn onto.
fn through(canvas: &Canvas, [w, h]: [usize; 2], from: &Layers, query: &Query) -> Layers {
    let mut out = Layers::nothing(canvas.places.len(), query);
    for (i, &[x, y]) in canvas.places.iter().enumerate() {
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
        if let (Some(to), Some(from)) = (out.normal.get_mut(i), from.normal.get(nearest)) {
            *to = *from;
        }
        if let (Some(to), Some(from)) = (out.canonical.get_mut(i), from.canonical.get(nearest)) {
            *to = *from;
        }
    }
    out
}
