//! Planes of features of place and time (Fridovich-Keil et al., "K-Planes", 2023): a network that sees them need not tell one place
//! from another by its coordinates alone.

use super::at::{At, Moves};
use super::parameters::{Parameters, TIME};
use super::settings::{bad, in_range};
use crate::settings::together;
use engine::system::SystemError;
use field_core::encoding::planes::Planes;
use field_core::tape::{EncodingOp, Node, Tape, TapeError};
use losses::kernel::Kernel;
use losses::planes::{PlaneShape, time_smoothness_backward};
use losses::variation;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Sets of planes at most.
const MOST: usize = 8;

/// Who sees planes of place and time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SeenBy {
    /// The network that moves points.
    Warp,
    /// The density network.
    Density,
    /// Both.
    Both,
}

/// Settings of planes of place and time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaneSettings {
    /// Cells along an axis of each set of planes; none: `[]`.
    #[serde(rename = "planes")]
    pub(crate) cells: Vec<usize>,
    /// Who sees them: `warp`, `density` or `both`.
    #[serde(rename = "planes_seen_by")]
    pub(crate) seen_by: SeenBy,
    /// Features of a set.
    #[serde(rename = "plane_features")]
    pub(crate) features: usize,
    /// Cells along the axis of time.
    #[serde(rename = "plane_times")]
    pub(crate) times: usize,
    /// Learning rate, a factor of that of the networks.
    #[serde(rename = "plane_lr")]
    pub(crate) rate: f64,
    /// Factor of the variation of their features in space; 0: none.
    #[serde(rename = "plane_tv")]
    pub(crate) variation: f32,
    /// Factor of their second differences in time, summed over planes: what changes steadily costs nothing; 0: none.
    #[serde(rename = "plane_smoothness")]
    pub(crate) smoothness: f32,
}

impl PlaneSettings {
    /// No planes.
    pub(crate) const NONE: Self = Self {
        cells: Vec::new(),
        seen_by: SeenBy::Warp,
        features: 8,
        times: 24,
        rate: 10.0,
        variation: 0.0,
        smoothness: 0.0,
    };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        if self.cells.len() > MOST || !self.cells.iter().all(|cells| (1..=512).contains(cells)) {
            let problem = format!("must be at most {MOST} numbers in 1..=512");
            return Err(bad("planes", format!("{:?}", self.cells), problem));
        }
        in_range("plane_features", self.features, 1..=32)?;
        in_range("plane_times", self.times, 1..=1024)?;
        in_range("plane_lr", self.rate, 0.0..=100.0)?;
        in_range("plane_tv", self.variation, 0.0..=1e3)?;
        in_range("plane_smoothness", self.smoothness, 0.0..=1e3)
    }

    fn is_seen_by(&self, whom: SeenBy) -> bool {
        self.seen_by == whom || self.seen_by == SeenBy::Both
    }

    fn rows_for(&self, whom: SeenBy) -> usize {
        if self.is_seen_by(whom) { self.cells.len() * self.features } else { 0 }
    }

    /// Rows that the network of the warp sees.
    pub(crate) fn warp_rows(&self) -> usize {
        self.rows_for(SeenBy::Warp)
    }

    /// Rows that the density network sees.
    pub(crate) fn density_rows(&self) -> usize {
        self.rows_for(SeenBy::Density)
    }
}

/// Sets of planes of place and time.
pub(crate) struct TimePlanes {
    settings: PlaneSettings,
    sets: Vec<Set>,
}

struct Set {
    planes: Planes,
    op: EncodingOp<Planes>,
    /// Of the deformation's parameters.
    range: Range<usize>,
}

/// Features `p(x, t)` of a tile, a node for each set of planes.
pub(crate) struct PlaneFeatures<'s> {
    settings: &'s PlaneSettings,
    nodes: Vec<Node>,
}

impl PlaneFeatures<'_> {
    fn of_those_for(&self, whom: SeenBy) -> &[Node] {
        if self.settings.is_seen_by(whom) { &self.nodes } else { &[] }
    }

    /// What the network of the warp sees of them.
    pub(crate) fn for_warp(&self) -> &[Node] {
        self.of_those_for(SeenBy::Warp)
    }

    /// What the density network sees of them.
    pub(crate) fn for_density(&self) -> &[Node] {
        self.of_those_for(SeenBy::Density)
    }
}

