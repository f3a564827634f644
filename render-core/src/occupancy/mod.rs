//! The occupancy grid: which cells of space hold anything, so that rays skip the others.
//!
//! # Space
//! Positions are **grid coordinates**: the scene normalised so that its main part lies in `[-1, 1]^3`. Cascade `k` covers
//! the cube `[-2^k, 2^k]^3` with `resolution^3` cells of side `2^(k + 1) / resolution`; each is twice as coarse as the one
//! inside it. A point belongs to the smallest cascade that contains it and whose cells are larger than two steps.
//!
//! # Cells
//! Each cell keeps a running maximum of the optical thickness that one shortest step has in it. It is occupied when that
//! exceeds `min(threshold, mean)`; a coarse cell also when a cell of a finer cascade inside it is. Before the first
//! update every cell that a camera sees counts as occupied.
//!
//! # Memory
//! 4 bytes and 1 bit a cell: 8.7 MB for one cascade of 128^3, times the cascades. Cells are numbered in nested blocks:
//! `id = ((block_16 * 64) + block_4 in it) * 64 + cell in it`, x fastest on each level, so that one 64-bit word is a block of
//! 4^3 cells and one word of the level above tells which of its 4^3 blocks have any.
//!
//! # Source
//! Müller et al., "Instant Neural Graphics Primitives", 2022, section 5.4 and appendix.

mod cells;
mod march;
mod update;

pub use cells::CellBits;
pub use march::{Marched, RaySpan, StepRule};

use alloc::vec;
use alloc::vec::Vec;
use core::fmt;

/// Shape and constants of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct GridSettings {
    /// Cells along each axis of a cascade; a multiple of 16.
    pub resolution: u32,
    /// Number of cascades, at least 1.
    pub cascades: u32,
    /// Factor on the running maximum of a cell each time it is updated.
    pub decay: f32,
    /// Optical thickness of one shortest step above which a cell is always occupied.
    pub threshold: f32,
}

impl GridSettings {
    /// 128^3, one cascade, decay 0.95, threshold 0.01.
    pub const DEFAULT: Self = Self { resolution: 128, cascades: 1, decay: 0.95, threshold: 0.01 };

    float_core::setters! {
        with_resolution resolution: u32;
        with_cascades cascades: u32;
        with_decay decay: f32;
        with_threshold threshold: f32;
    }
}

impl Default for GridSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A grid that cannot be made.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum GridError {
    /// The resolution is 0 or not a multiple of 16.
    Resolution(u32),
    /// No cascades, or more than 16.
    Cascades(u32),
    /// More than `2^31` cells in all.
    Cells(u64),
    /// Saved state has `got` cells where the settings make `want`.
    State {
        /// Cells that there are.
        got: usize,
        /// Cells that there should be.
        want: usize,
    },
    /// Saved state holds NaN at this cell.
    Nan(usize),
}

impl fmt::Display for GridError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Resolution(r) => write!(f, "occupancy resolution {r}: it must be a multiple of 16, at least 16"),
            Self::Cascades(k) => write!(f, "{k} occupancy cascades: there must be 1 to 16"),
            Self::Cells(n) => write!(f, "{n} occupancy cells: more than 2^31, use a lower resolution"),
            Self::State { got, want } => write!(f, "saved occupancy has {got} cells, the grid has {want}"),
            Self::Nan(i) => write!(f, "saved occupancy of cell {i} is NaN"),
        }
    }
}

impl core::error::Error for GridError {}

/// What a cell that no camera sees holds.
const INVISIBLE: f32 = -1.0;

/// Cascades of bits over space. See the [module](self).
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyGrid {
    settings: GridSettings,
    /// Running maximum of each cell, negative where no camera sees it.
    thickness: Vec<f32>,
    occupied: CellBits,
    /// What each axis adds to a cell's number: `axis[x][0] + axis[y][1] + axis[z][2]`.
    axis: Vec<[u32; 3]>,
    updates: u64,
}

