//! Does what one photo alone shows explain the scene away?
//!
//! A field with a transient part (NeRF in the Wild) may end with nothing static at all: every photo explained by matter of
//! its own, and nothing left for a picture from elsewhere. Nothing in the loss tells; the weight of the transient part does.

/// Share of the photos above which the transient part explains too much.
const TOO_MUCH: f64 = 0.6;

/// Watched from this step on, or from this share of a shorter run.
const STEPS: u64 = 5000;
const SHARE: f64 = 0.25;

/// Steps the mean is taken over, about.
const MEMORY: u64 = 100;

/// Watches the weight of the transient part over the steps of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TransientWatch {
    mean: f64,
    steps: u64,
    said: bool,
}

impl TransientWatch {
    /// A step was done, the last of `step`, `done` of the run, with this mean weight. Returns what there is to say, once.
    pub(crate) fn see(&mut self, weight: f64, step: u64, done: f64) -> Option<String> {
        self.steps = (self.steps + 1).min(MEMORY);
        self.mean += (weight - self.mean) / self.steps as f64;
        let late = step >= STEPS || done >= SHARE;
        if self.said || !late || self.mean <= TOO_MUCH {
            return None;
        }
        self.said = true;
        Some(format!(
            "the transient part explains {:.0} % of the photos after {step} steps, and the static scene empties: raise the \
             price of transient matter (`--set lambda_u=...`) or the least uncertainty (`--set beta_min=...`)",
            100.0 * self.mean
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said in a run of `steps` steps, and after how many.
    fn said(steps: u64, weight: impl Fn(u64) -> f64) -> Vec<(u64, String)> {
        let mut watch = TransientWatch::default();
        let see = |step: u64| Some((step, watch.see(weight(step), step, step as f64 / steps as f64)?));
        (1..=steps).filter_map(see).collect()
    }

    #[test]
    fn an_emptied_scene_is_told_of_once_and_not_at_the_start() {
        for (steps, first) in [(400, 100), (20_000, 5000), (300_000, 5000)] {
            let lines = said(steps, |_| 0.8);
            let [(step, line)] = &lines[..] else { panic!("{lines:?}") };
            assert_eq!(*step, first);
            assert!(line.contains("80 %") && line.contains("lambda_u") && line.contains("beta_min"), "{line}");
            assert!(!line.contains('\n'));
        }
    }

    #[test]
    fn occluders_are_not_a_reason_to_warn() {
        assert!(said(20_000, |_| 0.59).is_empty());
        // A cloudy start, and a step now and then.
        assert!(said(20_000, |step| if step < 3000 { 1.0 } else { 0.1 }).is_empty());
        assert!(said(20_000, |step| if step % 50 == 0 { 1.0 } else { 0.3 }).is_empty());
        // It may come late.
        assert_eq!(said(20_000, |step| if step < 9000 { 0.1 } else { 0.9 }).len(), 1);
    }
}
