//! Multiresolution hash grid: features stored at the vertices of several grids, blended trilinearly.
//!
//! Source: Müller et al., "Instant neural graphics primitives with a multiresolution hash encoding", 2022, section 3.

mod batch;
mod level;
mod touched;

use core::ops::Range;

use float_core::Simd;

use crate::FieldError;
use crate::encoding::lattice::kernel::{Axes, Gather, Place, Scatter};
pub use crate::encoding::lattice::{Addressing, Interpolation};
use crate::encoding::{axes, check_points, rows, rows_mut};
use crate::error::check_len;
pub use level::{Level, MAX_LEVELS};
pub use touched::{BLOCK_FLOATS, Touched};

/// Where the vertices of a level lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// As in the authors' code: `p = x (N b^l - 1) + 1/2`, `ceil(N b^l - 1) + 1` vertices, dense levels rounded up to 8
    /// entries. The half staggers the levels. At `x = 1` the index one past the last vertex wraps to another entry.
    Ngp,
    /// As in the paper's text: `N_l = floor(N b^l)` cells, `p = x N_l`, `N_l + 1` vertices.
    Paper,
}

/// How resolutions grow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Growth {
    /// By this factor from level to level, `>= 1`.
    Factor(f64),
    /// Geometrically, so that the last level has this size.
    UpTo(u32),
}

/// Size of a hash grid: [`HashGridConfig::default`], changed by `with_` and the name of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct HashGridConfig {
    /// Levels, `1..=32`.
    pub levels: usize,
    /// Features for each entry: 1, 2, 4 or 8.
    pub features: usize,
    /// Each level has at most `2^log2_table` entries, `3..=28`.
    pub log2_table: u32,
    /// Size of the coarsest level.
    pub n_min: u32,
    /// Sizes of the others.
    pub growth: Growth,
    /// Where vertices lie.
    pub rule: Rule,
    /// Between vertices.
    pub interpolation: Interpolation,
}

impl Default for HashGridConfig {
    /// The paper's: 16 levels of 2 features, `2^19` entries, 16 to 2048.
    fn default() -> Self {
        Self {
            levels: 16,
            features: 2,
            log2_table: 19,
            n_min: 16,
            growth: Growth::UpTo(2048),
            rule: Rule::Ngp,
            interpolation: Interpolation::Linear,
        }
    }
}

impl HashGridConfig {
    /// Number of levels, `1..=32`.
    #[must_use]
    pub fn with_levels(self, levels: usize) -> Self {
        Self { levels, ..self }
    }

    /// Features for each entry: 1, 2, 4 or 8.
    #[must_use]
    pub fn with_features(self, features: usize) -> Self {
        Self { features, ..self }
    }

    /// At most `2^log2_table` entries for each level, `3..=28`.
    #[must_use]
    pub fn with_log2_table(self, log2_table: u32) -> Self {
        Self { log2_table, ..self }
    }

    /// Size of the coarsest level.
    #[must_use]
    pub fn with_n_min(self, n_min: u32) -> Self {
        Self { n_min, ..self }
    }

    /// Sizes of the other levels.
    #[must_use]
    pub fn with_growth(self, growth: Growth) -> Self {
        Self { growth, ..self }
    }

    /// Where vertices lie.
    #[must_use]
    pub fn with_rule(self, rule: Rule) -> Self {
        Self { rule, ..self }
    }

    /// How values between vertices are blended.
    #[must_use]
    pub fn with_interpolation(self, interpolation: Interpolation) -> Self {
        Self { interpolation, ..self }
    }
}

