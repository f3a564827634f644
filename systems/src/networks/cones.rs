//! The cones of pixels: which of them cross the space, and pictures made of tiles of them.

use crate::space::{InternalRay, Space};
use engine::data::{Batch, Dataset};
use engine::system::{Layers, Query, SkipRow};
use rayon::prelude::*;
use render_core::ray::Ray;
use std::ops::Range;

/// Rays that go through the networks together.
pub(crate) const TILE: usize = 4;
/// Rays of one task of a render.
const RENDER_TASK: usize = 32;

/// What a ray of a system is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Footprint {
    /// A line.
    Point,
    /// The cone of a pixel.
    Cone,
}

/// Which pixels of a batch are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// Those that count.
    Counted,
    /// All.
    All,
}

/// The rays of the pixels `ids` of a batch that cross the space, and which pixels these are.
pub(crate) fn crossing(
    space: &Space,
    data: &Dataset,
    batch: &Batch,
    ids: Range<usize>,
    footprint: Footprint,
    which: Which,
) -> (Vec<InternalRay>, Vec<usize>) {
    let (mut rays, mut hit) = (Vec::new(), Vec::new());
    for i in ids {
        let radius = match footprint {
            Footprint::Point => 0.0,
            Footprint::Cone => {
                let [x, y] = batch.pixel[i];
                data.view(batch.view[i] as usize).cone_radius(x.into(), y.into()).unwrap_or(0.0)
            }
        };
        let ray = space.internal_cone(&batch.rays[i], radius);
        if ray.end > ray.start && (which == Which::All || batch.weight[i] > 0.0) {
            rays.push(ray);
            hit.push(i);
        }
    }
    (rays, hit)
}

/// Rays to render.
#[derive(Clone, Copy)]
pub(crate) struct Cones<'a> {
    pub(crate) rays: &'a [Ray],
    /// Radius of each pixel's cone at distance 1; 0 for a line.
    pub(crate) radii: &'a [f32],
}

impl Cones<'_> {
    /// In internal coordinates.
    pub(crate) fn internal(self, space: &Space) -> Vec<InternalRay> {
        self.rays.iter().zip(self.radii).map(|(ray, &r)| space.internal_cone(ray, r.into())).collect()
    }
}

/// The layers of rays, tile by tile in parallel: `render` appends those of a tile's rays. Nothing where the query's halt is raised.
pub(crate) fn render_tiles<S: Default>(
    rays: &[Ray],
    radii: &[f32],
    query: &Query,
    render: impl Fn(Cones<'_>, &mut S, &mut Layers) + Sync + Send,
) -> Layers {
    let parts: Vec<Layers> = rays
        .par_chunks(RENDER_TASK)
        .zip(radii.par_chunks(RENDER_TASK))
        .map_init(S::default, |scratch, (rays, radii)| {
            let mut out = Layers::default();
            for (rays, radii) in rays.chunks(TILE).zip(radii.chunks(TILE)) {
                match query.halt.raised() {
                    true => out.extend(Layers::nothing(rays.len(), query)),
                    false => render(Cones { rays, radii }, scratch, &mut out),
                }
            }
            out
        })
        .collect();
    let mut out = Layers::default();
    parts.into_iter().for_each(|part| out.extend(part));
    out
}

/// The row of the table of skips for training rays that were not sampled, of those cast.
pub(crate) fn missed_row(missed: u64, cast: u64) -> SkipRow {
    SkipRow::counted(
        "training: rays that miss the scene's box or are masked",
        missed,
        cast,
        "rays",
        "0: nothing is there to sample".into(),
    )
}
