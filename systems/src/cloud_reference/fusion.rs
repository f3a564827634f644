//! The network that fuses what a Gaussian is with what it reads of a photo:
//!
//! ```text
//! (b, g) = f(c_i, s_i, F_1(x_i1), .., F_m(x_im), e, d)           its colour from all around, its own numbers, features, the photo
//! c'_i = (1 + s g) c_i(d) + s b                                  its colour in the appearance; s is `tone_scale`
//! ```
//!
//! Features of maps stand beside each other, or are added up: [`Joined`]. The direction `d` that a Gaussian is seen along is there where that
//! is asked for; its centre has no gradient from there.

use super::reading::{Joined, Reading};
use super::sampling::Tap;
use crate::buffers::sized;
use crate::fields::RowNetwork;
use crate::views::{DrawnCloud, PlaceCodes};
use float_core::Simd;
use rayon::prelude::*;

/// Gaussians per task.
const CHUNK: usize = 1024;
/// Summands and factors of three channels.
pub(crate) const OUTPUTS: usize = 6;
/// What a Gaussian is: its colour from all around and its own numbers.
pub(crate) const OWN: usize = 3 + PlaceCodes::ROWS;

/// Numbers of a direction.
pub(crate) const DIRECTION: usize = 3;

/// Summands, then factors.
pub(crate) type ToneOf = [f32; OUTPUTS];

/// A colour in a tone.
pub(crate) fn toned(rgb: [f32; 3], tone: &ToneOf, scale: f32) -> [f32; 3] {
    [0, 1, 2].map(|c| (1.0 + scale * tone[3 + c]) * rgb[c] + scale * tone[c])
}

/// Reads Gaussians in one appearance.
pub(crate) struct Reader<'a> {
    /// `tone_scale`.
    pub(crate) scale: f32,
    /// Ready for its kernels.
    pub(crate) network: &'a RowNetwork,
    pub(crate) reading: Reading<'a>,
    /// Whether it sees the direction of a Gaussian from `eye`; 0 where there is none.
    pub(crate) directed: bool,
    pub(crate) eye: Option<[f32; 3]>,
    pub(crate) simd: Simd,
}

/// Buffers of a chunk.
#[derive(Default)]
struct Scratch {
    x: Vec<f32>,
    y: Vec<f32>,
    y_bar: Vec<f32>,
    acts: Vec<f32>,
    scratch: Vec<f32>,
}

/// What one chunk of Gaussians brings.
pub(crate) struct ChunkBars {
    n: usize,
    /// `[inputs][n]`, with respect to what the network saw.
    inputs: Vec<f32>,
    /// With respect to the network's parameters, in the order of its kernels.
    pub(crate) network: Vec<f32>,
    /// `[n][maps]`, where maps were read.
    taps: Vec<Option<Tap>>,
    /// `[n][maps whose coordinates are learnt]`, with respect to these.
    coordinates: Vec<[f32; 2]>,
}

impl ChunkBars {
    /// Gradients of the three colours from all around, and of a Gaussian's own numbers: rows `[n]`.
    fn own(&self) -> (&[f32], &[f32]) {
        self.inputs[..OWN * self.n].split_at(3 * self.n)
    }
}

