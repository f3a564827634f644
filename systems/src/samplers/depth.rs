//! Measured depth leads a march: samples lie around it, and where the field disagrees most it is the measurement that gives way
//! (EndoNeRF, Wang et al., 2022, section 2).

use crate::buffers::sized;
use crate::space::Space;
use engine::data::Dataset;
use engine::render::plain_query;
use engine::system::{Query, System, SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use losses::kernel::Kernel;
use rayon::prelude::*;
use render_core::bounds::percentile;
use render_core::ray::Ray;
use render_core::sample::{DepthCue, depth_cued};
use scene_io::SceneError;
use serde::{Deserialize, Serialize};

/// What is made of measured depth. Fields of a system's settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthCueConfig {
    /// Factor of the depth loss; 0: none.
    pub depth: f32,
    /// Width of its Huber kernel, a share of the range of depths.
    pub depth_delta: f32,
    /// Samples of a ray around its measured depth, besides those of the march; 0: none.
    pub cue_samples: usize,
    /// Their spread, a share of the range of depths, and the share of them that lies anywhere.
    pub cue_spread: f32,
    /// See `cue_spread`.
    pub cue_anywhere: f32,
    /// Steps between rounds in which measured depths give way to rendered ones; 0: they never do.
    pub refine_every: u64,
    /// Rounds of it.
    pub refine_rounds: u64,
    /// Share of a photo's depths that give way in a round.
    pub refine_share: f32,
}

impl DepthCueConfig {
    /// Measured depth is left alone.
    pub const NONE: Self = Self {
        depth: 0.0,
        depth_delta: 0.2,
        cue_samples: 0,
        cue_spread: 0.05,
        cue_anywhere: 0.1,
        refine_every: 0,
        refine_rounds: 4,
        refine_share: 0.1,
    };

    /// Whether anything is made of it.
    pub(crate) fn asks(&self) -> bool {
        self.depth > 0.0 || self.cue_samples > 0
    }

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        for (field, value, range) in [
            ("depth", self.depth, 0.0..=1e3),
            ("depth_delta", self.depth_delta, 1e-4..=1e3),
            ("cue_samples", self.cue_samples as f32, 0.0..=1024.0),
            ("cue_spread", self.cue_spread, 0.0..=10.0),
            ("cue_anywhere", self.cue_anywhere, 0.0..=1.0),
            ("refine_share", self.refine_share, 0.0..=1.0),
        ] {
            if !range.contains(&value) {
                let problem = format!("must be in {}..={}", range.start(), range.end());
                return Err(SystemError::Config { field, value: value.to_string(), problem });
            }
        }
        Ok(())
    }
}

/// The intervals of a ray: those of `t`, `dt` from `first` on.
pub(crate) struct Intervals<'a> {
    /// Where they begin.
    pub(crate) t: &'a mut Vec<f32>,
    /// Their lengths.
    pub(crate) dt: &'a mut Vec<f32>,
    pub(crate) first: usize,
}

/// Room for [`MeasuredDepth::cut`]: random numbers, places of cuts, the intervals before.
#[derive(Default)]
pub(crate) struct CutRoom {
    u: Vec<f32>,
    places: Vec<f32>,
    marched: Vec<(f32, f32)>,
}

/// Measured depth of the training views.
pub(crate) struct MeasuredDepth {
    config: DepthCueConfig,
    /// `[views][height][width]`, internal distance along the pixel's ray; 0 where nothing is known.
    t: Vec<Vec<f32>>,
    /// `[views]`
    widths: Vec<usize>,
    /// Spread of depths over all views, internal units.
    range: f32,
}

/// Rays of a round of refinement, roughly: a few seconds.
const REFINE_RAYS: u64 = 150_000;
/// Shares of the depths at the ends of their range (EndoNeRF's own).
const NEAREST: f64 = 0.03;
const FURTHEST: f64 = 0.999;
/// Measured depths that the range is found from, of all photos together.
const KNOWN: usize = 1 << 24;

