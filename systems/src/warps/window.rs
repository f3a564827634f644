//! Windows of a schedule: what comes in little by little.

/// When octaves, or rates, come in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Window {
    /// All of it is there from the start.
    Open,
    /// Little by little.
    Over {
        /// Share of the schedule after which it begins to come in.
        from: f64,
        /// Share of the schedule from then on until all is there.
        length: f64,
    },
}

impl Window {
    /// How far it is open once the share `done` of the schedule is over.
    pub(super) fn open(self, done: f64) -> f64 {
        match self {
            Self::Open => 1.0,
            Self::Over { from, .. } if done < from => 0.0,
            Self::Over { from, length } if length > 0.0 => ((done - from) / length).min(1.0),
            Self::Over { .. } => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_open_by_shares_of_the_schedule() {
        let window = Window::Over { from: 0.2, length: 0.4 };
        let open = [0.0, 0.2, 0.3, 0.6, 1.0].map(|done| window.open(done));
        for (open, want) in open.iter().zip([0.0, 0.0, 0.25, 1.0, 1.0]) {
            assert!((open - want).abs() < 1e-12, "{open} {want}");
        }
        let at_once = Window::Over { from: 0.2, length: 0.0 };
        assert_eq!([0.0, 0.19, 0.2, 1.0].map(|done| at_once.open(done)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(Window::Over { from: 0.0, length: 0.0 }.open(0.0), 1.0);
        assert_eq!(Window::Open.open(0.0), 1.0);
    }
}
