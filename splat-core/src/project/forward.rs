//! All Gaussians of a cloud to ellipses: those that no pixel can see are left out.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector};

use super::Footprint;
use super::block::{Block, Lens, Raw};
use super::colour::{Sight, colour};
use super::rows::{lanes, numbers};
use crate::chunks::for_each;
use crate::{Gaussians, Rules, SplatError, View};

/// Gaussians that one task projects.
pub(super) const CHUNK: usize = 1024;

/// Ellipses of a cloud on a picture, in the order of their Gaussians, with their colours.
#[derive(Clone, Debug, Default)]
pub struct Projection {
    /// Of each visible Gaussian.
    pub footprints: Vec<Footprint>,
    /// Their colours, not below 0.
    pub rgb: Vec<[f32; 3]>,
    chunks: Vec<Chunk>,
}

#[derive(Clone, Debug, Default)]
struct Chunk {
    footprints: Vec<Footprint>,
    rgb: Vec<[f32; 3]>,
}

impl Projection {
    /// Project a cloud, with spherical harmonics up to `degree` or what the cloud has.
    ///
    /// # Errors
    /// [`SplatError`] for a camera that cannot see, rules out of range, or fields of the wrong length.
    pub fn project(
        &mut self,
        simd: Simd,
        cloud: &Gaussians,
        view: &View,
        rules: &Rules,
        degree: usize,
    ) -> Result<(), SplatError> {
        view.check()?;
        rules.check()?;
        cloud.check()?;
        let degree = degree.min(cloud.degree());
        self.chunks.resize_with(cloud.len().div_ceil(CHUNK), Chunk::default);
        for_each(&mut self.chunks, |k, chunk| {
            chunk.footprints.clear();
            chunk.rgb.clear();
            simd.run(Project {
                cloud,
                view,
                rules,
                degree,
                range: [k * CHUNK, ((k + 1) * CHUNK).min(cloud.len())],
                chunk,
            });
        });
        self.footprints.clear();
        self.rgb.clear();
        for chunk in &self.chunks {
            self.footprints.extend_from_slice(&chunk.footprints);
            self.rgb.extend_from_slice(&chunk.rgb);
        }
        Ok(())
    }

    /// Which footprints are of Gaussians of chunk `k`.
    pub(super) fn seen(&self, k: usize) -> core::ops::Range<usize> {
        let start = self.footprints.partition_point(|f| (f.index as usize) < k * CHUNK);
        let end = self.footprints.partition_point(|f| (f.index as usize) < (k + 1) * CHUNK);
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
    rules: &'a Rules,
    degree: usize,
    range: [usize; 2],
    chunk: &'a mut Chunk,
}

impl Task for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { cloud, view, rules, degree, range: [from, to], chunk } = self;
        let lens = Lens::<V>::new(view, rules);
        let sight = Sight::<V>::new(view);
        for at in (from..to).step_by(V::LANES) {
            let raw = Raw::<V>::load(cloud, at);
            let b = Block::new(&lens, &raw);
            let count = V::LANES.min(to - at);
            if !numbers(b.visible)[..count].iter().any(|&v| v > 0.0) {
                continue;
            }
            let (rgb, finite) = colour(cloud, degree, at, &sight.direction(raw.mean));
            let (rgb, visible) =
                (each!(3, |k| numbers(rgb[k])), numbers(finite.select_positive(b.visible, V::splat(0.0))));
            let [u, v] = each!(2, |k| numbers(b.uv[k]));
            let [ca, cb, cc] = each!(3, |k| numbers(b.conic[k]));
            let (o, q_max, [hx, hy], z) =
                (numbers(b.o_eff), numbers(b.q_max), each!(2, |k| numbers(b.half[k])), numbers(b.p[2]));
            for k in (0..count).filter(|&k| visible[k] > 0.0) {
                chunk.footprints.push(Footprint {
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