/// The layout of a hash grid. Parameters are the caller's: one buffer `[entry][feature]`, levels one after the other,
/// each starting at `level.offset` entries.
///
/// # Shapes
/// * `x` `[3][n]` positions in `[0, 1]`; clamped, with zero gradient outside; NaN counts as 0
/// * `params`, `grad` `[entries][features]`, see [`params_len`](Self::params_len)
/// * `out`, `out_bar` `[levels * features][n]`, level by level
///
/// # Functions
/// | whole batch | one level | |
/// | --- | --- | --- |
/// | [`encode`](Self::encode) | [`encode_level`](Self::encode_level) | features |
/// | [`encode_backward`](Self::encode_backward) | [`encode_level_backward`](Self::encode_level_backward) | adds to the table's gradient |
/// | [`encode_backward_x`](Self::encode_backward_x) | | adds to the positions' gradient |
/// | [`tangent`](Self::tangent) | [`tangent_level`](Self::tangent_level) | derivative along `x_dot` |
/// | [`tangent_backward`](Self::tangent_backward) | [`tangent_level_backward`](Self::tangent_level_backward) | adds to the table's gradient, through the derivative |
/// | [`tangent_backward_x`](Self::tangent_backward_x) | | adds to the positions' gradient, through the derivative |
///
/// The gradient of the tangent with respect to `x_dot` is [`encode_backward_x`](Self::encode_backward_x) with the
/// tangent's cotangent: the tangent is linear in `x_dot`.
///
/// # Numerics
/// All SIMD levels and all numbers of threads give the same bits: gradients are added in the order of the samples, and
/// a level is one thread's work.
#[derive(Clone, Debug, PartialEq)]
pub struct HashGrid {
    config: HashGridConfig,
    levels: [Level; MAX_LEVELS],
    entries: usize,
}

impl HashGrid {
    /// Lay out a grid.
    ///
    /// # Errors
    /// [`FieldError::Config`] naming the setting that is out of range.
    pub fn new(config: HashGridConfig) -> Result<Self, FieldError> {
        let refuse = |what, got, accepts| Err(FieldError::Config { what, got, accepts });
        if !(1..=MAX_LEVELS).contains(&config.levels) {
            return refuse("levels", config.levels as f64, "1 to 32");
        }
        if !matches!(config.features, 1 | 2 | 4 | 8) {
            return refuse("features", config.features as f64, "1, 2, 4 or 8");
        }
        if !(3..=28).contains(&config.log2_table) {
            return refuse("log2_table", f64::from(config.log2_table), "3 to 28");
        }
        if config.n_min == 0 {
            return refuse("n_min", 0.0, "at least 1");
        }
        match config.growth {
            Growth::Factor(b) if !(b >= 1.0 && b.is_finite()) => return refuse("growth", b, "a finite factor >= 1"),
            Growth::UpTo(n) if n < config.n_min => return refuse("growth", f64::from(n), "a size of at least n_min"),
            _ => {}
        }
        let (levels, entries) = level::lay_out(&config)?;
        Ok(Self { config, levels, entries })
    }

    /// The configuration it was made from.
    #[must_use]
    pub fn config(&self) -> &HashGridConfig {
        &self.config
    }

    /// The levels, coarse to fine.
    #[must_use]
    pub fn levels(&self) -> &[Level] {
        &self.levels[..self.config.levels]
    }

