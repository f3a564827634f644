//! Projects all Gaussians of a cloud; those that cannot touch a pixel are left out.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector};

use super::ProjectedGaussian;
use super::block::{Block, Camera, Raw};
use super::colour::{Viewpoint, colour};
use super::rows::{lanes, to_array};
use crate::chunks::for_each;
use crate::{Gaussians, RasterSettings, SplatError, View};

/// Gaussians per task.
pub(super) const CHUNK: usize = 1024;

/// The visible Gaussians of a cloud as one camera sees them, in the order of the cloud. Buffers are kept between calls.
///
/// The functions below [`Renderer`](crate::Renderer), in the order of a training step:
///
/// ```
/// use splat_core::{Gaussians, Projection, Raster, RasterSettings, Simd, View};
///
/// // Opacity 1/2, standard deviation 1: a red one, and a blue one behind it.
/// let mut cloud = Gaussians::new(2, 0)?;
/// cloud.mean.copy_from_slice(&[-0.5, 0.5, 0.0, 0.0, 4.0, 6.0]);
/// cloud.dc.copy_from_slice(&[1.0, -1.0, -1.0, -1.0, -1.0, 1.0]);
/// let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let view = View { r, t: [0.0; 3], f: [20.0; 2], c: [16.0; 2], size: [32, 32] };
/// let (simd, settings, degree) = (Simd::best(), RasterSettings::DEFAULT, 0);
///
/// let mut projection = Projection::default();
/// projection.project(simd, &cloud, &view, &settings, degree)?;
/// let mut raster = Raster::<3>::default();
/// raster.draw(simd, &projection.gaussians, &projection.rgb, view.size, &settings)?;
/// let mut planes = vec![0.0; 4 * 32 * 32]; // red, green, blue, transmittance
/// raster.planes(&mut planes)?;
/// let [red, _, blue, transmittance] = [0, 1, 2, 3].map(|plane| planes[plane * 32 * 32 + 16 * 32 + 16]);
/// assert!(red > blue && transmittance < 0.4);
///
/// // The loss is the mean of red.
/// let mut planes_bar = vec![0.0; 4 * 32 * 32];
/// planes_bar[..32 * 32].fill(1.0 / 1024.0);
/// let mut gradients = Vec::new();
/// raster.backward(simd, &projection.gaussians, &projection.rgb, &settings, &planes_bar, &mut gradients)?;
/// let mut cloud_bar = Gaussians::new(2, 0)?;
/// projection.backward(simd, &cloud, &view, &settings, degree, &gradients, None, &mut cloud_bar)?;
/// // More red: the front one more opaque, both redder; green and blue make no difference.
/// assert!(cloud_bar.logit[0] > 0.0 && cloud_bar.dc[0] > cloud_bar.dc[1] && cloud_bar.dc[1] > 0.0);
/// assert!(cloud_bar.dc[2..].iter().all(|&bar| bar == 0.0));
/// # Ok::<(), splat_core::SplatError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Projection {
    /// The projected Gaussians, by ascending [`index`](ProjectedGaussian::index).
    pub gaussians: Vec<ProjectedGaussian>,
    /// Their colours in this direction, at least 0.
    pub rgb: Vec<[f32; 3]>,
    chunks: Vec<Chunk>,
}

#[derive(Clone, Debug, Default)]
struct Chunk {
    gaussians: Vec<ProjectedGaussian>,
    rgb: Vec<[f32; 3]>,
}

