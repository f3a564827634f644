//! In which spans of time the cells of an occupancy grid are full: a ray of one time passes over what is full at others only.
//!
//! The grid itself tells what is ever full. Here the times of the photos are cut into spans, the bins, and two periods of bits say where
//! probes found something in each: this period and the one before. In a period an occupied cell is probed about [`PROBES`] times in each bin.
//! A cell is visible in a bin where the grid counts it as occupied, and it, or one of its neighbours in space, was found full in this
//! bin or one beside it. So a cell is lost for a time only where all 27 were found empty around that time in two periods. Before the first
//! period is over nothing is known to be empty.

use super::probe::{Found, updates_of};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_counts, take_numbers, take_u64, u64_tensor};
use rayon::prelude::*;
use render_core::occupancy::{CellBits, OccupancyGrid};

/// Bins at most: a bit each of a word.
pub(super) const MOST_BINS: usize = 64;
/// Fewer times than this are not told apart.
const LEAST_TIMES: usize = 4;
/// Times at which an occupied cell is probed in each bin, in a period.
const PROBES: u64 = 2;

/// The names of a checkpoint.
const EDGES: &str = "occupancy.times";
const NOW: &str = "occupancy.now";
const BEFORE: &str = "occupancy.before";
const PERIOD: &str = "occupancy.period";

/// In which bins of time the cells of a grid are full.
pub(super) struct TimeBins {
    /// `[bins - 1]`, where one bin ends and the next begins: times in `[-1, 1]`, ascending.
    edges: Vec<f32>,
    /// Words of a bit for each cell.
    words: usize,
    /// `[bins][words]`, cells found full in this period, and in the one before.
    now: Vec<u64>,
    before: Vec<u64>,
    /// Updates of this period, and periods that are over.
    updates: u64,
    periods: u64,
    /// `[bins]`; empty in the first period.
    visible: Vec<CellBits>,
}

/// Where bins begin and end among the times of views, which are in `[-1, 1]`: `most` bins of equally many times, or fewer where there are
/// fewer times. `None` where there are too few to tell apart.
pub(super) fn edges_of(times: &[f32], most: usize) -> Option<Vec<f32>> {
    let mut distinct: Vec<f32> = times.iter().copied().filter(|time| time.is_finite()).collect();
    distinct.sort_unstable_by(f32::total_cmp);
    distinct.dedup();
    let bins = most.min(distinct.len()).min(MOST_BINS);
    if bins < 2 || distinct.len() < LEAST_TIMES {
        return None;
    }
    let edge = |bin: usize| {
        let first = bin * distinct.len() / bins;
        0.5 * (distinct[first - 1] + distinct[first])
    };
    Some((1..bins).map(edge).collect())
}

impl TimeBins {
    /// Bins between these edges, at least one of them, of which nothing is known.
    pub(super) fn new(edges: Vec<f32>, grid: &OccupancyGrid) -> Self {
        let words = grid.bits().len();
        let all = (edges.len() + 1) * words;
        Self { edges, words, now: vec![0; all], before: vec![0; all], updates: 0, periods: 0, visible: Vec::new() }
    }

    /// Where bins begin and end.
    pub(super) fn edges(&self) -> &[f32] {
        &self.edges
    }

    pub(super) fn bins(&self) -> usize {
        self.edges.len() + 1
    }

    /// Bytes that so many bins of a grid hold once a period is over.
    pub(super) fn bytes_of(bins: usize, grid: &OccupancyGrid) -> usize {
        bins * (2 * size_of_val(grid.bits()) + grid.occupied_set().memory_bytes())
    }

    /// The bin of a time.
    fn bin(&self, time: f32) -> usize {
        self.edges.partition_point(|edge| *edge <= time)
    }

    /// The bits of all bins.
    pub(super) fn all(&self) -> u64 {
        u64::MAX >> (MOST_BINS - self.bins())
    }

    /// Of each time the bit of its bin.
    pub(super) fn bits_of(&self, times: &[f32]) -> Vec<u64> {
        times.iter().map(|&time| 1 << self.bin(time)).collect()
    }

    /// The cells that are visible at a time; `None` for times beyond those of the photos, and where nothing is known yet.
    pub(super) fn visible_at(&self, time: f32) -> Option<&CellBits> {
        let is_within = (-1.0..=1.0).contains(&time);
        self.visible.get(self.bin(time)).filter(|_| is_within)
    }

    /// Cells that were found full. What is seen follows with [`TimeBins::refresh`].
    pub(super) fn note(&mut self, found: &[Found]) {
        self.now.par_chunks_mut(self.words).enumerate().for_each(|(bin, now)| {
            for Found { cell, bins } in found {
                now[*cell as usize / 64] |= (bins >> bin & 1) << (cell % 64);
            }
        });
    }

    /// Take in what the tasks of an update found: [`TimeBins::note`], and an update of the period is over.
    pub(super) fn learn(&mut self, found: &[Vec<Found>]) {
        found.iter().for_each(|found| self.note(found));
        self.updates += 1;
        if self.updates >= updates_of(PROBES * self.bins() as u64) {
            std::mem::swap(&mut self.now, &mut self.before);
            self.now.fill(0);
            self.updates = 0;
            self.periods += 1;
        }
    }

