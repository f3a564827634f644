//! The smallest size that photos can show: the 3D filter of Mip-Splatting.

use alloc::vec::Vec;

use float_core::{Simd, Task, Vector, m32, vecmath};

use crate::chunks::for_each;
use crate::project::lanes;
use crate::{Gaussians, SplatError, View};

/// Rows per task.
const CHUNK: usize = 1024;
/// Opacities are at most 1 less this (a logit of 69), so that gradients with respect to logits have an end.
const CLEAR_MIN: f32 = 1e-30;

/// How wide the 3D filter of each Gaussian is.
///
/// A pixel of a photo is `z / f` wide at depth `z`, with `f` the focal length in pixels. What is smaller than the finest pixel that shows
/// a place was learnt from no photo, and looks wrong in a picture from nearer by. So each Gaussian is convolved with a round one of
/// about that pixel's size:
///
/// ```text
/// f_i = sqrt(variance) min over the cameras that see it of z / f        one standard deviation for each Gaussian
/// s'_k = sqrt(s_k^2 + f_i^2)                                            standard deviations
/// o' = o prod_k s_k / s'_k                                              opacity: opacity times volume stays
/// ```
///
/// The optimiser keeps `s` and `o`; what is drawn and exported is `s'` and `o'` ([`Smoothed`]).
///
/// # Source
/// Yu, Chen, Huang, Sattler, Geiger, "Mip-Splatting: alias-free 3D Gaussian splatting", 2024, section 4.1, equations 7 to 9. The released
/// code divides the depths by the largest focal length of all cameras; here each is divided by that of its own camera, as in equation 7.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SmoothingFilter {
    /// Variance of the filter, squared pixels.
    pub variance: f32,
    /// A camera sees what is farther away than this, world units,
    pub near: f32,
    /// and lies in its picture or beside it, by no more than this part of its size on each side.
    pub margin: f32,
}

impl SmoothingFilter {
    /// The published constants.
    pub const DEFAULT: Self = Self { variance: 0.2, near: 0.2, margin: 0.15 };

    float_core::setters! {
        with_variance variance: f32;
        with_near near: f32;
        with_margin margin: f32;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let checks = [
            ("variance", self.variance, self.variance >= 0.0, "at least 0"),
            ("near", self.near, self.near > 0.0, "a positive number"),
            ("margin", self.margin, self.margin >= 0.0, "at least 0"),
        ];
        match checks.into_iter().find(|(_, got, fine, _)| !(*fine && got.is_finite())) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got: got.into(), accepts }),
            None => Ok(()),
        }
    }

    /// The standard deviation of the filter of each Gaussian `[n]`, world units. One that no camera sees has the largest of the others';
    /// 0 where no Gaussian is seen.
    ///
    /// # Errors
    /// [`SplatError`] for settings or a camera out of range, or fields of the wrong length.
    pub fn sizes(&self, cloud: &Gaussians, views: &[View]) -> Result<Vec<f32>, SplatError> {
        self.check()?;
        cloud.check()?;
        views.iter().try_for_each(View::check)?;
        let (n, factor) = (cloud.len(), m32::sqrt(self.variance));
        let mut out = alloc::vec![0.0; n];
        let mut parts: Vec<&mut [f32]> = out.chunks_mut(CHUNK).collect();
        for_each(&mut parts, |k, part| {
            for (j, size) in part.iter_mut().enumerate() {
                let x = core::array::from_fn(|axis| cloud.mean[axis * n + k * CHUNK + j]);
                *size = factor * views.iter().map(|view| self.pixel(view, x)).fold(f32::INFINITY, f32::min);
            }
        });
        let largest = out.iter().filter(|size| size.is_finite()).fold(0.0, |most: f32, &size| most.max(size));
        for size in out.iter_mut().filter(|size| !size.is_finite()) {
            *size = largest;
        }
        Ok(out)
    }

    /// Width of a pixel at `x`, world units; infinite where the camera does not see it.
    fn pixel(&self, view: &View, x: [f32; 3]) -> f32 {
        let [u, v, z] =
            core::array::from_fn(|row| (0..3).map(|axis| view.r[row][axis] * x[axis]).sum::<f32>() + view.t[row]);
        let within = |at: f32, axis: usize| {
            let size = view.size[axis] as f32;
            let pixel = view.f[axis] * at / z + view.c[axis];
            pixel >= -self.margin * size && pixel <= (1.0 + self.margin) * size
        };
        // The finer of its sides.
        if z > self.near && within(u, 0) && within(v, 1) { z / view.f[0].max(view.f[1]) } else { f32::INFINITY }
    }
}

