//! How many steps of a cloud there will be until a stop, and how many of them with smaller pictures: the same on every machine, for
//! two cores, before the first is made.

use engine::data::Dataset;
use engine::options::Stop;
use engine::system::SystemError;

/// Pictures of more pixels than this begin smaller: a step of half the size costs a third, and what is coarse is learnt as well.
const COARSE_PIXELS: u64 = 65_536;
/// Most halvings.
const HALVINGS: u32 = 4;
/// Share of the schedule that each smaller size has, and all of them together at most.
const COARSE_SHARE: f64 = 0.3;
const COARSE_SHARES: f64 = 0.6;
/// Seconds of a step of a cloud on two cores, roughly: in any case, for each pixel that shows something, and for each Gaussian that
/// there may be in the end.
const STEP: f64 = 3e-3;
const STEP_PER_PIXEL: f64 = 6.5e-8;
const STEP_PER_GAUSSIAN: f64 = 1.2e-7;
/// The limit on Gaussians grows by this many with each step. It is at most the pixels of all photos over the second number (with fewer
/// pixels for each Gaussian a cloud over-fits), and always within the last two.
const GAUSSIANS_PER_STEP: f64 = 80.0;
const PIXELS_PER_GAUSSIAN: f64 = 50.0;
const GAUSSIANS: [f64; 2] = [100_000.0, 600_000.0];
/// The same of Gaussians that move: networks are asked for each of them in each step.
const STEP_PER_MOVING: f64 = 1.0e-6;
const MOVING_PER_STEP: f64 = 2.0;
const MOVING: [f64; 2] = [10_000.0, 40_000.0];
/// A field before a cloud has this share of the seconds, or of the steps, of a run; seconds of a step of it on two cores, roughly.
const FIELD_SHARE: [f64; 2] = [0.05, 0.1];
const FIELD_STEP: f64 = 0.03;
/// That share where things stand before the scene in some photos: a cloud that begins anywhere learns these, and masks of it are wrong
/// (yard, 60 s: 24.6 dB from random places, 28.8 and 29.5 after 300 and 1000 steps of a field).
const LARGE_FIELD_SHARE: [f64; 2] = [0.3; 2];
/// The same of a field that moves.
const MOVING_STEP: f64 = 0.08;
/// Parts of a schedule whose time is planned.
const TIME_PARTS: u32 = 64;
/// Intervals that are halved: to a millionth of the first.
const HALVED: u32 = 20;
/// Photos that are looked at, at most, spread evenly; pixels more transparent than this show nothing.
const LOOKED_AT: usize = 16;
const TRANSPARENT: u8 = 32;

/// How much of a run a field before the cloud has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FieldShare {
    /// Of photos that show one scene.
    Usual,
    /// Of photos in which things stand before it.
    Large,
}

/// What the steps of a cloud are planned by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CloudPace {
    photos: f64,
    /// Pixels of a photo, on average; and those that show something.
    pub(crate) pixels: u64,
    shown: f64,
    /// Seconds of a step for each Gaussian; how many more of them there may be for each step; the least and the most.
    per_gaussian: f64,
    per_step: f64,
    gaussians: [f64; 2],
}

impl CloudPace {
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub(crate) fn of(data: &Dataset) -> Result<Self, SystemError> {
        let pixels = data.pixel_count() / data.len().max(1) as u64;
        let count = data.len().min(LOOKED_AT);
        let mut share = 0.0;
        for k in 0..count {
            let image = data.image(k * data.len() / count)?;
            let shows = |pixel: &[u8]| pixel.get(3).is_none_or(|alpha| *alpha >= TRANSPARENT);
            let shown = image.data.chunks_exact(image.channels.into()).filter(|pixel| shows(pixel)).count();
            share += shown as f64 / (f64::from(image.width) * f64::from(image.height)).max(1.0);
        }
        Ok(Self {
            photos: data.len() as f64,
            pixels,
            shown: share / count.max(1) as f64 * pixels as f64,
            per_gaussian: STEP_PER_GAUSSIAN,
            per_step: GAUSSIANS_PER_STEP,
            gaussians: GAUSSIANS,
        })
    }

    /// The same of a cloud that moves.
    pub(crate) fn moving(self) -> Self {
        Self { per_gaussian: STEP_PER_MOVING, per_step: MOVING_PER_STEP, gaussians: MOVING, ..self }
    }

    /// By how many halvings pictures begin smaller.
    pub(crate) fn halvings(&self) -> u32 {
        (self.pixels.max(1) / COARSE_PIXELS).checked_ilog2().map_or(0, |octaves| octaves / 2 + 1).min(HALVINGS)
    }

