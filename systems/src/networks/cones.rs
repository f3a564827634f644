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

/// Which pixels of a batch are looked at.
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
    (data, batch): (&Dataset, &Batch),
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

/// The layers of rays, tile by tile in parallel: `render` appends those of a tile's rays, given with the radii of their cones. Nothing where the query's halt is raised.
pub(crate) fn render_tiles<S: Default>(
    rays: &[Ray],
    radii: &[f32],
    query: &Query,
    render: impl Fn((&[Ray], &[f32]), &mut S, &mut Layers) + Sync + Send,
) -> Layers {
    let parts: Vec<Layers> = rays
        .par_chunks(RENDER_TASK)
        .zip(radii.par_chunks(RENDER_TASK))
        .map_init(S::default, |scratch, (rays, radii)| {
            let mut out = Layers::default();
            for cones in rays.chunks(TILE).zip(radii.chunks(TILE)) {
                match query.halt.raised() {
                    true => out.extend(Layers::nothing(cones.0.len(), query)),
                    false => render(cones, scratch, &mut out),
                }
            }
            out
        })
        .collect();
    let mut out = Layers::default();
    parts.into_iter().for_each(|part| out.extend(part));
    out
}

/// The row of the table of skips for training rays that were not looked at, of those cast.
pub(crate) fn missed_row(missed: u64, cast: u64) -> SkipRow {
    SkipRow::counted(
        "training: rays that miss the scene's box or are masked",
        missed,
        cast,
        "rays",
        "0: nothing is there to sample".into(),
    )
}
