//! The appearance of a photo that was not trained on: the code that explains some of its pixels best, the networks as they
//! are (NeRF in the Wild, section 5: the left half of a test photo).
//!
//! Geometry does not depend on the code, so samples are placed and weighed once. Nor does all that the colour's hidden layer
//! sees besides the code: its sum before the activation is kept for each sample. The code adds the same numbers to all of
//! these, so a step of the fit costs a few hundred operations a sample.

use super::chunk::TwoLevelOps;
use super::cones::TILE;
use super::network::Seen;
use super::recipe::Recipe;
use super::render::Condition;
use super::samples::{Level, Tile};
use super::two_level::{TwoLevel, recorded};
use crate::space::InternalRay;
use engine::system::{Appearance, Fit, System};
use field_core::mlp::{Activation, Layer, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use render_core::quadrature::{LastInterval, Samples, weights};
use render_core::ray::Ray;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Pixels the fit knows of, and those of one of its steps.
const PIXELS: usize = 1 << 13;
const BATCH: usize = 1 << 10;
/// Samples that bring less than this to their pixel are left out, colour units.
const FAINT: f32 = 1e-3;
/// Stream of the pixels of each step.
const FITTED: u64 = 0x6669_7474;

/// The network of the colour, cut behind its hidden layer's sum.
struct Cut<'a> {
    /// The hidden layer without its activation.
    first: Mlp,
    packed: Packed,
    hidden: &'a Layer,
    last: &'a Layer,
    /// Parameters of the whole network of the colour.
    params: &'a [f32],
}

impl<'a> Cut<'a> {
    fn new(colour: &'a Mlp, params: &'a [f32]) -> Option<Self> {
        let [hidden, last] = colour.layers() else { return None };
        let first =
            Mlp::new(&MlpConfig::new(hidden.inputs, vec![], hidden.outputs).with_hidden_activation(Activation::None))
                .ok()?;
        let mut packed = Packed::default();
        first.pack(&params[hidden.weights.start..hidden.biases.end], &mut packed);
        Some(Self { first, packed, hidden, last, params })
    }

    /// Weights of hidden unit `h` for a code of `dims`, which comes last.
    fn of_code(&self, h: usize, dims: usize) -> &[f32] {
        let row = &self.params[self.hidden.weights.clone()][h * self.hidden.inputs..][..self.hidden.inputs];
        &row[self.hidden.inputs - dims..]
    }
}

/// The samples of some pixels that carry weight.
#[derive(Default)]
struct FittedSamples {
    /// Samples of each pixel.
    counts: Vec<usize>,
    /// `[n]`, weights.
    w: Vec<f32>,
    /// `[n][hidden]`: sums of the hidden layer for the code 0.
    hidden: Vec<f32>,
    /// `[pixels][3]`: the truth less what is behind the samples.
    rest: Vec<[f32; 3]>,
}

