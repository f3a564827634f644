//! A deformation of any parts, for tests.

use super::*;
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};

/// Settings of the parts.
#[derive(Clone, Debug)]
pub(crate) struct MadeSettings {
    pub(crate) time: TimeSettings,
    pub(crate) warp: WarpSettings,
    pub(crate) ambient: AmbientSettings,
    pub(crate) planes: PlaneSettings,
    pub(crate) density: DensitySettings,
}

impl MadeSettings {
    /// Nothing but the time: no part sees it yet.
    pub(crate) fn of_time(kind: TimeKind, octaves: usize, dims: usize) -> Self {
        Self {
            time: TimeSettings { kind, octaves, dims, width: 8, rate: 1.0, code_rate: 1.0, warmup: 0.0 },
            warp: WarpSettings { motion: Motion::None, origin: Origin::Free, octaves: 2, anneal: 0.0, depth: 2 },
            ambient: AmbientSettings { dims: 0, octaves: 2, width: 8, depth: 2, from: 0.0, anneal: 0.0 },
            planes: PlaneSettings::NONE,
            density: DensitySettings::PLACE,
        }
    }

    /// Of the times of training views.
    pub(crate) fn deform(self, times: Times, seed: u64) -> Deform {
        let mut parameters = Parameters::new(seed);
        let time = Time::new(self.time, times, &parameters).unwrap();
        let (rows, more) = (time.rows(), self.planes.warp_rows());
        let made = Made {
            warp: Warp::new(&self.warp, &time, more, &mut parameters).unwrap(),
            ambient: Ambient::new(&self.ambient, rows, &mut parameters).unwrap(),
            density: DensityInputs::new(&self.density, rows, &parameters).unwrap(),
            plane_rows: self.planes.density_rows(),
            planes: TimePlanes::new(self.planes, &mut parameters).unwrap(),
        };
        Deform::new(Box::new(made), time, parameters)
    }
}

/// All parts that there are.
struct Made {
    warp: Option<Warp>,
    ambient: Option<Ambient>,
    planes: TimePlanes,
    plane_rows: usize,
    density: DensityInputs,
}

impl Deformation for Made {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError> {
        let p = self.planes.of(tape, &at)?;
        let mut x = None;
        if let Some(warp) = moving(&self.warp, &at) {
            let gamma = warp.octaves.of(tape, at.x)?;
            let outputs = warp.network.of(tape, &[&[gamma, at.time], p.for_warp()].concat())?;
            let outputs = since_origin(tape, &at, outputs, |tape, at_0| {
                let p_0 = self.planes.for_warp(tape, at_0)?;
                warp.network.of(tape, &[&[gamma, at_0.time], &p_0[..]].concat())
            })?;
            x = Some(warp.moved(tape, at.x, outputs)?);
        }
        let mut seen = Vec::new();
        if let Some(ambient) = &self.ambient {
            seen.push(ambient.of(tape, &at)?);
        }
        seen.extend(self.density.of(tape, &at)?);
        seen.extend(p.for_density());
        Moved::new(tape, x, &seen)
    }

    fn warps(&self) -> bool {
        self.warp.is_some()
    }

    fn seen_rows(&self) -> usize {
        self.ambient.as_ref().map_or(0, Ambient::rows) + self.density.rows() + self.plane_rows
    }

    fn origin(&self) -> Origin {
        Warp::origin(self.warp.as_ref())
    }

    fn windows(&self) -> Windows<'_> {
        Windows::of(self.warp.as_ref(), self.ambient.as_ref())
    }

    fn planes(&self) -> Option<&TimePlanes> {
        Some(&self.planes)
    }

    fn renew(&mut self, params: &[f32], done: f64) {
        self.warp.iter_mut().for_each(|warp| warp.renew(params, done));
        self.ambient.iter_mut().for_each(|ambient| ambient.renew(params, done));
    }

    fn set_windows(&mut self, warp: &[f32], ambient: &[f32]) {
        self.warp.iter_mut().for_each(|part| part.octaves.set_window(warp));
        self.ambient.iter_mut().for_each(|part| part.set_window(ambient));
    }
}

impl Deform {
    /// Parameters of some size each, once the share `done` of the schedule is over.
    pub(crate) fn randomise(&mut self, done: f64) {
        for (k, numbers) in [&mut self.params, &mut self.time.learned].into_iter().enumerate() {
            let mut noise = vec![0.0; numbers.len()];
            Rng::new(5, 7 + k as u64).fill_uniform(0, &mut noise);
            numbers.iter_mut().zip(noise).for_each(|(p, u)| *p += 0.6 * (u - 0.5));
        }
        self.done = done;
        self.renew();
    }

    /// Parameters of networks and planes, and what is learned of the time.
    pub(crate) fn parameters(&self) -> (&[f32], &[f32]) {
        (&self.params, &self.time.learned)
    }

    /// Their gradients, from what [`Deform::learn`] gave.
    pub(crate) fn gradients(&self, grad: &DeformGrad) -> (Vec<f32>, Vec<f32>) {
        (grad.params.clone(), self.time.gradient(&grad.times))
    }

    /// Add to number `i` of the parameters of networks and planes, or of what is `learned` of the time.
    pub(crate) fn shift(&mut self, learned: bool, i: usize, by: f32) {
        let numbers = if learned { &mut self.time.learned } else { &mut self.params };
        numbers[i] += by;
        self.renew();
    }
}