    /// These cells, a bit each, count as found full in all bins: they stay in sight until the next period is over.
    pub(super) fn open(&mut self, cells: &[u64]) {
        for now in self.now.chunks_exact_mut(self.words) {
            now.iter_mut().zip(cells).for_each(|(now, cells)| *now |= cells);
        }
    }

    /// See anew which cells are visible, of those that the grid counts as occupied.
    pub(super) fn refresh(&mut self, grid: &OccupancyGrid) {
        if self.periods == 0 {
            return;
        }
        let of_bin = |bin: usize| {
            let mut bits = vec![0_u64; self.words];
            for near in bin.saturating_sub(1)..=(bin + 1).min(self.bins() - 1) {
                for found in [&self.now, &self.before] {
                    let found = &found[near * self.words..][..self.words];
                    bits.iter_mut().zip(found).for_each(|(bits, found)| *bits |= found);
                }
            }
            // Coarse cells first: what lies at the border of a fine cascade has its neighbours among them.
            grid.lift(&mut bits);
            grid.dilate(&mut bits);
            bits.iter_mut().zip(grid.bits()).for_each(|(bits, occupied)| *bits &= occupied);
            CellBits::new(bits)
        };
        self.visible = (0..self.bins()).into_par_iter().map(of_bin).collect();
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let visible: usize = self.visible.iter().map(CellBits::memory_bytes).sum();
        4 * self.edges.len() + 8 * (self.now.len() + self.before.len()) + visible
    }

