//! A tile of training rays: all rounds forward, their losses, and all of it backwards.

use super::driver::{BACKGROUND, Chunk, MipNerf360, SAMPLES, Sums, Tile, fits};
use super::level::Level;
use super::network::Ops;
use super::quadrature::QuadratureOp;
use super::rounds::Rounds;
use crate::networks::placed;
use crate::space::InternalRay;
use engine::data::Batch;
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};
use float_core::Simd;
use losses::interlevel::{self, Levels, interlevel_backward};
use losses::kernel::Kernel;
use losses::{Edges, RayIntervals, Reduction, distortion};
use render_core::proposal::Resampler;

/// What a tile of training rays needs to know.
struct TrainTile<'a> {
    pixels: Pixels<'a>,
    rounds: Rounds<'a>,
}

/// The pixels of a tile's rays, and how they are judged.
pub(super) struct Pixels<'a> {
    pub(super) ops: &'a Ops<'a>,
    pub(super) batch: &'a Batch,
    /// Places of the rays in the batch.
    pub(super) ids: &'a [usize],
    /// `[rays][3]`
    pub(super) background: &'a [f32],
    /// One over the rays of the batch that count.
    pub(super) per_ray: f64,
    /// Whether the gradient goes on to what the network sees of the rays.
    pub(super) by_ray: bool,
}

/// What all tiles of a step share.
#[derive(Clone, Copy)]
pub(super) struct Pass {
    pub(super) step: u64,
    /// One over the rays of the batch that count.
    pub(super) per_ray: f64,
}

/// Work space of the rounds.
struct Scratch<'a> {
    resampler: &'a mut Resampler,
    interlevel: &'a mut interlevel::Scratch,
}

impl MipNerf360 {
    /// Forward and backward of one tile of training rays, whose places in the batch are `ids`.
    pub(super) fn train_tile(
        &self,
        ops: &Ops<'_>,
        pass: Pass,
        rays: &[InternalRay],
        ids: &[usize],
        chunk: &mut Chunk,
    ) -> Result<(), TapeError> {
        let Pass { step, per_ray } = pass;
        let behind = Rng::new(self.seed, BACKGROUND).substream(step);
        let Chunk { grad, tile, sums } = chunk;
        let Tile { levels, resampler, interlevel, background } = tile;
        background.clear();
        for &i in ids {
            background.extend(self.background.of_ray(&behind, i as u64));
        }
        let random = Rng::new(self.seed, SAMPLES).substream(step);
        let rounds = Rounds { rays, random: Some((random, ids)), fraction: self.config.step.fraction(step) };
        levels.resize_with(self.config.rounds.proposals + 1, Level::default);
        self.fill(&rounds, 0, None, resampler, &mut levels[0]);
        let pixels = Pixels { ops, batch: &self.batch, ids, background, per_ray, by_ray: false };
        let tile = TrainTile { pixels, rounds };
        self.round(&tile, levels, Scratch { resampler, interlevel }, sums, grad)
    }

