//! The times of samples.

use field_core::tape::{Node, Tape, TapeError};

/// The times of samples, on the tape.
#[derive(Clone, Copy)]
pub(super) struct When {
    /// `[1 x n]`, in `[0, 1]`.
    pub(super) t: Node,
    /// `[1 x n]`: 0 for samples of `t = 0`, where nothing moves, 1 for the others. `None`: all move.
    pub(super) moves: Option<Node>,
}

impl When {
    /// One time for `n` samples; `None` for `t = 0`, where nothing moves.
    pub(super) fn of_all(tape: &mut Tape<'_>, n: usize, time: f32) -> Option<Self> {
        (time != 0.0).then(|| Self { t: tape.fill(1, n, time), moves: None })
    }
}

/// Memory for the times of a tile's samples.
#[derive(Default)]
pub(super) struct SampleTimes {
    /// `[2][n]`, as the nodes of [`When`].
    rows: Vec<f32>,
}

impl SampleTimes {
    /// Give each sample the time of its ray. Returns whether anything moves at any of them.
    pub(super) fn spread(&mut self, times: impl Iterator<Item = f32>, offsets: &[u32]) -> bool {
        let n = offsets.last().map_or(0, |&n| n as usize);
        self.rows.resize(2 * n, 0.0);
        let (t, moves) = self.rows.split_at_mut(n);
        let mut any = false;
        for (time, span) in times.zip(offsets.windows(2)) {
            let span = span[0] as usize..span[1] as usize;
            t[span.clone()].fill(time);
            moves[span].fill(if time == 0.0 { 0.0 } else { 1.0 });
            any |= time != 0.0;
        }
        any
    }

    /// Record them.
    pub(super) fn record(&self, tape: &mut Tape<'_>) -> Result<When, TapeError> {
        let both = tape.constant(2, self.rows.len() / 2, &self.rows)?;
        Ok(When { t: tape.slice(both, 0..1)?, moves: Some(tape.slice(both, 1..2)?) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_has_the_time_of_its_ray_and_rests_at_time_0_only() {
        let mut times = SampleTimes::default();
        assert!(times.spread([0.0, 0.5].into_iter(), &[0, 2, 3]));
        assert_eq!(times.rows, [0.0, 0.0, 0.5, 0.0, 0.0, 1.0]);
        assert!(!times.spread([0.0].into_iter(), &[0, 1]));
        assert_eq!(times.rows, [0.0, 0.0]);
        assert!(!times.spread(std::iter::empty(), &[0]));
    }
}
