//! The chain rule of a whole cloud: from sums over pixels to gradients of raw parameters.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector};

use super::block::{Block, Lens, Raw};
use super::block_backward::FootprintBar;
use super::colour::{Sight, colour_backward};
use super::forward::{CHUNK, Projection};
use super::rows::{LANES_MAX, numbers};
use crate::chunks::for_each;
use crate::gaussians::rest_len;
use crate::raster::Record;
use crate::{Gaussians, Rules, SplatError, View};

/// Rows of a chunk's gradients, in the order of [`Gaussians::fields`].
type RowsOf<'a> = Vec<&'a mut [f32]>;
/// Where the rows of each field begin.
const LOG_SCALE: usize = 3;
const WXYZ: usize = 6;
const LOGIT: usize = 10;
const DC: usize = 11;
const REST: usize = 14;

impl Projection {
    /// Gradients of a cloud that was projected last with the same view, rules and degree. `records` has one entry for each of
    /// [`footprints`](Self::footprints), its first three features being the colour and feature `depth`, if there is one, the depth
    /// `z`. `grad`, of the cloud's shape, is **written**: 0 where a Gaussian is not visible.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    ///
    /// # Panics
    /// May do so where [`footprints`](Self::footprints) are not in the order in which [`project`](Self::project) left them.
    #[expect(clippy::too_many_arguments, reason = "the forward pass's inputs and their gradients")]
    pub fn backward<const K: usize>(
        &self,
        simd: Simd,
        cloud: &Gaussians,
        view: &View,
        rules: &Rules,
        degree: usize,
        (records, depth): (&[Record<K>], Option<usize>),
        grad: &mut Gaussians,
    ) -> Result<(), SplatError> {
        let same = |what, want, got| if want == got { Ok(()) } else { Err(SplatError::Shape { what, want, got }) };
        cloud.check()?;
        grad.check()?;
        same("records", self.footprints.len(), records.len())?;
        same("grad", cloud.len(), grad.len())?;
        same("grad.degree", cloud.degree(), grad.degree())?;
        same("features", depth.map_or(3, |depth| depth.saturating_add(1)).max(3).max(K), K)?;
        same("rgb", self.footprints.len(), self.rgb.len())?;
        // In ascending order: the last is the largest.
        let last = self.footprints.last().map_or(0, |f| f.index as usize + 1);
        same("cloud", last.max(cloud.len()), cloud.len())?;
        let (degree, n) = (degree.min(cloud.degree()), cloud.len());
        if n == 0 {
            return Ok(());
        }
        let mut jobs: Vec<RowsOf<'_>> = (0..n.div_ceil(CHUNK)).map(|_| Vec::new()).collect();
        for (_, rows) in grad.fields_mut() {
            for row in rows.chunks_exact_mut(n) {
                for (job, part) in jobs.iter_mut().zip(row.chunks_mut(CHUNK)) {
                    job.push(part);
                }
            }
        }
        for_each(&mut jobs, |k, rows| {
            let seen = self.seen(k);
            let part = Part { cloud, view, rules, degree, depth, from: k * CHUNK, rows };
            simd.run(Backward { part, projection: self, records, seen });
        });
        Ok(())
    }
}

struct Part<'a, 'b> {
    cloud: &'a Gaussians,
    view: &'a View,
    rules: &'a Rules,
    degree: usize,
    depth: Option<usize>,
    from: usize,
    rows: &'a mut RowsOf<'b>,
}

struct Backward<'a, 'b, const K: usize> {
    part: Part<'a, 'b>,
    projection: &'a Projection,
    records: &'a [Record<K>],
    /// Footprints of this chunk.
    seen: core::ops::Range<usize>,
}

impl<const K: usize> Task for Backward<'_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { part: Part { cloud, view, rules, degree, depth, from, rows }, projection, records, seen } = self;
        for row in rows.iter_mut() {
            row.fill(0.0);
        }
        let lens = Lens::<V>::new(view, rules);
        let sight = Sight::<V>::new(view);
        let mut next = seen.start;
        while next < seen.end {
            // The block of the next visible Gaussian, and all others in it.
            let at = from + (projection.footprints[next].index as usize - from) / V::LANES * V::LANES;
            let mut lanes = [[0.0_f32; LANES_MAX]; 10];
            let mut visible = [0.0_f32; LANES_MAX];
            while next < seen.end && (projection.footprints[next].index as usize) < at + V::LANES {
                let (footprint, record) = (&projection.footprints[next], &records[next]);
                let lane = footprint.index as usize - at;
                visible[lane] = 1.0;
                let [u, v] = record.uv;
                let [a, b, c] = record.conic;
                // Nothing goes back through a colour that was clamped.
                let rgb = projection.rgb[next];
                let rgb_bar: [f32; 3] = core::array::from_fn(|k| if rgb[k] > 0.0 { record.features[k] } else { 0.0 });
                let z = depth.map_or(0.0, |k| record.features[k]);
                for (row, x) in
                    [u, v, a, b, c, record.opacity, z, rgb_bar[0], rgb_bar[1], rgb_bar[2]].into_iter().enumerate()
                {
                    lanes[row][lane] = x;
                }
                next += 1;
            }
            let load = |row: usize| V::load(&lanes[row]);
            let raw = Raw::<V>::load(cloud, at);
            let block = Block::new(&lens, &raw);
            let bar =
                FootprintBar { uv: [load(0), load(1)], conic: [load(2), load(3), load(4)], o_eff: load(5), z: load(6) };
            let raw_bar = block.backward(&lens, &bar);
            let visible = V::load(&visible);
            let to = sight.direction(raw.mean);
            let (through, h_bar) = colour_backward(cloud, degree, at, &to, [load(7), load(8), load(9)]);
            for k in 0..3 {
                put(rows, k, at - from, visible, raw_bar.mean[k] + through[k]);
                put(rows, LOG_SCALE + k, at - from, visible, raw_bar.log_scale[k]);
                put(rows, DC + k, at - from, visible, h_bar[0][k]);
            }
            for k in 0..4 {
                put(rows, WXYZ + k, at - from, visible, raw_bar.wxyz[k]);
            }
            put(rows, LOGIT, at - from, visible, raw_bar.logit);
            for k in 0..3 * rest_len(degree) {
                put(rows, REST + k, at - from, visible, h_bar[1 + k / 3][k % 3]);
            }
        }
    }
}

/// Write the lanes that are visible to a row, 0 to the others: a block is written once.
#[inline(always)]
fn put<V: Vector>(rows: &mut [&mut [f32]], row: usize, at: usize, visible: V, x: V) {
    let x = visible.select_positive(x, V::splat(0.0));
    let out = &mut rows[row][at..];
    if out.len() >= V::LANES {
        x.store(out);
    } else {
        out.copy_from_slice(&numbers(x)[..out.len()]);
    }
}