/// See [`System::fit_appearance`].
pub(super) fn fit<R: Recipe>(system: &TwoLevel<R>, pixels: &Fit<'_>) -> Option<Vec<f32>> {
    let mut code = system.appearance_code(&Appearance::Mean)?;
    let (colour, range) = system.shapes.colour();
    let cut = Cut::new(colour, &system.network(1)[range])?;
    let kept =
        pixels.keep(PIXELS, cut.hidden.outputs + 1, |every, most| keep(system, &cut, pixels, code.len(), every, most));
    let count = kept.rest.len();
    if count == 0 {
        return Some(code);
    }
    let mut starts = vec![0];
    starts.extend(kept.counts.iter().scan(0, |at, n| {
        *at += n;
        Some(*at)
    }));
    let units = cut.hidden.outputs;
    let mut adam = Adam::new(code.len(), AdamConfig::DEFAULT);
    let rng = Rng::new(pixels.seed, FITTED);
    let (mut active, mut colours) = (Vec::new(), Vec::new());
    for step in 0..pixels.steps {
        if pixels.halt.raised() {
            break;
        }
        let draw = rng.substream(step);
        let chosen: Vec<usize> = match count <= BATCH {
            true => (0..count).collect(),
            false => (0..BATCH as u64).map(|i| (draw.u64_at(i) % count as u64) as usize).collect(),
        };
        let shift: Vec<f32> =
            (0..units).map(|h| cut.of_code(h, code.len()).iter().zip(&code).map(|(w, x)| w * x).sum()).collect();
        let mut shift_bar = vec![0.0; units];
        for &p in &chosen {
            let span = starts[p]..starts[p + 1];
            let (w, hidden) = (&kept.w[span.clone()], &kept.hidden[span.start * units..span.end * units]);
            let value = cut.forward(w, hidden, &shift, &mut active, &mut colours);
            // Half the mean squared error.
            let value_bar = [0, 1, 2].map(|c| (value[c] - kept.rest[p][c]) / (3 * chosen.len()) as f32);
            cut.backward(w, value_bar, &active, &colours, &mut shift_bar);
        }
        let mut bar = vec![0.0; code.len()];
        for (h, shift_bar) in shift_bar.iter().enumerate() {
            for (bar, w) in bar.iter_mut().zip(cut.of_code(h, code.len())) {
                *bar += shift_bar * w;
            }
        }
        let third = (3 * step / pixels.steps.max(1)) as i32;
        // Entries that are not finite stay as they are.
        let _ = adam.step(Simd::best(), pixels.lr * 0.1_f64.powi(third), &mut code, &bar);
    }
    Some(code)
}

impl Cut<'_> {
    /// Sum of the colours of a pixel's samples times their weights. `active` `[n][hidden]` and `colours` `[n][3]` are for
    /// the way back.
    fn forward(
        &self,
        w: &[f32],
        hidden: &[f32],
        shift: &[f32],
        active: &mut Vec<f32>,
        colours: &mut Vec<[f32; 3]>,
    ) -> [f32; 3] {
        let units = shift.len();
        let (weights, biases) = (&self.params[self.last.weights.clone()], &self.params[self.last.biases.clone()]);
        active.clear();
        colours.clear();
        let mut value = [0.0; 3];
        for (w, hidden) in w.iter().zip(hidden.chunks_exact(units)) {
            let at = active.len();
            active.extend(hidden.iter().zip(shift).map(|(x, shift)| (x + shift).max(0.0)));
            let rgb = [0, 1, 2].map(|c| {
                let row = &weights[c * units..(c + 1) * units];
                let sum: f32 = active[at..].iter().zip(row).map(|(a, w)| a * w).sum();
                self.last.activation.value(sum + biases[c])
            });
            colours.push(rgb);
            for (value, rgb) in value.iter_mut().zip(rgb) {
                *value += w * rgb;
            }
        }
        value
    }

    /// Add the gradient of the sums of the hidden layer, which is that of what the code adds to them.
    fn backward(&self, w: &[f32], value_bar: [f32; 3], active: &[f32], colours: &[[f32; 3]], shift_bar: &mut [f32]) {
        let units = shift_bar.len();
        let weights = &self.params[self.last.weights.clone()];
        for ((w, rgb), active) in w.iter().zip(colours).zip(active.chunks_exact(units)) {
            let bar = [0, 1, 2].map(|c| value_bar[c] * w * self.last.activation.derivative_from_output(rgb[c]));
            for (h, (sum, a)) in shift_bar.iter_mut().zip(active).enumerate() {
                let through = bar[0] * weights[h] + bar[1] * weights[units + h] + bar[2] * weights[2 * units + h];
                *sum += if *a > 0.0 { through } else { 0.0 };
            }
        }
    }
}

