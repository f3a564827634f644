//! What moves by itself: pixels whose flow no point that stays could make.
//!
//! With known cameras, a point that stays lies in a neighbouring picture on the epipolar line of its pixel. Its distance from there (Sampson)
//! is taken to each neighbour; above a threshold it moves. What moves along the line is not found, nor anything from cameras
//! that stand at one place.
//!
//! Without cameras the flow itself says what its points that stay have in common: a fundamental matrix, which leaves the same lines, or a homography,
//! which leaves a place for each pixel. The distances from these are judged alike.
//!
//! # Source
//! Liu et al., "Robust dynamic radiance fields", 2023, who find the lines from the flow itself; the thresholds are our own.

mod epipolar;
mod fundamental;
mod homography;
mod judge;
mod morphology;
mod relation;
mod robust;
mod two_views;

pub use judge::Motion;
pub use two_views::{Fit, FitKind, FitScore};

use epipolar::Epipolar;
use judge::{Distances, median, of_pixels};
use render_core::camera::Camera;
use scene_io::{Flow, Size};
use two_views::TwoViews;

/// Median parallax, pixels, below which the line's direction is not known: two cameras at nearly one place.
const LEAST_PARALLAX: f64 = 0.5;

/// Another photo taken at another time.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// Its camera, at its photo's size.
    pub camera: &'a Camera,
    /// Flow from the photo in question to it.
    pub flow: &'a Flow,
}

/// The pixels of a photo, taken by `camera`, that show something that moves by itself: to some neighbour their flow leads off the epipolar line,
/// by more than 0.75 pixels and by more than the errors of that flow. Specks are taken out and small gaps filled.
///
/// Neighbours whose camera stands at nearly the same place (median parallax below half a pixel) say nothing.
///
/// # Panics
/// If a flow has not the size of the camera's photo.
#[must_use]
pub fn motion(camera: &Camera, neighbours: &[Neighbour<'_>]) -> Motion {
    let known: Vec<Distances> = neighbours.iter().filter_map(|neighbour| distances(camera, neighbour)).collect();
    Motion::of(Size::from(camera), &known)
}

/// [`motion`] where no camera is known, with what was found about it by the flow to each neighbour. Flow leads off the epipolar line of a
/// fundamental matrix, or off the place that a homography says: [`Fit`] says which. A neighbour whose flow neither fits says nothing.
///
/// The same bits with any number of threads.
///
/// # Panics
/// If a flow has not the size of the photo.
#[must_use]
pub fn motion_without_cameras(photo: Size, flows: &[&Flow]) -> (Motion, Vec<Fit>) {
    for flow in flows {
        assert_eq!((flow.width, flow.height), (photo.width, photo.height), "flow and photo of two sizes");
    }
    let views: Vec<TwoViews> = flows.iter().map(|flow| TwoViews::of(flow)).collect();
    let known: Vec<Distances> = views.iter().zip(flows).filter_map(|(view, flow)| view.distances(flow)).collect();
    (Motion::of(photo, &known), views.iter().map(|view| view.fit).collect())
}

/// `None` where the neighbour says nothing.
fn distances(camera: &Camera, neighbour: &Neighbour<'_>) -> Option<Distances> {
    let flow = neighbour.flow;
    assert_eq!((flow.width, flow.height), (camera.width, camera.height), "flow and photo of two sizes");
    let epipolar = Epipolar::new(camera, neighbour.camera)?;
    let all = of_pixels(flow, |centre, way| epipolar.deviation(centre, way));
    if median(all.iter().flatten().map(|d| d.parallax).collect())? < LEAST_PARALLAX {
        return None;
    }
    let sampson: Vec<Option<f64>> = all.iter().map(|d| d.map(|d| d.sampson)).collect();
    Distances::of(&sampson)
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_without_cameras;
