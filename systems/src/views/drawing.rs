//! Clouds as a camera sees them: projected together, with the features that are composited.

use super::cloud_parameters::CloudParameters;
use super::hooks::OfAppearance;
use super::planes::{COLOUR, PlaneLayout};
use float_core::Simd;
use rayon::prelude::*;
use splat_core::{
    CameraGradient, Gaussians, ProjectedGaussian, ProjectedGradient, Projection, RasterSettings, SplatError, View,
};
use std::ops::Range;

/// Gaussians per task.
const ROWS: usize = 4096;

/// A cloud at the time of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawnCloud<'a> {
    /// Number of the cloud in its picture.
    pub(crate) index: usize,
    pub(crate) gaussians: &'a Gaussians,
    /// `[rows][n]` extra rows.
    pub(crate) extra: &'a [f32],
    /// How many of them are composited: the first ones.
    pub(crate) composited: usize,
    /// Spherical harmonics are evaluated up to this degree.
    pub(crate) degree: usize,
}

impl<'a> DrawnCloud<'a> {
    /// A cloud without extra rows, of all its degrees.
    pub(crate) fn alone(gaussians: &'a Gaussians) -> Self {
        Self { index: 0, gaussians, extra: &[], composited: 0, degree: gaussians.degree() }
    }
}

/// A cloud, and its Gaussians that a picture shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VisibleCloud<'a> {
    pub(crate) cloud: DrawnCloud<'a>,
    pub(crate) gaussians: &'a [ProjectedGaussian],
    /// Where the camera of the picture is, of the clouds' frame; `None`: the Gaussians are seen from nowhere.
    pub(crate) eye: Option<[f32; 3]>,
}

/// Gaussians that a picture shows, and the gradients with respect to their centres on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenGaussians<'a> {
    pub(crate) gaussians: &'a [ProjectedGaussian],
    /// View-space gradients, plain or absolute, of each of them.
    pub(crate) uv: &'a [[f32; 2]],
}

/// What Gaussians were projected with, and which features they had.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projected<'a> {
    pub(crate) view: &'a View,
    pub(crate) settings: &'a RasterSettings,
    pub(crate) layout: PlaneLayout,
}

/// The projected Gaussians of all clouds of a picture: sorted by depth together, ties in the order of the clouds.
#[derive(Debug, Default)]
pub(crate) struct Projections {
    /// One for each cloud.
    each: Vec<Projection>,
    /// Of all clouds, where there are several.
    joined: Vec<ProjectedGaussian>,
    /// Where the camera is.
    eye: Option<[f32; 3]>,
}

