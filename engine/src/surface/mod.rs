//! A reconstruction to points and meshes, in the scene's frame and unit.
//!
//! Density is not a surface: points are where the transmittance of a ray falls to one half, a mesh is where the density crosses a level
//! that the caller states.

mod frame_points;

pub use frame_points::frame_points;

use crate::crop::CropBox;
use crate::data::Dataset;
use crate::error::RunError;
use crate::progress::{Meter, Observer};
use crate::system::{LayerRequest, Normals, Query, Splats, System};
use losses::metrics::quantise_value;
use render_core::ray::Ray;
use scene_io::export::{Mesh, MeshGrid, PointCloud, marching_cubes};
use splat_core::SH_0;
use splat_core::density::opacity;

/// Rays or points given to the system at one time.
const BATCH: usize = 1 << 14;

/// Opacity a ray must have for its hit to count as a point.
pub const POINT_OPACITY: f32 = 0.5;

/// About `count` coloured points with normals and confidence (the ray's opacity): where the rays of evenly chosen pixels
/// of the training views fall to a transmittance of one half, inside `crop`. Of a cloud of Gaussians: the centres of at most `count`, without
/// normals. Where the observer asks to stop, the points of the views seen so far.
///
/// # Panics
/// If the system gives fewer values than rays.
pub fn points(
    system: &dyn System,
    data: &Dataset,
    query: &Query,
    crop: &CropBox,
    count: usize,
    observer: &mut dyn Observer,
) -> PointCloud {
    if let Some(splats) = system.splats(query) {
        return centres(&splats, crop, count);
    }
    let query =
        Query { layers: LayerRequest { normals: Normals::Compute, ..LayerRequest::default() }, ..query.clone() };
    // Every `stride`-th pixel, counted through all views: an odd stride does not fall into columns.
    let stride = (data.pixel_count() / count.max(1) as u64).max(1) | 1;
    let mut cloud = PointCloud::default();
    let mut rays: Vec<Ray> = Vec::with_capacity(BATCH);
    let mut next = 0;
    let mut first = 0;
    let mut meter = Meter::new("view for points", data.len());
    for view in data.views() {
        if observer.stop_asked() {
            return cloud;
        }
        let (width, pixels) =
            (u64::from(view.camera.width), u64::from(view.camera.width) * u64::from(view.camera.height));
        while next < first + pixels {
            let at = next - first;
            rays.extend(view.ray((at % width) as u32, (at / width) as u32));
            if rays.len() == BATCH {
                add_hits(system, &query, crop, &mut rays, &mut cloud);
            }
            next += stride;
        }
        first += pixels;
        meter.advance(observer);
    }
    add_hits(system, &query, crop, &mut rays, &mut cloud);
    cloud
}

/// Centres of Gaussians that are more opaque than not, the most opaque first, in their colour at degree 0.
///
/// # Panics
/// When fields of the cloud disagree in length.
pub fn centres(splats: &Splats, crop: &CropBox, count: usize) -> PointCloud {
    let cloud = &splats.gaussians;
    let n = cloud.len();
    let place = |i: usize| [0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i]));
    let mut shown: Vec<(f64, usize)> = (0..n)
        .map(|i| (opacity(cloud, i), i))
        .filter(|&(o, i)| o >= f64::from(POINT_OPACITY) && inside(&place(i), crop))
        .collect();
    shown.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    shown.truncate(count);
    PointCloud {
        positions: shown.iter().map(|&(_, i)| place(i)).collect(),
        colours: shown
            .iter()
            .map(|&(_, i)| [0, 1, 2].map(|c| quantise_value(0.5 + SH_0 * cloud.dc[c * n + i])))
            .collect(),
        normals: Vec::new(),
        confidence: shown.iter().map(|&(o, _)| o as f32).collect(),
    }
}

fn add_hits(system: &dyn System, query: &Query, crop: &CropBox, rays: &mut Vec<Ray>, cloud: &mut PointCloud) {
    let layers = system.render(rays, query);
    for (i, ray) in rays.iter().enumerate() {
        let (opacity, t) = (layers.opacity[i], f64::from(layers.median_depth[i]));
        let x = (ray.o + ray.d * t).to_array();
        if opacity >= POINT_OPACITY && t.is_finite() && inside(&x, crop) {
            cloud.positions.push(x);
            cloud.colours.push(own_colour(layers.rgb[i], opacity, query.background));
            cloud.normals.push(layers.normal[i]);
            cloud.confidence.push(opacity.min(1.0));
        }
    }
    rays.clear();
}

/// What is seen without the background it is composited on.
pub(crate) fn own_colour(rgb: [f32; 3], opacity: f32, background: [f32; 3]) -> [u8; 3] {
    [0, 1, 2].map(|c| quantise_value((rgb[c] - (1.0 - opacity) * background[c]) / opacity))
}

pub(crate) fn inside(x: &[f64; 3], [min, max]: &CropBox) -> bool {
    (0..3).all(|i| (min[i]..=max[i]).contains(&x[i]))
}

/// The density at which 2 % of the longest side of `crop` are opaque to `1 - 1/e`: what a mesh is cut at when nothing is
/// said.
pub fn default_level(crop: &CropBox) -> f32 {
    let longest = (0..3).map(|i| crop[1][i] - crop[0][i]).fold(0.0, f64::max);
    (50.0 / longest) as f32
}

/// The mesh where the density at a time crosses `level` inside `crop`, with `resolution` cells along the longest side; vertices take
/// the colour they show along their normal. Where the observer asks to stop, the rest is left empty: not to be used.
///
/// # Errors
/// [`RunError::Option`] for a cloud of Gaussians; [`RunError::Scene`] for an empty box, a level that is not a number, or a mesh too large for its file format.
pub fn mesh(
    system: &dyn System,
    crop: &CropBox,
    level: f32,
    resolution: usize,
    time: f64,
    observer: &mut dyn Observer,
) -> Result<Mesh, RunError> {
    if system.is_cloud() {
        let problem = "`--method density`: Gaussians have no density to cut at: use `--method tsdf`";
        return Err(RunError::Option(problem.into()));
    }
    let grid = MeshGrid::cubic(crop[0], crop[1], resolution);
    let mut meter = Meter::new("layer of the mesh", grid.cells[2] + 1);
    let mut mesh = marching_cubes(&grid, level, |points, out| {
        if observer.stop_asked() {
            return out.fill(0.0);
        }
        for (points, out) in points.chunks(BATCH).zip(out.chunks_mut(BATCH)) {
            system.density(points, time, out);
        }
        meter.advance(observer);
    })?;
    if observer.stop_asked() {
        return Ok(mesh);
    }
    let mut colours = vec![[0.0; 3]; mesh.vertices.len()];
    let inward: Vec<[f32; 3]> = mesh.normals.iter().map(|n| n.map(|c| -c)).collect();
    let batches = mesh.vertices.chunks(BATCH).zip(inward.chunks(BATCH)).zip(colours.chunks_mut(BATCH));
    for ((points, d), out) in batches {
        system.colour(points, d, time, out);
    }
    mesh.colours = colours.iter().map(|c| c.map(quantise_value)).collect();
    Ok(mesh)
}
