//! Where the Gaussians of a baked cloud begin.
//!
//! A pixel of a picture that sees matter is a sample: the point at its median depth, as large as the pixel is there, with the
//! normal that the depths beside it span. Samples of about one size in one cell of a grid become one Gaussian; where there are
//! finer samples coarser ones are left out. A pixel that is opaque and sees nothing at any distance sees the sky: a Gaussian
//! far behind everything.

use super::BakeOptions;
use super::shots::Picture;
use engine::error::RunError;
use engine::neighbours::mean_squared_distances;
use engine::surface::POINT_OPACITY;
use glam::{DQuat, DVec2, DVec3};
use rayon::prelude::*;
use splat_core::density::logit;
use splat_core::{Gaussians, SH_0};
use std::collections::HashMap;
use std::f64::consts::FRAC_1_SQRT_2;

/// Opacity of all.
const OPACITY: f64 = 0.9;
/// Side of a cell at first, sizes of a pixel; it grows by the factor beside it until there are few enough Gaussians.
const CELL: [f64; 2] = [1.0, 1.2];
/// Cells are grown this often at most.
const ROUNDS: usize = 60;
/// Coarser samples are left out where there are some this many levels finer.
const FINER: i32 = 2;
/// Standard deviation in the surface: this part of the distance to the neighbours, between two parts of a cell.
const ACROSS: f64 = 0.65;
const LIMITS: [f64; 2] = [0.45, 1.3];
/// Standard deviation along the normal, a part of that across.
const FLAT: f64 = 0.3;
/// Depths that differ by more than this part of themselves are not of one surface.
const EDGE: f64 = 0.05;
/// The sky is this many times as far as what is far: nearer, cameras apart would see it shifted against each other.
const SKY: f64 = 50.0;

/// What a pixel sees.
#[derive(Clone, Copy, Debug)]
struct Sample {
    x: DVec3,
    normal: DVec3,
    /// Size of the pixel there, world units.
    size: f64,
    rgb: [f64; 3],
}

/// Samples that became one Gaussian.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    x: DVec3,
    normal: DVec3,
    size: f64,
    rgb: [f64; 3],
    count: f64,
}

/// What one picture shows of the sky.
#[derive(Clone, Copy)]
struct SkyPixel {
    /// To the sky, of length 1.
    d: DVec3,
    /// The size of the pixel at distance 1.
    size: f64,
    rgb: [f64; 3],
}

/// A cloud at the start of the fit, in the scene's frame.
///
/// # Errors
/// [`RunError::Option`] for a degree that there is not.
pub(super) fn cloud(pictures: &[&Picture], options: &BakeOptions) -> Result<Gaussians, RunError> {
    let found: Vec<(Vec<Sample>, Vec<SkyPixel>)> = pictures.par_iter().map(|p| samples(p)).collect();
    let mut matter: Vec<Sample> = found.iter().flat_map(|(matter, _)| matter.iter().copied()).collect();
    let sky = sky(pictures, &matter, &found);
    // The finest first; those of one size in the order of pictures.
    matter.sort_by(|a, b| a.size.total_cmp(&b.size));
    let (mut side, mut cells) = (CELL[0], Vec::new());
    for _ in 0..ROUNDS {
        cells = merged(&matter, side);
        cells.extend(merged(&sky, side));
        if cells.len() <= options.most {
            break;
        }
        side *= CELL[1];
    }
    cells.truncate(options.most);
    gaussians(&cells, side, options.degree).map_err(|e| RunError::Option(format!("the field cannot be baked: {e}")))
}

