//! Measured depth leads a march: samples lie around it, and where the field disagrees most it is the measurement that gives way
//! (EndoNeRF, Wang et al., 2022, section 2).

use crate::buffers::sized;
use crate::space::Space;
use engine::data::Dataset;
use engine::system::{LayerRequest, Query, System, SystemError, Tensor, TensorMap, f32_tensor, take_f32};
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
        intervals: (&mut Vec<f32>, &mut Vec<f32>, usize),
        room: &mut CutRoom,
    ) -> u32 {
        let n = self.config.cue_samples;
        if n == 0 || depth <= 0.0 || end <= start {
            return 0;
        }
        let (t, dt, first) = intervals;
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

    /// Whether measurements give way before this step.
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
            let query = Query {
                background,
                layers: LayerRequest::default(),
                error_budget: 1.0 / 255.0,
                appearance: engine::system::Appearance::Mean,
                time: seen.time,
                halt: engine::halt::Halt::NEVER,
            };
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

/// Replace the share of `t` at `known` that is furthest from `found`, strictly above the quantile; 0 in `found` is no depth.
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
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use render_core::camera::Camera;
    use render_core::pose::Pose;
    use scene_io::synthetic::{TabletopOptions, tabletop};
    use scene_io::{DepthMap, DepthSource, Frame, Image, ImageSource, ImageStore, Scene, StoreOptions};
    use std::sync::Arc;

    #[test]
    fn the_worst_share_gives_way_and_what_agrees_stays() {
        let mut t = vec![1.0, 1.0, 1.0, 0.0, 1.0];
        give_way(&mut t, &[0, 1, 2, 4], &[1.0, 1.5, 1.01, 0.0], 0.34);
        assert_eq!(t, [1.0, 1.5, 1.0, 0.0, 1.0], "one of three, not the one without a rendered depth");
        let before = t.clone();
        give_way(&mut t, &[0, 1, 2], &[1.0, 1.5, 1.0], 0.34);
        assert_eq!(t, before, "nothing to replace where rendered equals stored");
        give_way(&mut t, &[], &[], 0.5);
    }

    /// A photo of 9 x 7 pixels, and what is known of its depth.
    fn measured(z: impl Fn(usize) -> f32) -> Dataset {
        let pose = Pose { r: DMat3::from_rotation_y(0.3), c: DVec3::new(0.2, -0.1, -3.0) };
        let camera = Camera::pinhole(9, 7, 8.0, 8.5, 4.2, 3.9, pose);
        let image = Image::rgb(9, 7, vec![80; 3 * 63]).unwrap();
        let mut frame = Frame::new("a", ImageSource::Memory(Arc::new(image)), camera);
        frame.depth = Some(DepthSource::memory(DepthMap::new(9, 7, (0..63).map(z).collect()).unwrap()));
        let mut other = frame.clone();
        (other.name, other.depth) = ("b".into(), None);
        let scene = tabletop(&TabletopOptions { train: 0, test: 0, ..Default::default() });
        let scene = Scene { frames: vec![frame, other], ..scene };
        let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
        Dataset::new(&scene, store, vec![0, 1]).unwrap()
    }

    fn cues(config: DepthCueConfig, z: impl Fn(usize) -> f32) -> MeasuredDepth {
        MeasuredDepth::read(config, &Space::boxed(DVec3::ZERO, 4.0, 0.01), &measured(z)).unwrap().unwrap()
    }

    const LED: DepthCueConfig = DepthCueConfig { depth: 0.7, cue_samples: 24, ..DepthCueConfig::NONE };

    #[test]
    fn a_depth_map_is_distances_along_the_rays_and_holes_stay_holes() {
        let z = |k: usize| {
            if k.is_multiple_of(5) { [0.0, f32::NAN, -1.0, f32::INFINITY][k % 4] } else { 2.0 + 0.02 * k as f32 }
        };
        let (space, data, cues) = (Space::boxed(DVec3::ZERO, 4.0, 0.01), measured(z), cues(LED, z));
        let view = data.view(0);
        for k in 0..63_usize {
            let at = [(k % 9) as u16, (k / 9) as u16];
            let t = cues.at(0, at);
            if k % 5 == 0 {
                assert_eq!(t, 0.0, "pixel {k}");
                continue;
            }
            let ray = view.ray(at[0].into(), at[1].into()).unwrap();
            let x = ray.o + ray.d * space.world_distance(&ray, t);
            let found = (x - view.camera.pose.c).dot(view.camera.optical_axis());
            assert!((found - f64::from(z(k))).abs() < 1e-5, "pixel {k}: {found} for {}", z(k));
            assert_eq!(cues.at(1, at), 0.0, "of the photo without depth nothing is known");
        }
    }

    #[test]
    fn depths_that_are_all_the_same_have_a_range_all_the_same_and_none_are_no_cues() {
        let flat = cues(LED, |_| 3.0);
        assert!(flat.range > 0.0 && flat.range.is_finite());
        let space = Space::boxed(DVec3::ZERO, 4.0, 0.01);
        assert!(MeasuredDepth::read(LED, &space, &measured(|_| 0.0)).unwrap().is_none());
    }

    #[test]
    fn intervals_are_cut_around_the_measurement_and_cover_what_they_covered() {
        let mut room = CutRoom::default();
        // Two runs of steps with an empty stretch between them, behind those of another ray.
        let marched = || {
            let at: Vec<f32> = [9.0, 0.5, 0.6, 0.7, 0.8, 1.1, 1.2, 1.3, 1.4].into();
            let step = vec![0.1; at.len()];
            (at, step)
        };
        let covered = |t: &[f32], dt: &[f32]| -> f32 { t.iter().zip(dt).skip(1).map(|(_, dt)| dt).sum() };
        for (config, jitter) in [
            (LED, 0.0),
            (LED, 0.999),
            (DepthCueConfig { cue_spread: 0.0, ..LED }, 0.5),
            (DepthCueConfig { cue_anywhere: 0.0, ..LED }, 0.5),
            (DepthCueConfig { cue_anywhere: 1.0, ..LED }, 0.5),
            (DepthCueConfig { cue_samples: 1, ..LED }, 0.3),
        ] {
            let cues = cues(config, |k| 2.0 + 0.02 * k as f32);
            for depth in [0.2, 0.95, 1.25, 4.0, 1e6] {
                let (mut t, mut dt) = marched();
                let n = cues.cut(0.5, 1.5, depth, jitter, (&mut t, &mut dt, 1), &mut room);
                assert_eq!((t.len(), dt.len()), (9 + n as usize, 9 + n as usize));
                assert!(n as usize <= config.cue_samples && t[0] == 9.0 && dt[0] == 0.1, "the other ray stays");
                assert!(t[1..].windows(2).all(|w| w[0] < w[1]), "{config:?}, {depth}: {t:?}");
                assert!(dt.iter().all(|dt| *dt > 0.0), "{dt:?}");
                assert!((covered(&t, &dt) - 0.8).abs() < 1e-5, "{}", covered(&t, &dt));
                let inside = |t: f32| (0.5..=0.9 + 1e-6).contains(&t) || (1.1 - 1e-6..=1.5).contains(&t);
                assert!(t[1..].iter().all(|t| inside(*t)), "nothing where it is known to be empty: {t:?}");
                if config.cue_spread == 0.0 && config.cue_anywhere == 0.0 && depth == 1.25 {
                    assert_eq!(n, 1, "places that fall on each other are one");
                }
            }
            let mut nothing = |start, end, depth| {
                let (mut t, mut dt) = marched();
                assert_eq!(cues.cut(start, end, depth, jitter, (&mut t, &mut dt, 1), &mut room), 0);
                assert_eq!((t, dt), marched(), "nothing is known, or nothing is left");
            };
            nothing(0.5, 1.5, 0.0);
            nothing(1.5, 1.5, 1.0);
        }
        // A surface that was measured inside a run gets its samples.
        let cues = cues(DepthCueConfig { cue_anywhere: 0.0, cue_spread: 0.01, ..LED }, |k| 2.0 + 0.02 * k as f32);
        let (mut t, mut dt) = marched();
        let n = cues.cut(0.5, 1.5, 1.25, 0.5, (&mut t, &mut dt, 1), &mut room);
        assert!(n >= 20, "{n}");
    }

    #[test]
    fn the_gradient_of_the_depth_loss_is_that_of_differences() {
        let (t, dt) = ([0.6, 0.8, 1.1, 1.3_f32], [0.2, 0.3, 0.2, 0.4_f32]);
        let w = [0.1, 0.4, 0.25, 0.05_f32];
        // Where the kernel is a square, where it is a line, and where next to nothing was hit.
        for (delta, measured, scale) in [(10.0, 0.9, 1.0), (1e-3, 0.4, 1.0), (1e-3, 1.6, 1.0), (0.2, 1.2, 1e-2)] {
            let cues = cues(DepthCueConfig { depth_delta: delta, ..LED }, |k| 2.0 + 0.02 * k as f32);
            let w = w.map(|w| scale * w);
            let value = |w: &[f32]| f64::from(cues.learn(w, &t, &dt, measured, 0.0, &mut [0.0; 4]));
            let mut bar = [1.5; 4];
            cues.learn(&w, &t, &dt, measured, 2.0, &mut bar);
            for i in 0..4 {
                let at = |sign: f32| {
                    let mut w = w;
                    w[i] += sign * 5e-3 * scale;
                    value(&w)
                };
                let want = 1.5 + 2.0 * (at(1.0) - at(-1.0)) / f64::from(1e-2 * scale);
                let room = 1e-2 * want.abs().max(1.0 / f64::from(scale));
                assert!((f64::from(bar[i]) - want).abs() < room, "{delta}, {measured}: {} for {want}", bar[i]);
            }
        }
        let cues = cues(LED, |k| 2.0 + 0.02 * k as f32);
        let mut bar = [0.0; 4];
        let loss = cues.learn(&[0.0; 4], &t, &dt, 0.9, 1.0, &mut bar);
        assert!(loss.is_finite() && bar.iter().all(|b| b.is_finite()), "of a ray that meets nothing");
        assert_eq!(cues.learn(&[], &[], &[], 0.0, 1.0, &mut []), 0.0);
    }

    #[test]
    fn rounds_come_when_they_are_due_and_then_no_more() {
        let cues = cues(DepthCueConfig { refine_every: 5, refine_rounds: 2, ..LED }, |_| 2.0);
        assert_eq!((0..30).filter(|&step| cues.is_due(step)).collect::<Vec<u64>>(), [5, 10]);
        assert!(cues.state().len() == 2 && cues.holds());
        let never = self::cues(LED, |_| 2.0);
        assert!((0..30).all(|step| !never.is_due(step)) && never.state().is_empty());
    }
}