impl MeasuredDepth {
    /// Those of the training views, where any has depth.
    pub(crate) fn read(config: DepthCueConfig, space: &Space, data: &Dataset) -> Result<Option<Self>, SceneError> {
        let views: Vec<Vec<f32>> =
            (0..data.len()).into_par_iter().map(|i| distances(space, data, i)).collect::<Result<_, _>>()?;
        let pixels: usize = views.iter().map(Vec::len).sum();
        let some = views.iter().flatten().step_by(pixels.div_ceil(KNOWN).max(1));
        let mut known: Vec<f64> = some.filter(|&&t| t > 0.0).map(|&t| f64::from(t)).collect();
        known.sort_unstable_by(f64::total_cmp);
        let [Some(near), Some(middle), Some(far)] = [NEAREST, 0.5, FURTHEST].map(|share| percentile(&known, share))
        else {
            return Ok(None);
        };
        // Depths that are all the same have no range.
        let range = (far - near).max(1e-3 * middle) as f32;
        let widths = data.views().iter().map(|view| view.camera.width as usize).collect();
        Ok(Some(Self { config, t: views, widths, range }))
    }

    /// Measured distance of a pixel; 0 where nothing is known.
    pub(crate) fn at(&self, view: u32, [x, y]: [u16; 2]) -> f32 {
        let width = self.widths[view as usize];
        self.t[view as usize].get(usize::from(y) * width + usize::from(x)).copied().unwrap_or(0.0)
    }

    /// Cut a ray's intervals at places around its measured distance, where that is asked for: a march that steps over space alone
    /// places no more samples where a surface was measured. What is known to be empty stays so. How many cuts.
    pub(crate) fn cut(
        &self,
        start: f32,
        end: f32,
        depth: f32,
        jitter: f32,
        intervals: Intervals<'_>,
        room: &mut CutRoom,
    ) -> u32 {
        let n = self.config.cue_samples;
        if n == 0 || depth <= 0.0 || end <= start {
            return 0;
        }
        let Intervals { t, dt, first } = intervals;
        let CutRoom { u, places, marched } = room;
        let cue = DepthCue { sigma: self.config.cue_spread * self.range, uniform_share: self.config.cue_anywhere };
        u.clear();
        u.resize(n, jitter);
        let places = sized(places, n);
        depth_cued(start, end, depth, cue, u, places);
        marched.clear();
        marched.extend(t[first..].iter().copied().zip(dt[first..].iter().copied()));
        t.truncate(first);
        dt.truncate(first);
        let mut next = 0;
        for &(mut from, length) in &*marched {
            let to = from + length;
            next += places[next..].iter().take_while(|&&p| p <= from).count();
            while let Some(&p) = places.get(next).filter(|&&p| p < to) {
                next += 1;
                // Places may fall on each other.
                if p > from {
                    t.push(from);
                    dt.push(p - from);
                    from = p;
                }
            }
            t.push(from);
            dt.push(to - from);
        }
        (t.len() - first - marched.len()) as u32
    }

    /// What the expected distance of a ray, `sum w t / sum w`, costs; `factor` times its derivative is added to `w_bar`. Each
    /// sample counts where the middle of its interval is, as renders have it.
    pub(crate) fn learn(&self, w: &[f32], t: &[f32], dt: &[f32], measured: f32, factor: f32, w_bar: &mut [f32]) -> f32 {
        let at = |i: usize| t[i] + 0.5 * dt[i];
        let sum: f32 = w.iter().sum::<f32>() + 1e-6;
        let found = (0..w.len()).map(|i| w[i] * at(i)).sum::<f32>() / sum;
        let kernel = Kernel::Huber { delta: self.config.depth_delta };
        let derivative = self.config.depth * kernel.derivative(found / self.range, measured / self.range) / self.range;
        for (i, bar) in w_bar.iter_mut().enumerate() {
            *bar += factor * derivative * (at(i) - found) / sum;
        }
        self.config.depth * kernel.value(found / self.range, measured / self.range)
    }

    /// Whether rendered depth is held to measured depth.
    pub(crate) fn holds(&self) -> bool {
        self.config.depth > 0.0
    }

    /// Steps of the schedule between one refinement and the next.
    pub(crate) fn every(&self) -> u64 {
        self.config.refine_every
    }

    /// Whether measurements give way before this step of the schedule.
    pub(crate) fn is_due(&self, step: u64) -> bool {
        let DepthCueConfig { refine_every, refine_rounds, .. } = self.config;
        refine_every > 0 && step > 0 && step.is_multiple_of(refine_every) && step / refine_every <= refine_rounds
    }