    /// Share of the schedule that each smaller size has.
    fn coarse_share(&self) -> f64 {
        COARSE_SHARE.min(COARSE_SHARES / f64::from(self.halvings().max(1)))
    }

    /// Steps of each smaller size in a schedule of `horizon` steps.
    pub(crate) fn coarse_steps(&self, horizon: u64) -> u64 {
        (self.coarse_share() * horizon as f64) as u64
    }

    /// The limit on Gaussians for a training of `steps` steps.
    pub(crate) fn gaussians(&self, steps: f64) -> usize {
        let [least, most] = self.gaussians;
        (self.per_step * steps).min(self.photos * self.shown / PIXELS_PER_GAUSSIAN).clamp(least, most) as usize
    }

    /// Share of the time of a schedule of `horizon` steps until equally spaced positions, from 0 to 1: `halvings` is by how many a step's
    /// picture is smaller, `gaussians` how many Gaussians there are about.
    pub(crate) fn shares(
        &self,
        horizon: u64,
        halvings: impl Fn(u64) -> u32,
        gaussians: impl Fn(u64) -> f64,
    ) -> Vec<f64> {
        let mut sum = 0.0;
        let sums: Vec<f64> = (0..TIME_PARTS)
            .map(|k| {
                let step = ((k as f64 + 0.5) / f64::from(TIME_PARTS) * horizon as f64) as u64;
                let pixels = self.shown * 0.25_f64.powf(f64::from(halvings(step)));
                sum += STEP + STEP_PER_PIXEL * pixels + self.per_gaussian * gaussians(step);
                sum
            })
            .collect();
        std::iter::once(0.0).chain(sums.iter().map(|until| until / sum)).collect()
    }

    /// Seconds of a step, averaged over the sizes of pictures, with a limit of `gaussians`.
    fn seconds(&self, gaussians: usize) -> f64 {
        let (share, halvings) = (self.coarse_share(), self.halvings());
        let smaller: f64 = (1..=halvings).map(|h| share / f64::from(4_u32.pow(h))).sum();
        let size = smaller + 1.0 - share * f64::from(halvings);
        STEP + STEP_PER_PIXEL * size * self.shown + self.per_gaussian * gaussians as f64
    }

    /// Steps of a field until a stop, roughly where it is given in seconds; `None` where no stop is known.
    pub(crate) fn of_field(stop: Option<Stop>) -> Option<u64> {
        stop.map(|stop| match stop {
            Stop::Steps(n) => n,
            Stop::Seconds(s) => (s / FIELD_STEP) as u64,
        })
    }

    /// The same of a field that moves. The schedule keeps up with the time where it is wrong by a factor of five.
    pub(crate) fn of_moving_field(stop: Option<Stop>) -> Option<u64> {
        stop.map(|stop| match stop {
            Stop::Steps(n) => n,
            Stop::Seconds(s) => (s / MOVING_STEP) as u64,
        })
    }

    /// Steps that a field before the cloud has in a run until a stop; none where no stop is known.
    pub(crate) fn field_steps(stop: Option<Stop>, share: FieldShare) -> f64 {
        let [of_seconds, of_steps] = match share {
            FieldShare::Usual => FIELD_SHARE,
            FieldShare::Large => LARGE_FIELD_SHARE,
        };
        stop.map_or(0.0, |stop| match stop {
            Stop::Steps(n) => of_steps * n as f64,
            Stop::Seconds(s) => of_seconds * s / FIELD_STEP,
        })
    }

    /// What a stop leaves the cloud after `steps` steps of a field.
    pub(crate) fn after_field(stop: Option<Stop>, steps: u64) -> Option<Stop> {
        stop.map(|stop| match stop {
            Stop::Steps(n) => Stop::Steps(n.saturating_sub(steps)),
            Stop::Seconds(s) => Stop::Seconds((s - FIELD_STEP * steps as f64).max(0.0)),
        })
    }