impl Reader<'_> {
    /// Numbers that the network sees of a Gaussian.
    fn input_count(&self) -> usize {
        OWN + self.reading.features() + self.reading.whole.len() + if self.directed { DIRECTION } else { 0 }
    }

    /// Which row of the features channel `c` of a map adds to.
    fn feature(&self, map: usize, c: usize) -> usize {
        match self.reading.joined {
            Joined::Beside => map * self.reading.texels.channels() + c,
            Joined::Sum => c,
        }
    }

    /// What the network sees of Gaussians `rows`, written to `x` `[inputs][n]`; where they read the maps.
    fn inputs(&self, cloud: &DrawnCloud<'_>, rows: &[u32], x: &mut [f32]) -> Vec<Option<Tap>> {
        let Reading { texels, places, code, whole, .. } = &self.reading;
        let (n, all, maps) = (rows.len(), cloud.gaussians.len(), texels.maps());
        let own = cloud.gaussians.dc.chunks_exact(all.max(1)).take(3);
        let own = own.chain(cloud.extra.chunks_exact(all.max(1)).take(PlaceCodes::ROWS));
        let (of_own, rest) = x.split_at_mut(OWN * n);
        for (row, out) in own.zip(of_own.chunks_exact_mut(n.max(1))) {
            out.iter_mut().zip(rows).for_each(|(x, i)| *x = row[*i as usize]);
        }
        let (of_maps, of_whole) = rest.split_at_mut(self.reading.features() * n);
        of_maps.fill(0.0);
        let mut taps = Vec::with_capacity(maps * n);
        for (k, &i) in rows.iter().enumerate() {
            for map in 0..maps {
                let tap = places.tap(cloud, i as usize, map, texels.side());
                if let Some(tap) = &tap {
                    texels.sample(map, tap, |c, value| of_maps[self.feature(map, c) * n + k] += value);
                }
                taps.push(tap);
            }
        }
        let (of_whole, of_direction) = of_whole.split_at_mut(whole.len() * n);
        for (out, x) in of_whole.chunks_exact_mut(n.max(1)).zip(&code[whole.clone()]) {
            out.fill(*x);
        }
        if self.directed {
            for (k, &i) in rows.iter().enumerate() {
                let d = self.eye.map_or([0.0; DIRECTION], |eye| direction(eye, cloud, i as usize));
                (0..DIRECTION).for_each(|axis| of_direction[axis * n + k] = d[axis]);
            }
        }
        taps
    }

    /// Tones of Gaussians `rows` of a cloud.
    pub(crate) fn tones(&self, cloud: &DrawnCloud<'_>, rows: &[u32]) -> Vec<ToneOf> {
        let mut out = vec![[0.0; OUTPUTS]; rows.len()];
        let chunks = rows.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK));
        chunks.for_each_init(Scratch::default, |scratch, (rows, out)| {
            let n = rows.len();
            let Scratch { x, y, scratch, .. } = scratch;
            let x = sized(x, self.input_count() * n);
            self.inputs(cloud, rows, x);
            let (y, scratch) = (sized(y, OUTPUTS * n), sized(scratch, self.network.infer_scratch_len()));
            self.network.infer(self.simd, x, n, y, scratch);
            for (i, tone) in out.iter_mut().enumerate() {
                *tone = std::array::from_fn(|c| y[c * n + i]);
            }
        });
        out
    }

    /// Backward twin of [`toned`] with [`tones`](Self::tones), of colours `rgb` `[rows]`; `bar` becomes the gradient with respect to
    /// `rgb`.
    pub(crate) fn backward(
        &self,
        cloud: &DrawnCloud<'_>,
        rows: &[u32],
        rgb: &[[f32; 3]],
        bar: &mut [[f32; 3]],
    ) -> Vec<ChunkBars> {
        let chunks = rows.par_chunks(CHUNK).zip(rgb.par_chunks(CHUNK)).zip(bar.par_chunks_mut(CHUNK));
        chunks
            .map_init(Scratch::default, |scratch, ((rows, rgb), bar)| {
                self.chunk_backward(cloud, rows, rgb, bar, scratch)
            })
            .collect()
    }

    fn chunk_backward(
        &self,
        cloud: &DrawnCloud<'_>,
        rows: &[u32],
        rgb: &[[f32; 3]],
        bar: &mut [[f32; 3]],
        scratch: &mut Scratch,
    ) -> ChunkBars {
        let (n, scale) = (rows.len(), self.scale);
        let Scratch { x, y, y_bar, acts, scratch } = scratch;
        let x = sized(x, self.input_count() * n);
        let taps = self.inputs(cloud, rows, x);
        let (y, y_bar) = (sized(y, OUTPUTS * n), sized(y_bar, OUTPUTS * n));
        let acts = self.network.forward(self.simd, x, n, y, acts);
        for (i, (rgb, bar)) in rgb.iter().zip(bar).enumerate() {
            for c in 0..3 {
                y_bar[c * n + i] = scale * bar[c];
                y_bar[(3 + c) * n + i] = scale * rgb[c] * bar[c];
                bar[c] *= 1.0 + scale * y[(3 + c) * n + i];
            }
        }
        let mut inputs = vec![0.0; self.input_count() * n];
        let network = self.network.backward(self.simd, acts, y_bar, n, &mut inputs, scratch);
        let (maps, of_maps) = (self.reading.texels.maps(), &inputs[OWN * n..]);
        let learnt: Vec<bool> = (0..maps).map(|map| self.reading.places.learnt_rows(map).is_some()).collect();
        let coordinates = taps
            .iter()
            .enumerate()
            .filter(|(at, _)| learnt[at % maps])
            .map(|(at, tap)| {
                let (i, map) = (at / maps, at % maps);
                let bar = |c: usize| of_maps[self.feature(map, c) * n + i];
                tap.as_ref().map_or([0.0; 2], |tap| self.reading.texels.coordinates_bar(map, tap, bar))
            })
            .collect();
        ChunkBars { n, inputs, network, taps, coordinates }
    }

    /// Add what chunks say of Gaussians to the gradients of a cloud: `rows` of coefficients of degree 0, and of the extra rows.
    pub(crate) fn add_own(
        &self,
        all: usize,
        rows: &[u32],
        chunks: &[ChunkBars],
        base: &mut [[f32; 3]],
        extra: &mut [f32],
    ) {
        let maps = 0..self.reading.texels.maps();
        let learnt: Vec<usize> = maps.filter_map(|map| self.reading.places.learnt_rows(map)).collect();
        let mut rest = (rows, base);
        for chunk in chunks {
            let (of_base, of_codes) = chunk.own();
            let n = chunk.n;
            let (rows, base) = (&rest.0[..n], &mut rest.1[..n]);
            for (i, base) in base.iter_mut().enumerate() {
                *base = [0, 1, 2].map(|c| base[c] + of_base[c * n + i]);
            }
            for (row, bars) in of_codes.chunks_exact(n.max(1)).enumerate() {
                rows.iter().zip(bars).for_each(|(i, bar)| extra[row * all + *i as usize] += bar);
            }
            for (at, bar) in chunk.coordinates.iter().enumerate() {
                let (i, row) = (rows[at / learnt.len()] as usize, learnt[at % learnt.len()]);
                (0..2).for_each(|k| extra[(row + k) * all + i] += bar[k]);
            }
            rest = (&rest.0[n..], &mut std::mem::take(&mut rest.1)[n..]);
        }
    }

    /// The gradient with respect to the code: each channel of a map of its own, Gaussian after Gaussian.
    pub(crate) fn code_bar(&self, chunks: &[ChunkBars]) -> Vec<f32> {
        let Reading { code, texels, whole, .. } = &self.reading;
        let (maps, channels) = (texels.maps(), texels.channels());
        let mut out = vec![0.0; code.len()];
        let pixels = texels.side() * texels.side();
        out[..texels.len()].par_chunks_exact_mut(pixels).enumerate().for_each(|(plane, out)| {
            let (map, feature) = (plane / channels, self.feature(plane / channels, plane % channels));
            for chunk in chunks {
                let bars = &chunk.inputs[(OWN + feature) * chunk.n..][..chunk.n];
                let taps = chunk.taps.iter().skip(map).step_by(maps);
                for (tap, bar) in taps.zip(bars) {
                    if let Some(tap) = tap {
                        (0..4).for_each(|k| out[tap.at[k] as usize] += tap.shares[k] * bar);
                    }
                }
            }
        });
        let first = OWN + self.reading.features();
        for (k, sum) in out[whole.clone()].iter_mut().enumerate() {
            *sum =
                chunks.iter().map(|chunk| chunk.inputs[(first + k) * chunk.n..][..chunk.n].iter().sum::<f32>()).sum();
        }
        out
    }
}

/// The unit vector from `eye` to Gaussian `i`; 0 where it is there, or no number.
fn direction(eye: [f32; 3], cloud: &DrawnCloud<'_>, i: usize) -> [f32; DIRECTION] {
    let n = cloud.gaussians.len();
    let d = [0, 1, 2].map(|k| cloud.gaussians.mean[k * n + i] - eye[k]);
    let length = d.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length > 0.0 && length.is_finite() { d.map(|x| x / length) } else { [0.0; DIRECTION] }
}