/// Samples of matter, and the pixels of the sky.
fn samples(picture: &Picture) -> (Vec<Sample>, Vec<SkyPixel>) {
    let (camera, layers) = (&picture.camera, &picture.layers);
    let (w, h) = (camera.width as usize, camera.height as usize);
    let points: Vec<Option<DVec3>> = (0..w * h)
        .map(|i| {
            let t = f64::from(layers.median_depth[i]);
            let ray = camera.ray(DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5))?;
            (layers.opacity[i] >= POINT_OPACITY && t.is_finite()).then(|| ray.at(t)).filter(|x| x.is_finite())
        })
        .collect();
    let o = camera.pose.c;
    let (mut matter, mut sky) = (Vec::new(), Vec::new());
    for i in 0..w * h {
        if layers.opacity[i] < POINT_OPACITY || !layers.rgb[i].iter().all(|c| c.is_finite()) {
            continue;
        }
        let rgb = layers.rgb[i].map(f64::from);
        let (column, row) = (i % w, i / w);
        let Some(x) = points[i] else {
            if let Some(ray) = camera.ray(DVec2::new(column as f64 + 0.5, row as f64 + 0.5)) {
                sky.push(SkyPixel { d: ray.d, size: 1.0 / camera.fx, rgb });
            }
            continue;
        };
        let t = x.distance(o);
        // A tangent of the surface along a side of the picture, from the neighbours on the same surface.
        let tangent = |low: Option<usize>, high: Option<usize>| {
            let near = |j: Option<usize>| j.and_then(|j| points[j]).filter(|y| (y.distance(o) - t).abs() < EDGE * t);
            let (low, high) = (near(low).unwrap_or(x), near(high).unwrap_or(x));
            (high != low).then(|| high - low)
        };
        let across = tangent(column.checked_sub(1).map(|_| i - 1), (column + 1 < w).then_some(i + 1));
        let down = tangent(row.checked_sub(1).map(|_| i - w), (row + 1 < h).then_some(i + w));
        let to_camera = (o - x).normalize_or_zero();
        let normal = across.zip(down).and_then(|(a, b)| a.cross(b).try_normalize()).unwrap_or(to_camera);
        let normal = if normal.dot(to_camera) < 0.0 { -normal } else { normal };
        matter.push(Sample { x, normal, size: t / camera.fx, rgb });
    }
    (matter, sky)
}

/// The sky as samples: far behind everything, facing the cameras.
fn sky(pictures: &[&Picture], matter: &[Sample], found: &[(Vec<Sample>, Vec<SkyPixel>)]) -> Vec<Sample> {
    let n = pictures.len().max(1) as f64;
    let centre = pictures.iter().map(|p| p.camera.pose.c / n).sum::<DVec3>();
    let mut distances: Vec<f64> = matter.iter().map(|s| s.x.distance(centre)).collect();
    distances.sort_by(f64::total_cmp);
    let far = distances.get(distances.len().saturating_sub(1) * 98 / 100).copied();
    let cameras = pictures.iter().map(|p| p.camera.pose.c.distance(centre)).fold(0.0, f64::max);
    let radius = SKY * far.unwrap_or(1.0).max(cameras).max(f64::MIN_POSITIVE);
    let place =
        |&SkyPixel { d, size, rgb }: &SkyPixel| Sample { x: centre + d * radius, normal: -d, size: size * radius, rgb };
    let mut out: Vec<Sample> = found.iter().flat_map(|(_, sky)| sky.iter().map(place)).collect();
    out.sort_by(|a, b| a.size.total_cmp(&b.size));
    out
}

/// Samples, the finest first, to cells of `side` times their size.
fn merged(samples: &[Sample], side: f64) -> Vec<Cell> {
    let mut known: HashMap<(i32, [i64; 3]), usize> = HashMap::new();
    let mut cells: Vec<Cell> = Vec::new();
    for sample in samples {
        let level = (sample.size * side).log2().round();
        if !level.is_finite() {
            continue;
        }
        let level = level as i32;
        let key = |level: i32| {
            let size = f64::from(level).exp2();
            (level, (sample.x / size).to_array().map(|x| x.floor() as i64))
        };
        if (1..=FINER).any(|finer| known.contains_key(&key(level - finer))) {
            continue;
        }
        let at = *known.entry(key(level)).or_insert_with(|| {
            cells.push(Cell::default());
            cells.len() - 1
        });
        let cell = &mut cells[at];
        cell.x += sample.x;
        cell.normal += sample.normal;
        cell.size += sample.size;
        cell.count += 1.0;
        for (sum, c) in cell.rgb.iter_mut().zip(sample.rgb) {
            *sum += c;
        }
    }
    for cell in &mut cells {
        let share = 1.0 / cell.count;
        cell.x *= share;
        cell.size *= share;
        cell.rgb = cell.rgb.map(|c| c * share);
    }
    cells
}

