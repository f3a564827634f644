//! Intervals along rays, as losses on weights see them.

use crate::LossError;
use core::ops::Range;

/// Where the intervals of a batch of rays begin and end.
#[derive(Clone, Copy, Debug)]
pub enum Edges<'a> {
    /// Interval after interval without gaps: a ray of `k` intervals has `k + 1` edges, `[n + rays]` in all. Those of ray `r`
    /// are `offsets[r] + r ..= offsets[r + 1] + r`.
    Joined(&'a [f32]),
    /// `[n]` each: every interval has its own ends, there may be gaps.
    Apart {
        /// Beginnings.
        start: &'a [f32],
        /// Ends, each at or behind its beginning.
        end: &'a [f32],
    },
}

/// Intervals of a batch of rays, non-decreasing along each ray, in normalised distance `s` (any unit that does not change
/// along the ray will do).
#[derive(Clone, Copy, Debug)]
pub struct RayIntervals<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the intervals `offsets[r] .. offsets[r + 1]`.
    pub offsets: &'a [u32],
    /// Where they lie.
    pub edges: Edges<'a>,
}

/// What a sum over rays and intervals is divided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Reduction {
    /// By nothing.
    Sum,
    /// By the number of rays: the mean of what a ray costs.
    #[default]
    PerRay,
    /// By the number of intervals.
    PerInterval,
}

impl Reduction {
    /// Factor of the sum; 1 where there is nothing to divide.
    #[must_use]
    pub fn factor(self, rays: usize, intervals: usize) -> f64 {
        let by = match self {
            Self::Sum => 1,
            Self::PerRay => rays,
            Self::PerInterval => intervals,
        };
        1.0 / by.max(1) as f64
    }
}

impl RayIntervals<'_> {
    /// Number of rays.
    #[must_use]
    pub fn rays(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// The intervals of ray `r`.
    #[inline(always)]
    pub(crate) fn range(&self, r: usize) -> Range<usize> {
        self.offsets[r] as usize..self.offsets[r + 1] as usize
    }

    /// Beginnings and ends of ray `r`.
    #[inline(always)]
    pub(crate) fn ends(&self, r: usize) -> (&[f32], &[f32]) {
        let span = self.range(r);
        match self.edges {
            Edges::Joined(s) => {
                let n = span.len();
                let s = &s[span.start + r..][..n + 1];
                (&s[..n], &s[1..])
            }
            Edges::Apart { start, end } => (&start[span.clone()], &end[span]),
        }
    }

    /// `w` holds one weight for each interval, and the offsets stay within them.
    pub(crate) fn check(&self, what: &'static str, w: usize) -> Result<(), LossError> {
        if !self.offsets.is_sorted() {
            return Err(LossError::Order { what: "offsets" });
        }
        let last = self.offsets.last().copied().unwrap_or(0) as usize;
        if last != w {
            return Err(LossError::Shape { what, want: last, got: w });
        }
        let same = |what, want, got| if want == got { Ok(()) } else { Err(LossError::Shape { what, want, got }) };
        match self.edges {
            Edges::Joined(s) => same("edges", w + self.rays(), s.len()),
            Edges::Apart { start, end } => same("start", w, start.len()).and(same("end", w, end.len())),
        }
    }
}