impl Default for SmoothingFilter {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Standard deviations and opacities of Gaussians after their [`SmoothingFilter`]. Buffers are kept between calls.
///
/// ```
/// use splat_core::{Gaussians, Simd, Smoothed, SmoothingFilter, View};
///
/// let mut cloud = Gaussians::new(1, 0)?;
/// cloud.mean[2] = 4.0;
/// cloud.log_scale.fill(-9.0);
/// let view = View { f: [20.0; 2], c: [16.0; 2], ..View::at_origin([32, 32]) };
/// let sizes = SmoothingFilter::DEFAULT.sizes(&cloud, &[view])?;
/// // A fifth of a pixel is as small as anything is drawn: the root of 0.2 of 4 / 20.
/// assert!((sizes[0] - 0.2 * 0.2_f32.sqrt()).abs() < 1e-6);
/// let mut smoothed = Smoothed::default();
/// smoothed.smooth(Simd::best(), &cloud, &sizes)?;
/// smoothed.exchange(&mut cloud);
/// assert!((cloud.log_scale[0].exp() - sizes[0]).abs() < 1e-4);
/// smoothed.exchange(&mut cloud);
/// assert_eq!(cloud.log_scale[0], -9.0);
/// # Ok::<(), splat_core::SplatError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Smoothed {
    log_scale: Vec<f32>,
    logit: Vec<f32>,
}

impl Smoothed {
    /// Filter the Gaussians of `cloud`. `sizes` `[n]` are the standard deviations of their filters; 0: none.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn smooth(&mut self, simd: Simd, cloud: &Gaussians, sizes: &[f32]) -> Result<(), SplatError> {
        check(cloud, sizes)?;
        self.log_scale.resize(cloud.log_scale.len(), 0.0);
        self.logit.resize(cloud.logit.len(), 0.0);
        let mut pieces = pieces(&mut self.log_scale, &mut self.logit);
        for_each(&mut pieces, |k, piece| simd.run(Smooth::<false> { cloud, sizes, first: k * CHUNK, piece }));
        Ok(())
    }

    /// Exchange what was filtered with the fields of `cloud`; a second time it is as it was before.
    pub fn exchange(&mut self, cloud: &mut Gaussians) {
        core::mem::swap(&mut self.log_scale, &mut cloud.log_scale);
        core::mem::swap(&mut self.logit, &mut cloud.logit);
    }

    /// Backward twin of [`smooth`](Self::smooth): `cloud` is what it was given, and `grad`, with respect to the filtered Gaussians, becomes
    /// that with respect to these. Sizes of filters are constants.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn backward(simd: Simd, cloud: &Gaussians, sizes: &[f32], grad: &mut Gaussians) -> Result<(), SplatError> {
        check(cloud, sizes)?;
        grad.check()?;
        if grad.len() != cloud.len() {
            return Err(SplatError::Shape { what: "grad", want: cloud.len(), got: grad.len() });
        }
        let mut pieces = pieces(&mut grad.log_scale, &mut grad.logit);
        for_each(&mut pieces, |k, piece| simd.run(Smooth::<true> { cloud, sizes, first: k * CHUNK, piece }));
        Ok(())
    }
}