    /// Everything that the next update depends on, besides the grid.
    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(EDGES, &self.edges));
        out.push(u64_tensor(NOW, self.now.clone()));
        out.push(u64_tensor(BEFORE, self.before.clone()));
        out.push(u64_tensor(PERIOD, vec![self.updates, self.periods]));
    }

    /// What [`TimeBins::push_state`] gave, beside this grid; `None` where a checkpoint has no bins.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(super) fn of_state(state: &TensorMap, grid: &OccupancyGrid) -> Result<Option<Self>, SystemError> {
        let Some(edges) = state.get(EDGES) else { return Ok(None) };
        let edges = take_numbers(state, EDGES, edges.shape.first().copied().unwrap_or(0))?;
        if !(1..MOST_BINS).contains(&edges.len()) || !edges.is_sorted() {
            let problem = format!("1 to {} ascending numbers expected", MOST_BINS - 1);
            return Err(SystemError::State { name: EDGES.into(), problem });
        }
        let mut bins = Self::new(edges, grid);
        bins.now = take_u64(state, NOW, bins.now.len())?;
        bins.before = take_u64(state, BEFORE, bins.before.len())?;
        let period = take_counts(state, PERIOD, 2)?;
        (bins.updates, bins.periods) = (period[0], period[1]);
        bins.refresh(grid);
        Ok(Some(bins))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::occupancy::GridSettings;

    fn grid() -> OccupancyGrid {
        OccupancyGrid::new(GridSettings::default().with_resolution(16).with_cascades(2)).unwrap()
    }

    /// Bins of eight times, from -1 to 1.
    fn bins(grid: &OccupancyGrid) -> TimeBins {
        let times: Vec<f32> = (0..8).map(time).collect();
        TimeBins::new(edges_of(&times, 24).unwrap(), grid)
    }

    fn time(k: usize) -> f32 {
        2.0 * k as f32 / 7.0 - 1.0
    }

    fn period(bins: &TimeBins) -> u64 {
        updates_of(PROBES * bins.bins() as u64)
    }

    fn update(bins: &mut TimeBins, grid: &OccupancyGrid, found: &[Found]) {
        bins.learn(&[found.to_vec()]);
        bins.refresh(grid);
    }

    #[test]
    fn bins_hold_equally_many_times_and_none_is_without() {
        let times: Vec<f32> = [0.5, -1.0, 0.5, 0.9, -0.9, 1.0, -0.8].repeat(3);
        assert_eq!(edges_of(&times, 3).unwrap(), [0.5 * (-0.9_f32 - 0.8), 0.5 * (0.5_f32 + 0.9)]);
        assert_eq!(edges_of(&times, 24).unwrap().len(), 5, "one for each time");
        for most in [2, 4, 5] {
            let bins = TimeBins::new(edges_of(&times, most).unwrap(), &grid());
            let met = bins.bits_of(&times).into_iter().fold(0, |met, bit| met | bit);
            assert_eq!((bins.bins(), met), (most, bins.all()), "each bin has times");
        }
        let many: Vec<f32> = (0..1000).map(|i| i as f32 / 999.0).collect();
        let all = TimeBins::new(edges_of(&many, 64).unwrap(), &grid());
        assert_eq!((all.bins(), all.all()), (64, u64::MAX));
        assert_eq!([0, 1].map(|most| edges_of(&times, most)), [None, None]);
        assert_eq!((edges_of(&times[..3], 24), edges_of(&[f32::NAN; 9], 24), edges_of(&[], 24)), (None, None, None));
    }

    #[test]
    fn a_cell_is_seen_around_its_place_and_time_until_two_periods_found_it_empty() {
        let grid = grid();
        let mut bins = bins(&grid);
        let (cell, beside, far) = (grid.cell(0, [4, 5, 6]), grid.cell(0, [5, 4, 7]), grid.cell(0, [6, 5, 6]));
        let around = grid.cell(1, [4 + 4 / 2, 4 + 5 / 2, 4 + 6 / 2]);
        for update_of in 1..=3 * period(&bins) {
            // In the fourth of eight bins, once in the first period.
            let found = if update_of == 3 { vec![Found { cell, bins: 1 << 3 }] } else { Vec::new() };
            update(&mut bins, &grid, &found);
            if update_of < period(&bins) {
                assert!((0..8).all(|k| bins.visible_at(time(k)).is_none()), "nothing is known in the first period");
                continue;
            }
            for k in 0..8 {
                let visible = bins.visible_at(time(k)).unwrap();
                let seen = (2..=4).contains(&k) && update_of < 2 * period(&bins);
                assert_eq!([cell, beside, around].map(|id| visible.contains(id)), [seen; 3], "bin {k}, {update_of}");
                assert!(!visible.contains(far));
            }
        }
        // Beyond the photos' times nothing is known.
        assert!([-1.01, 1.01, f32::NAN].iter().all(|&time| bins.visible_at(time).is_none()));
    }

    #[test]
    fn what_is_opened_is_seen_at_all_times_until_the_next_period_is_over() {
        let grid = grid();
        let mut bins = bins(&grid);
        let cell = grid.cell(1, [3, 3, 3]);
        for _ in 0..period(&bins) + 3 {
            update(&mut bins, &grid, &[]);
        }
        let seen = |bins: &TimeBins| (0..8).filter(|&k| bins.visible_at(time(k)).unwrap().contains(cell)).count();
        assert_eq!(seen(&bins), 0);
        let mut cells = vec![0; grid.bits().len()];
        cells[cell as usize / 64] = 1 << (cell % 64);
        bins.open(&cells);
        bins.refresh(&grid);
        for k in 0..2 * period(&bins) {
            assert_eq!(seen(&bins), if k < 2 * period(&bins) - 3 { 8 } else { 0 }, "after {k} updates");
            update(&mut bins, &grid, &[]);
        }
    }

    #[test]
    fn nothing_is_seen_that_the_grid_counts_as_empty() {
        let mut grid = grid();
        let mut bins = bins(&grid);
        let cells: Vec<u32> = (0..grid.cells() as u32).collect();
        let found: Vec<Found> = cells.iter().map(|&cell| Found { cell, bins: bins.all() }).collect();
        for _ in 0..period(&bins) {
            update(&mut bins, &grid, &found);
        }
        assert_eq!(bins.visible_at(0.0), Some(grid.occupied_set()));
        let thickness: Vec<f32> = cells.iter().map(|id| (id % 3) as f32).collect();
        grid.update(&cells, &thickness);
        assert!(grid.occupied_cells() < grid.cells() as u64);
        bins.refresh(&grid);
        assert!((0..8).all(|k| bins.visible_at(time(k)) == Some(grid.occupied_set())));
    }

    #[test]
    fn state_comes_back_and_what_does_not_fit_is_refused() {
        let grid = grid();
        let mut whole = bins(&grid);
        for k in 0..period(&whole) + 2 {
            let cell = (97 * k) as u32 % grid.cells() as u32;
            update(&mut whole, &grid, &[Found { cell, bins: 1 << (k % 8) }]);
        }
        let mut out = Vec::new();
        whole.push_state(&mut out);
        let state: TensorMap = out.into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
        let mut copy = TimeBins::of_state(&state, &grid).unwrap().unwrap();
        assert!(copy.visible == whole.visible && copy.edges == whole.edges);
        for bins in [&mut copy, &mut whole] {
            for _ in 0..period(bins) - 1 {
                update(bins, &grid, &[Found { cell: 5, bins: 1 }]);
            }
        }
        assert!(copy.visible == whole.visible && copy.now == whole.now && copy.before == whole.before);
        assert!((copy.updates, copy.periods) == (whole.updates, whole.periods) && whole.periods == 2);
        assert!(TimeBins::of_state(&TensorMap::new(), &grid).unwrap().is_none());
        for name in [NOW, BEFORE, PERIOD] {
            let mut less = state.clone();
            less.remove(name);
            assert!(TimeBins::of_state(&less, &grid).is_err_and(|e| e.to_string().contains(name)));
        }
        let mut forged = state.clone();
        forged.insert(EDGES.into(), f32_tensor(EDGES, &[0.5, 0.1, 0.2, 0.3, 0.4, 0.6, 0.7]).into_owned());
        assert!(TimeBins::of_state(&forged, &grid).is_err_and(|e| e.to_string().contains(EDGES)));
    }
}
