//! Learning rates as functions of the step.

use core::f64::consts::{FRAC_PI_2, PI};
use float_core::m64;

/// How the learning rate falls. Steps count from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Schedule {
    /// Always `lr`.
    Constant {
        /// The rate.
        lr: f64,
    },
    /// `lr * rate^(step / steps)`, going on past `steps`: NeRF, with a rate of 0.1 over the run.
    Exponential {
        /// At step 0.
        lr: f64,
        /// Factor over `steps`.
        rate: f64,
        /// Steps for one factor of `rate`.
        steps: u64,
    },
    /// Linear in the logarithm from `lr_init` to `lr_final`, which is kept after `steps`: mip-NeRF and later.
    LogLerp {
        /// At step 0, `> 0`.
        lr_init: f64,
        /// From step `steps` on, `> 0`.
        lr_final: f64,
        /// Length.
        steps: u64,
    },
    /// Half a cosine from `lr_max` down to `lr_min`, which is kept after `steps`.
    Cosine {
        /// At step 0.
        lr_max: f64,
        /// From step `steps` on.
        lr_min: f64,
        /// Length.
        steps: u64,
    },
    /// `lr * gamma^step`.
    Gamma {
        /// At step 0.
        lr: f64,
        /// Factor of one step.
        gamma: f64,
    },
    /// `lr` times `factor` at step `first` and again after every `every` steps: instant-ngp, with 0.33, 20 000, 10 000.
    Steps {
        /// Before `first`.
        lr: f64,
        /// Each time.
        factor: f64,
        /// First drop.
        first: u64,
        /// Steps between the later drops; 0 means that there are none.
        every: u64,
    },
}

/// A factor that rises to 1 over the first steps.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Warmup {
    /// 1 throughout.
    #[default]
    None,
    /// `min(1, (step + 1) / steps)`.
    Linear {
        /// Length.
        steps: u64,
    },
    /// `start + (1 - start) sin(pi / 2 * min(1, step / steps))`: mip-NeRF's "delay".
    Sine {
        /// Factor at step 0.
        start: f64,
        /// Length.
        steps: u64,
    },
}

/// A schedule times a warm-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearningRate {
    /// The schedule.
    pub schedule: Schedule,
    /// The warm-up.
    pub warmup: Warmup,
}

impl From<Schedule> for LearningRate {
    fn from(schedule: Schedule) -> Self {
        Self { schedule, warmup: Warmup::None }
    }
}

impl LearningRate {
    /// The rate for a step, counted from 0. Every step past the end of a schedule is legal.
    #[must_use]
    pub fn at(&self, step: u64) -> f64 {
        self.schedule.at(step) * self.warmup.at(step)
    }
}

/// `step / steps`; a schedule without length is over at once.
fn progress(step: u64, steps: u64) -> f64 {
    if steps == 0 { 1.0 } else { step as f64 / steps as f64 }
}

impl Schedule {
    /// The rate at a step, without warm-up.
    #[must_use]
    pub fn at(&self, step: u64) -> f64 {
        match *self {
            Self::Constant { lr } => lr,
            Self::Exponential { lr, rate, steps } => lr * m64::powf(rate, progress(step, steps)),
            Self::LogLerp { lr_init, lr_final, steps } => {
                let x = progress(step, steps).min(1.0);
                m64::exp((1.0 - x) * m64::ln(lr_init) + x * m64::ln(lr_final))
            }
            Self::Cosine { lr_max, lr_min, steps } => {
                let x = progress(step, steps).min(1.0);
                lr_min + 0.5 * (lr_max - lr_min) * (1.0 + m64::cos(PI * x))
            }
            Self::Gamma { lr, gamma } => lr * m64::powf(gamma, step as f64),
            Self::Steps { lr, factor, first, every } => {
                let drops = match step.checked_sub(first) {
                    None => 0,
                    Some(after) => after.checked_div(every).unwrap_or(0).saturating_add(1),
                };
                lr * m64::powf(factor, drops as f64)
            }
        }
    }
}

