//! The frames of a film: which follow each other, their cameras, and what other programs found out about them.
//!
//! A frame's neighbours are those of the next and the previous time; of several cameras at that time the nearest. The unit of scene flow
//! is such a step, also where photos in between are held out. Optical flow counts only where it goes to the neighbour: a file is of the
//! next photo of the dataset.

use crate::rays::mover_masks::MoverMasks;
use engine::data::{Dataset, View};
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::Prepared;
use render_core::ray::Ray;
use scene_io::{BitMask, Disparity, Flow, FlowPrior, SceneError};

/// The passes: the moving part at its own time, one frame on, one frame back, and two frames on or back.
pub(crate) const HERE: usize = 0;
pub(crate) const NEXT: usize = 1;
pub(crate) const PREVIOUS: usize = 2;
pub(crate) const BEYOND: usize = 3;
/// Number of passes.
pub(crate) const PASSES: usize = 4;

/// A frame, and those beside it as passes see them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frames {
    pub(crate) view: u32,
    pub(crate) beside: [Option<u32>; PASSES],
}

/// What other programs found out about a photo, at the size of the training.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FramePriors {
    pub(crate) flow: FlowPrior,
    pub(crate) disparity: Option<Disparity>,
    /// What moves.
    pub(crate) moves: Option<BitMask>,
}

impl FramePriors {
    fn of(view: &View) -> Result<Self, SceneError> {
        let (width, height) = (view.camera.width, view.camera.height);
        Ok(Self {
            flow: view.source.read_flow_prior()?.resized(width, height),
            disparity: view.source.read_disparity()?.map(|disparity| disparity.resized(width, height)),
            moves: MoverMasks::of_view(view)?,
        })
    }

    /// Whether any pixel is known to go somewhere.
    fn has_flow(&self) -> bool {
        let is_known = |flow: &Flow| flow.seen.count() > 0;
        self.flow.forward.as_ref().is_some_and(is_known) || self.flow.backward.as_ref().is_some_and(is_known)
    }

    /// Whether the disparity says which pixels are nearer than others.
    fn has_shape(&self) -> bool {
        let range = self.disparity.as_ref().and_then(Disparity::range);
        range.is_some_and(|[low, high]| low < high)
    }
}

/// The frames of a film.
#[derive(Clone, Debug)]
pub(crate) struct Film {
    /// `[views]`, the next frame of each and the one before.
    beside: Vec<[Option<u32>; 2]>,
    cameras: Vec<Prepared>,
    /// `[views]`; masks are apart.
    priors: Vec<FramePriors>,
    masks: MoverMasks,
}

/// The view of `time` whose camera is nearest.
fn nearest(data: &Dataset, time: f64, c: DVec3) -> Option<u32> {
    let at = data.views().iter().enumerate().filter(|(_, view)| view.time == time);
    let far = |view: &View| view.camera.pose.c.distance_squared(c);
    at.min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b))).map(|(i, _)| i as u32)
}

impl Film {
    /// The training views, and their priors.
    ///
    /// # Errors
    /// [`SceneError`] naming the file of a prior that cannot be read, or is of another shape than its photo.
    pub(crate) fn of(data: &Dataset) -> Result<Self, SceneError> {
        let priors = data.views().par_iter().map(FramePriors::of).collect::<Result<Vec<_>, _>>()?;
        Ok(Self::with(data, priors))
    }

