//! Which time each frame of an animation shows.

/// A time, or a way from one time to another. 0 is the first time step of the sequence, 1 the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimePath {
    from: f64,
    to: f64,
}

impl TimePath {
    /// From the first time step to the last.
    pub const WHOLE: Self = Self { from: 0.0, to: 1.0 };
    /// The first time step.
    pub const START: Self = Self { from: 0.0, to: 0.0 };

    /// Time of frame `i` of `frames`.
    #[must_use]
    pub fn at(self, i: usize, frames: usize) -> f64 {
        let share = if frames > 1 { i as f64 / (frames - 1) as f64 } else { 0.0 };
        self.from + share * (self.to - self.from)
    }

    /// Whether all frames show the same time.
    #[must_use]
    pub fn is_still(self) -> bool {
        self.from == self.to
    }
}

impl std::str::FromStr for TimePath {
    type Err = String;

    /// `T` or `A..B`, numbers in `0..=1`.
    fn from_str(text: &str) -> Result<Self, String> {
        let number = |word: &str| match word.trim().parse::<f64>() {
            Ok(t) if (0.0..=1.0).contains(&t) => Ok(t),
            _ => Err(format!(
                "`{word}` is not a time: write T or A..B, with numbers from 0 (first time step) to 1 (last)"
            )),
        };
        let (from, to) = match text.split_once("..") {
            Some((from, to)) => (number(from)?, number(to)?),
            None => (number(text)?, number(text)?),
        };
        Ok(Self { from, to })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_go_evenly_from_one_end_to_the_other() {
        let path: TimePath = "0.25..0.75".parse().unwrap();
        assert_eq!([0, 1, 2].map(|i| path.at(i, 3)), [0.25, 0.5, 0.75]);
        assert_eq!(path.at(0, 1), 0.25);
        assert!(!path.is_still() && "0.5".parse::<TimePath>().unwrap().is_still());
        let back: TimePath = "1..0".parse().unwrap();
        assert_eq!([back.at(0, 5), back.at(4, 5)], [1.0, 0.0]);
        for wrong in ["", "..", "0..", "2", "-1..0", "nan", "a..b"] {
            assert!(wrong.parse::<TimePath>().is_err(), "{wrong}");
        }
    }
}
