//! The times of the training views, and what lies between them.

use engine::data::Dataset;

/// Distinct times of the training views, ascending, and which of them each view shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Times {
    /// `[steps]`, in `[0, 1]`.
    distinct: Vec<f64>,
    /// `[views]`
    of_view: Vec<u32>,
}

/// Two time steps and how far a time is from the first to the second, `0..=1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Between {
    pub(crate) before: usize,
    pub(crate) after: usize,
    pub(crate) share: f32,
}

impl Times {
    /// Those of the training views.
    pub(crate) fn of(data: &Dataset) -> Self {
        Self::of_list(&data.views().iter().map(|view| view.time).collect::<Vec<f64>>())
    }

    /// Those of views with these times.
    pub(crate) fn of_list(times: &[f64]) -> Self {
        let mut distinct = times.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        let place = |t: &f64| distinct.partition_point(|m| m < t) as u32;
        let of_view = times.iter().map(place).collect();
        Self { distinct, of_view }
    }

    /// Number of time steps.
    pub(crate) fn len(&self) -> usize {
        self.distinct.len()
    }

    /// Time of each view.
    pub(crate) fn of_views(&self) -> impl Iterator<Item = f64> + '_ {
        self.of_view.iter().map(|&step| self.distinct[step as usize])
    }

    /// Time step of a view.
    pub(crate) fn step(&self, view: usize) -> usize {
        self.of_view[view] as usize
    }

    /// Views in the order of time.
    pub(crate) fn in_order(&self) -> Vec<u32> {
        let mut views: Vec<u32> = (0..self.of_view.len() as u32).collect();
        views.sort_by_key(|&v| self.of_view[v as usize]);
        views
    }

    /// A time between that of a view and that of a neighbouring time step: `u[0]` says which of the two, `u[1]` how far towards it.
    pub(crate) fn beside(&self, view: usize, u: [f32; 2]) -> f64 {
        let (k, last) = (self.step(view), self.distinct.len() - 1);
        let other = match k {
            0 => last.min(1),
            _ if k == last || u[0] < 0.5 => k - 1,
            _ => k + 1,
        };
        self.distinct[k] + f64::from(u[1]) * (self.distinct[other] - self.distinct[k])
    }

    /// The time steps around a time; before the first and after the last one stands still.
    pub(crate) fn between(&self, time: f64) -> Between {
        let last = self.distinct.len().saturating_sub(1);
        let after = self.distinct.partition_point(|&t| t < time).min(last);
        let before = if self.distinct.get(after).is_some_and(|&t| t <= time) { after } else { after.saturating_sub(1) };
        let gap = self.distinct.get(after).zip(self.distinct.get(before)).map_or(0.0, |(b, a)| b - a);
        let share = if gap > 0.0 { ((time - self.distinct[before]) / gap).clamp(0.0, 1.0) as f32 } else { 0.0 };
        Between { before, after, share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(distinct: &[f64]) -> Times {
        Times { distinct: distinct.to_vec(), of_view: (0..distinct.len() as u32).collect() }
    }

    #[test]
    fn a_time_lies_between_its_neighbours_and_ends_stand_still() {
        let t = times(&[0.0, 0.5, 1.0]);
        assert_eq!(t.between(0.5), Between { before: 1, after: 1, share: 0.0 });
        assert_eq!(t.between(0.75), Between { before: 1, after: 2, share: 0.5 });
        assert_eq!(t.between(-1.0), Between { before: 0, after: 0, share: 0.0 });
        assert_eq!(t.between(2.0).after, 2);
        let after = t.between(2.0);
        assert!(after.share == 0.0 || after.before == after.after || after.share == 1.0, "{after:?}");
        assert_eq!(times(&[0.3]).between(0.9), Between { before: 0, after: 0, share: 0.0 });
    }

    #[test]
    fn a_time_beside_a_view_is_on_the_way_to_a_neighbour() {
        let t = times(&[0.0, 0.5, 1.0]);
        assert_eq!([[0.0, 0.5], [0.9, 0.5]].map(|u| t.beside(0, u)), [0.25; 2], "the first has one neighbour");
        assert_eq!([[0.0, 0.5], [0.9, 0.5]].map(|u| t.beside(1, u)), [0.25, 0.75]);
        assert_eq!([[0.0, 0.5], [0.9, 0.5]].map(|u| t.beside(2, u)), [0.75; 2], "and so has the last");
        assert_eq!((t.beside(1, [0.0; 2]), times(&[0.3]).beside(0, [0.9; 2])), (0.5, 0.3));
    }
}