impl Projection {
    /// Project a cloud. Spherical harmonics are evaluated up to `degree`, or the cloud's degree if that is lower.
    ///
    /// # Errors
    /// [`SplatError`] for a camera or settings out of range, or fields of the wrong length.
    pub fn project(
        &mut self,
        simd: Simd,
        cloud: &Gaussians,
        view: &View,
        settings: &RasterSettings,
        degree: usize,
    ) -> Result<(), SplatError> {
        view.check()?;
        settings.check()?;
        cloud.check()?;
        let degree = degree.min(cloud.degree());
        self.chunks.resize_with(cloud.len().div_ceil(CHUNK), Chunk::default);
        for_each(&mut self.chunks, |k, chunk| {
            chunk.gaussians.clear();
            chunk.rgb.clear();
            simd.run(Project {
                cloud,
                view,
                settings,
                degree,
                range: [k * CHUNK, ((k + 1) * CHUNK).min(cloud.len())],
                chunk,
            });
        });
        let visible = self.chunks.iter().map(|chunk| chunk.gaussians.len()).sum();
        self.gaussians.resize(visible, ProjectedGaussian::default());
        self.rgb.resize(visible, [0.0; 3]);
        let (mut gaussians, mut rgb) = (&mut self.gaussians[..], &mut self.rgb[..]);
        let mut parts = Vec::with_capacity(self.chunks.len());
        for chunk in &self.chunks {
            let (part, rest) = gaussians.split_at_mut(chunk.gaussians.len());
            let (colours, others) = rgb.split_at_mut(chunk.rgb.len());
            parts.push((chunk, part, colours));
            (gaussians, rgb) = (rest, others);
        }
        for_each(&mut parts, |_, (chunk, gaussians, rgb)| {
            gaussians.copy_from_slice(&chunk.gaussians);
            rgb.copy_from_slice(&chunk.rgb);
        });
        Ok(())
    }

    /// Range of the projected Gaussians that belong to chunk `k` of the cloud.
    pub(super) fn of_chunk(&self, k: usize) -> core::ops::Range<usize> {
        let start = self.gaussians.partition_point(|f| (f.index as usize) < k * CHUNK);
        let end = self.gaussians.partition_point(|f| (f.index as usize) < (k + 1) * CHUNK);
        start..end
    }
}

impl<V: Vector> Raw<V> {
    #[inline(always)]
    pub(crate) fn load(cloud: &Gaussians, at: usize) -> Self {
        let n = cloud.len();
        let three = |rows: &[f32]| each!(3, |k| lanes(rows, n, k, at));
        Self {
            mean: three(&cloud.mean),
            log_scale: three(&cloud.log_scale),
            wxyz: each!(4, |k| lanes(&cloud.wxyz, n, k, at)),
            logit: lanes(&cloud.logit, n, 0, at),
        }
    }
}

struct Project<'a> {
    cloud: &'a Gaussians,
    view: &'a View,
    settings: &'a RasterSettings,
    degree: usize,
    range: [usize; 2],
    chunk: &'a mut Chunk,
}

impl Task for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { cloud, view, settings, degree, range: [from, to], chunk } = self;
        let camera = Camera::<V>::new(view, settings);
        let viewpoint = Viewpoint::<V>::new(view);
        for at in (from..to).step_by(V::LANES) {
            let raw = Raw::<V>::load(cloud, at);
            let b = Block::new(&camera, &raw);
            let count = V::LANES.min(to - at);
            if !to_array(b.visible)[..count].iter().any(|&v| v > 0.0) {
                continue;
            }
            let (rgb, finite) = colour(cloud, degree, at, &viewpoint.direction(raw.mean));
            let (rgb, visible) =
                (each!(3, |k| to_array(rgb[k])), to_array(finite.select_positive(b.visible, V::splat(0.0))));
            let [u, v] = each!(2, |k| to_array(b.uv[k]));
            let [ca, cb, cc] = each!(3, |k| to_array(b.conic[k]));
            let (o, q_max, [hx, hy], z) =
                (to_array(b.o_eff), to_array(b.q_max), each!(2, |k| to_array(b.half[k])), to_array(b.p[2]));
            for k in (0..count).filter(|&k| visible[k] > 0.0) {
                chunk.gaussians.push(ProjectedGaussian {
                    uv: [u[k], v[k]],
                    conic: [ca[k], cb[k], cc[k]],
                    opacity: o[k],
                    q_max: q_max[k],
                    half: [hx[k], hy[k]],
                    z: z[k],
                    index: (at + k) as u32,
                });
                chunk.rgb.push([rgb[0][k], rgb[1][k], rgb[2][k]]);
            }
        }
    }
}
