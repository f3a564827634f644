//! The usual way to draw and to differentiate: a renderer that keeps the state of the forward pass with its picture.

use alloc::vec::Vec;

use float_core::Simd;

use crate::project::CameraGradient;
use crate::{
    DrawStats, Gaussians, ProjectedGaussian, ProjectedGradient, Projection, Raster, RasterSettings, SplatError, View,
};

/// Channels of a colour: the first features.
const COLOUR: usize = 3;

/// A cloud to be drawn, with what is composited besides its colours.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Cloud<'a> {
    /// The Gaussians.
    pub gaussians: &'a Gaussians,
    /// Spherical harmonics are evaluated up to this degree, or the cloud's if that is lower.
    pub degree: usize,
    /// `[E][n]` further features of each Gaussian (masks, labels, codes), composited as they are. `E` is the number of a
    /// [`Renderer`]'s [extras](Renderer::extras).
    pub extras: &'a [f32],
}

impl<'a> Cloud<'a> {
    /// A cloud of its full degree, without extras.
    #[must_use]
    pub const fn new(gaussians: &'a Gaussians) -> Self {
        Self { gaussians, degree: crate::MAX_DEGREE, extras: &[] }
    }

    float_core::setters! {
        with_degree degree: usize;
        with_extras extras: &'a [f32];
    }
}

/// What a backward pass computes besides the gradients of the clouds. Nothing by default, and what is not asked for costs nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GradientOptions {
    /// The gradient with respect to the camera.
    pub camera: bool,
    /// Absolute view-space gradients.
    pub absolute: bool,
}

impl GradientOptions {
    /// Gradients of the clouds only.
    pub const DEFAULT: Self = Self { camera: false, absolute: false };

    float_core::setters! {
        with_camera camera: bool;
        with_absolute absolute: bool;
    }
}

/// Gradients of a picture. Keep it between calls: buffers are reused.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Gradients {
    /// With respect to each cloud, in the order in which they were given.
    pub clouds: Vec<CloudGradient>,
    /// With respect to the camera, if asked for.
    pub camera: Option<CameraGradient>,
}

/// Gradient with respect to one cloud.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct CloudGradient {
    /// With respect to the parameters; 0 for Gaussians that are not visible.
    pub gaussians: Gaussians,
    /// `[E][n]` with respect to the extras; 0 for Gaussians that are not visible.
    pub extras: Vec<f32>,
    /// One for each of [`Picture::projected`]: the view-space positional gradient, see [`ProjectedGradient::uv`].
    pub uv: Vec<[f32; 2]>,
    /// The same as sums of absolute values over pixels, if asked for; else empty. See [`Raster::backward_absolute`].
    pub uv_absolute: Vec<[f32; 2]>,
}

/// Draws clouds of Gaussians with `K` features: the three channels of colour, the depth `z` (with [`with_depth`](Self::with_depth)), then
/// extras. Buffers are kept between pictures.
///
/// A [`Picture`] borrows its renderer and its clouds, so its gradients are always those of what was drawn. Drawing another picture
/// while it is needed does not compile:
///
/// ```compile_fail,E0499
/// # use splat_core::{Cloud, Gaussians, RasterSettings, Renderer, View};
/// # fn f(renderer: &mut Renderer<3>, gaussians: &Gaussians, view: &View, other: &View) {
/// let first = renderer.render(&[Cloud::new(gaussians)], view).unwrap();
/// let second = renderer.render(&[Cloud::new(gaussians)], other).unwrap();
/// first.planes();
/// # }
/// ```
///
/// Neither does changing a cloud before the picture's gradients were taken:
///
/// ```compile_fail,E0506
/// # use splat_core::{Cloud, Gaussians, GradientOptions, Gradients, Renderer, View};
/// # fn f(renderer: &mut Renderer<3>, mut gaussians: Gaussians, view: &View, bar: &[f32], gradients: &mut Gradients) {
/// let mut picture = renderer.render(&[Cloud::new(&gaussians)], view).unwrap();
/// gaussians = Gaussians::default();
/// picture.backward(bar, GradientOptions::default(), gradients).unwrap();
/// # }
/// ```
///
/// [`Projection`] and [`Raster`] do the same work without these checks, with features of any kind.
#[derive(Clone, Debug)]
pub struct Renderer<const K: usize> {
    simd: Simd,
    settings: RasterSettings,
    depth: bool,
    /// One for each cloud.
    projections: Vec<Projection>,
    /// The projected Gaussians of all clouds, where there are several.
    joined: Vec<ProjectedGaussian>,
    /// Features of all clouds' projected Gaussians.
    features: Vec<[f32; K]>,
    raster: Raster<K>,
    planes: Vec<f32>,
    gradients: Vec<ProjectedGradient<K>>,
    uv_absolute: Vec<[f32; 2]>,
}

