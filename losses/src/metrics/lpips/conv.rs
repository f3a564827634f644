//! Convolution with ReLU: a matrix product over panels of pixels.
//!
//! `out[o][p] = max(0, bias[o] + sum_k weight[o][k] * panel[k][p])`, where column `p` of the panel holds the inputs that
//! output pixel `p` sees (im2col). Pixels are cut into fixed tiles, so that a panel stays in the L2 cache and tiles can go
//! to threads; every output is summed in the order of `k`, whatever the tile, so the bits depend on the SIMD level only.

use super::weights::LpipsTensor;
use alloc::{vec, vec::Vec};
use float_core::{Simd, Task, Vector};

/// Activations `[channel][row][column]`.
#[derive(Clone, Debug)]
pub(super) struct Features {
    pub(super) channels: usize,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<f32>,
}

/// Output channels worked on together: with [`WIDE`] vectors each they fill half the registers of AVX2.
const ROWS: usize = 4;
/// Vectors of pixels worked on together.
const WIDE: usize = 2;
/// Pixels of a tile, a multiple of every strip (`WIDE` vectors).
const TILE: usize = 192;
/// Marks a tap outside the image.
const OUTSIDE: usize = usize::MAX;

/// A convolution with equal padding on all sides, followed by ReLU.
#[derive(Clone, Debug)]
pub(super) struct Conv {
    inputs: usize,
    outputs: usize,
    /// Taps are `side` x `side`.
    side: usize,
    stride: usize,
    pad: usize,
    /// `[outputs / ROWS][k][ROWS]`, filled up with zeros.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Conv {
    /// `weight` is `[outputs, inputs, side, side]`, `bias` `[outputs]`.
    pub(super) fn new(weight: &LpipsTensor<'_>, bias: &LpipsTensor<'_>, stride: usize, pad: usize) -> Self {
        let [outputs, inputs, side] = [weight.shape[0], weight.shape[1], weight.shape[2]];
        let depth = inputs * side * side;
        let mut packed = vec![0.0; outputs.div_ceil(ROWS) * ROWS * depth];
        for (o, row) in weight.data.chunks_exact(depth).enumerate() {
            for (k, &w) in row.iter().enumerate() {
                packed[(o / ROWS * depth + k) * ROWS + o % ROWS] = w;
            }
        }
        Self { inputs, outputs, side, stride, pad, weight: packed, bias: bias.data.to_vec() }
    }

    pub(super) fn outputs(&self) -> usize {
        self.outputs
    }

    fn depth(&self) -> usize {
        self.inputs * self.side * self.side
    }

    /// Size of the output along an axis of `n` pixels.
    fn out_size(&self, n: usize) -> usize {
        (n + 2 * self.pad - self.side) / self.stride + 1
    }

    pub(super) fn run(&self, simd: Simd, x: &Features) -> Features {
        let (width, height) = (self.out_size(x.width), self.out_size(x.height));
        let mut data = vec![0.0; self.outputs * width * height];
        self.run_into(simd, x, &mut data);
        Features { channels: self.outputs, width, height, data }
    }

    /// Writes `[outputs][pixels]`.
    pub(super) fn run_into(&self, simd: Simd, x: &Features, out: &mut [f32]) {
        debug_assert_eq!(x.channels, self.inputs, "channels of the input");
        let pixels = self.out_size(x.width) * self.out_size(x.height);
        debug_assert_eq!(out.len(), self.outputs * pixels, "length of the output");
        // Tile by tile, the piece of every output channel.
        let mut tiles: Vec<Vec<&mut [f32]>> =
            (0..pixels.div_ceil(TILE)).map(|_| Vec::with_capacity(self.outputs)).collect();
        for plane in out.chunks_exact_mut(pixels) {
            for (tile, piece) in tiles.iter_mut().zip(plane.chunks_mut(TILE)) {
                tile.push(piece);
            }
        }
        let work = |scratch: &mut Scratch, (i, out): (usize, Vec<&mut [f32]>)| {
            simd.run(Tile { conv: self, x, first: i * TILE, out, scratch });
        };
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            tiles.into_par_iter().enumerate().for_each_init(Scratch::default, work);
        }
        #[cfg(not(feature = "rayon"))]
        {
            let mut scratch = Scratch::default();
            tiles.into_iter().enumerate().for_each(|tile| work(&mut scratch, tile));
        }
    }
}

/// Buffers of a tile, kept from one to the next.
#[derive(Default)]
struct Scratch {
    /// `[strip][k][strip pixels]`.
    panel: Vec<f32>,
    /// Index of each tap of each pixel into a plane: `[tap][TILE]`.
    source: Vec<usize>,
}

