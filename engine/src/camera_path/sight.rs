//! What photos saw of a frame: the share of its pixels that show a place which at least two photos show, too.

use super::BOUND;
use super::rig::median;
use crate::data::Dataset;
use crate::error::RunError;
use crate::picture::limited;
use crate::render::Rendered;
use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::coverage::{DepthMap, Observer, Target, seen_by};
use render_core::path::order;
use std::fmt::Write;

/// Draws a camera of the scene's frame at a time, without anything but colour, opacity and depth.
pub type Draw<'a> = dyn Fn(&Camera, f64) -> Result<Rendered, RunError> + 'a;

/// File of the shares, beside the frames.
pub const SEEN_FILE: &str = "coverage.csv";
/// Longest side of the pictures that are drawn to find out, pixels.
const SIDE: u32 = 48;
/// Photos that are asked, at most: those that lie farthest apart.
const PHOTOS: usize = 64;
/// Photos that must have seen a place: depth takes two.
const LEAST: usize = 2;
/// Opacity from which on a pixel shows a surface.
const OPAQUE: f32 = 0.5;
/// Surfaces this many times farther than usual are at infinity.
const INFINITE: f64 = 30.0;
/// Frames that a line names.
const NAMED: usize = 8;

/// What the photos of a run saw, by what its field or cloud shows from there.
pub struct Sight<'a> {
    draw: &'a Draw<'a>,
    witnesses: Vec<Observer>,
    /// Index of each in the dataset, and the distance of what it shows in its middle.
    photos: Vec<(usize, Option<f64>)>,
    poses: Vec<Pose>,
    of: usize,
    scale: f64,
    /// Whether surfaces hide what is behind them: not taken into account where things move.
    hides: bool,
}

impl<'a> Sight<'a> {
    /// Draw the photos' depth once, small. A scene that moves hides nothing: photos of other times do not say what hid what.
    ///
    /// # Errors
    /// Those of `draw`.
    ///
    /// # Panics
    /// If a picture of `draw` lacks pixels.
    pub fn new(data: &Dataset, draw: &'a Draw<'a>) -> Result<Self, RunError> {
        let all: Vec<usize> = (0..data.len()).filter(|&i| data.view(i).level == 0).collect();
        let poses: Vec<Pose> = all.iter().map(|&i| data.view(i).camera.pose).collect();
        let extent = poses.iter().flat_map(|p| poses.first().map(|q| p.c.distance(q.c))).fold(0.0, f64::max);
        let taken = order::farthest_points(&poses, if extent > 0.0 { extent } else { 1.0 }, PHOTOS);
        let hides = data.time_steps() <= 1;
        let mut photos = Vec::with_capacity(taken.len());
        let mut maps = Vec::with_capacity(taken.len());
        for &k in &taken {
            let view = data.view(all[k]);
            let small = limited(&view.camera, Some(SIDE));
            let map = depth_map(&draw(&small, view.time)?);
            photos.push((all[k], middle(&map)));
            maps.push((view.camera, map));
        }
        let scale = median(photos.iter().filter_map(|p| p.1).collect()).filter(|s| *s > 0.0).unwrap_or(1.0);
        let blur = 1.0 / (INFINITE * scale);
        let witness = |(camera, map): (Camera, DepthMap)| {
            Observer::new(&camera, hides.then_some(DepthMap { disparity_tolerance: blur, ..map }))
        };
        let witnesses: Vec<Observer> = maps.into_iter().map(witness).collect();
        let poses = witnesses.iter().map(|w| w.camera().pose).collect();
        Ok(Self { draw, witnesses, photos, poses, of: all.len(), scale, hides })
    }

    /// Distance of what a photo shows in its middle, world units; `None` for photos that were not drawn, and where nothing is.
    pub(super) fn depth_of(&self, view: usize) -> Option<f64> {
        self.photos.iter().find(|p| p.0 == view).and_then(|p| p.1)
    }

    /// The share of a frame that at least two photos saw; pixels that the lens has no ray for do not count.
    ///
    /// # Errors
    /// Those of drawing.
    ///
    /// # Panics
    /// As [`Sight::new`].
    pub fn share(&self, camera: &Camera, time: f64) -> Result<f64, RunError> {
        let small = limited(camera, Some(SIDE));
        let view = (self.draw)(&small, time)?;
        let prepared = small.prepare();
        // The nearest photos first: two are found soon.
        let mut nearest: Vec<(f64, &Observer)> = self
            .poses
            .iter()
            .zip(&self.witnesses)
            .map(|(p, w)| (order::pose_distance(p, &camera.pose, self.scale), w))
            .collect();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        let least = LEAST.min(nearest.len());
        let pixel = |i: usize| {
            let width = small.width as usize;
            let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let ray = prepared.ray(at)?;
            let distance = view.layers.median_depth[i];
            let target = match distance.is_finite() && view.layers.opacity[i] >= OPAQUE {
                true => Target::Point(ray.at(f64::from(distance))),
                false => Target::Sky(ray.d),
            };
            Some(seen_by(nearest.iter().map(|n| n.1), target, least))
        };
        let pixels: Vec<Option<bool>> = (0..view.layers.opacity.len()).into_par_iter().map(pixel).collect();
        let rays = pixels.iter().flatten().count();
        let seen = pixels.iter().flatten().filter(|seen| **seen).count();
        Ok(if rays > 0 { seen as f64 / rays as f64 } else { 1.0 })
    }