impl<const K: usize> Renderer<K> {
    /// A renderer of colours and `K - 3` extras, at the best SIMD level of this CPU. `K` below 3 does not compile.
    #[must_use]
    pub fn new(settings: RasterSettings) -> Self {
        const { assert!(K >= COLOUR, "a Renderer composites at least the three channels of colour") };
        Self {
            simd: Simd::best(),
            settings,
            depth: false,
            projections: Vec::new(),
            joined: Vec::new(),
            features: Vec::new(),
            raster: Raster::default(),
            planes: Vec::new(),
            gradients: Vec::new(),
            uv_absolute: Vec::new(),
        }
    }

    float_core::setters! {
        with_simd simd: Simd;
        with_settings settings: RasterSettings;
        with_depth depth: bool;
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &RasterSettings {
        &self.settings
    }

    /// Number of extras: `K - 3`, one less with depth.
    #[must_use]
    pub fn extras(&self) -> usize {
        (K - COLOUR).saturating_sub(usize::from(self.depth))
    }

    /// Draw clouds on one picture, Gaussians of all clouds sorted by depth together (ties in the order of the clouds).
    ///
    /// # Errors
    /// [`SplatError`] for a camera or settings out of range, fields or extras of the wrong length, depth with `K = 3`, or more Gaussians
    /// or pairs of a Gaussian and a tile than `u32` can count.
    ///
    /// # Panics
    /// If there is no memory for the picture.
    pub fn render<'r, 'c>(&'r mut self, clouds: &[Cloud<'c>], view: &View) -> Result<Picture<'r, 'c, K>, SplatError> {
        view.check()?;
        self.settings.check()?;
        let extras = self.extras();
        let used = COLOUR + usize::from(self.depth) + extras;
        if used != K {
            return Err(SplatError::Shape { what: "features", want: used, got: K });
        }
        for cloud in clouds {
            let want = extras * cloud.gaussians.len();
            if cloud.extras.len() != want {
                return Err(SplatError::Shape { what: "extras", want, got: cloud.extras.len() });
            }
        }
        self.projections.resize_with(clouds.len(), Projection::default);
        for (projection, cloud) in self.projections.iter_mut().zip(clouds) {
            projection.project(self.simd, cloud.gaussians, view, &self.settings, cloud.degree)?;
        }
        self.features.clear();
        self.joined.clear();
        for (projection, cloud) in self.projections.iter().zip(clouds) {
            if clouds.len() > 1 {
                self.joined.extend_from_slice(&projection.gaussians);
            }
            let (depth, n) = (self.depth, cloud.gaussians.len());
            self.features.extend(projection.gaussians.iter().zip(&projection.rgb).map(|(gaussian, rgb)| {
                let mut features = [0.0; K];
                features[..COLOUR].copy_from_slice(rgb);
                if depth {
                    features[COLOUR] = gaussian.z;
                }
                for (e, feature) in features[K - extras..].iter_mut().enumerate() {
                    *feature = cloud.extras[e * n + gaussian.index as usize];
                }
                features
            }));
        }
        if u32::try_from(self.features.len()).is_err() {
            return Err(SplatError::TooMany { what: "Gaussians", got: self.features.len() });
        }
        let gaussians = drawn(&self.projections, &self.joined);
        let stats = self.raster.draw(self.simd, gaussians, &self.features, view.size, &self.settings)?;
        self.planes.resize((K + 1) * view.size[0] * view.size[1], 0.0);
        self.raster.planes(&mut self.planes)?;
        Ok(Picture { renderer: self, clouds: clouds.to_vec(), view: *view, stats })
    }
}

/// The projected Gaussians of all clouds, one cloud after the other.
fn drawn<'a>(projections: &'a [Projection], joined: &'a [ProjectedGaussian]) -> &'a [ProjectedGaussian] {
    match projections {
        [one] => &one.gaussians,
        _ => joined,
    }
}

/// A picture, with the state of its forward pass.
#[derive(Debug)]
pub struct Picture<'r, 'c, const K: usize> {
    renderer: &'r mut Renderer<K>,
    clouds: Vec<Cloud<'c>>,
    view: View,
    stats: DrawStats,
}

