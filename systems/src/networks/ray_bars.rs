//! The gradients of a chunk's rays.

use super::along::{Along, PlaceBars, wide};
use super::recipe::Recipe;
use crate::space::Space;
use glam::DVec3;
use render_core::ray::RayBar;

/// The gradients of a chunk's rays.
#[derive(Default)]
pub(super) struct RayGeometryBars {
    /// `[pixels]`, of the rays in internal coordinates.
    pub(super) internal: Vec<RayBar>,
    /// `[pixels]`, of viewing directions.
    pub(super) view: Vec<DVec3>,
}

impl RayGeometryBars {
    /// All zero for this many pixels.
    pub(super) fn begin(&mut self, pixels: usize) {
        self.internal.clear();
        self.internal.resize(pixels, RayBar::default());
        self.view.clear();
        self.view.resize(pixels, DVec3::ZERO);
    }

    /// Add those of a level along the rays of the pixels at `places`.
    pub(super) fn add<R: Recipe>(
        &mut self,
        config: &R,
        space: &Space,
        along: &Along<'_>,
        bars: &PlaceBars<'_>,
        places: impl Iterator<Item = usize>,
    ) {
        let (mut own, n) = (vec![RayBar::default(); along.rays.len()], along.t.len());
        config.pull_rays(space, along, bars.x, &mut own);
        for ((place, bar), span) in places.zip(own).zip(along.offsets.windows(2)) {
            self.internal[place] += bar;
            for i in span[0] as usize..span[1] as usize {
                self.view[place] += wide([0, 1, 2].map(|a| bars.d[a * n + i]));
            }
        }
    }
}