impl OccupancyGrid {
    /// A grid with every cell occupied.
    ///
    /// # Errors
    /// [`GridError`] when the settings make no grid.
    pub fn new(settings: GridSettings) -> Result<Self, GridError> {
        let GridSettings { resolution, cascades, .. } = settings;
        if resolution == 0 || !resolution.is_multiple_of(16) {
            return Err(GridError::Resolution(resolution));
        }
        if !(1..=16).contains(&cascades) {
            return Err(GridError::Cascades(cascades));
        }
        let cells = u64::from(resolution).saturating_pow(3).saturating_mul(u64::from(cascades));
        if cells > 1 << 31 {
            return Err(GridError::Cells(cells));
        }
        let cells = cells as usize;
        let blocks_16 = resolution / 16;
        let axis = (0..resolution)
            .map(|x| {
                let in_block = (x & 3) | ((x >> 2 & 3) << 6);
                let block = x >> 4;
                [
                    in_block + (block << 12),
                    (in_block << 2) + ((block * blocks_16) << 12),
                    (in_block << 4) + ((block * blocks_16 * blocks_16) << 12),
                ]
            })
            .collect();
        Ok(Self {
            settings,
            thickness: vec![0.0; cells],
            occupied: CellBits::new(vec![u64::MAX; cells / 64]),
            axis,
            updates: 0,
        })
    }

    /// A grid as it was saved: the settings, [`thickness`](Self::thickness) and [`updates`](Self::updates) are all there is.
    ///
    /// # Errors
    /// [`GridError`] when the settings make no grid or the state is of another.
    pub fn from_state(settings: GridSettings, thickness: &[f32], updates: u64) -> Result<Self, GridError> {
        let mut grid = Self::new(settings)?;
        if thickness.len() != grid.thickness.len() {
            return Err(GridError::State { got: thickness.len(), want: grid.thickness.len() });
        }
        if let Some(i) = thickness.iter().position(|x| x.is_nan()) {
            return Err(GridError::Nan(i));
        }
        grid.thickness.copy_from_slice(thickness);
        grid.updates = updates;
        grid.rebuild();
        Ok(grid)
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> GridSettings {
        self.settings
    }

    /// `[cells]` running maximum of the optical thickness of a shortest step; negative where no camera sees the cell.
    #[must_use]
    pub fn thickness(&self) -> &[f32] {
        &self.thickness
    }

    /// `[cells / 64]` the occupied cells, one bit each, lowest bit first.
    #[must_use]
    pub fn bits(&self) -> &[u64] {
        &self.occupied.bits
    }

    /// The occupied cells.
    #[must_use]
    pub fn occupied_set(&self) -> &CellBits {
        &self.occupied
    }

    /// Number of updates so far.
    #[must_use]
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.thickness.len()
    }

    /// Number of occupied cells.
    #[must_use]
    pub fn occupied_cells(&self) -> u64 {
        self.occupied.count()
    }

    /// Number of cells that some camera sees.
    #[must_use]
    pub fn visible_cells(&self) -> u64 {
        self.thickness.iter().map(|&x| u64::from(x >= 0.0)).sum()
    }