/// Samples that carry weight along every `every`-th ray; `None` where these are more than `most` and of more than one tile.
fn keep<R: Recipe>(
    system: &TwoLevel<R>,
    cut: &Cut<'_>,
    pixels: &Fit<'_>,
    dims: usize,
    every: usize,
    most: usize,
) -> Option<FittedSamples> {
    let chosen: Vec<(&Ray, [f32; 3])> = pixels.rays.iter().zip(pixels.rgb.iter().copied()).step_by(every).collect();
    let ops = system.ops();
    // Whichever tile sees that they are too many, all of them are thrown away.
    let total = AtomicUsize::new(0);
    let too_many = || chosen.len() > TILE && total.load(Ordering::Relaxed) > most;
    let parts: Vec<FittedSamples> = chosen
        .par_chunks(TILE)
        .map_init(Tile::default, |tile, chosen| {
            let rays = chosen.iter().map(|(ray, _)| system.space.internal_ray(ray));
            let (rays, truth): (Vec<InternalRay>, Vec<[f32; 3]>) =
                rays.zip(chosen.iter().map(|c| c.1)).filter(|(ray, _)| ray.end > ray.start).unzip();
            let mut kept = FittedSamples::default();
            let pixels_of_tile = TilePixels { rays: &rays, truth: &truth, background: pixels.background };
            if !rays.is_empty() && !too_many() {
                recorded(keep_tile(system, &ops, cut, &pixels_of_tile, dims, tile, &mut kept));
            }
            total.fetch_add(kept.w.len(), Ordering::Relaxed);
            kept
        })
        .collect();
    if too_many() {
        return None;
    }
    let mut all = FittedSamples::default();
    for part in parts {
        all.counts.extend(part.counts);
        all.w.extend(part.w);
        all.hidden.extend(part.hidden);
        all.rest.extend(part.rest);
    }
    Some(all)
}

/// Pixels of a tile that a code is fitted to.
struct TilePixels<'a> {
    rays: &'a [InternalRay],
    truth: &'a [[f32; 3]],
    background: [f32; 3],
}

/// Add the samples of a tile that carry weight.
fn keep_tile<R: Recipe>(
    system: &TwoLevel<R>,
    ops: &TwoLevelOps<'_, R::Position>,
    cut: &Cut<'_>,
    pixels: &TilePixels<'_>,
    dims: usize,
    tile: &mut Tile,
    kept: &mut FittedSamples,
) -> Result<(), TapeError> {
    let TilePixels { rays, truth, background } = *pixels;
    // The code of these rays is what is sought: 0 adds nothing to the sums.
    let blank = vec![0.0; dims];
    system.place_samples(ops, rays, Condition { code: &blank, time: 0.0 }, tile)?;
    let Level { arena, offsets, dt, x, d, .. } = &mut tile.fine;
    let (n, units) = (dt.len(), cut.hidden.outputs);
    let mut tape = Tape::new(arena, system.network(1));
    let seen = Seen {
        x: tape.constant(x.len() / n.max(1), n, x)?,
        d: tape.constant(3, n, d)?,
        when: None,
        code: Some(tape.fill(dims, n, 0.0)),
    };
    let out = ops.levels[1].record(&mut tape, seen)?;
    let raw = tape.value(out.raw_density)?.data;
    let tau: Vec<f32> = raw.iter().zip(&*dt).map(|(&raw, dt)| system.config.density_of(raw) * dt).collect();
    let samples = Samples { offsets, tau: &tau, last: LastInterval::Finite };
    let (mut w, mut trans_end) = (vec![0.0; n], vec![0.0; rays.len()]);
    weights(Simd::best(), samples, &mut w, &mut trans_end);
    let mut hidden = vec![0.0; units * n];
    let mut scratch = vec![0.0; cut.first.infer_scratch_len()];
    let input = tape.value(out.colour_input)?.data;
    cut.first.infer(Simd::best(), &cut.packed, input, n, n, &mut hidden, n, &mut scratch);
    for (r, (truth, trans_end)) in truth.iter().zip(&trans_end).enumerate() {
        let before = kept.w.len();
        for i in (offsets[r] as usize..offsets[r + 1] as usize).filter(|&i| w[i] > FAINT) {
            kept.w.push(w[i]);
            kept.hidden.extend((0..units).map(|h| hidden[h * n + i]));
        }
        kept.counts.push(kept.w.len() - before);
        kept.rest.push([0, 1, 2].map(|c| truth[c] - trans_end * background[c]));
    }
    Ok(())
}