impl<const K: usize> Picture<'_, '_, K> {
    /// `[K + 1][rows][columns]`: the features, then the transmittance. A background `b` is added as `feature + transmittance * b`.
    #[must_use]
    pub fn planes(&self) -> &[f32] {
        &self.renderer.planes
    }

    /// `[rows][columns]` feature `k`, or the transmittance for `k = K`.
    ///
    /// # Panics
    /// If `k` is above `K`.
    #[must_use]
    pub fn plane(&self, k: usize) -> &[f32] {
        let pixels = self.view.size[0] * self.view.size[1];
        &self.renderer.planes[k * pixels..][..pixels]
    }

    /// The camera.
    #[must_use]
    pub fn view(&self) -> &View {
        &self.view
    }

    /// How much work it was.
    #[must_use]
    pub fn stats(&self) -> DrawStats {
        self.stats
    }

    /// The visible Gaussians of cloud `cloud`, by ascending index.
    ///
    /// # Panics
    /// If there is no cloud `cloud`.
    #[must_use]
    pub fn projected(&self, cloud: usize) -> &[ProjectedGaussian] {
        &self.renderer.projections[cloud].gaussians
    }

    /// Median depth, written to `out` `[rows][columns]`: see [`Raster::median_depth`].
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn median_depth(&self, out: &mut [f32]) -> Result<(), SplatError> {
        let Renderer { simd, settings, projections, joined, features, raster, .. } = &*self.renderer;
        raster.median_depth(*simd, drawn(projections, joined), features, settings, out)
    }

    /// Gradients of a loss, written to `gradients`. `planes_bar` `[K + 1][rows][columns]` is the gradient with respect to
    /// [`planes`](Self::planes).
    ///
    /// # Errors
    /// [`SplatError::Shape`] if `planes_bar` has the wrong length.
    ///
    /// # Panics
    /// If there is no memory for the gradients.
    pub fn backward(
        &mut self,
        planes_bar: &[f32],
        options: GradientOptions,
        gradients: &mut Gradients,
    ) -> Result<(), SplatError> {
        let Renderer {
            simd,
            settings,
            depth,
            projections,
            joined,
            features,
            raster,
            gradients: all,
            uv_absolute: absolute,
            planes: _,
        } = &mut *self.renderer;
        let (simd, depth_feature, drawn) = (*simd, depth.then_some(COLOUR), drawn(projections, joined));
        if options.absolute {
            raster.backward_absolute(simd, drawn, features, settings, planes_bar, all, absolute)?;
        } else {
            absolute.clear();
            raster.backward(simd, drawn, features, settings, planes_bar, all)?;
        }
        gradients.clouds.resize_with(self.clouds.len(), CloudGradient::default);
        gradients.camera = options.camera.then(CameraGradient::default);
        let mut first = 0;
        for ((projection, cloud), out) in projections.iter().zip(&self.clouds).zip(&mut gradients.clouds) {
            let range = first..first + projection.gaussians.len();
            first = range.end;
            let (own, n) = (&all[range.clone()], cloud.gaussians.len());
            out.uv.clear();
            out.uv.extend(own.iter().map(|gradient| gradient.uv));
            out.uv_absolute.clear();
            if options.absolute {
                out.uv_absolute.extend_from_slice(&absolute[range]);
            }
            out.extras.clear();
            out.extras.resize(cloud.extras.len(), 0.0);
            let extras = cloud.extras.len().checked_div(n).unwrap_or(0);
            for (gaussian, gradient) in projection.gaussians.iter().zip(own) {
                for (e, x) in gradient.features[K - extras..].iter().enumerate() {
                    out.extras[e * n + gaussian.index as usize] = *x;
                }
            }
            if out.gaussians.len() != n || out.gaussians.degree() != cloud.gaussians.degree() {
                out.gaussians = Gaussians::new(n, cloud.gaussians.degree())?;
            }
            let (view, degree, grad) = (&self.view, cloud.degree, &mut out.gaussians);
            if let Some(camera) = &mut gradients.camera {
                let more = projection.backward_with_camera(
                    simd,
                    cloud.gaussians,
                    view,
                    settings,
                    degree,
                    own,
                    depth_feature,
                    grad,
                )?;
                *camera = camera.plus(&more);
            } else {
                projection.backward(simd, cloud.gaussians, view, settings, degree, own, depth_feature, grad)?;
            }
        }
        Ok(())
    }
}