    /// Bytes held.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        4 * self.thickness.len() + self.occupied.memory_bytes() + 12 * self.axis.len()
    }

    /// Half the side of the outermost cube, grid units: nothing outside is ever marched through.
    #[must_use]
    pub fn half_extent(&self) -> f32 {
        (1_u32 << (self.settings.cascades - 1)) as f32
    }

    /// Side of a cell of cascade `k`, grid units.
    #[must_use]
    pub fn cell_side(&self, k: u32) -> f32 {
        (2_u32 << k) as f32 / self.settings.resolution as f32
    }

    /// Number of the cell at column `x`, row `y`, layer `z` of cascade `k`.
    ///
    /// # Panics
    /// When there is no such cell.
    #[must_use]
    pub fn cell(&self, k: u32, [x, y, z]: [u32; 3]) -> u32 {
        assert!(k < self.settings.cascades, "cascade {k}");
        k * self.cascade_cells() + self.axis[x as usize][0] + self.axis[y as usize][1] + self.axis[z as usize][2]
    }

    /// Cascade and column, row, layer of a cell: [`cell`](Self::cell) backwards.
    #[must_use]
    pub fn coordinates(&self, id: u32) -> (u32, [u32; 3]) {
        let (k, id) = (id / self.cascade_cells(), id % self.cascade_cells());
        let blocks_16 = self.settings.resolution / 16;
        let block = id >> 12;
        let block = [block % blocks_16, block / blocks_16 % blocks_16, block / (blocks_16 * blocks_16)];
        (k, core::array::from_fn(|a| (block[a] << 4) | ((id >> (6 + 2 * a) & 3) << 2) | (id >> (2 * a) & 3)))
    }

    /// Lowest corner and side of a cell, grid units.
    ///
    /// # Panics
    /// May do so when there is no such cell.
    #[must_use]
    pub fn cell_box(&self, id: u32) -> ([f32; 3], f32) {
        let (k, x) = self.coordinates(id);
        let (side, half) = (self.cell_side(k), (1_u32 << k) as f32);
        (x.map(|x| x as f32 * side - half), side)
    }

    /// A point of a cell, grid units; `u` in `[0, 1)` says where in it.
    ///
    /// # Panics
    /// As [`cell_box`](Self::cell_box).
    #[must_use]
    pub fn cell_point(&self, id: u32, u: [f32; 3]) -> [f32; 3] {
        let (corner, side) = self.cell_box(id);
        core::array::from_fn(|a| corner[a] + u[a] * side)
    }

    /// Whether a sample of length `dt` (grid units; 0 for a bare point) at `p` would be taken. Outside: no.
    #[must_use]
    pub fn occupied(&self, p: [f32; 3], dt: f32) -> bool {
        self.holds(&self.occupied, p, dt)
    }

    /// [`occupied`](Self::occupied), were these cells the occupied ones.
    ///
    /// # Panics
    /// May do so when they are of another grid.
    #[must_use]
    pub fn holds(&self, cells: &CellBits, p: [f32; 3], dt: f32) -> bool {
        self.cell_of(p, dt).is_some_and(|id| cells.contains(id))
    }

    /// The cell that says whether a sample of length `dt` (grid units; 0 for a bare point) at `p` is taken. Outside: none.
    #[must_use]
    pub fn cell_of(&self, p: [f32; 3], dt: f32) -> Option<u32> {
        let m = max_abs(p);
        let is_inside = !m.is_nan() && m <= self.half_extent();
        is_inside.then(|| self.locate(p, self.cascade(p, dt)).0)
    }

    fn cascade_cells(&self) -> u32 {
        self.settings.resolution.pow(3)
    }

    /// Cascade of a point and of a sample of length `dt`.
    #[inline(always)]
    fn cascade(&self, p: [f32; 3], dt: f32) -> u32 {
        // The smallest k with -2^k <= p < 2^k, as cells hold their lower faces and not their upper ones, and with
        // 2 dt < 2^(k + 1) / resolution. Numbers that are not negative have the order of their bits: the exponent of the largest tells.
        let [x, y, z] = p.map(|p| (p.to_bits() & !SIGN).saturating_sub(p.to_bits() >> 31));
        let largest = x.max(y).max(z).max((dt * self.settings.resolution as f32).to_bits());
        ((largest >> 23) as i32 - 126).clamp(0, self.settings.cascades as i32 - 1) as u32
    }

    /// Number and place of the cell of cascade `k` that holds `p`.
    #[inline(always)]
    fn locate(&self, p: [f32; 3], k: u32) -> (u32, [u32; 3]) {
        let half = 0.5 * self.settings.resolution as f32;
        let scale = half * inv_pow2(k);
        let top = (self.settings.resolution - 1) as f32;
        let x = p.map(|p| floor_within(p * scale + half, top));
        let axis = &self.axis;
        (k * self.cascade_cells() + axis[x[0] as usize][0] + axis[x[1] as usize][1] + axis[x[2] as usize][2], x)
    }
}

/// The bit of a number's sign.
const SIGN: u32 = 1 << 31;

/// Largest coordinate, sign aside; NaN when the first is.
#[inline(always)]
fn max_abs(p: [f32; 3]) -> f32 {
    let m = p[0].abs();
    let m = if p[1].abs() <= m { m } else { p[1].abs() };
    if p[2].abs() <= m { m } else { p[2].abs() }
}

/// `2^k`, for `k < 128`.
#[inline(always)]
fn pow2(k: u32) -> f32 {
    f32::from_bits((127 + k) << 23)
}

/// `2^-k`, for `k < 127`.
#[inline(always)]
fn inv_pow2(k: u32) -> f32 {
    f32::from_bits((127 - k) << 23)
}

/// The whole number in `[0, top]` below `x`, or at its ends.
#[inline(always)]
fn floor_within(x: f32, top: f32) -> u32 {
    // Added to 2^23 a number leaves its integer part in the low bits; the clamp also takes out NaN. Cheaper than a
    // saturating cast. Rounding up is undone.
    const MAGIC: f32 = (1 << 23) as f32;
    let x = x.max(0.0).min(top);
    let shifted = x + MAGIC;
    (shifted.to_bits() - MAGIC.to_bits()) - u32::from(shifted - MAGIC > x)
}
