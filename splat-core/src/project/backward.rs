//! Backward pass of the projection of a whole cloud: from gradients of projected Gaussians to gradients of raw parameters.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector};

use super::block::{Block, Camera, Raw};
use super::block_backward::ProjectedBar;
use super::colour::{Viewpoint, colour_backward};
use super::forward::{CHUNK, Projection};
use super::rows::{LANES_MAX, to_array};
use crate::chunks::for_each;
use crate::gaussians::rest_len;
use crate::raster::ProjectedGradient;
use crate::{Gaussians, RasterSettings, SplatError, View};

/// Rows of one chunk's gradients, in the order of [`Gaussians::fields`].
type RowsOf<'a> = Vec<&'a mut [f32]>;
// First row of each field; `mean` begins at row 0.
const LOG_SCALE: usize = 3;
const WXYZ: usize = 6;
const LOGIT: usize = 10;
const DC: usize = 11;
const REST: usize = 14;

impl Projection {
    /// Gradient with respect to the cloud's parameters, written to `grad` (of the cloud's shape); 0 where a Gaussian is not visible.
    ///
    /// `cloud`, `view`, `settings` and `degree` must be those of the last [`project`](Self::project); only shapes are compared.
    /// `gradients` has one entry for each of [`gaussians`](Self::gaussians): its first three features are the colour, and feature
    /// `depth_feature`, if given, is the depth `z`. Other features are ignored.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    ///
    /// # Panics
    /// May panic if [`gaussians`](Self::gaussians) were reordered since [`project`](Self::project).
    #[expect(clippy::too_many_arguments, reason = "the forward pass's inputs and their gradients")]
    pub fn backward<const K: usize>(
        &self,
        simd: Simd,
        cloud: &Gaussians,
        view: &View,
        settings: &RasterSettings,
        degree: usize,
        gradients: &[ProjectedGradient<K>],
        depth_feature: Option<usize>,
        grad: &mut Gaussians,
    ) -> Result<(), SplatError> {
        let same = |what, want, got| if want == got { Ok(()) } else { Err(SplatError::Shape { what, want, got }) };
        cloud.check()?;
        grad.check()?;
        same("gradients", self.gaussians.len(), gradients.len())?;
        same("grad", cloud.len(), grad.len())?;
        same("grad.degree", cloud.degree(), grad.degree())?;
        same("features", depth_feature.map_or(3, |k| k.saturating_add(1)).max(3).max(K), K)?;
        same("rgb", self.gaussians.len(), self.rgb.len())?;
        // Indices ascend: the last one is the largest.
        let last = self.gaussians.last().map_or(0, |f| f.index as usize + 1);
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
            let of_chunk = self.of_chunk(k);
            let part = Part { cloud, view, settings, degree, depth_feature, from: k * CHUNK, rows };
            simd.run(Backward { part, projection: self, gradients, of_chunk });
        });
        Ok(())
    }
}

struct Part<'a, 'b> {
    cloud: &'a Gaussians,
    view: &'a View,
    settings: &'a RasterSettings,
    degree: usize,
    depth_feature: Option<usize>,
    /// First Gaussian of the chunk.
    from: usize,
    rows: &'a mut RowsOf<'b>,
}

struct Backward<'a, 'b, const K: usize> {
    part: Part<'a, 'b>,
    projection: &'a Projection,
    gradients: &'a [ProjectedGradient<K>],
    /// Footprints of this chunk.
    of_chunk: core::ops::Range<usize>,
}

impl<const K: usize> Task for Backward<'_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self {
            part: Part { cloud, view, settings, degree, depth_feature, from, rows },
            projection,
            gradients,
            of_chunk,
        } = self;
        for row in rows.iter_mut() {
            row.fill(0.0);
        }
        let camera = Camera::<V>::new(view, settings);
        let viewpoint = Viewpoint::<V>::new(view);
        let mut next = of_chunk.start;
        while next < of_chunk.end {
            // The vector that holds the next visible Gaussian, with all others that it holds.
            let at = from + (projection.gaussians[next].index as usize - from) / V::LANES * V::LANES;
            let mut lanes = [[0.0_f32; LANES_MAX]; 10];
            let mut visible = [0.0_f32; LANES_MAX];
            while next < of_chunk.end && (projection.gaussians[next].index as usize) < at + V::LANES {
                let (gaussian, gradient) = (&projection.gaussians[next], &gradients[next]);
                let lane = gaussian.index as usize - at;
                visible[lane] = 1.0;
                let [u, v] = gradient.uv;
                let [a, b, c] = gradient.conic;
                // A colour clamped to 0 has gradient 0.
                let rgb = projection.rgb[next];
                let rgb_bar: [f32; 3] = core::array::from_fn(|k| if rgb[k] > 0.0 { gradient.features[k] } else { 0.0 });
                let z = depth_feature.map_or(0.0, |k| gradient.features[k]);
                for (row, x) in
                    [u, v, a, b, c, gradient.opacity, z, rgb_bar[0], rgb_bar[1], rgb_bar[2]].into_iter().enumerate()
                {
                    lanes[row][lane] = x;
                }
                next += 1;
            }
            let load = |row: usize| V::load(&lanes[row]);
            let raw = Raw::<V>::load(cloud, at);
            let block = Block::new(&camera, &raw);
            let bar =
                ProjectedBar { uv: [load(0), load(1)], conic: [load(2), load(3), load(4)], o_eff: load(5), z: load(6) };
            let raw_bar = block.backward(&camera, &bar);
            let visible = V::load(&visible);
            let to = viewpoint.direction(raw.mean);
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

/// Write a vector to a row, 0 in the lanes that are not visible.
#[inline(always)]
fn put<V: Vector>(rows: &mut [&mut [f32]], row: usize, at: usize, visible: V, x: V) {
    let x = visible.select_positive(x, V::splat(0.0));
    let out = &mut rows[row][at..];
    if out.len() >= V::LANES {
        x.store(out);
    } else {
        out.copy_from_slice(&to_array(x)[..out.len()]);
    }
}