    /// Entries of all levels.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Length of the parameter buffer.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.entries * self.config.features
    }

    /// Rows of the output: `levels * features`.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.config.levels * self.config.features
    }

    /// Which parameters belong to a level.
    ///
    /// # Panics
    /// If there is no such level.
    #[must_use]
    pub fn level_range(&self, level: usize) -> Range<usize> {
        let l = &self.levels()[level];
        l.offset * self.config.features..(l.offset + l.entries as usize) * self.config.features
    }

    /// Features of one level: `out` `[features][n]`.
    ///
    /// `params` is the whole buffer.
    ///
    /// # Errors
    /// [`FieldError::Shape`], [`FieldError::Index`] for a level that does not exist.
    pub fn encode_level(
        &self,
        simd: Simd,
        params: &[f32],
        level: usize,
        x: &[f32],
        out: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_level(level, params, x, out.len())?;
        self.gather(simd, params, level, axes(x), None, out);
        Ok(())
    }

    /// Derivative of one level's features along `x_dot` `[3][n]`: `out_dot` `[features][n]`.
    ///
    /// # Errors
    /// As [`encode_level`](Self::encode_level).
    pub fn tangent_level(
        &self,
        simd: Simd,
        params: &[f32],
        level: usize,
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check_level(level, params, x, out_dot.len())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        self.gather(simd, params, level, axes(x), Some(axes(x_dot)), out_dot);
        Ok(())
    }

    /// Add one level's table gradient. `grad` is the level's part of the gradient, see
    /// [`level_range`](Self::level_range); `touched` its words of a [`Touched`].
    ///
    /// # Errors
    /// As [`encode_level`](Self::encode_level).
    pub fn encode_level_backward(
        &self,
        simd: Simd,
        level: usize,
        x: &[f32],
        out_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut [u64]>,
    ) -> Result<(), FieldError> {
        self.check_level_backward(level, x, out_bar.len(), grad.len(), touched.as_deref())?;
        self.scatter(simd, level, axes(x), None, out_bar, grad, touched);
        Ok(())
    }

    /// Add one level's table gradient through [`tangent_level`](Self::tangent_level).
    ///
    /// # Errors
    /// As [`encode_level`](Self::encode_level).
    #[expect(clippy::too_many_arguments, reason = "the arguments of the pair, and the touched words")]
    pub fn tangent_level_backward(
        &self,
        simd: Simd,
        level: usize,
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut [u64]>,
    ) -> Result<(), FieldError> {
        self.check_level_backward(level, x, out_dot_bar.len(), grad.len(), touched.as_deref())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        self.scatter(simd, level, axes(x), Some(axes(x_dot)), out_dot_bar, grad, touched);
        Ok(())
    }

    fn check_level(&self, level: usize, params: &[f32], x: &[f32], out: usize) -> Result<(), FieldError> {
        self.check_level_number(level)?;
        check_len("params", params.len(), self.params_len())?;
        check_points(x)?;
        check_len("out", out, x.len() / 3 * self.config.features)
    }

    fn check_level_backward(
        &self,
        level: usize,
        x: &[f32],
        out: usize,
        grad: usize,
        touched: Option<&[u64]>,
    ) -> Result<(), FieldError> {
        self.check_level_number(level)?;
        check_points(x)?;
        check_len("out_bar", out, x.len() / 3 * self.config.features)?;
        let floats = self.level_range(level).len();
        check_len("grad", grad, floats)?;
        touched.map_or(Ok(()), |t| check_len("touched", t.len(), floats.div_ceil(BLOCK_FLOATS).div_ceil(64)))
    }

    fn check_level_number(&self, level: usize) -> Result<(), FieldError> {
        if level < self.config.levels {
            return Ok(());
        }
        Err(FieldError::Index { what: "level", index: 0, got: level, limit: self.config.levels })
    }

    fn place<'a>(&self, level: usize, x: Axes<'a>, x_dot: Option<Axes<'a>>) -> Place<'a> {
        let (lattice, features) = (self.levels[level].lattice(), self.config.features);
        Place { lattice, stride: features, features, first: 0, interpolation: self.config.interpolation, x, x_dot }
    }

    /// The rows `out` are `[features][n]`.
    fn gather(&self, simd: Simd, params: &[f32], level: usize, x: Axes<'_>, x_dot: Option<Axes<'_>>, out: &mut [f32]) {
        let (place, table) = (self.place(level, x, x_dot), &params[self.level_range(level)]);
        match self.config.features {
            1 => simd.run(Gather::<1> { place, table, out: rows_mut(out) }),
            2 => simd.run(Gather::<2> { place, table, out: rows_mut(out) }),
            4 => simd.run(Gather::<4> { place, table, out: rows_mut(out) }),
            _ => simd.run(Gather::<8> { place, table, out: rows_mut(out) }),
        }
    }

    #[expect(clippy::too_many_arguments, reason = "private; the arguments of the pair")]
    fn scatter(
        &self,
        simd: Simd,
        level: usize,
        x: Axes<'_>,
        x_dot: Option<Axes<'_>>,
        out_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut [u64]>,
    ) {
        let place = self.place(level, x, x_dot);
        match self.config.features {
            1 => simd.run(Scatter::<1> { place, out_bar: rows(out_bar), grad, touched }),
            2 => simd.run(Scatter::<2> { place, out_bar: rows(out_bar), grad, touched }),
            4 => simd.run(Scatter::<4> { place, out_bar: rows(out_bar), grad, touched }),
            _ => simd.run(Scatter::<8> { place, out_bar: rows(out_bar), grad, touched }),
        }
    }
}