    /// Steps until a stop, roughly where it is given in seconds; `None` where no stop is known.
    pub(crate) fn steps(&self, stop: Option<Stop>) -> Option<f64> {
        stop.map(|stop| match stop {
            Stop::Steps(n) => n as f64,
            Stop::Seconds(s) => {
                // The more steps the more Gaussians, and the longer each step: where both fit is between these.
                let [mut low, mut high] = [f64::INFINITY, 0.0].map(|steps| s / self.seconds(self.gaussians(steps)));
                for _ in 0..HALVED {
                    let middle = 0.5 * (low + high);
                    if middle * self.seconds(self.gaussians(middle)) < s { low = middle } else { high = middle }
                }
                low
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;

    #[test]
    fn a_stop_is_steps_or_seconds() {
        let (_, data) = made::capture(made::Points::None);
        let pace = CloudPace::of(&data).unwrap();
        assert_eq!(pace.steps(Some(Stop::Steps(240))), Some(240.0));
        assert_eq!(pace.steps(None), None);
        let [one, two] = [60.0, 120.0].map(|s| pace.steps(Some(Stop::Seconds(s))).unwrap());
        assert!((2000.0..20_000.0).contains(&one) && (two - 2.0 * one).abs() < 1e-3 * two, "{one} {two}");
    }

    #[test]
    fn a_field_before_the_cloud_takes_a_small_share_of_the_run() {
        let seconds = Some(Stop::Seconds(300.0));
        let steps = CloudPace::field_steps(seconds, FieldShare::Usual) as u64;
        assert_eq!((steps, CloudPace::after_field(seconds, steps)), (500, Some(Stop::Seconds(285.0))));
        let steps = Some(Stop::Steps(5000));
        assert_eq!(
            (CloudPace::field_steps(steps, FieldShare::Usual), CloudPace::after_field(steps, 500)),
            (500.0, Some(Stop::Steps(4500)))
        );
        assert_eq!((CloudPace::field_steps(None, FieldShare::Usual), CloudPace::after_field(None, 500)), (0.0, None));
        let large = |stop| CloudPace::field_steps(stop, FieldShare::Large).round();
        assert_eq!([large(seconds), large(Some(Stop::Steps(5000)))], [3000.0, 1500.0]);
        let of_field = [None, Some(Stop::Steps(7)), Some(Stop::Seconds(300.0))].map(CloudPace::of_field);
        assert_eq!(of_field, [None, Some(7), Some(10_000)]);
        let of_moving = [None, Some(Stop::Steps(7)), Some(Stop::Seconds(300.0))].map(CloudPace::of_moving_field);
        assert_eq!(of_moving, [None, Some(7), Some(3750)]);
        assert_eq!(CloudPace::after_field(Some(Stop::Seconds(1.0)), 500), Some(Stop::Seconds(0.0)));
    }

    #[test]
    fn pixels_that_show_nothing_take_no_time() {
        let of = |left_out: u32| {
            let colour = |_, x, _| [9, 9, 9, if x < left_out { 0 } else { 255 }];
            CloudPace::of(&made::scene(made::frames(4, colour), Vec::new()).1).unwrap()
        };
        let all = f64::from(made::SIDE * made::SIDE);
        assert_eq!([of(0).shown, of(made::SIDE / 2).shown], [all, all / 2.0]);
    }

    /// A hundred photos of `pixels` pixels each, without transparent ones.
    fn of(pixels: u64) -> CloudPace {
        CloudPace {
            photos: 100.0,
            pixels,
            shown: pixels as f64,
            per_gaussian: STEP_PER_GAUSSIAN,
            per_step: GAUSSIANS_PER_STEP,
            gaussians: GAUSSIANS,
        }
    }

    #[test]
    fn large_pictures_begin_smaller_and_steps_of_theirs_are_more() {
        assert_eq!([60_000, 70_000, 400_000, 12_000_000].map(|n| of(n).halvings()), [0, 1, 2, 4]);
        let pace = of(400_000);
        let steps = pace.steps(Some(Stop::Seconds(600.0))).unwrap();
        let whole = STEP + STEP_PER_PIXEL * 400_000.0 + STEP_PER_GAUSSIAN * pace.gaussians(f64::INFINITY) as f64;
        assert!(steps * whole > 1.05 * 600.0, "{steps} {whole}");
        assert!(pace.coarse_steps(1000) == 300 && of(12_000_000).coarse_steps(1000) == 150);
    }

    #[test]
    fn the_time_of_a_schedule_goes_by_what_its_steps_cost() {
        let pace = of(400_000);
        let even = pace.shares(1000, |_| 0, |_| 5e4);
        let small_first = pace.shares(1000, |step| u32::from(step < 500), |step| 100.0 * step as f64);
        for shares in [&even, &small_first] {
            assert!(shares[0] == 0.0 && shares.last() == Some(&1.0) && shares.windows(2).all(|w| w[0] < w[1]));
        }
        let middle = even.len() / 2;
        assert!((even[middle] - 0.5).abs() < 1e-9 && (0.1..0.35).contains(&small_first[middle]));
    }

    #[test]
    fn gaussians_are_as_many_as_steps_and_pixels_allow() {
        assert_eq!(of(30_000).gaussians(10_000.0), 100_000);
        assert_eq!(of(400_000).gaussians(4_000.0), 320_000);
        assert_eq!(of(100_000).gaussians(f64::INFINITY), 200_000);
        assert_eq!(of(12_000_000).gaussians(f64::INFINITY), 600_000);
    }
}
