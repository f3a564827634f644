//! The box that is worth a mesh: where the surface lies that several cameras agree on.

use super::depth::{DepthView, Place, known};
use crate::crop::CropBox;
use glam::DVec3;
use rayon::prelude::*;
use render_core::bounds::robust_box;

/// Points that are asked about, about.
const ASKED: usize = 40_000;
/// Cameras that must agree on a point: this number, and this share of them all.
const CAMERAS: usize = 3;
const SHARE: f64 = 0.08;
/// Depths agree within this share.
const AGREE: f64 = 0.02;
/// Points beyond this percentile of each axis are strays; the box is then grown by this share of its sides.
const STRAYS: f64 = 0.01;
const GROWN: f64 = 0.04;

/// Points of the surface that cameras agree on, and how large a pixel is there.
#[derive(Clone, Debug, Default)]
pub(super) struct Agreed {
    pub(super) points: Vec<DVec3>,
    /// World units, one a point.
    pub(super) footprints: Vec<f64>,
}

impl Agreed {
    /// Ask about evenly chosen pixels of the photos' views, inside `crop` if there is one.
    pub(super) fn new(views: &[DepthView], crop: Option<&CropBox>) -> Self {
        let photos: Vec<&DepthView> = views.iter().filter(|v| v.place == Place::Photo).collect();
        let pixels: usize = photos.iter().map(|v| v.len()).sum();
        // Odd, so that it does not fall into columns.
        let stride = (pixels / ASKED).max(1) | 1;
        let need = ((photos.len() as f64 * SHARE) as usize).max(CAMERAS).min(photos.len());
        let of_view = |view: &&DepthView| -> Vec<(DVec3, f64, usize)> {
            (0..view.len())
                .step_by(stride)
                .filter(|&i| view.is_steady(i))
                .filter_map(|i| Some((i, view.point(i)?)))
                .filter(|(_, x)| crop.is_none_or(|crop| crate::surface::inside(&x.to_array(), crop)))
                .map(|(i, x)| (x, view.footprint(i), agreeing(&photos, x)))
                .collect()
        };
        let asked: Vec<(DVec3, f64, usize)> = photos.par_iter().map(of_view).collect::<Vec<_>>().concat();
        let taken = |least: usize| -> Self {
            let kept = asked.iter().filter(|(.., n)| *n >= least);
            let (points, footprints) = kept.map(|&(x, side, _)| (x, side)).unzip();
            Self { points, footprints }
        };
        let agreed = taken(need);
        // Where hardly anything is agreed on, all of it must do.
        if agreed.points.len() * 20 < asked.len() { taken(0) } else { agreed }
    }

    /// The box around them, without strays; `None` without any point, or where they have no extent.
    pub(super) fn crop(&self) -> Option<CropBox> {
        let around = robust_box(&self.points, STRAYS)?;
        let grown = (around.max - around.min) * GROWN;
        // A flat wall has depth, too.
        let grown = grown.max(DVec3::splat(grown.max_element()));
        (grown.max_element() > 0.0).then(|| [(around.min - grown).to_array(), (around.max + grown).to_array()])
    }

    /// The side of a pixel in the middle of all.
    pub(super) fn footprint(&self) -> Option<f64> {
        let mut sorted = self.footprints.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}

/// How many views show a surface where `x` is.
fn agreeing(views: &[&DepthView], x: DVec3) -> usize {
    let shows = |view: &&&DepthView| {
        view.pixel(x).is_some_and(|(i, z)| known(view.z[i]) && f64::from((view.z[i] - z).abs()) <= AGREE * f64::from(z))
    };
    views.iter().filter(shows).count()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{all_around, seen, sphere};
    use super::*;

    #[test]
    fn the_box_holds_what_cameras_agree_on_and_nothing_else() {
        let mut views = all_around(&sphere(0.5), 20, 40);
        // One view is wrong about everything.
        views.push(seen(&sphere(1.7), DVec3::new(0.0, 0.0, 4.0), 40));
        let [min, max] = Agreed::new(&views, None).crop().unwrap();
        for k in 0..3 {
            assert!((-0.62..-0.48).contains(&min[k]) && (0.48..0.62).contains(&max[k]), "{min:?} {max:?}");
        }
        let half = [[0.0, -9.0, -9.0], [9.0; 3]];
        assert!(Agreed::new(&views, Some(&half)).points.iter().all(|x| x.x >= 0.0));
        assert!(Agreed::new(&[], None).crop().is_none());
    }
}