fn check(cloud: &Gaussians, sizes: &[f32]) -> Result<(), SplatError> {
    cloud.check()?;
    match sizes.len() == cloud.len() {
        true => Ok(()),
        false => Err(SplatError::Shape { what: "sizes", want: cloud.len(), got: sizes.len() }),
    }
}

/// The same rows of three standard deviations and of opacities.
type Piece<'a> = [&'a mut [f32]; 4];

/// `log_scale` `[3][n]` and `logit` `[n]`, chunk by chunk.
fn pieces<'a>(log_scale: &'a mut [f32], logit: &'a mut [f32]) -> Vec<Piece<'a>> {
    let n = logit.len();
    let (x, rest) = log_scale.split_at_mut(n);
    let (y, z) = rest.split_at_mut(n);
    let scales = x.chunks_mut(CHUNK).zip(y.chunks_mut(CHUNK)).zip(z.chunks_mut(CHUNK));
    scales.zip(logit.chunks_mut(CHUNK)).map(|(((x, y), z), o)| [x, y, z, o]).collect()
}

/// Some Gaussians, filtered.
struct Filtered<V> {
    /// `x` of `(f / s)^2 = exp(x)`: `(s' / s)^2 = 1 + exp(x)` for numbers of any size.
    ratio: [V; 3],
    /// `-ln o'`, above 0.
    faintness: V,
}

impl<V: Vector> Filtered<V> {
    #[inline(always)]
    fn load(cloud: &Gaussians, sizes: &[f32], at: usize) -> Self {
        let n = cloud.len();
        let tiny = V::splat(f32::MIN_POSITIVE);
        let ln_size = vecmath::ln(lanes::<V>(sizes, n, 0, at).max(tiny));
        let ratio = each!(3, |k| V::splat(2.0) * (ln_size - lanes::<V>(&cloud.log_scale, n, k, at)));
        let [a, b, c] = each!(3, |k| vecmath::softplus(ratio[k]));
        let logit = lanes::<V>(&cloud.logit, n, 0, at);
        let faintness = (a + b + c).mul_add(V::splat(0.5), vecmath::softplus(-logit)).max(V::splat(CLEAR_MIN));
        Self { ratio, faintness }
    }
}

/// A chunk of Gaussians, filtered, or with `BACKWARD` the gradient in `piece` taken back.
struct Smooth<'p, 'a, const BACKWARD: bool> {
    cloud: &'p Gaussians,
    sizes: &'p [f32],
    first: usize,
    piece: &'p mut Piece<'a>,
}

impl<const BACKWARD: bool> Task for Smooth<'_, '_, BACKWARD> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { cloud, sizes, first, piece } = self;
        let [scales @ .., logits] = piece;
        for i in (0..logits.len()).step_by(V::LANES) {
            let Filtered { ratio, faintness } = Filtered::<V>::load(cloud, sizes, first + i);
            let clear = vecmath::one_minus_exp_neg(faintness);
            // d logit' / d ln o' = 1 / (1 - o').
            let bar = V::load_part(&logits[i..]) / clear;
            for (k, (scales, ratio)) in scales.iter_mut().zip(ratio).enumerate() {
                let out = if BACKWARD {
                    // d ln s' / d ln s is what of the variance is the Gaussian's own; d ln o' / d ln s is the rest.
                    let (own, rest) = (vecmath::logistic(-ratio), vecmath::logistic(ratio));
                    V::load_part(&scales[i..]).mul_add(own, bar * rest)
                } else {
                    let log_scale = lanes::<V>(&cloud.log_scale, cloud.len(), k, first + i);
                    vecmath::softplus(ratio).mul_add(V::splat(0.5), log_scale)
                };
                out.store_part(&mut scales[i..]);
            }
            let out = if BACKWARD {
                bar * vecmath::logistic(-lanes::<V>(&cloud.logit, cloud.len(), 0, first + i))
            } else {
                // ln(o / (1 - o)).
                -faintness - vecmath::ln(clear)
            };
            out.store_part(&mut logits[i..]);
        }
    }
}
