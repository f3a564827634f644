//! A step's picture of two clouds, drawn one by one: compared together, and the gradient taken back to both.

use super::MASK_ROWS;
use super::composite::{Composed, FrontPixel, PixelBars, compose, pull_back};
use super::costs::Costs;
use super::seen::{CostBars, Seen};
use super::settings::LayerSettings;
use crate::views::{
    CloudLayers, CloudParameters, DrawnCloud, FrontSeen, LossParts, Outcome, Pass, PassError, PicturePass, PlaneLayout,
    RenderedPicture, SeenGaussians, StepCamera, TargetPicture, squared_error,
};
use float_core::Simd;
use float_core::m32::logistic;
use losses::anisotropy::anisotropy_backward;
use rayon::prelude::*;
use splat_core::density::opacity;
use splat_core::{Gaussians, View};

/// Colour and depth of the cloud behind; those and masks of the one in front.
const BEHIND: PlaneLayout = PlaneLayout { depth: true, extras: 0, plain: false };
const FRONT: PlaneLayout = PlaneLayout { depth: true, extras: MASK_ROWS, plain: false };
const BEHIND_FEATURES: usize = 4;
const FRONT_FEATURES: usize = 8;
/// Steps between two in which Gaussians are held to be no more slender than this.
const SLENDER_EVERY: u64 = 10;
const SLENDER_FREE: f64 = 5.0;
/// Pixels that one task takes.
const PIXELS: usize = 1 << 13;

/// Two clouds, the second in front of the first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TwoLayers {
    settings: LayerSettings,
    /// Steps of the schedule.
    horizon: u64,
}

impl TwoLayers {
    pub(crate) fn new(settings: LayerSettings, horizon: u64) -> Self {
        Self { settings, horizon }
    }

    /// The mask of a row.
    fn mask(&self, row: usize, extra: f32) -> f32 {
        let first = if self.settings.front_at_camera { CLEAR_AT_FIRST } else { MASKS_AT_FIRST };
        logistic(first[row] + extra)
    }

    /// What Gaussians that are too slender cost; its gradient is added to that of each cloud. Every tenth step, as released.
    fn slenderness<'a>(
        &self,
        step: u64,
        clouds: impl Iterator<Item = (&'a DrawnCloud<'a>, &'a mut CloudParameters)>,
    ) -> Result<f64, PassError> {
        let weight = self.settings.front_anisotropy;
        let mut sum = 0.0;
        for (cloud, bar) in clouds.filter(|_| weight > 0.0 && step.is_multiple_of(SLENDER_EVERY)) {
            let (sizes, bars) = (&cloud.gaussians.log_scale, &mut bar.gaussians.log_scale);
            sum += weight * anisotropy_backward(sizes, SLENDER_FREE, weight, bars)?;
        }
        Ok(sum)
    }

    /// The view as the cloud in front has it: where that goes with the camera, the camera stands at the origin.
    fn of_front(&self, view: &View) -> View {
        if self.settings.front_at_camera {
            View { r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], t: [0.0; 3], ..*view }
        } else {
            *view
        }
    }
}

/// Logits of the masks of a Gaussian whose rows are 0: what is in front begins as opaque as its Gaussians, nearly.
const MASKS_AT_FIRST: [f32; MASK_ROWS] = [2.0, -2.0, 0.0];
/// The same where it goes with the camera: as clear, whatever its Gaussians are.
const CLEAR_AT_FIRST: [f32; MASK_ROWS] = [-2.0, 2.0, 0.0];

impl CloudLayers for TwoLayers {
    fn pass(&self, simd: Simd) -> Box<dyn PicturePass> {
        Box::new(LayeredPass {
            layers: *self,
            behind: Pass::new(simd, BEHIND),
            front: Pass::new(simd, FRONT),
            costs: Costs::new(simd, self.settings),
            masks: Vec::new(),
            composed: Vec::new(),
            colour: Vec::new(),
            uv: Vec::new(),
            uses: Vec::new(),
        })
    }

    fn masks(&self, extra: &[f32], n: usize, i: usize) -> [f32; 3] {
        [0, 1, 2].map(|row| self.mask(row, extra[row * n + i]))
    }

    fn pixel(&self, front: &FrontSeen, behind: [f32; 3]) -> ([f32; 3], f32) {
        let FrontSeen { colour, masks, transmittance } = *front;
        let seen = compose(&FrontPixel { colour, masks, transmittance }, behind, self.settings.front_shades);
        (seen.colour, seen.share)
    }

    fn front_alone(&self, front: &CloudParameters) -> Gaussians {
        let mut alone = front.gaussians.clone();
        let n = alone.len();
        for (i, logit) in alone.logit.iter_mut().enumerate() {
            let [own, behind, _] = self.masks(&front.extra, n, i);
            let opacity = (logistic(*logit) * own / (own + behind).max(f32::MIN_POSITIVE)).clamp(1e-6, 1.0 - 1e-6);
            *logit = (opacity / (1.0 - opacity)).ln();
        }
        alone
    }
}

