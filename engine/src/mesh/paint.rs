//! Colours of vertices, from the pictures that show them.

use super::depth::{DepthView, Place};
use super::smooth::Neighbours;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use scene_io::export::Mesh;

/// Rounds in which vertices that no picture shows take their neighbours' colour.
const ROUNDS: usize = 64;
/// Of those that even then have none.
const GREY: Vec3 = Vec3::splat(0.5);

/// Mean colour of what the photos' views show within `reach` of each vertex, those that face it first.
/// sRGB, `0..=1`.
pub(super) fn paint(mesh: &Mesh, views: &[DepthView], reach: f64) -> Vec<Vec3> {
    let photos: Vec<&DepthView> = views.iter().filter(|v| v.place == Place::Photo).collect();
    let mut colours: Vec<Option<Vec3>> = mesh
        .vertices
        .par_iter()
        .map(|x| {
            let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
            for view in &photos {
                if let Some((rgb, w)) = seen(view, DVec3::from(*x), reach) {
                    sum += rgb * w;
                    weight += w;
                }
            }
            (weight > 0.0).then(|| sum / weight)
        })
        .collect();
    let neighbours = Neighbours::new(mesh);
    let mut left: Vec<usize> = (0..colours.len()).filter(|&v| colours[v].is_none()).collect();
    for _ in 0..ROUNDS {
        let known: Vec<(usize, Vec3)> = left
            .iter()
            .filter_map(|&v| {
                let of: Vec<Vec3> = neighbours.of(v).iter().filter_map(|w| colours[*w as usize]).collect();
                (!of.is_empty()).then(|| (v, of.iter().sum::<Vec3>() / of.len() as f32))
            })
            .collect();
        if known.is_empty() {
            break;
        }
        known.into_iter().for_each(|(v, colour)| colours[v] = Some(colour));
        left.retain(|&v| colours[v].is_none());
    }
    colours.into_iter().map(|c| c.unwrap_or(GREY)).collect()
}

/// What a view shows at `x`, and how much that counts: near, straight, away from edges.
fn seen(view: &DepthView, x: DVec3, reach: f64) -> Option<(Vec3, f32)> {
    let (i, z) = view.pixel(x)?;
    let w = view.weight[i];
    if w <= 0.0 || f64::from((view.z[i] - z).abs()) > reach {
        return None;
    }
    let side = z / view.camera.fx as f32;
    Some((Vec3::from(view.rgb[i].map(|c| f32::from(c) / 255.0)), w * w / (side * side)))
}
