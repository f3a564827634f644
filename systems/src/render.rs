//! A camera to a picture: whole images of layers, strip by strip.

use crate::system::{LayerRequest, Layers, Normals, Query, System};
use glam::DVec2;
use render_core::camera::Camera;
use render_core::ray::Ray;

/// Rays of one call to [`System::render_cones`]: enough work for many threads, little memory.
const STRIP: usize = 1 << 14;

/// The layers of a whole image, row by row; pixels the lens has no ray for show the background and nothing else.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// One entry a pixel.
    pub layers: Layers,
}

/// Render what `camera` sees.
pub fn render(system: &dyn System, camera: &Camera, query: &Query) -> Rendered {
    let (width, height) = (camera.width, camera.height);
    let pixels = width as usize * height as usize;
    let normals = query.layers.normals == Normals::Compute;
    let mut layers = Layers {
        rgb: vec![query.background; pixels],
        opacity: vec![0.0; pixels],
        depth: vec![f32::INFINITY; pixels],
        median_depth: vec![f32::INFINITY; pixels],
        normal: if normals { vec![[0.0; 3]; pixels] } else { Vec::new() },
    };
    let prepared = camera.prepare();
    let mut rays: Vec<Ray> = Vec::with_capacity(STRIP);
    let mut radii: Vec<f32> = Vec::with_capacity(STRIP);
    let mut places: Vec<usize> = Vec::with_capacity(STRIP);
    for pixel in 0..pixels {
        let (x, y) = (pixel % width as usize, pixel / width as usize);
        let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        if let Some(ray) = prepared.ray(centre) {
            rays.push(ray);
            radii.push(prepared.cone_radius(centre).unwrap_or(0.0) as f32);
            places.push(pixel);
        }
        if rays.len() == STRIP || pixel + 1 == pixels {
            let strip = system.render_cones(&rays, &radii, query);
            for (k, &place) in places.iter().enumerate() {
                layers.rgb[place] = strip.rgb[k];
                layers.opacity[place] = strip.opacity[k];
                layers.depth[place] = strip.depth[k];
                layers.median_depth[place] = strip.median_depth[k];
                if normals {
                    layers.normal[place] = strip.normal[k];
                }
            }
            rays.clear();
            radii.clear();
            places.clear();
        }
    }
    Rendered { width, height, layers }
}

/// A query for colour, opacity and depth.
pub fn plain_query(background: [f32; 3], error_budget: f32) -> Query {
    Query { background, layers: LayerRequest::default(), error_budget }
}
