//! How many steps of a cloud there will be until a stop: the same on every machine, for two cores, before the first is made.

use engine::data::Dataset;
use engine::options::Stop;

/// Seconds of a step of a cloud on two cores, roughly: in any case, and for each pixel of the photo.
const STEP: f64 = 0.028;
const STEP_PER_PIXEL: f64 = 1.2e-8;

/// Steps of a cloud until a stop, roughly where it is given in seconds; `None` where no stop is known.
pub(crate) fn cloud_steps(data: &Dataset, stop: Option<Stop>) -> Option<f64> {
    let step = STEP + STEP_PER_PIXEL * data.pixel_count() as f64 / data.len().max(1) as f64;
    stop.map(|stop| match stop {
        Stop::Steps(n) => n as f64,
        Stop::Seconds(s) => s / step,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;

    #[test]
    fn a_stop_is_steps_or_seconds() {
        let (_, data) = made::capture(made::Points::None);
        assert_eq!(cloud_steps(&data, Some(Stop::Steps(240))), Some(240.0));
        assert_eq!(cloud_steps(&data, None), None);
        let seconds = cloud_steps(&data, Some(Stop::Seconds(60.0))).unwrap();
        assert!((2000.0..2200.0).contains(&seconds), "{seconds}");
    }
}