    /// Let the measured depths that disagree most with those that `system` renders give way to these (EndoNeRF, depth refinement). A
    /// depth under a mask or without a rendered counterpart stays.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub(crate) fn refine(
        &mut self,
        system: &dyn System,
        space: &Space,
        background: [f32; 3],
        data: &Dataset,
        step: u64,
    ) -> Result<(), SystemError> {
        // Of many photos, some pixels in each round: others each time.
        let stride = (data.pixel_count() as f64 / REFINE_RAYS as f64).sqrt().ceil().max(1.0) as usize;
        let round = (step / self.config.refine_every) as usize;
        let [column, row] = [round % stride, round / stride % stride];
        for view in 0..data.len() {
            let (seen, image) = (data.view(view), data.image(view)?);
            let width = seen.camera.width;
            let used = |k: usize| image.mask.as_ref().is_none_or(|mask| mask[k] >= 128);
            let turn = |k: usize| k % width as usize % stride == column && k / width as usize % stride == row;
            let asked = (0..self.t[view].len()).filter(|&k| turn(k) && self.t[view][k] > 0.0 && used(k));
            let known: Vec<usize> = asked.collect();
            let place = |k: usize| seen.ray(k as u32 % width, k as u32 / width);
            let rays: Vec<Ray> = known.iter().filter_map(|&k| place(k)).collect();
            let query = Query { time: seen.time, ..plain_query(background, 1.0 / 255.0) };
            let depth = system.render(&rays, &query).depth;
            let internal = |(ray, t): (&Ray, f32)| {
                if t.is_finite() { space.internal_distance(ray, t.into()) } else { 0.0 }
            };
            let found: Vec<f32> = rays.iter().zip(depth).map(internal).collect();
            give_way(&mut self.t[view], &known, &found, self.config.refine_share);
        }
        Ok(())
    }

    /// What later steps depend on; nothing while measurements are as they were read.
    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        let view = |(i, t): (usize, &Vec<f32>)| Tensor {
            shape: vec![t.len()],
            ..f32_tensor(format!("cues.{i}"), t).into_owned()
        };
        if self.config.refine_every == 0 { Vec::new() } else { self.t.iter().enumerate().map(view).collect() }
    }

    /// Put back what [`MeasuredDepth::state`] gave.
    pub(crate) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        if self.config.refine_every > 0 {
            let read = |(i, t): (usize, &Vec<f32>)| take_f32(state, &format!("cues.{i}"), t.len());
            self.t = self.t.iter().enumerate().map(read).collect::<Result<_, _>>()?;
        }
        Ok(())
    }
}

/// Internal distances of a view's pixels.
fn distances(space: &Space, data: &Dataset, i: usize) -> Result<Vec<f32>, SceneError> {
    let view = data.view(i);
    let (width, height) = (view.camera.width, view.camera.height);
    let mut out = vec![0.0; width as usize * height as usize];
    let Some(map) = view.source.read_depth()? else { return Ok(out) };
    let (map, axis) = (map.resized(width, height), view.camera.optical_axis());
    for (k, (out, &z)) in out.iter_mut().zip(&map.z).enumerate() {
        let Some(ray) = view.ray(k as u32 % width, k as u32 / width).filter(|_| z > 0.0) else { continue };
        *out = space.internal_distance(&ray, f64::from(z) / ray.d.dot(axis));
    }
    Ok(out)
}

/// Replace the share of `t` at `known` that is furthest from `found`, strictly above the quantile; 0 in `found` means: no depth.
fn give_way(t: &mut [f32], known: &[usize], found: &[f32], share: f32) {
    let pairs = known.iter().zip(found).filter(|(_, found)| **found > 0.0);
    let mut errors: Vec<f64> = pairs.clone().map(|(&k, &found)| f64::from((t[k] - found).powi(2))).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let Some(limit) = percentile(&errors, 1.0 - f64::from(share)) else { return };
    for (&k, &found) in pairs {
        if f64::from((t[k] - found).powi(2)) > limit {
            t[k] = found;
        }
    }
}

#[cfg(test)]
#[path = "depth_tests.rs"]
mod tests;
