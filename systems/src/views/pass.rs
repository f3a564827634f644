//! One training step's picture: draw the clouds as a photo's camera sees them, compare, and take the gradient back.

use super::cloud_parameters::CloudParameters;
use super::drawing::{DrawnCloud, Projected, Projections, SeenGaussians};
use super::hooks::{Beside, ColourAppearance, ColourBars, OfAppearance, RenderJudge};
use super::planes::{COLOUR, PlaneBars, PlaneLayout, RenderedPicture, add_background};
use super::terms::{PictureTerm, TargetPicture};
use engine::system::Appearance;
use float_core::Simd;
use splat_core::{CameraGradient, DrawStats, ProjectedGradient, Raster, RasterSettings, SplatError, View};
use std::time::Instant;

/// Parts of a step that are timed.
pub(crate) const PARTS: [&str; 6] =
    ["photo", "projection", "rasterising", "loss", "rasterising, backwards", "projection, backwards"];

/// Which view-space gradients the density control is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ViewSpaceGradient {
    /// The gradient of the loss (3DGS).
    #[default]
    Plain,
    /// Sums of absolute values over pixels (AbsGS).
    Absolute,
}

/// The camera of a step and what is behind its picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepCamera<'a> {
    pub(crate) view: &'a View,
    pub(crate) settings: &'a RasterSettings,
    pub(crate) background: [f32; 3],
}

/// What came out, besides the gradients.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    pub(crate) loss: f64,
    pub(crate) mse: f64,
    pub(crate) drawn: DrawStats,
}

/// A pass that could not be made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PassError {
    /// What the rasteriser refuses.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// What the loss refuses.
    #[error(transparent)]
    Loss(#[from] losses::LossError),
}

/// The pictures of steps.
pub(crate) trait PicturePass: Send + Sync {
    /// The loss of a picture of `clouds` against a photo, and its gradient with respect to each cloud, written to `gradients`.
    fn run(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        camera: &StepCamera<'_>,
        target: &TargetPicture<'_>,
        parts: &mut LossParts<'_>,
        gradients: &mut [CloudParameters],
    ) -> Result<Outcome, PassError>;

    /// The Gaussians of cloud `index` that the last photo shows, and what it says of them.
    fn seen(&self, index: usize) -> SeenGaussians<'_>;

    /// What the last photo needs of each Gaussian of cloud `index`, `[n]`; nothing where that is not counted.
    fn uses(&self, index: usize) -> &[f32] {
        let _ = index;
        &[]
    }

    /// `[3][pixels]`, the colours of the last picture.
    fn colour(&self) -> &[f32];

    /// The same before the appearance, where these are drawn.
    fn plain(&self) -> Option<&[f32]>;
}

/// What a picture's loss is made of, and where time is written.
pub(crate) struct LossParts<'a> {
    pub(crate) terms: &'a mut [Box<dyn PictureTerm>],
    pub(crate) appearance: Option<&'a mut (dyn ColourAppearance + 'static)>,
    /// Says which pixels of the photo count, by its render.
    pub(crate) judge: Option<StepJudge<'a>>,
    /// How much each pixel counted, where there is a judge and it said anything.
    pub(crate) judged: Option<Vec<f32>>,
    pub(crate) view_space: ViewSpaceGradient,
    /// Step of the schedule.
    pub(crate) step: u64,
    /// Where the gradient with respect to the camera of the step goes; `None`: nobody asks.
    pub(crate) camera: Option<&'a mut CameraGradient>,
    /// Seconds of each of [`PARTS`], added to.
    pub(crate) seconds: &'a mut [f64; PARTS.len()],
}

/// Judges a picture in a step of the schedule.
pub(crate) struct StepJudge<'a> {
    pub(crate) judge: &'a mut (dyn RenderJudge + 'static),
    pub(crate) step: u64,
}

/// Most features that a pass composites.
pub(crate) const MOST_FEATURES: usize = 8;

/// A pass over pictures of this layout; `None` for more features than [`MOST_FEATURES`].
pub(crate) fn picture_pass(simd: Simd, layout: PlaneLayout) -> Option<Box<dyn PicturePass>> {
    match layout.features() {
        COLOUR => Some(Box::new(Pass::<COLOUR>::new(simd, layout))),
        4 => Some(Box::new(Pass::<4>::new(simd, layout))),
        5..=6 => Some(Box::new(Pass::<6>::new(simd, layout))),
        7..=MOST_FEATURES => Some(Box::new(Pass::<MOST_FEATURES>::new(simd, layout))),
        _ => None,
    }
}