/// The pass, with its buffers.
struct LayeredPass {
    layers: TwoLayers,
    behind: Pass<BEHIND_FEATURES>,
    front: Pass<FRONT_FEATURES>,
    costs: Costs,
    /// `[rows][n]`, the masks of the Gaussians in front.
    masks: Vec<f32>,
    composed: Vec<Composed>,
    /// `[3][pixels]`
    colour: Vec<f32>,
    uv: Vec<[f32; 2]>,
    /// `[n]`, what the last photo needs of each Gaussian in front, where that is counted.
    uses: Vec<f32>,
}

impl LayeredPass {
    /// Put both pictures together.
    fn compose(&mut self, size: [usize; 2], begun: bool) {
        let (behind, front) = (self.behind.picture(size), begun.then(|| self.front.picture(size)));
        let n = size[0] * size[1];
        let shades = self.layers.settings.front_shades;
        self.composed.resize(n, Composed::default());
        self.composed.par_iter_mut().with_min_len(PIXELS).enumerate().for_each(|(i, composed)| {
            *composed = compose(&front_pixel(front.as_ref(), i, n), rgb(behind.colour, i, n), shades);
        });
        self.colour.resize(3 * n, 0.0);
        for (c, plane) in self.colour.chunks_exact_mut(n.max(1)).enumerate() {
            plane.iter_mut().zip(&self.composed).for_each(|(x, composed)| *x = composed.colour[c]);
        }
    }

    /// What the photo needs of each Gaussian in front: `o m_f / (m_f + m_b + 1e-6)` of those that it shows.
    fn count_uses(&mut self, front: &DrawnCloud<'_>, begun: bool) {
        self.uses.clear();
        if self.layers.settings.front_prune <= 0.0 {
            return;
        }
        let n = front.gaussians.len();
        self.uses.resize(n, 0.0);
        for seen in self.front.seen(0).gaussians.iter().filter(|_| begun) {
            let i = seen.index as usize;
            let [own, behind] = [0, 1].map(|row| front.extra[row * n + i]);
            self.uses[i] = opacity(front.gaussians, i) as f32 * own / (own + behind + 1e-6);
        }
    }

    /// Take a part of the cost's gradient back to the planes of both clouds, and from there to features and places on the picture.
    fn raster_backward(
        &mut self,
        camera: &StepCamera<'_>,
        parts: &LossParts<'_>,
        bars: &CostBars,
        begun: bool,
    ) -> Result<(), PassError> {
        let size = camera.view.size;
        let of_front = self.layers.of_front(camera.view);
        let n = size[0] * size[1];
        let shades = self.layers.settings.front_shades;
        let pixels: Vec<PixelBars> = {
            let (behind, front) = (self.behind.picture(size), begun.then(|| self.front.picture(size)));
            let pixels = (&self.composed, &bars.composed).into_par_iter().with_min_len(PIXELS).enumerate();
            let pulled = pixels.map(|(i, (seen, bar))| {
                pull_back(&front_pixel(front.as_ref(), i, n), rgb(behind.colour, i, n), shades, seen, bar)
            });
            pulled.collect()
        };
        let planes = self.behind.begin_bars(size);
        for (c, plane) in planes.colour().chunks_exact_mut(n.max(1)).enumerate() {
            plane.iter_mut().zip(&pixels).for_each(|(bar, pixel)| *bar = pixel.behind[c]);
        }
        planes.depth().copy_from_slice(&bars.behind_depth);
        self.behind.raster_backward(camera, parts.view_space)?;
        if begun {
            let planes = self.front.begin_bars(size);
            for (c, plane) in planes.colour().chunks_exact_mut(n.max(1)).enumerate() {
                plane.iter_mut().zip(&pixels).for_each(|(bar, pixel)| *bar = pixel.front.colour[c]);
            }
            for (c, plane) in planes.extras().chunks_exact_mut(n.max(1)).enumerate() {
                plane.iter_mut().zip(&pixels).for_each(|(bar, pixel)| *bar = pixel.front.masks[c]);
            }
            planes.depth().copy_from_slice(&bars.front_depth);
            let own = bars.front_transmittance.iter().zip(&pixels);
            let transmittance = planes.transmittance();
            transmittance.iter_mut().zip(own).for_each(|(bar, (own, pixel))| *bar = own + pixel.front.transmittance);
            self.front.raster_backward(&over_nothing(camera, &of_front), parts.view_space)?;
        }
        Ok(())
    }
}

