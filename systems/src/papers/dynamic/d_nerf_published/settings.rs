//! Settings of the published networks; all of them can be given as `--set name=value`.

use crate::limits::{at_least_0, at_least_1, positive, within};
use crate::networks::{DisplacementShape, Origin, TwoLevelConfig};
use engine::options::Stop;
use engine::system::{MOST_LAYERS, MOST_UNITS, SystemError, at_most};
use serde::{Deserialize, Serialize};

/// Most octaves of an encoding.
const MOST_OCTAVES: usize = 32;
/// Steps of a published training.
const PUBLISHED_STEPS: u64 = 800_000;
/// The most that a plan says of a run: what a number in TOML holds.
const MOST_STEPS: u64 = 1 << 53;
/// Multiplications a second of both passes through the networks on two cores, roughly.
const MULTIPLICATIONS: f64 = 5e10;

/// The displacement. As released, but for `origin`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DisplacementSettings {
    /// What happens at `t = 0`, where nothing moves: `tied` (the displacement is continuous) or `exact` (it jumps, as published).
    pub(super) origin: Origin,
    /// Octaves of the point that the displacement sees, 10.
    #[serde(rename = "warp_octaves")]
    pub(super) octaves: usize,
    /// Octaves of the time, 10 in the released settings; the paper says 4.
    pub(super) time_octaves: usize,
    /// Width of its layers, 256.
    #[serde(rename = "warp_width")]
    pub(super) width: usize,
    /// Layers before the one that gives the displacement, 8.
    #[serde(rename = "warp_depth")]
    pub(super) depth: usize,
    /// Factor of the squared difference of displacements between a frame's time and one on the way to a neighbour's, summed over the
    /// fine samples of a ray, mean over rays; 0: none, as published.
    #[serde(rename = "warp_variation")]
    pub(super) variation: f32,
    /// Whether the fine level has networks of its own; released: one pair serves both.
    pub(super) fine_networks: bool,
}

impl DisplacementSettings {
    /// The released settings, continuous at `t = 0`.
    pub(super) const RELEASED: Self = Self {
        origin: Origin::Tied,
        octaves: 10,
        time_octaves: 10,
        width: 256,
        depth: 8,
        variation: 0.0,
        fine_networks: false,
    };

    /// Those of a shape.
    #[cfg(test)]
    pub(super) fn of(shape: DisplacementShape) -> Self {
        let DisplacementShape { origin, octaves, time_octaves, width, depth } = shape;
        Self { origin, octaves, time_octaves, width, depth, ..Self::RELEASED }
    }

    /// What the network is made of.
    pub(super) fn shape(&self) -> DisplacementShape {
        let &Self { origin, octaves, time_octaves, width, depth, .. } = self;
        DisplacementShape { origin, octaves, time_octaves, width, depth }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub(super) fn check(&self) -> Result<(), SystemError> {
        at_most(&[("warp_width", self.width, MOST_UNITS), ("warp_depth", self.depth, MOST_LAYERS)])?;
        within("warp_octaves", self.octaves, 0..=MOST_OCTAVES)?;
        within("time_octaves", self.time_octaves, 0..=MOST_OCTAVES)?;
        at_least_1("warp_width", self.width as u64)?;
        at_least_1("warp_depth", self.depth as u64)?;
        at_least_0("warp_variation", self.variation)
    }

    /// Evaluations of the network for a point that moves.
    fn evaluations(&self) -> f64 {
        match self.origin {
            Origin::Tied => 2.0,
            Origin::Exact => 1.0,
        }
    }
}

/// Schedules, in shares of the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ScheduleSettings {
    /// Steps that the run is likely to have, what shares are of. Published: 800 000.
    pub(super) horizon: u64,
    /// Learning rate at the start, 5e-4.
    pub(super) lr: f32,
    /// Share of the run in which the rate falls to a tenth. Released: 500 000 of 800 000 steps.
    pub(super) lr_decay_share: f64,
    /// Share of the run at the start of which rays are of the middle of the photos only; 0: none. Released: 500 of 800 000 steps,
    /// which would be none of a short run.
    pub(super) precrop_share: f64,
    /// The middle, as a share of the columns and of the rows, 0.5.
    pub(super) precrop_side: f64,
    /// Share of the run after which all frames have come in, in the order of time; 0: they are there from the start. Released:
    /// 100 000 of 800 000 steps.
    pub(super) curriculum_share: f64,
}