    /// The round whose level is the first of `levels`, those behind it, and the way back.
    fn round(
        &self,
        tile: &TrainTile<'_>,
        levels: &mut [Level],
        mut scratch: Scratch<'_>,
        sums: &mut Sums,
        grad: &mut [f32],
    ) -> Result<(), TapeError> {
        let (level, behind) = levels.split_first_mut().expect("a level for each round");
        if behind.is_empty() {
            return self.final_round(&tile.pixels, level, sums, grad);
        }
        let n = level.dt.len();
        sums.samples += n as u64;
        // The tape's memory, while the next level is filled from this one.
        let mut arena = std::mem::take(&mut level.arena);
        {
            let last = self.config.rounds.last();
            let op = QuadratureOp { simd: Simd::best(), offsets: &level.offsets, dt: &level.dt, last, background: &[] };
            let mut tape = Tape::new(&mut arena, &self.trained.params);
            let x = tape.constant(level.x.len() / n, n, &level.x)?;
            let sigma = tile.pixels.ops.proposal(&mut tape, x)?;
            let out = tape.custom(&op, &[sigma])?;
            level.w.copy_from_slice(tape.value(out)?.data);
            let round = self.config.rounds.proposals - behind.len();
            self.fill(&tile.rounds, round + 1, Some(level), scratch.resampler, &mut behind[0]);
            let Scratch { resampler, interlevel } = &mut scratch;
            self.round(tile, behind, Scratch { resampler, interlevel }, sums, grad)?;

            let fine = behind.last().expect("the final level is behind every proposal");
            let levels = Levels {
                fine: RayIntervals { offsets: &fine.offsets, edges: Edges::Joined(&fine.s) },
                w: &fine.w,
                proposal: RayIntervals { offsets: &level.offsets, edges: Edges::Joined(&level.s) },
                w_proposal: &level.w,
            };
            // Over rays and final intervals.
            let factor =
                f64::from(self.config.loss.interlevel) * tile.pixels.per_ray / self.config.rounds.samples as f64;
            level.bar.clear();
            level.bar.resize(n, 0.0);
            let loss = interlevel::interlevel(levels, Reduction::Sum, scratch.interlevel);
            sums.loss += factor * fits(loss);
            fits(interlevel_backward(levels, Reduction::Sum, factor, &mut level.bar, scratch.interlevel));
            tape.backward(&[(out, &level.bar)], grad)?;
        }
        level.arena = arena;
        Ok(())
    }

    /// The final network: colours, the loss on them and on the weights.
    pub(super) fn final_round(
        &self,
        pixels: &Pixels<'_>,
        level: &mut Level,
        sums: &mut Sums,
        grad: &mut [f32],
    ) -> Result<(), TapeError> {
        let Level { arena, offsets, s, dt, w, x, d, bar, x_bar, d_bar, .. } = level;
        let Pixels { ops, batch, ids, background, per_ray, by_ray } = *pixels;
        let (n, rays) = (dt.len(), ids.len());
        sums.samples += n as u64;
        let last = self.config.rounds.last();
        let op = QuadratureOp { simd: Simd::best(), offsets, dt, last, background };
        let mut tape = Tape::new(arena, &self.trained.params);
        let (x, d) = (placed(&mut tape, by_ray, x.len() / n, n, x)?, placed(&mut tape, by_ray, 3, n, d)?);
        let (sigma, rgb) = ops.record(&mut tape, x, d)?;
        let out = tape.custom(&op, &[sigma, rgb])?;
        let values = tape.value(out)?.data;
        let colours = &values[..3 * rays];
        w.copy_from_slice(&values[3 * rays..]);

        bar.clear();
        bar.resize(3 * rays + n, 0.0);
        let (pixel_bar, w_bar) = bar.split_at_mut(3 * rays);
        let kernel = Kernel::Charbonnier { c: self.config.loss.charbonnier };
        for (r, &i) in ids.iter().enumerate() {
            let (alpha, weight) = (batch.alpha[i], f64::from(batch.weight[i]));
            for c in 0..3 {
                let truth = batch.rgb[i][c] * alpha + background[3 * r + c] * (1.0 - alpha);
                let value = colours[3 * r + c];
                let e = f64::from(value - truth);
                sums.loss += weight * f64::from(kernel.value(value, truth)) * per_ray / 3.0;
                sums.squared_error += weight * e * e * per_ray / 3.0;
                pixel_bar[3 * r + c] = (weight * f64::from(kernel.derivative(value, truth)) * per_ray / 3.0) as f32;
            }
        }
        if self.config.loss.distortion > 0.0 {
            let intervals = RayIntervals { offsets, edges: Edges::Joined(s) };
            let factor = f64::from(self.config.loss.distortion) * per_ray;
            sums.loss += factor * fits(distortion::distortion(intervals, w, Reduction::Sum));
            fits(distortion::distortion_backward(intervals, w, Reduction::Sum, factor, w_bar));
        }
        tape.backward(&[(out, bar)], grad)?;
        if by_ray {
            for (bar, seen) in [(x_bar, x), (d_bar, d)] {
                bar.clear();
                bar.extend_from_slice(tape.gradient(seen)?);
            }
        }
        Ok(())
    }
}
