//! Points at their time steps, the gradients that they bring, and room for a tile of them.

use super::time::TimeSteps;
use field_core::tape::Arena;

/// Points and their time steps.
#[derive(Clone, Copy)]
pub(crate) struct Points<'a> {
    /// `[3][n]`, in the unit cube.
    pub(crate) x: &'a [f32],
    /// `[n]`, which of the time steps each belongs to.
    pub(crate) which: &'a [u32],
    /// The time steps.
    pub(crate) time_steps: &'a TimeSteps,
}

impl Points<'_> {
    /// Whether nothing moves at a point's time.
    #[inline(always)]
    pub(super) fn rests(&self, i: u32) -> bool {
        self.time_steps.still[self.which[i as usize] as usize]
    }

    /// Points `[3][columns]`, rows of time steps `[dims][columns]` and times `[columns]` of some columns.
    pub(super) fn gather(&self, columns: &[u32], x: &mut Vec<f32>, time: &mut Vec<f32>, t: &mut Vec<f32>) {
        gather(self.x, self.which.len(), columns, x);
        let TimeSteps { dims, rows, times, .. } = self.time_steps;
        let step = |i: u32| self.which[i as usize] as usize;
        t.clear();
        t.extend(columns.iter().map(|&i| times[step(i)]));
        time.clear();
        for k in 0..*dims {
            time.extend(columns.iter().map(|&i| rows[step(i) * dims + k]));
        }
    }
}

/// Where gradients of a deformation go.
#[derive(Clone, Debug, Default)]
pub(crate) struct DeformGrad {
    /// As the parameters of networks and planes.
    pub(super) params: Vec<f32>,
    /// `[steps][dims]`, of the rows of time steps.
    pub(super) times: Vec<f32>,
}

impl DeformGrad {
    /// Add the gradients of the time of some columns, `[dims][columns]`, to those of their time steps.
    pub(super) fn add_times(&mut self, points: &Points<'_>, columns: &[u32], bars: &[f32]) {
        let (dims, m) = (points.time_steps.dims, columns.len());
        for (k, &i) in columns.iter().enumerate() {
            let out = &mut self.times[points.which[i as usize] as usize * dims..][..dims];
            out.iter_mut().enumerate().for_each(|(d, sum)| *sum += bars[d * m + k]);
        }
    }
}

/// Work space.
#[derive(Default)]
pub(crate) struct DeformScratch {
    pub(super) tape: Arena,
    pub(super) columns: Vec<u32>,
    pub(super) x: Vec<f32>,
    pub(super) time: Vec<f32>,
    pub(super) t: Vec<f32>,
    pub(super) x_bar: Vec<f32>,
    pub(super) seen_bar: Vec<f32>,
    /// `[3][columns]`, neighbours of points, and the way to them.
    pub(super) near: Vec<f32>,
    pub(super) way: Vec<f32>,
}

impl DeformScratch {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.tape.memory_bytes() + 4 * (self.x.capacity() + self.time.capacity() + self.columns.capacity())
    }
}

/// Columns `columns` of the rows of `from`, `[rows][n]`, to `out`, `[rows][columns]`.
pub(super) fn gather(from: &[f32], n: usize, columns: &[u32], out: &mut Vec<f32>) {
    out.clear();
    for row in from.chunks_exact(n) {
        out.extend(columns.iter().map(|&i| row[i as usize]));
    }
}

/// The other direction: write `from` `[rows][columns]` over the columns of `out`, `[rows][n]`.
pub(super) fn scatter(from: &[f32], n: usize, columns: &[u32], out: &mut [f32]) {
    for (from, out) in from.chunks_exact(columns.len()).zip(out.chunks_exact_mut(n)) {
        for (value, &i) in from.iter().zip(columns) {
            out[i as usize] = *value;
        }
    }
}