    /// The training views with these priors.
    pub(crate) fn with(data: &Dataset, mut priors: Vec<FramePriors>) -> Self {
        let mut times: Vec<f64> = data.views().iter().map(|view| view.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        let beside: Vec<[Option<u32>; 2]> = data
            .views()
            .iter()
            .map(|view| {
                let step = times.partition_point(|time| *time < view.time);
                let at = |step: Option<usize>| nearest(data, *times.get(step?)?, view.camera.pose.c);
                [at(Some(step + 1)), at(step.checked_sub(1))]
            })
            .collect();
        let frame = |view: u32| data.view(view as usize).frame;
        for (v, (prior, [next, previous])) in priors.iter_mut().zip(&beside).enumerate() {
            let own = frame(v as u32);
            if next.is_none_or(|next| frame(next) != own + 1) {
                prior.flow.forward = None;
            }
            if previous.is_none_or(|previous| frame(previous) + 1 != own) {
                prior.flow.backward = None;
            }
        }
        let masks = MoverMasks::new(priors.iter_mut().map(|prior| prior.moves.take()).collect());
        Self { beside, cameras: data.views().iter().map(|view| view.camera.prepare()).collect(), priors, masks }
    }

    /// The next frame and the one before.
    fn neighbours(&self, view: u32) -> [Option<u32>; 2] {
        self.beside[view as usize]
    }

    /// A frame and those beside it; the last of them two frames on or back, as `chained` says.
    pub(super) fn frames(&self, view: u32, chained: Option<usize>) -> Frames {
        let [next, previous] = self.neighbours(view);
        let beyond = match chained {
            Some(NEXT) => next.and_then(|next| self.neighbours(next)[0]),
            Some(_) => previous.and_then(|previous| self.neighbours(previous)[1]),
            None => None,
        };
        let mut beside = [None; PASSES];
        (beside[HERE], beside[NEXT], beside[PREVIOUS], beside[BEYOND]) = (Some(view), next, previous, beyond);
        Frames { view, beside }
    }

    /// Cameras of all frames.
    pub(crate) fn cameras(&self) -> &[Prepared] {
        &self.cameras
    }

    /// Where in its photo a ray goes through, pixels; the middle of pixel `place` where the lens cannot say.
    pub(super) fn pixel_of(&self, view: u32, ray: &Ray, place: [u16; 2]) -> [f32; 2] {
        let found = self.cameras[view as usize].project(ray.o + ray.d);
        found.map_or(place.map(|at| f32::from(at) + 0.5), |pixel| pixel.to_array().map(|x| x as f32))
    }

    /// Of the angle between a ray and the optical axis of its photo.
    pub(super) fn cosine(&self, view: u32, ray: &Ray) -> f64 {
        self.cameras[view as usize].camera().pose.r.z_axis.dot(ray.d)
    }

    /// Optical flow of a pixel to the frame of `pass`, [`NEXT`] or [`PREVIOUS`]; `None` where it is not known.
    pub(crate) fn flow(&self, view: u32, pass: usize, [x, y]: [u16; 2]) -> Option<[f32; 2]> {
        let prior = &self.priors[view as usize].flow;
        let flow = if pass == NEXT { prior.forward.as_ref() } else { prior.backward.as_ref() }?;
        let (x, y) = (u32::from(x), u32::from(y));
        let inside = x < flow.width && y < flow.height;
        (inside && flow.seen.get(x, y)).then(|| flow.vectors[(y * flow.width + x) as usize])
    }

    /// Disparity of a pixel, larger where nearer; `None` where it is not known.
    pub(super) fn disparity(&self, view: u32, [x, y]: [u16; 2]) -> Option<f32> {
        let prior = self.priors[view as usize].disparity.as_ref()?;
        let (x, y) = (u32::from(x), u32::from(y));
        let inside = x < prior.width && y < prior.height;
        (inside && prior.known.get(x, y)).then(|| prior.values[(y * prior.width + x) as usize])
    }

    /// Whether a pixel moves; `None` where no mask says so.
    pub(crate) fn moves(&self, view: u32, place: [u16; 2]) -> Option<bool> {
        self.masks.moves(view, place)
    }

    /// What motion masks say.
    pub(in crate::rays) fn masks(&self) -> &MoverMasks {
        &self.masks
    }

    /// What is known of the frames, a line for each kind of prior.
    pub(crate) fn lines(&self) -> Vec<String> {
        let n = self.priors.len();
        let count = |has: fn(&FramePriors) -> bool| self.priors.iter().filter(|prior| has(prior)).count();
        let flow = count(FramePriors::has_flow);
        let [disparity, shapes] = [count(|prior| prior.disparity.is_some()), count(FramePriors::has_shape)];
        let alone = self.beside.iter().filter(|beside| beside.iter().all(Option::is_none)).count();
        let mut lines = Vec::new();
        if alone == n {
            lines.push("scene flow: the photos are all of one time, so no frame has another beside it".into());
        }
        lines.push(match flow {
            0 => "scene flow: no optical flow to the neighbouring photos (`flow/`), so nothing is held to it".into(),
            _ => format!("scene flow: held to the optical flow of {flow} of {n} photos"),
        });
        lines.push(match [disparity, shapes] {
            [0, _] => "depth: no disparities (`disp/`), so what moves is as deep as the photos alone say".into(),
            [some, 0] => format!(
                "depth: the disparities of {some} of {n} photos are the same everywhere, which says nothing of shapes, so nothing is held to them"
            ),
            [_, some] => format!("depth: what moves is held to the disparities of {some} of {n} photos"),
        });
        lines.push(self.masks.line());
        lines
    }
}