/// Buffers of a pass that composites `K` features, of which the layout's are read.
#[derive(Debug)]
pub(crate) struct Pass<const K: usize> {
    simd: Simd,
    layout: PlaneLayout,
    projections: Projections,
    /// Colours before and after the appearance.
    colours: Vec<[f32; 3]>,
    of_appearance: Vec<[f32; 3]>,
    features: Vec<[f32; K]>,
    raster: Raster<K>,
    planes: Vec<f32>,
    bars: PlaneBars,
    gradients: Vec<ProjectedGradient<K>>,
    uv: Vec<[f32; 2]>,
    clock: Clock,
}

impl<const K: usize> Pass<K> {
    pub(crate) fn new(simd: Simd, layout: PlaneLayout) -> Self {
        Self {
            simd,
            layout,
            projections: Projections::default(),
            colours: Vec::new(),
            of_appearance: Vec::new(),
            features: Vec::new(),
            raster: Raster::default(),
            planes: Vec::new(),
            bars: PlaneBars::default(),
            gradients: Vec::new(),
            uv: Vec::new(),
            clock: Clock::default(),
        }
    }

    /// Draw the clouds, over the background.
    pub(crate) fn draw(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        camera: &StepCamera<'_>,
        appearance: Option<OfAppearance<'_>>,
    ) -> Result<DrawStats, PassError> {
        let StepCamera { view, settings, background } = *camera;
        self.projections.project(self.simd, clouds, view, settings)?;
        self.projections.colours(&mut self.colours);
        let colours = match appearance {
            None => &self.colours,
            Some(of_appearance) => {
                self.of_appearance.clone_from(&self.colours);
                self.projections.of_appearance(clouds, of_appearance, &mut self.of_appearance);
                &self.of_appearance
            }
        };
        self.projections.features(clouds, self.layout, colours, &mut self.features);
        self.clock.lap(1);
        let drawn = self.raster.draw(self.simd, self.projections.gaussians(), &self.features, view.size, settings)?;
        let pixels = view.size[0] * view.size[1];
        self.planes.resize((K + 1) * pixels, 0.0);
        self.raster.planes(&mut self.planes)?;
        let (features, transmittance) = self.planes.split_at_mut(K * pixels);
        for first in self.layout.over_background() {
            add_background(&mut features[first * pixels..][..COLOUR * pixels], transmittance, background);
        }
        self.clock.lap(2);
        Ok(drawn)
    }

    /// The loss of the last picture and its gradient with respect to the planes.
    fn compare(
        &mut self,
        size: [usize; 2],
        target: &TargetPicture<'_>,
        parts: &mut LossParts<'_>,
    ) -> Result<(f64, f64), PassError> {
        let picture = pictured::<K>(&self.planes, self.layout, size);
        parts.judged = parts.judge.as_mut().and_then(|at| judged(at, &picture, target));
        let target = &TargetPicture { weights: parts.judged.as_deref().or(target.weights), ..*target };
        self.bars.begin(size[0] * size[1], K, self.layout);
        let mut loss = 0.0;
        for term in &mut *parts.terms {
            term.add(&picture, target, &mut self.bars, &mut loss)?;
        }
        Ok((loss, squared_error(&picture, target)))
    }

    /// The gradient with respect to the colours as spherical harmonics give them, in the place of that with respect to those that were
    /// composited. Returns that with respect to coefficients of degree 0 that the appearance itself reads.
    fn appearance_backward(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        part: &mut dyn ColourAppearance,
        appearance: &Appearance,
        gradients: &mut [CloudParameters],
    ) -> Vec<[f32; 3]> {
        let mut bar: Vec<[f32; 3]> = self.gradients.iter().map(|g| [0, 1, 2].map(|c| g.features[c])).collect();
        let mut base = vec![[0.0; 3]; bar.len()];
        for (((range, projection), cloud), gradient) in self.projections.each().zip(clouds).zip(gradients) {
            let rgb = &self.colours[range.clone()];
            let bars = ColourBars { rgb: &mut bar[range.clone()], base: &mut base[range], extra: &mut gradient.extra };
            let seen = self.projections.seen(cloud, projection);
            part.backward(appearance, seen, rgb, bars);
        }
        let plain = self.layout.plain.then_some(self.layout.first_plain());
        for (gradient, bar) in self.gradients.iter_mut().zip(&bar) {
            let plain = |c: usize| plain.map_or(0.0, |first| gradient.features[first + c]);
            let sum = [0, 1, 2].map(|c| bar[c] + plain(c));
            gradient.features[..COLOUR].copy_from_slice(&sum);
        }
        base
    }