impl ScheduleSettings {
    /// The published schedules in a run of so many steps, with a crop that a short run sees, too.
    pub(super) fn published(horizon: u64) -> Self {
        Self {
            horizon,
            lr: 5e-4,
            lr_decay_share: 0.625,
            precrop_share: 0.02,
            precrop_side: 0.5,
            curriculum_share: 0.125,
        }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub(super) fn check(&self) -> Result<(), SystemError> {
        at_least_1("horizon", self.horizon)?;
        positive("lr", self.lr)?;
        within("lr_decay_share", self.lr_decay_share, 1e-6..=1e6)?;
        within("precrop_share", self.precrop_share, 0.0..=1.0)?;
        within("precrop_side", self.precrop_side, 0.0..=1.0)?;
        within("curriculum_share", self.curriculum_share, 0.0..=1.0)
    }

    /// Share of the run that has passed before a step.
    pub(super) fn passed(&self, step: u64) -> f64 {
        step as f64 / self.horizon as f64
    }

    /// Learning rate of a step.
    pub(super) fn learning_rate(&self, step: u64) -> f64 {
        f64::from(self.lr) * 0.1_f64.powf(self.passed(step) / self.lr_decay_share)
    }

    /// Share of the sides of the photos that the rays of a step are of; `None`: all of them.
    pub(super) fn middle(&self, step: u64) -> Option<f64> {
        (self.passed(step) < self.precrop_share).then_some(self.precrop_side)
    }
}

/// Steps that a run is likely to have: as it is told, roughly where it stops after seconds, as published where no stop is known.
pub(super) fn likely_steps(stop: Option<Stop>, levels: &TwoLevelConfig, displacement: &DisplacementSettings) -> u64 {
    let steps = match stop {
        None => PUBLISHED_STEPS,
        Some(Stop::Steps(steps)) => steps,
        Some(Stop::Seconds(seconds)) => (seconds * MULTIPLICATIONS / multiplications(levels, displacement)) as u64,
    };
    steps.clamp(1, MOST_STEPS)
}

/// Multiplications of a step, roughly: the trunks alone, forwards once and backwards twice.
fn multiplications(levels: &TwoLevelConfig, displacement: &DisplacementSettings) -> f64 {
    let trunk = |width: usize, depth: usize| (width * width) as f64 * depth as f64;
    let network = levels.network;
    let canonical = trunk(network.width, network.depth);
    let point = canonical + displacement.evaluations() * trunk(displacement.width, displacement.depth);
    let rays = levels.rays;
    // The fine level is evaluated at the coarse samples, too.
    let points = rays.batch_rays as f64 * (2 * rays.coarse + rays.fine) as f64;
    (3.0 * point * points).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networks::{NetworkConfig, PlaceConfig, RaysConfig};
    use crate::space::SpaceKind;

    fn levels() -> TwoLevelConfig {
        TwoLevelConfig {
            place: PlaceConfig::unit(SpaceKind::Box),
            network: NetworkConfig::published(10, 0.0),
            rays: RaysConfig::published(64, 128),
        }
    }

    #[test]
    fn schedules_are_shares_of_the_run() {
        let schedule = ScheduleSettings::published(PUBLISHED_STEPS);
        assert!((schedule.learning_rate(500_000) / schedule.learning_rate(0) - 0.1).abs() < 1e-9, "as released");
        assert_eq!(schedule.learning_rate(0), f64::from(5e-4_f32));
        assert_eq!(schedule.passed(100_000), schedule.curriculum_share, "as released");
        let short = ScheduleSettings::published(100);
        assert_eq!([0, 1, 2].map(|step| short.middle(step)), [Some(0.5), Some(0.5), None]);
        assert_eq!(ScheduleSettings { precrop_share: 0.0, ..short }.middle(0), None);
    }

    #[test]
    fn a_run_has_the_steps_that_it_is_told_or_that_fit_into_its_seconds() {
        let released = DisplacementSettings::RELEASED;
        let steps = |stop| likely_steps(stop, &levels(), &released);
        assert_eq!((steps(None), steps(Some(Stop::Steps(70)))), (800_000, 70));
        let [one, two] = [600.0, 1200.0].map(|s| steps(Some(Stop::Seconds(s))));
        assert!(one > 50 && two.abs_diff(2 * one) <= 1, "{one} {two}");
        let exact = DisplacementSettings { origin: Origin::Exact, ..released };
        assert!(likely_steps(Some(Stop::Seconds(600.0)), &levels(), &exact) > one, "one evaluation instead of two");
        let ends = [Stop::Seconds(0.0), Stop::Steps(0), Stop::Steps(u64::MAX)];
        assert_eq!(ends.map(|stop| steps(Some(stop))), [1, 1, MOST_STEPS]);
    }

    #[test]
    fn what_cannot_work_is_named() {
        let refused = |change: fn(&mut DisplacementSettings)| {
            let mut settings = DisplacementSettings::RELEASED;
            change(&mut settings);
            settings.check().unwrap_err().to_string()
        };
        assert!(refused(|s| s.width = 0).contains("`warp_width` = 0"));
        assert!(refused(|s| s.depth = 0).contains("`warp_depth` = 0"));
        assert!(refused(|s| s.time_octaves = 33).contains("`time_octaves` = 33"));
        assert!(refused(|s| s.variation = f32::NAN).contains("`warp_variation` = NaN"));
        let schedule = ScheduleSettings { precrop_share: 1.5, ..ScheduleSettings::published(9) };
        assert!(schedule.check().unwrap_err().to_string().contains("`precrop_share` = 1.5"));
        let schedule = ScheduleSettings { horizon: 0, ..schedule };
        assert!(schedule.check().unwrap_err().to_string().contains("`horizon` = 0"));
        assert!(DisplacementSettings::RELEASED.check().is_ok() && ScheduleSettings::published(1).check().is_ok());
    }
}
