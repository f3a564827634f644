//! The appearance of a photo that was not trained on: the code that explains some of its pixels best, the field as it is.
//!
//! Geometry does not depend on the code, so the samples of the rays are placed, weighed and encoded once; a step of the fit
//! asks the colour network alone (NeRF in the Wild, section 5: the left half of a test photo).

use super::chunk::Chunk;
use super::context::StepContext;
use super::driver::RaySystem;
use super::step::Plan;
use crate::buffers::sized;
use crate::fields::Columns;
use crate::photo_model::Codes;
use engine::data::Batch;
use engine::system::{Appearance, Fit, System};
use field_core::rng::Rng;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;

/// Pixels the fit knows of, and those of one of its steps.
const PIXELS: usize = 1 << 14;
const BATCH: usize = 1 << 10;
/// Rays that are sampled at one time: a field that has hardly trained has hundreds of samples along each.
const RAYS: usize = 256;
/// Pixels of a step whose colours are asked for at one time.
const GROUP: usize = 64;
/// Samples that bring less than this to their pixel are left out, colour units.
const FAINT: f32 = 1e-3;
/// Stream of the pixels of each step.
const FITTED: u64 = 0x6669_7474;

/// The samples of the fitted pixels that carry weight.
#[derive(Default)]
struct Kept {
    /// `[pixels + 1]`
    offsets: Vec<u32>,
    /// `[n]`, weights.
    w: Vec<f32>,
    /// `[n][geometry + sh]`: what the colour network sees besides the code.
    input: Vec<f32>,
    /// `[pixels][3]`: the truth less what is behind the samples.
    rest: Vec<[f32; 3]>,
}

/// See [`System::fit_appearance`].
pub(super) fn fit(driver: &RaySystem, pixels: &Fit<'_>) -> Option<Vec<f32>> {
    let mut code = driver.appearance_code(&Appearance::Mean)?;
    let numbers = driver.field.colour.inputs() - code.len() + 1;
    let kept = pixels.keep(PIXELS, numbers, |every, most| keep(driver, pixels, code.len(), every, most));
    let count = kept.rest.len();
    if count == 0 {
        return Some(code);
    }
    let mut adam = Adam::new(code.len(), AdamConfig::DEFAULT);
    let rng = Rng::new(pixels.seed, FITTED);
    let mut rooms: Vec<Room> = Vec::new();
    rooms.resize_with(BATCH.min(count).div_ceil(GROUP), Room::default);
    for step in 0..pixels.steps {
        if pixels.halt.raised() {
            break;
        }
        let draw = rng.substream(step);
        let chosen: Vec<usize> = match count <= BATCH {
            true => (0..count).collect(),
            false => (0..BATCH as u64).map(|i| (draw.u64_at(i) % count as u64) as usize).collect(),
        };
        let share = 1.0 / (3 * chosen.len()) as f32;
        let groups = rooms.par_iter_mut().zip(chosen.par_chunks(GROUP));
        groups.for_each(|(room, chosen)| room.gradient(driver, &kept, chosen, &code, share));
        // Always in this order, whoever was ready first.
        let bar: Vec<f32> = (0..code.len()).map(|k| rooms.iter().map(|room| room.bar[k]).sum()).collect();
        let third = (3 * step / pixels.steps.max(1)) as i32;
        // Entries that are not finite stay as they are.
        let _ = adam.step(driver.field.simd, pixels.lr * 0.1_f64.powi(third), &mut code, &bar);
    }
    Some(code)
}

/// Buffers for the gradient of some pixels, kept from step to step.
#[derive(Default)]
struct Room {
    columns: Vec<u32>,
    /// `[pixels + 1]`, the first column of each.
    firsts: Vec<u32>,
    x: Vec<f32>,
    acts: Vec<f32>,
    rgb: Vec<f32>,
    rgb_bar: Vec<f32>,
    x_bar: Vec<f32>,
    grad: Vec<f32>,
    scratch: Vec<f32>,
    /// With respect to the code.
    bar: Vec<f32>,
}