    /// Add what the appearance says of coefficients of degree 0 to the gradients of the clouds.
    fn add_base(&self, base: &[[f32; 3]], gradients: &mut [CloudParameters]) {
        for ((range, projection), gradient) in self.projections.each().zip(gradients) {
            let n = gradient.len();
            for (gaussian, bar) in projection.gaussians.iter().zip(&base[range]) {
                for (c, bar) in bar.iter().enumerate() {
                    gradient.gaussians.dc[c * n + gaussian.index as usize] += bar;
                }
            }
        }
    }

    /// The last picture, of `size`.
    pub(crate) fn picture(&self, size: [usize; 2]) -> RenderedPicture<'_> {
        pictured::<K>(&self.planes, self.layout, size)
    }

    /// Gradients with respect to the planes of the last picture, of `size`: none yet.
    pub(crate) fn begin_bars(&mut self, size: [usize; 2]) -> &mut PlaneBars {
        self.bars.begin(size[0] * size[1], K, self.layout);
        &mut self.bars
    }

    /// Exchange the gradients with respect to the centres on the picture, which the density control is given.
    pub(crate) fn swap_uv(&mut self, uv: &mut Vec<[f32; 2]>) {
        std::mem::swap(&mut self.uv, uv);
    }

    /// Take the gradient with respect to features and places on the picture back to `clouds`.
    pub(crate) fn projection_backward(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        camera: &StepCamera<'_>,
        mut camera_gradient: Option<&mut CameraGradient>,
        gradients: &mut [CloudParameters],
    ) -> Result<(), SplatError> {
        let projected = Projected { view: camera.view, settings: camera.settings, layout: self.layout };
        for (cloud, gradient) in clouds.iter().zip(gradients) {
            let camera = camera_gradient.as_deref_mut();
            self.projections.backward(self.simd, cloud, &projected, &self.gradients, gradient, camera)?;
        }
        Ok(())
    }

    /// Add the seconds of each of [`PARTS`] since the last time.
    pub(crate) fn add_seconds(&mut self, seconds: &mut [f64; PARTS.len()]) {
        for (sum, more) in seconds.iter_mut().zip(std::mem::take(&mut self.clock).seconds) {
            *sum += more;
        }
    }

    /// Take the gradient with respect to the planes back to the features and the view-space positions.
    pub(crate) fn raster_backward(
        &mut self,
        camera: &StepCamera<'_>,
        view_space: ViewSpaceGradient,
    ) -> Result<(), SplatError> {
        let Self { simd, projections, features, raster, bars, gradients, uv, .. } = self;
        let (simd, gaussians, settings) = (*simd, projections.gaussians(), camera.settings);
        let bars = bars.composited(camera.background);
        self.clock.lap(3);
        match view_space {
            ViewSpaceGradient::Plain => {
                raster.backward(simd, gaussians, features, settings, bars, gradients)?;
                uv.clear();
                uv.extend(gradients.iter().map(|gradient| gradient.uv));
            }
            ViewSpaceGradient::Absolute => {
                raster.backward_absolute(simd, gaussians, features, settings, bars, gradients, uv)?;
            }
        }
        self.clock.lap(4);
        Ok(())
    }
}