impl Warmup {
    /// The factor at a step, in `[0, 1]`.
    #[must_use]
    pub fn at(&self, step: u64) -> f64 {
        match *self {
            Self::None => 1.0,
            Self::Linear { steps } => progress(step.saturating_add(1), steps).min(1.0),
            Self::Sine { start, steps } => start + (1.0 - start) * m64::sin(FRAC_PI_2 * progress(step, steps).min(1.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b.abs()
    }

    #[test]
    fn ends_are_as_said() {
        let loglerp = Schedule::LogLerp { lr_init: 1e-2, lr_final: 1e-4, steps: 30_000 };
        assert!(near(loglerp.at(0), 1e-2) && near(loglerp.at(15_000), 1e-3));
        assert!(near(loglerp.at(30_000), 1e-4) && near(loglerp.at(u64::MAX), 1e-4));
        let cosine = Schedule::Cosine { lr_max: 1.0, lr_min: 0.1, steps: 10 };
        assert!(near(cosine.at(0), 1.0) && near(cosine.at(5), 0.55) && near(cosine.at(99), 0.1));
        let nerf = Schedule::Exponential { lr: 5e-4, rate: 0.1, steps: 500_000 };
        assert!(near(nerf.at(0), 5e-4) && near(nerf.at(500_000), 5e-5) && near(nerf.at(1_000_000), 5e-6));
        assert_eq!(Schedule::Constant { lr: 0.3 }.at(7), 0.3);
    }

    #[test]
    fn step_decay_drops_at_its_steps() {
        let ngp = Schedule::Steps { lr: 1e-2, factor: 0.33, first: 20_000, every: 10_000 };
        for (step, drops) in [(0, 0), (19_999, 0), (20_000, 1), (29_999, 1), (30_000, 2), (45_000, 3)] {
            assert!(near(ngp.at(step), 1e-2 * m64::powi(0.33, drops)), "step {step}");
        }
        let once = Schedule::Steps { lr: 1.0, factor: 0.5, first: 10, every: 0 };
        assert_eq!((once.at(9), once.at(10), once.at(1_000_000)), (1.0, 0.5, 0.5));
    }

    #[test]
    fn warm_ups_rise_to_one_and_stay() {
        for warmup in [Warmup::Linear { steps: 100 }, Warmup::Sine { start: 0.01, steps: 100 }] {
            let factors: alloc::vec::Vec<f64> = (0..200).map(|s| warmup.at(s)).collect();
            assert!(factors[0] <= 0.010_000_001 && factors.windows(2).all(|f| f[0] <= f[1]));
            assert!(factors[100..].iter().all(|f| *f == 1.0));
        }
        let rate = LearningRate { schedule: Schedule::Constant { lr: 2.0 }, warmup: Warmup::Linear { steps: 4 } };
        assert_eq!((rate.at(0), rate.at(3), rate.at(4)), (0.5, 2.0, 2.0));
    }

    #[test]
    fn no_length_means_over_at_once() {
        assert!(near(Schedule::LogLerp { lr_init: 1.0, lr_final: 0.1, steps: 0 }.at(0), 0.1));
        assert!(near(Schedule::Cosine { lr_max: 1.0, lr_min: 0.1, steps: 0 }.at(0), 0.1));
        assert!(near(Schedule::Exponential { lr: 1.0, rate: 0.1, steps: 0 }.at(5), 0.1));
        assert_eq!(Warmup::Linear { steps: 0 }.at(0), 1.0);
        assert_eq!(Warmup::Sine { start: 0.0, steps: 0 }.at(0), 1.0);
    }

    #[test]
    fn rates_are_finite_at_the_last_step_there_is() {
        for schedule in [
            Schedule::Exponential { lr: 1.0, rate: 0.1, steps: 10 },
            Schedule::Gamma { lr: 1.0, gamma: 0.97 },
            Schedule::Steps { lr: 1.0, factor: 0.33, first: 0, every: 1 },
        ] {
            let lr = schedule.at(u64::MAX);
            assert!(lr >= 0.0 && lr.is_finite(), "{schedule:?}: {lr}");
        }
        assert_eq!(Warmup::Linear { steps: 3 }.at(u64::MAX), 1.0);
    }
}
