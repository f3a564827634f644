//! A rehearsal: a few steps of a copy of the system, to see what training really takes.
//!
//! What a step needs besides parameters depends on the photos, on the number of threads and on how many samples rays have.
//! Formulas for it went wrong by factors; so the process is measured while the work is done. The run's own system is not
//! touched: its bits do not depend on the rehearsal.

use crate::data::Dataset;
use crate::halt::Halt;
use crate::memory::work::Work;
use crate::options::Stop;
use crate::render::plain_query;
use crate::system::{Fit, Query, System};
use render_core::camera::Camera;
use render_core::ray::Ray;
use std::time::Duration;

/// Steps at most: batches have grown to their size, empty space was searched again, and the buffers of most chunks have met
/// a large one.
const STEPS: u64 = 40;
/// No further step after this work.
const ENOUGH: Duration = Duration::from_secs(3);
/// Rays that are rendered at most: those of a strip of a picture.
const RAYS: usize = 1 << 14;
/// Rays that are rendered first; then four times as many, and so on, while that is quick.
const FIRST_RAYS: usize = 64;
/// No more rays where they would take longer than this.
const QUICK: Duration = Duration::from_secs(4);

/// Training views that a pre-pass is tried on.
const PREPASSES: usize = 3;

/// Train a copy of a run's system for some steps, render a strip of a picture with it, and do the pre-pass of some photos where it has
/// one. What goes wrong in it will go wrong again in the training, and is reported there. Whether it has a pre-pass.
pub fn rehearse(copy: &mut dyn System, views: &Dataset, stop: Option<Stop>, halt: &Halt) -> bool {
    let work = Work::begin();
    for step in 0..STEPS {
        // No more than the training itself will do.
        let trained = stop.is_some_and(|stop| stop.reached(step, work.done().as_secs_f64()));
        if trained || halt.raised() || copy.step(views, step).is_err() || work.done() > ENOUGH {
            break;
        }
    }
    if let Some(view) = views.views().first() {
        let (rays, radii) = strip(&view.camera);
        render_some(copy, &view.camera, &rays, &radii, halt);
        fit_once(copy, &rays, view.time, halt);
    }
    let work = Work::begin();
    let mut has_prepass = false;
    for (i, view) in views.views().iter().enumerate().take(PREPASSES) {
        if halt.raised() || work.done() > ENOUGH {
            break;
        }
        let pixels = f64::from(view.camera.width) * f64::from(view.camera.height);
        // As many rays as a strip has: buffers are of a few hundred.
        let stride = (pixels / RAYS as f64).sqrt().ceil().max(1.0) as u32;
        has_prepass |= copy.prepass(views, i, stride).unwrap_or(false);
    }
    has_prepass
}

/// Rays of a strip from the middle of the picture, where there is most to see, and the radii of their cones.
fn strip(camera: &Camera) -> (Vec<Ray>, Vec<f32>) {
    let prepared = camera.prepare();
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let skipped = (camera.width as usize * camera.height as usize).saturating_sub(RAYS) / 2;
    let centres = pixels.skip(skipped).take(RAYS).map(|(x, y)| glam::dvec2(x.into(), y.into()) + 0.5);
    centres.filter_map(|at| Some((prepared.ray(at)?, prepared.cone_radius(at).unwrap_or(0.0) as f32))).unzip()
}

/// One step of fitting an appearance, as each held-out view begins with it: the samples of all its rays are kept meanwhile, and a
/// field that has hardly trained has samples everywhere.
fn fit_once(copy: &dyn System, rays: &[Ray], time: f64, halt: &Halt) {
    let rgb = vec![[0.5; 3]; rays.len()];
    copy.fit_appearance(&Fit { rays, rgb: &rgb, time, background: [0.0; 3], steps: 1, lr: 0.1, seed: 0, halt });
}

/// Rays of a strip, fewer where they take long: networks as published need for one tile what they need for all.
fn render_some(copy: &dyn System, camera: &Camera, rays: &[Ray], radii: &[f32], halt: &Halt) {
    let query = Query { halt: halt.clone(), ..plain_query([0.0; 3], 0.0) };
    if copy.render_view(camera, &query).is_some() {
        return;
    }
    let mut count = FIRST_RAYS.min(rays.len());
    while !halt.raised() {
        let work = Work::begin();
        copy.render_cones(&rays[..count], &radii[..count], &query);
        if count == rays.len() || 4 * work.done() > QUICK {
            break;
        }
        count = (4 * count).min(rays.len());
    }
}