impl TimePlanes {
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(settings: PlaneSettings, parameters: &mut Parameters) -> Result<Self, SystemError> {
        settings.check()?;
        let mut sets = Vec::with_capacity(settings.cells.len());
        for (k, &cells) in settings.cells.iter().enumerate() {
            let resolution = [cells, cells, cells, settings.times].map(|cells| cells as u32);
            let planes = Planes::k_planes(resolution, settings.features)
                .map_err(|e| together("planes, plane_features, plane_times", &settings, e))?;
            let range = parameters.planes(k, &planes);
            sets.push(Set { planes, op: EncodingOp::new(planes, parameters.simd), range });
        }
        Ok(Self { settings, sets })
    }

    pub(super) fn settings(&self) -> &PlaneSettings {
        &self.settings
    }

    pub(super) fn is_empty(&self) -> bool {
        self.sets.is_empty()
    }

    /// Features of points at their times; none where no network sees them.
    ///
    /// # Errors
    /// [`TapeError`] for other shapes.
    pub(crate) fn of<'a>(&'a self, tape: &mut Tape<'a>, at: &At<'_>) -> Result<PlaneFeatures<'a>, TapeError> {
        let mut features = PlaneFeatures { settings: &self.settings, nodes: Vec::new() };
        if self.sets.is_empty() || (at.moves == Moves::No && !self.settings.is_seen_by(SeenBy::Density)) {
            return Ok(features);
        }
        let t = tape.constant(1, at.t.len(), at.t)?;
        let place_and_time = tape.concat(&[at.x, t])?;
        for set in &self.sets {
            let table = tape.param(set.range.start, set.range.len(), 1)?;
            features.nodes.push(tape.custom(&set.op, &[place_and_time, table])?);
        }
        Ok(features)
    }

    /// Those of [`TimePlanes::of`] that the network of the warp sees; nothing is computed where it sees none.
    ///
    /// # Errors
    /// As [`TimePlanes::of`].
    pub(crate) fn for_warp<'a>(&'a self, tape: &mut Tape<'a>, at: &At<'_>) -> Result<Vec<Node>, TapeError> {
        if self.settings.is_seen_by(SeenBy::Warp) { Ok(self.of(tape, at)?.nodes) } else { Ok(Vec::new()) }
    }

    /// Add the gradient of what first differences in space cost, and second differences in time (K-Planes, equations 3 and 4), to that
    /// of the deformation's parameters. Each is the sum over axes and planes of a mean.
    pub(super) fn smooth(&self, params: &[f32], grad: &mut [f32]) {
        let PlaneSettings { variation, smoothness, .. } = self.settings;
        let fits = "a plane has this shape";
        for Set { planes, range, .. } in &self.sets {
            for (k, pair) in planes.pairs().enumerate() {
                let plane = planes.plane_range(k);
                let plane = range.start + plane.start..range.start + plane.end;
                let [wide, high] = pair.map(|axis| planes.resolution()[axis] as usize);
                let (params, bar) = (&params[plane.clone()], &mut grad[plane]);
                let shape = [high, wide, planes.features()];
                // Time is the second axis of its planes.
                let timed = pair[1] == TIME;
                if variation > 0.0 {
                    let axes: &[usize] = if timed { &[1] } else { &[0, 1] };
                    let factor = variation.into();
                    variation::total_variation_backward(params, &shape, axes, Kernel::Squared, factor, bar)
                        .expect(fits);
                }
                if timed && smoothness > 0.0 {
                    let shape = PlaneShape { rows: high, columns: wide, features: planes.features() };
                    time_smoothness_backward(params, shape, smoothness.into(), bar).expect(fits);
                }
            }
        }
    }

    /// Each set with the range of its parameters.
    #[cfg(test)]
    pub(crate) fn sets(&self) -> impl Iterator<Item = (&Planes, Range<usize>)> {
        self.sets.iter().map(|set| (&set.planes, set.range.clone()))
    }
}