    /// What is not taken into account, for people; `None` where everything is.
    #[must_use]
    pub fn limits(&self) -> Option<String> {
        match (self.hides, self.witnesses.len() < self.of) {
            (false, _) => Some("things move: what hides what is not taken into account".into()),
            (true, true) => Some(format!("by {} of {} photos", self.witnesses.len(), self.of)),
            (true, false) => None,
        }
    }
}

/// Distances where surfaces are.
fn depth_map(view: &Rendered) -> DepthMap {
    let layers = &view.layers;
    let surface = |(t, o): (&f32, &f32)| if *o >= OPAQUE { *t } else { f32::INFINITY };
    DepthMap {
        width: view.width as usize,
        height: view.height as usize,
        distance: layers.median_depth.iter().zip(&layers.opacity).map(surface).collect(),
        disparity_tolerance: 0.0,
    }
}

/// Median distance in the middle third of a picture; `None` where that shows nothing.
fn middle(map: &DepthMap) -> Option<f64> {
    let (w, h) = (map.width, map.height);
    let rows = (h / 3)..(h - h / 3);
    let columns = || (w / 3)..(w - w / 3);
    let at = rows.flat_map(|y| columns().map(move |x| f64::from(map.distance[y * w + x])));
    let hit: Vec<f64> = at.clone().filter(|t| t.is_finite()).collect();
    if 2 * hit.len() < at.count() { None } else { median(hit) }
}

/// One line about the shares of all frames: the least, the mean, and the frames below [`BOUND`].
#[must_use]
pub fn coverage_line(shares: &[f64], limits: Option<&str>) -> String {
    let n = shares.len().max(1) as f64;
    let least = shares.iter().copied().fold(1.0, f64::min);
    let mean = shares.iter().sum::<f64>() / n;
    let mut line = format!(
        "seen by two photos: {:.0} % of each frame at least, {:.0} % in the mean",
        100.0 * least.max(0.0),
        100.0 * mean
    );
    if let Some(limits) = limits {
        let _ = write!(line, " ({limits})");
    }
    let below: Vec<String> = (0..shares.len()).filter(|&i| shares[i] < BOUND).map(|i| i.to_string()).collect();
    if !below.is_empty() {
        let named = below[..below.len().min(NAMED)].join(", ");
        let more = if below.len() > NAMED { format!(" and {} more", below.len() - NAMED) } else { String::new() };
        let _ = write!(
            line,
            "; {} of {} frames show more than {:.0} % that fewer saw, expect fog there: {named}{more}",
            below.len(),
            shares.len(),
            100.0 * (1.0 - BOUND)
        );
    }
    line
}

/// The shares as a table: `frame,seen_by_two`.
#[must_use]
pub fn coverage_csv(shares: &[f64]) -> String {
    let mut text = String::from("frame,seen_by_two\n");
    for (i, share) in shares.iter().enumerate() {
        let _ = writeln!(text, "{i},{share:.4}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_names_the_frames_that_leave_what_photos_saw() {
        let line = coverage_line(&[1.0, 0.95, 0.5, 1.0], None);
        assert_eq!(
            line,
            "seen by two photos: 50 % of each frame at least, 86 % in the mean; 1 of 4 frames show more than 10 % that \
             fewer saw, expect fog there: 2"
        );
        let good = coverage_line(&[1.0, 0.9], Some("by 64 of 99 photos"));
        assert!(good.ends_with("95 % in the mean (by 64 of 99 photos)"), "{good}");
        assert!(coverage_line(&[0.0; 30], None).ends_with("0, 1, 2, 3, 4, 5, 6, 7 and 22 more"));
        assert_eq!(coverage_csv(&[1.0, 0.25]), "frame,seen_by_two\n0,1.0000\n1,0.2500\n");
    }

    #[test]
    fn the_middle_of_a_picture_is_where_most_of_it_is_hit() {
        let map = |distance: Vec<f32>| DepthMap { width: 3, height: 3, distance, disparity_tolerance: 0.0 };
        let mut distance = vec![f32::INFINITY; 9];
        assert_eq!(middle(&map(distance.clone())), None);
        distance[4] = 2.0;
        assert_eq!(middle(&map(distance)), Some(2.0));
    }
}