impl Room {
    /// The gradient of half the squared errors of the pixels `chosen`, times `share`, with respect to `code`: into
    /// [`Room::bar`].
    fn gradient(&mut self, driver: &RaySystem, kept: &Kept, chosen: &[usize], code: &[f32], share: f32) {
        let Self { columns, firsts, x, acts, rgb, rgb_bar, x_bar, grad, scratch, bar } = self;
        let field = &driver.field;
        let mlp = &field.colour;
        let (inputs, rows) = (mlp.inputs(), mlp.inputs() - code.len());
        columns.clear();
        firsts.clear();
        firsts.push(0);
        for &p in chosen {
            columns.extend(kept.offsets[p]..kept.offsets[p + 1]);
            firsts.push(columns.len() as u32);
        }
        let n = columns.len();
        let x = sized(x, inputs * n);
        for (j, &i) in columns.iter().enumerate() {
            for (k, value) in kept.input[i as usize * rows..][..rows].iter().enumerate() {
                x[k * n + j] = *value;
            }
        }
        for (k, value) in code.iter().enumerate() {
            x[(rows + k) * n..][..n].fill(*value);
        }
        let acts = sized(acts, mlp.activations_len(n));
        let rgb = sized(rgb, 3 * n);
        let rays = Columns::Rays(firsts);
        mlp.forward(field.simd, &field.colour_packed, x, n, rays, rgb, acts);
        let rgb_bar = sized(rgb_bar, 3 * n);
        let mut first = 0;
        for &p in chosen {
            let w = &kept.w[kept.offsets[p] as usize..kept.offsets[p + 1] as usize];
            for c in 0..3 {
                let value: f32 = rgb[c * n + first..].iter().zip(w).map(|(rgb, w)| rgb * w).sum();
                let derivative = (value - kept.rest[p][c]) * share;
                rgb_bar[c * n + first..].iter_mut().zip(w).for_each(|(bar, w)| *bar = derivative * w);
            }
            first += w.len();
        }
        let x_bar = sized(x_bar, inputs * n);
        x_bar.fill(0.0);
        let grad = sized(grad, mlp.packed_grad_len());
        grad.fill(0.0);
        let scratch = sized(scratch, mlp.backward_scratch_len());
        let out = Some(&mut *x_bar);
        mlp.backward(field.simd, &field.colour_packed, acts, rgb_bar, n, rays, out, grad, scratch);
        bar.clear();
        bar.extend((0..code.len()).map(|k| x_bar[(rows + k) * n..][..n].iter().sum::<f32>()));
    }
}

/// Samples that carry weight along every `every`-th ray; `None` where these are more than `most`.
fn keep(driver: &RaySystem, pixels: &Fit<'_>, dims: usize, every: usize, most: usize) -> Option<Kept> {
    let rays: Vec<_> = pixels.rays.iter().step_by(every).copied().collect();
    let truth: Vec<[f32; 3]> = pixels.rgb.iter().step_by(every).copied().collect();
    let inputs = driver.not_random(Batch::of_rays(&rays, &truth), pixels.background);
    let n = rays.len();
    let rows = driver.field.colour.inputs() - dims;
    // The codes of these rays are what is sought: any will do for where their samples lie.
    let blank = vec![0.0; dims];
    // All of them are of one view, the first, and its time is that of the photo.
    let time_steps = driver.field.time_steps_at(pixels.time);
    let ctx = StepContext {
        time_steps: &time_steps,
        appearance: Some(Codes { dims, rows: &blank }),
        transient: driver.photo_model.as_ref().and_then(|photo_model| photo_model.transient()),
        ..driver.context(&Plan::PICTURE, &inputs)
    };
    let mut kept = Kept { offsets: vec![0], ..Kept::default() };
    let mut chunk = Chunk::new(&driver.field, driver.head.as_ref());
    for first in (0..n).step_by(RAYS) {
        let span = first..(first + RAYS).min(n);
        chunk.sample(&ctx, span.clone());
        chunk.each_ray(&ctx, span, |pixel, ray| {
            for (i, &w) in ray.w.iter().enumerate().filter(|(_, w)| **w > FAINT) {
                kept.w.push(w);
                kept.input.extend((0..rows).map(|k| ray.input[k * ray.stride + ray.first + i]));
            }
            kept.offsets.push(kept.w.len() as u32);
            kept.rest.push([0, 1, 2].map(|c| inputs.truth[pixel][c] - ray.trans_end * pixels.background[c]));
        });
        if kept.w.len() > most && n > 1 {
            return None;
        }
    }
    Some(kept)
}