/// A flat Gaussian for each cell.
fn gaussians(cells: &[Cell], side: f64, degree: usize) -> Result<Gaussians, splat_core::SplatError> {
    let n = cells.len();
    let mut cloud = Gaussians::new(n, degree)?;
    cloud.logit.fill(logit(OPACITY));
    let places: Vec<[f64; 3]> = cells.iter().map(|c| c.x.to_array()).collect();
    let squares = mean_squared_distances(&places);
    for (i, (cell, square)) in cells.iter().zip(squares).enumerate() {
        let size = cell.size * side;
        let across = (ACROSS * square.sqrt()).clamp(LIMITS[0] * size, LIMITS[1] * size).max(f64::MIN_POSITIVE);
        // The third axis along the normal.
        let normal = cell.normal.try_normalize().unwrap_or(DVec3::Z);
        let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
        let turn = if turn.is_finite() { turn } else { DQuat::from_xyzw(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2) };
        for (k, q) in [turn.w, turn.x, turn.y, turn.z].into_iter().enumerate() {
            cloud.wxyz[k * n + i] = q as f32;
        }
        for (k, x) in places[i].iter().enumerate() {
            cloud.mean[k * n + i] = *x as f32;
            cloud.log_scale[k * n + i] = (if k == 2 { FLAT * across } else { across }).ln() as f32;
            cloud.dc[k * n + i] = (cell.rgb[k] as f32 - 0.5) / SH_0;
        }
    }
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::render::plain_query;
    use engine::system::Layers;
    use render_core::camera::{Camera, Pose};

    /// A grey wall at depth 4 on the left, sky on the right, and nothing in the last row.
    fn picture() -> Picture {
        let (w, h) = (16, 8);
        let camera = Camera::pinhole(w, h, 16.0, 16.0, 8.0, 4.0, Pose::IDENTITY);
        let mut layers = Layers::nothing((w * h) as usize, &plain_query([0.0; 3], 0.0));
        for i in 0..(w * (h - 1)) as usize {
            let x = DVec2::new((i % 16) as f64 + 0.5, (i / 16) as f64 + 0.5);
            let wall = i % 16 < 8;
            layers.opacity[i] = 1.0;
            layers.rgb[i] = if wall { [0.5; 3] } else { [0.2, 0.4, 0.9] };
            let cos = camera.ray(x).unwrap().d.z;
            layers.median_depth[i] = if wall { (4.0 / cos) as f32 } else { f32::INFINITY };
        }
        Picture { camera, layers, is_aside: false }
    }

    #[test]
    fn walls_become_flat_gaussians_and_the_sky_far_ones() {
        let picture = picture();
        let cloud = cloud(&[&picture], &BakeOptions::DEFAULT).unwrap();
        let n = cloud.len();
        let wall: Vec<usize> = (0..n).filter(|&i| (cloud.mean[2 * n + i] - 4.0).abs() < 1e-4).collect();
        assert!((20..=56).contains(&wall.len()), "{} of 56 pixels", wall.len());
        for &i in &wall {
            // Identity or half a turn: the flat axis is the optical axis.
            let across = cloud.log_scale[i].exp();
            assert!(cloud.log_scale[2 * n + i].exp() < 0.5 * across && across > 0.05 && across < 0.5, "{across}");
            let turn =
                glam::Quat::from_xyzw(cloud.wxyz[n + i], cloud.wxyz[2 * n + i], cloud.wxyz[3 * n + i], cloud.wxyz[i]);
            assert!((turn * glam::Vec3::Z).z.abs() > 0.99);
        }
        let far = (0..n).filter(|i| !wall.contains(i));
        for i in far {
            let x = DVec3::from([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])));
            assert!(x.length() > 15.0, "{x}");
        }
        assert!(n > wall.len());
    }

    #[test]
    fn there_are_no_more_than_allowed_and_none_of_nothing() {
        let picture = picture();
        let few = BakeOptions { most: 9, ..BakeOptions::DEFAULT };
        let some = cloud(&[&picture], &few).unwrap();
        assert!((1..=9).contains(&some.len()), "{}", some.len());
        assert!(cloud(&[], &BakeOptions::DEFAULT).unwrap().is_empty());
        let camera = picture.camera;
        let nothing = Layers::nothing(picture.layers.rgb.len(), &plain_query([0.0; 3], 0.0));
        let blank = Picture { camera, layers: nothing, is_aside: false };
        assert!(cloud(&[&blank], &BakeOptions::DEFAULT).unwrap().is_empty());
    }

    #[test]
    fn coarse_samples_give_way_to_fine_ones() {
        let at = |x: f64, size: f64| Sample { x: DVec3::new(x, 0.1, 0.1), normal: DVec3::Z, size, rgb: [0.5; 3] };
        let cells = merged(&[at(0.1, 0.25), at(0.1, 0.3), at(0.1, 1.0), at(9.0, 1.0)], 1.0);
        assert_eq!(cells.len(), 2);
        assert_eq!((cells[0].count, cells[1].count), (2.0, 1.0));
    }
}