impl PicturePass for LayeredPass {
    fn run(
        &mut self,
        clouds: &[DrawnCloud<'_>],
        camera: &StepCamera<'_>,
        target: &TargetPicture<'_>,
        parts: &mut LossParts<'_>,
        gradients: &mut [CloudParameters],
    ) -> Result<Outcome, PassError> {
        let &[behind, front] = clouds else { return Ok(Outcome::default()) };
        let at = parts.step as f64 / self.layers.horizon.max(1) as f64;
        let begun = at >= self.layers.settings.front_from && !front.gaussians.is_empty();
        let view_of_front = self.layers.of_front(camera.view);
        let camera_of_front = over_nothing(camera, &view_of_front);
        let behind = [DrawnCloud { index: 0, ..behind }];
        let mut drawn = self.behind.draw(&behind, camera, None)?;
        self.masks.clear();
        // Rows after the masks are no business of pictures.
        let rows = front.extra.chunks_exact(front.gaussians.len().max(1)).take(MASK_ROWS).enumerate();
        let layers = self.layers;
        self.masks.extend(rows.flat_map(|(row, extra)| extra.iter().map(move |&extra| layers.mask(row, extra))));
        // Its buffers stay with the pass.
        let masks = std::mem::take(&mut self.masks);
        let front = [DrawnCloud { index: 0, extra: &masks, composited: MASK_ROWS, ..front }];
        if begun {
            drawn.pairs += self.front.draw(&front, &camera_of_front, None)?.pairs;
        }
        let size = camera.view.size;
        self.compose(size, begun);
        let seen = Seen {
            composed: &self.composed,
            behind: self.behind.picture(size),
            front: begun.then(|| self.front.picture(size)),
        };
        let loss = self.costs.add(&seen, target, at)?;
        let picture = RenderedPicture { colour: &self.colour, ..seen.behind };
        let mse = squared_error(&picture, target);
        // The density control is given what the main part says; Gaussians learn from all of it.
        let [mut main, utility] = [std::mem::take(&mut self.costs.main), std::mem::take(&mut self.costs.utility)];
        self.raster_backward(camera, parts, &main, begun)?;
        let (mut behind_uv, mut front_uv) = (std::mem::take(&mut self.uv), Vec::new());
        self.behind.swap_uv(&mut behind_uv);
        self.front.swap_uv(&mut front_uv);
        main.add(&utility);
        self.raster_backward(camera, parts, &main, begun)?;
        self.behind.swap_uv(&mut behind_uv);
        self.front.swap_uv(&mut front_uv);
        (self.uv, self.costs.main, self.costs.utility) = (behind_uv, main, utility);
        let [of_behind, of_front] = gradients else { return Ok(Outcome::default()) };
        of_behind.extra.fill(0.0);
        self.behind.projection_backward(
            &behind,
            camera,
            parts.camera.as_deref_mut(),
            std::slice::from_mut(of_behind),
        )?;
        of_front.extra.fill(0.0);
        if begun {
            // What goes with the camera says nothing of where that is.
            let camera_bar = parts.camera.as_deref_mut().filter(|_| !self.layers.settings.front_at_camera);
            self.front.projection_backward(&front, &camera_of_front, camera_bar, std::slice::from_mut(of_front))?;
            of_front.extra.iter_mut().zip(&masks).for_each(|(bar, mask)| *bar *= mask * (1.0 - mask));
        } else {
            of_front.gaussians.fields_mut().into_iter().for_each(|(_, values)| values.fill(0.0));
        }
        let clouds = [(&behind[0], of_behind), (&front[0], of_front)];
        let slender = layers.slenderness(parts.step, clouds.into_iter().take(1 + usize::from(begun)))?;
        self.count_uses(&front[0], begun);
        self.masks = masks;
        self.behind.add_seconds(parts.seconds);
        self.front.add_seconds(parts.seconds);
        Ok(Outcome { loss: loss + slender, mse, drawn })
    }

    fn seen(&self, index: usize) -> SeenGaussians<'_> {
        if index == 0 { self.behind.seen(0) } else { self.front.seen(0) }
    }

    fn uses(&self, index: usize) -> &[f32] {
        if index == 0 { &[] } else { &self.uses }
    }

    fn colour(&self) -> &[f32] {
        &self.colour
    }

    fn plain(&self) -> Option<&[f32]> {
        None
    }
}

fn rgb(planes: &[f32], i: usize, n: usize) -> [f32; 3] {
    [0, 1, 2].map(|c| planes[c * n + i])
}

/// Pixel `i` of the cloud in front; of one that has not begun, nothing.
fn front_pixel(front: Option<&RenderedPicture<'_>>, i: usize, n: usize) -> FrontPixel {
    match front {
        None => FrontPixel { transmittance: 1.0, ..FrontPixel::default() },
        Some(front) => FrontPixel {
            colour: rgb(front.colour, i, n),
            masks: rgb(front.extras, i, n),
            transmittance: front.transmittance[i],
        },
    }
}

/// The camera as the cloud in front is drawn with it: by `view`, with nothing behind its picture.
fn over_nothing<'a>(camera: &StepCamera<'a>, view: &'a View) -> StepCamera<'a> {
    StepCamera { view, background: [0.0; 3], ..*camera }
}
