//! Backward pass of the projection of a whole cloud: from gradients of projected Gaussians to gradients of raw parameters.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector};

use super::block::{Block, Camera, Raw};
use super::block_backward::ProjectedBar;
use super::camera::{COMPONENTS, CameraGradient};
use super::colour::{Viewpoint, colour_backward};
use super::forward::{CHUNK, Projection};
use super::gradient::ProjectedGradient;
use super::rows::{LANES_MAX, to_array};
use crate::chunks::for_each;
use crate::gaussians::rest_len;
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
        let inputs = Inputs { cloud, view, settings, degree, gradients, depth_feature };
        self.run_backward::<K, false>(simd, inputs, grad).map(|_| ())
    }

    /// [`backward`](Self::backward), and the gradient with respect to the camera: its pose, focal lengths and principal point. `grad`
    /// receives the same bits.
    ///
    /// The camera's gradient is summed over Gaussians in the order of their indices, in `f64`. Degree and clamping are as drawn, the
    /// view dependence of colours is included.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    ///
    /// # Panics
    /// As [`backward`](Self::backward).
    #[expect(clippy::too_many_arguments, reason = "the forward pass's inputs and their gradients")]
    pub fn backward_with_camera<const K: usize>(
        &self,
        simd: Simd,
        cloud: &Gaussians,
        view: &View,
        settings: &RasterSettings,
        degree: usize,
        gradients: &[ProjectedGradient<K>],
        depth_feature: Option<usize>,
        grad: &mut Gaussians,
    ) -> Result<CameraGradient, SplatError> {
        let inputs = Inputs { cloud, view, settings, degree, gradients, depth_feature };
        self.run_backward::<K, true>(simd, inputs, grad)
    }

    fn run_backward<const K: usize, const CAMERA: bool>(
        &self,
        simd: Simd,
        inputs: Inputs<'_, K>,
        grad: &mut Gaussians,
    ) -> Result<CameraGradient, SplatError> {
        let same = |what, want, got| if want == got { Ok(()) } else { Err(SplatError::Shape { what, want, got }) };
        let Inputs { cloud, gradients, depth_feature, .. } = inputs;
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
        let n = cloud.len();
        if n == 0 {
            return Ok(CameraGradient::default());
        }
        let inputs = Inputs { degree: inputs.degree.min(cloud.degree()), ..inputs };
        let mut jobs: Vec<Job<'_>> =
            (0..n.div_ceil(CHUNK)).map(|_| Job { rows: Vec::new(), camera: [0.0; COMPONENTS] }).collect();
        for (_, rows) in grad.fields_mut() {
            for row in rows.chunks_exact_mut(n) {
                for (job, part) in jobs.iter_mut().zip(row.chunks_mut(CHUNK)) {
                    job.rows.push(part);
                }
            }
        }
        for_each(&mut jobs, |k, job| {
            let of_chunk = self.of_chunk(k);
            let rows = &mut job.rows;
            job.camera = simd.run(Backward::<K, CAMERA> { inputs, from: k * CHUNK, rows, projection: self, of_chunk });
        });
        let mut camera = [0.0; COMPONENTS];
        for job in &jobs {
            camera.iter_mut().zip(job.camera).for_each(|(sum, x)| *sum += x);
        }
        Ok(CameraGradient::from_components(camera))
    }
}

/// What the backward pass is given.
#[derive(Clone, Copy)]
struct Inputs<'a, const K: usize> {
    cloud: &'a Gaussians,
    view: &'a View,
    settings: &'a RasterSettings,
    degree: usize,
    gradients: &'a [ProjectedGradient<K>],
    depth_feature: Option<usize>,
}

/// One chunk of the cloud.
struct Job<'a> {
    rows: RowsOf<'a>,
    /// Its part of the camera's gradient.
    camera: [f64; COMPONENTS],
}

struct Backward<'a, 'b, const K: usize, const CAMERA: bool> {
    inputs: Inputs<'a, K>,
    /// First Gaussian of the chunk.
    from: usize,
    rows: &'a mut RowsOf<'b>,
    projection: &'a Projection,
    /// Range of the chunk's projected Gaussians.
    of_chunk: core::ops::Range<usize>,
}

impl<const K: usize, const CAMERA: bool> Task for Backward<'_, '_, K, CAMERA> {
    /// The camera's gradient; 0 without `CAMERA`.
    type Output = [f64; COMPONENTS];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; COMPONENTS] {
        let Self { inputs, from, rows, projection, of_chunk } = self;
        let Inputs { cloud, view, settings, degree, gradients, depth_feature } = inputs;
        let mut camera_bar = [0.0; COMPONENTS];
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
            if CAMERA {
                let lanes = block.camera_backward(&camera, &bar, &raw_bar, through);
                for (sum, x) in camera_bar.iter_mut().zip(lanes) {
                    let x = to_array(visible.select_positive(x, V::splat(0.0)));
                    *sum = x[..V::LANES].iter().fold(*sum, |sum, &x| sum + f64::from(x));
                }
            }
        }
        camera_bar
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
