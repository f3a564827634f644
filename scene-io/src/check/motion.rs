//! What priors of motion hold, and what looks wrong about them.

use crate::listing::listing;
use crate::priors::Disparity;
use crate::{Frame, Problem, Scene, SceneError};
use rayon::prelude::*;

/// What the priors of motion of a dataset hold: optical flow, disparity, masks of what moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionSummary {
    /// Photos with flow to the next one that could be read.
    pub forward: usize,
    /// Photos with flow to the one before that could be read.
    pub backward: usize,
    /// Mean share of the pixels of all these in which the flow is valid.
    pub valid: f64,
    /// Disparities that could be read.
    pub disparities: usize,
    /// Masks of what moves that could be read.
    pub masks: usize,
    /// Mean share of their pixels that moves.
    pub moving: f64,
}

impl MotionSummary {
    /// Lines for a report, one for each kind that is there.
    pub(super) fn lines(&self) -> Vec<String> {
        let Self { forward, backward, valid, disparities, masks, moving } = *self;
        let mut lines = Vec::new();
        if forward + backward > 0 {
            let both = format!("{forward} to the next photo, {backward} to the one before");
            lines.push(format!("flow: {both}, {:.1} % of the pixels valid", 100.0 * valid));
        }
        if disparities > 0 {
            lines.push(format!("disparity: {disparities} maps, no unit"));
        }
        if masks > 0 {
            lines.push(format!("motion masks: {masks}, {:.1} % of the pixels move", 100.0 * moving));
        }
        lines
    }
}

/// What a frame's files say, in numbers.
#[derive(Default)]
struct Found {
    /// Shares of valid pixels.
    forward: Option<f64>,
    backward: Option<f64>,
    disparity: Option<Shape>,
    /// Share of moving pixels.
    moving: Option<f64>,
    problems: Vec<Problem>,
}

#[derive(Clone, Copy, PartialEq)]
enum Shape {
    Empty,
    Flat,
    Usual,
}

/// What the priors of motion hold, each file read once, and what is wrong with them; `None` where none could be read.
pub(super) fn motion(scene: &Scene) -> (Option<MotionSummary>, Vec<Problem>) {
    let found: Vec<Found> = scene.frames.par_iter().map(read_all).collect();
    let mut summary = MotionSummary::default();
    let mut problems = Vec::new();
    let (mut lost, mut flat, mut empty, mut all) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (frame, found) in scene.frames.iter().zip(found) {
        let name = frame.name.as_str();
        problems.extend(found.problems);
        summary.forward += usize::from(found.forward.is_some());
        summary.backward += usize::from(found.backward.is_some());
        for share in [found.forward, found.backward].into_iter().flatten() {
            summary.valid += share;
            if share == 0.0 && lost.last() != Some(&name) {
                lost.push(name);
            }
        }
        if let Some(shape) = found.disparity {
            summary.disparities += 1;
            match shape {
                Shape::Empty => empty.push(name),
                Shape::Flat => flat.push(name),
                Shape::Usual => {}
            }
        }
        if let Some(share) = found.moving {
            summary.masks += 1;
            summary.moving += share;
            if share == 1.0 {
                all.push(name);
            }
        }
    }
    for (names, what, remedy) in [
        (lost, "a flow is valid nowhere", "check how it was made, or remove it"),
        (flat, "the disparity is the same everywhere, which says nothing of shapes,", "make it anew, or remove it"),
        (empty, "no disparity is known anywhere", "make it anew, or remove it"),
        (all, "everything moves, as the masks say,", "check that white is what moves"),
    ] {
        if !names.is_empty() {
            problems.push(Problem::new(&scene.root, format!("{what} in {}", listing(&names)), remedy).warning());
        }
    }
    if summary == MotionSummary::default() {
        return (None, problems);
    }
    summary.valid /= (summary.forward + summary.backward).max(1) as f64;
    summary.moving /= summary.masks.max(1) as f64;
    (Some(summary), problems)
}

/// Reads all of a frame's priors of motion.
fn read_all(frame: &Frame) -> Found {
    let mut found = Found::default();
    let files = &frame.priors.motion;
    let [forward, backward] = [&files.forward, &files.backward].map(|path| {
        let flow = kept(frame.read_flow_file(path.as_deref()), &mut found.problems);
        flow.map(|flow| flow.seen.share())
    });
    (found.forward, found.backward) = (forward, backward);
    let disparity = kept(frame.read_disparity(), &mut found.problems);
    found.disparity = disparity.as_ref().map(shape);
    found.moving = kept(frame.read_motion_mask(), &mut found.problems).map(|mask| mask.share());
    found
}

fn kept<T>(read: Result<Option<T>, SceneError>, problems: &mut Vec<Problem>) -> Option<T> {
    read.unwrap_or_else(|error| {
        problems.push(error.into_problem());
        None
    })
}

fn shape(disparity: &Disparity) -> Shape {
    match disparity.range() {
        None => Shape::Empty,
        Some([low, high]) if low == high => Shape::Flat,
        Some(_) => Shape::Usual,
    }
}