impl Projections {
    /// Project clouds.
    ///
    /// # Errors
    /// [`SplatError`] for a camera or settings out of range, or more Gaussians than `u32` can count.
    pub(crate) fn project(
        &mut self,
        simd: Simd,
        clouds: &[DrawnCloud<'_>],
        view: &View,
        settings: &RasterSettings,
    ) -> Result<(), SplatError> {
        self.eye = Some(view.centre());
        self.each.resize_with(clouds.len(), Projection::default);
        for (projection, cloud) in self.each.iter_mut().zip(clouds) {
            projection.project(simd, cloud.gaussians, view, settings, cloud.degree)?;
        }
        self.joined.clear();
        if self.each.len() != 1 {
            self.joined.extend(self.each.iter().flat_map(|projection| &projection.gaussians));
        }
        match u32::try_from(self.gaussians().len()) {
            Ok(_) => Ok(()),
            Err(_) => Err(SplatError::TooMany { what: "Gaussians", got: self.gaussians().len() }),
        }
    }

    /// A cloud as the picture shows it, by its projection.
    pub(crate) fn seen<'a>(&self, cloud: &DrawnCloud<'a>, projection: &'a Projection) -> VisibleCloud<'a> {
        VisibleCloud { cloud: *cloud, gaussians: &projection.gaussians, eye: self.eye }
    }

    /// Those of all clouds, one cloud after the other.
    pub(crate) fn gaussians(&self) -> &[ProjectedGaussian] {
        match &self.each[..] {
            [one] => &one.gaussians,
            _ => &self.joined,
        }
    }

    /// Those of each cloud: which of [`gaussians`](Self::gaussians), and the projection.
    pub(crate) fn each(&self) -> impl Iterator<Item = (Range<usize>, &Projection)> {
        let mut first = 0;
        self.each.iter().map(move |projection| {
            let range = first..first + projection.gaussians.len();
            first = range.end;
            (range, projection)
        })
    }

    /// Number of Gaussians of cloud `index` that are visible.
    pub(crate) fn of_cloud(&self, index: usize) -> Range<usize> {
        self.each().nth(index).map_or(0..0, |(range, _)| range)
    }

    /// Colours of all clouds as spherical harmonics give them, written to `out`.
    pub(crate) fn colours(&self, out: &mut Vec<[f32; 3]>) {
        out.resize(self.gaussians().len(), [0.0; 3]);
        for (range, projection) in self.each() {
            out[range].par_chunks_mut(ROWS).zip(projection.rgb.par_chunks(ROWS)).for_each(|(out, rgb)| {
                out.copy_from_slice(rgb);
            });
        }
    }

    /// Turn the colours of all clouds into those of an appearance.
    pub(crate) fn of_appearance(
        &self,
        clouds: &[DrawnCloud<'_>],
        of_appearance: OfAppearance<'_>,
        colours: &mut [[f32; 3]],
    ) {
        for ((range, projection), cloud) in self.each().zip(clouds) {
            let seen = self.seen(cloud, projection);
            of_appearance.part.forward(of_appearance.appearance, seen, &mut colours[range]);
        }
    }

    /// The features of all clouds, written to `out`: colours, depth, extra rows, colours before the appearance, zeros.
    pub(crate) fn features<const K: usize>(
        &self,
        clouds: &[DrawnCloud<'_>],
        layout: PlaneLayout,
        colours: &[[f32; 3]],
        out: &mut Vec<[f32; K]>,
    ) {
        out.resize(self.gaussians().len(), [0.0; K]);
        for ((range, projection), cloud) in self.each().zip(clouds) {
            let n = cloud.gaussians.len();
            let visible = projection.gaussians.par_iter().zip(&projection.rgb).zip(&colours[range.clone()]);
            visible.with_min_len(ROWS).zip(&mut out[range]).for_each(|(((gaussian, plain), rgb), features)| {
                *features = [0.0; K];
                features[..COLOUR].copy_from_slice(rgb);
                if let Some(depth) = layout.depth_feature() {
                    features[depth] = gaussian.z;
                }
                for (row, feature) in features[layout.first_extra()..].iter_mut().take(cloud.composited).enumerate() {
                    *feature = cloud.extra[row * n + gaussian.index as usize];
                }
                if layout.plain {
                    features[layout.first_plain()..][..COLOUR].copy_from_slice(plain);
                }
            });
        }
    }

    /// Gradients with respect to the parameters of cloud `cloud.index`, written to `bar`: those of its composited extra rows, and what
    /// its part of `gradients` says of the rest. What it says of the camera is added to `camera`, where that is asked for.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub(crate) fn backward<const K: usize>(
        &self,
        simd: Simd,
        cloud: &DrawnCloud<'_>,
        projected: &Projected<'_>,
        gradients: &[ProjectedGradient<K>],
        bar: &mut CloudParameters,
        camera: Option<&mut CameraGradient>,
    ) -> Result<(), SplatError> {
        let (Projected { view, settings, layout }, n) = (*projected, cloud.gaussians.len());
        let Some((range, projection)) = self.each().nth(cloud.index) else { return Ok(()) };
        let own = &gradients[range];
        for (gaussian, gradient) in projection.gaussians.iter().zip(own) {
            for row in 0..cloud.composited {
                bar.extra[row * n + gaussian.index as usize] += gradient.features[layout.first_extra() + row];
            }
        }
        let depth = layout.depth_feature();
        let (gaussians, degree, bar) = (cloud.gaussians, cloud.degree, &mut bar.gaussians);
        match camera {
            None => projection.backward(simd, gaussians, view, settings, degree, own, depth, bar),
            Some(sum) => {
                let own = projection.backward_with_camera(simd, gaussians, view, settings, degree, own, depth, bar)?;
                *sum = sum.plus(&own);
                Ok(())
            }
        }
    }
}