/// Pixels `first .. first + out[0].len()` of all output channels.
struct Tile<'a, 'o> {
    conv: &'a Conv,
    x: &'a Features,
    first: usize,
    out: Vec<&'o mut [f32]>,
    scratch: &'a mut Scratch,
}

impl Task for Tile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let strip = WIDE * V::LANES;
        let depth = self.conv.depth();
        let pixels = self.out[0].len();
        self.fill_panel(strip, pixels);
        for (group, rows) in self.out.chunks_mut(ROWS).enumerate() {
            let weight = &self.conv.weight[group * ROWS * depth..][..ROWS * depth];
            let mut bias = [0.0; ROWS];
            bias[..rows.len()].copy_from_slice(&self.conv.bias[group * ROWS..][..rows.len()]);
            for (i, panel) in self.scratch.panel.chunks_exact(strip * depth).enumerate() {
                let sums = block::<V>(weight, panel, &bias);
                let start = i * strip;
                let count = (pixels - start).min(strip);
                for (row, sums) in rows.iter_mut().zip(sums) {
                    store(sums, &mut row[start..start + count]);
                }
            }
        }
    }
}

impl Tile<'_, '_> {
    /// Gather what each pixel sees; the last strip is filled up with zeros.
    #[inline(always)]
    fn fill_panel(&mut self, strip: usize, pixels: usize) {
        let (conv, x) = (self.conv, self.x);
        let depth = conv.depth();
        let taps = conv.side * conv.side;
        let Scratch { panel, source } = &mut *self.scratch;
        // Every number is written below.
        panel.resize(pixels.div_ceil(strip) * strip * depth, 0.0);
        source.resize(taps * TILE, OUTSIDE);
        let out_width = conv.out_size(x.width);
        for (tap, source) in source.chunks_exact_mut(TILE).enumerate() {
            let (dy, dx) = (tap / conv.side, tap % conv.side);
            let (mut row, mut column) = (self.first / out_width, self.first % out_width);
            source[pixels..].fill(OUTSIDE);
            for source in &mut source[..pixels] {
                let (y, x_at) = (row * conv.stride + dy, column * conv.stride + dx);
                let inside = |at: usize, n: usize| (conv.pad..n + conv.pad).contains(&at);
                *source = if inside(y, x.height) && inside(x_at, x.width) {
                    (y - conv.pad) * x.width + x_at - conv.pad
                } else {
                    OUTSIDE
                };
                column += 1;
                if column == out_width {
                    (row, column) = (row + 1, 0);
                }
            }
        }
        let plane_len = x.width * x.height;
        for (i, panel) in panel.chunks_exact_mut(strip * depth).enumerate() {
            for (k, to) in panel.chunks_exact_mut(strip).enumerate() {
                let plane = &x.data[k / taps * plane_len..][..plane_len];
                let source = &source[k % taps * TILE + i * strip..][..strip];
                for (to, &source) in to.iter_mut().zip(source) {
                    *to = plane.get(source).copied().unwrap_or(0.0);
                }
            }
        }
    }
}

/// `ROWS` output channels of one strip, before ReLU. `weight` is `[k][ROWS]`, `panel` `[k][strip]`.
#[inline(always)]
fn block<V: Vector>(weight: &[f32], panel: &[f32], bias: &[f32; ROWS]) -> [[V; WIDE]; ROWS] {
    let mut sums = bias.map(|b| [V::splat(b); WIDE]);
    for (w, x) in weight.chunks_exact(ROWS).zip(panel.chunks_exact(WIDE * V::LANES)) {
        let x = [V::load(x), V::load(&x[V::LANES..])];
        for (sums, &w) in sums.iter_mut().zip(w) {
            let w = V::splat(w);
            for (sum, x) in sums.iter_mut().zip(x) {
                *sum = w.mul_add(x, *sum);
            }
        }
    }
    sums
}

/// ReLU, and write as many as there is room for.
#[inline(always)]
fn store<V: Vector>(sums: [V; WIDE], out: &mut [f32]) {
    for (sum, out) in sums.into_iter().zip(out.chunks_mut(V::LANES)) {
        let sum = sum.max(V::splat(0.0));
        if out.len() == V::LANES {
            sum.store(out);
        } else {
            // 16 lanes is the widest there is.
            let mut lanes = [0.0; 16];
            sum.store(&mut lanes);
            out.copy_from_slice(&lanes[..out.len()]);
        }
    }
}