impl<const K: usize> PicturePass for Pass<K> {
    fn run(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        camera: &StepCamera<'_>,
        target: &TargetPicture<'_>,
        parts: &mut LossParts<'_>,
        gradients: &mut [CloudParameters],
    ) -> Result<Outcome, PassError> {
        self.clock = Clock::default();
        let appearance = Appearance::View(target.view);
        let of_appearance = parts.appearance.as_deref().map(|part| OfAppearance { part, appearance: &appearance });
        let drawn = self.draw(clouds, camera, of_appearance)?;
        let (loss, mse) = self.compare(camera.view.size, target, parts)?;
        self.raster_backward(camera, parts.view_space)?;
        for gradient in gradients.iter_mut() {
            gradient.extra.fill(0.0);
        }
        let base =
            parts.appearance.as_deref_mut().map(|part| self.appearance_backward(clouds, part, &appearance, gradients));
        self.projection_backward(clouds, camera, parts.camera.as_deref_mut(), gradients)?;
        if let Some(base) = base {
            self.add_base(&base, gradients);
        }
        self.clock.lap(5);
        self.add_seconds(parts.seconds);
        Ok(Outcome { loss, mse, drawn })
    }

    fn seen(&self, index: usize) -> SeenGaussians<'_> {
        let range = self.projections.of_cloud(index);
        SeenGaussians { gaussians: &self.projections.gaussians()[range.clone()], uv: &self.uv[range] }
    }

    fn colour(&self) -> &[f32] {
        &self.planes[..self.planes.len() / (K + 1) * COLOUR]
    }

    fn plain(&self) -> Option<&[f32]> {
        let pixels = self.planes.len() / (K + 1);
        self.layout.plain.then(|| &self.planes[self.layout.first_plain() * pixels..][..COLOUR * pixels])
    }
}

/// A picture of `K` features, by its planes.
fn pictured<const K: usize>(planes: &[f32], layout: PlaneLayout, size: [usize; 2]) -> RenderedPicture<'_> {
    let pixels = size[0] * size[1];
    let plane = |first: usize, count: usize| &planes[first * pixels..][..count * pixels];
    RenderedPicture {
        size,
        colour: plane(0, COLOUR),
        depth: layout.depth_feature().map(|depth| plane(depth, 1)),
        extras: plane(layout.first_extra(), layout.extras),
        plain: layout.plain.then(|| plane(layout.first_plain(), COLOUR)),
        transmittance: plane(K, 1),
    }
}

/// How much each pixel counts in a step, by a judge and as before it. Pixels that do not count are as rendered for it: they say
/// nothing of their neighbours.
fn judged(at: &mut StepJudge<'_>, picture: &RenderedPicture<'_>, target: &TargetPicture<'_>) -> Option<Vec<f32>> {
    let (size, render) = (picture.size, picture.colour);
    let beside = Beside { view: target.view, size, render, photo: target.colour, before: target.weights };
    let Some(before) = target.weights else {
        return at.judge.weights(at.step, &beside);
    };
    let mut photo = target.colour.to_vec();
    for (photo, render) in photo.chunks_exact_mut(before.len().max(1)).zip(render.chunks_exact(before.len().max(1))) {
        for (i, _) in before.iter().enumerate().filter(|(_, weight)| **weight == 0.0) {
            photo[i] = render[i];
        }
    }
    let mut weights = at.judge.weights(at.step, &Beside { photo: &photo, ..beside })?;
    weights.iter_mut().zip(before).for_each(|(weight, before)| *weight *= before);
    Some(weights)
}

/// Mean squared error over every eighth row that counts: for the progress line, not for learning.
pub(crate) fn squared_error(picture: &RenderedPicture<'_>, target: &TargetPicture<'_>) -> f64 {
    let [width, height] = [picture.size[0].max(1), picture.size[1].max(1)];
    let (mut sum, mut count) = (0.0, 0.0);
    let rows = picture.colour.chunks_exact(width).zip(target.colour.chunks_exact(width));
    for (row, (x, y)) in rows.enumerate().step_by(8) {
        for (column, (x, y)) in x.iter().zip(y).enumerate() {
            let weight = target.weights.map_or(1.0, |w| w[row % height * width + column]);
            sum += f64::from(weight * (x - y) * (x - y));
            count += f64::from(weight);
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Seconds of each part of a step.
#[derive(Debug)]
struct Clock {
    at: Instant,
    seconds: [f64; PARTS.len()],
}

impl Default for Clock {
    fn default() -> Self {
        Self { at: Instant::now(), seconds: [0.0; PARTS.len()] }
    }
}

impl Clock {
    fn lap(&mut self, part: usize) {
        let now = Instant::now();
        self.seconds[part] += (now - self.at).as_secs_f64();
        self.at = now;
    }
}
