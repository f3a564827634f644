//! The network that fuses what a Gaussian is with what it reads in the maps of a photo:
//!
//! ```text
//! (b, g) = f(c_i, s_i, F^P(P_j p_i), F^1(x_i^1), .., F^K(x_i^K))     its colour from all around, its own numbers, features
//! c'_i = (1 + s g) c_i(d) + s b                                      its colour in the appearance; s is `tone_scale`
//! ```

use super::reference::Code;
use super::sampling::{Tap, Texels};
use super::settings::MapSettings;
use crate::buffers::sized;
use crate::fields::RowNetwork;
use crate::views::{DrawnCloud, PlaceCodes};
use float_core::Simd;
use rayon::prelude::*;

/// Gaussians per task.
const CHUNK: usize = 1024;
/// Summands and factors of three channels.
pub(super) const OUTPUTS: usize = 6;
/// What a Gaussian is: its colour from all around and its own numbers.
const OWN: usize = 3 + PlaceCodes::ROWS;

/// Summands, then factors.
pub(super) type ToneOf = [f32; OUTPUTS];

/// Numbers that the network sees of a Gaussian.
pub(super) fn inputs(settings: &MapSettings) -> usize {
    OWN + settings.maps() * settings.map_channels
}

/// A colour in a tone.
pub(super) fn toned(rgb: [f32; 3], tone: &ToneOf, scale: f32) -> [f32; 3] {
    [0, 1, 2].map(|c| (1.0 + scale * tone[3 + c]) * rgb[c] + scale * tone[c])
}

/// Reads Gaussians in one appearance.
pub(super) struct Reader<'a> {
    pub(super) settings: &'a MapSettings,
    /// Ready for its kernels.
    pub(super) network: &'a RowNetwork,
    pub(super) texels: Texels,
    pub(super) code: Code<'a>,
    pub(super) simd: Simd,
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
pub(super) struct ChunkBars {
    /// `[inputs][n]`, with respect to what the network saw.
    pub(super) inputs: Vec<f32>,
    /// With respect to the network's parameters, in the order of its kernels.
    pub(super) network: Vec<f32>,
    /// `[n][maps]`, where maps were read.
    taps: Vec<Option<Tap>>,
    /// `[n][sampled maps]`, with respect to the coordinates.
    pub(super) coordinates: Vec<[f32; 2]>,
}

impl ChunkBars {
    /// Gradients of the three colours from all around, and of a Gaussian's own numbers: rows `[n]`.
    pub(super) fn own(&self) -> (&[f32], &[f32]) {
        // Each has one tap more than it has coordinates.
        let n = self.taps.len() - self.coordinates.len();
        self.inputs[..OWN * n].split_at(3 * n)
    }
}

impl Reader<'_> {
    /// What the network sees of Gaussians `rows`, written to `x` `[inputs][n]`; where they read the maps.
    fn inputs(&self, cloud: &DrawnCloud<'_>, rows: &[u32], x: &mut [f32]) -> Vec<Option<Tap>> {
        let (n, all, maps) = (rows.len(), cloud.gaussians.len(), self.settings.maps());
        let channels = self.texels.channels();
        let own = cloud.gaussians.dc.chunks_exact(all.max(1)).take(3);
        let own = own.chain(cloud.extra.chunks_exact(all.max(1)).take(PlaceCodes::ROWS));
        let (of_own, of_maps) = x.split_at_mut(OWN * n);
        for (row, out) in own.zip(of_own.chunks_exact_mut(n.max(1))) {
            out.iter_mut().zip(rows).for_each(|(x, i)| *x = row[*i as usize]);
        }
        let mut taps = Vec::with_capacity(maps * n);
        for (k, &i) in rows.iter().enumerate() {
            let own = self.texels.taps(&self.code.camera, cloud, PlaceCodes::ROWS, i as usize);
            for (map, tap) in own.enumerate() {
                let mut put = |c: usize, value: f32| of_maps[(map * channels + c) * n + k] = value;
                match &tap {
                    Some(tap) => self.texels.sample(map, tap, put),
                    None => (0..channels).for_each(|c| put(c, 0.0)),
                }
                taps.push(tap);
            }
        }
        taps
    }

    /// Tones of Gaussians `rows` of a cloud.
    pub(super) fn tones(&self, cloud: &DrawnCloud<'_>, rows: &[u32]) -> Vec<ToneOf> {
        let mut out = vec![[0.0; OUTPUTS]; rows.len()];
        let chunks = rows.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK));
        chunks.for_each_init(Scratch::default, |scratch, (rows, out)| {
            let n = rows.len();
            let Scratch { x, y, scratch, .. } = scratch;
            let x = sized(x, inputs(self.settings) * n);
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
    pub(super) fn backward(
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
        let (n, scale) = (rows.len(), self.settings.tone_scale);
        let Scratch { x, y, y_bar, acts, scratch } = scratch;
        let x = sized(x, inputs(self.settings) * n);
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
        let mut inputs = vec![0.0; inputs(self.settings) * n];
        let network = self.network.backward(self.simd, acts, y_bar, n, &mut inputs, scratch);
        let (maps, channels) = (self.settings.maps(), self.texels.channels());
        let of_maps = &inputs[OWN * n..];
        let coordinates = taps
            .iter()
            .enumerate()
            .filter(|(at, _)| at % maps > 0)
            .map(|(at, tap)| {
                let (i, map) = (at / maps, at % maps);
                let bar = |c: usize| of_maps[(map * channels + c) * n + i];
                tap.as_ref().map_or([0.0; 2], |tap| self.texels.coordinates_bar(map, tap, bar))
            })
            .collect();
        ChunkBars { inputs, network, taps, coordinates }
    }

    /// The gradient with respect to the maps, `[maps][channels][pixels]`: each channel of its own, Gaussian after Gaussian.
    pub(super) fn maps_bar(&self, chunks: &[ChunkBars]) -> Vec<f32> {
        let (maps, channels) = (self.settings.maps(), self.texels.channels());
        let mut out = vec![0.0; self.code.maps.len()];
        let pixels = out.len() / (maps * channels);
        out.par_chunks_exact_mut(pixels).enumerate().for_each(|(plane, out)| {
            for chunk in chunks {
                let n = chunk.taps.len() / maps;
                let bars = &chunk.inputs[(OWN + plane) * n..][..n];
                let taps = chunk.taps.iter().skip(plane / channels).step_by(maps);
                for (tap, bar) in taps.zip(bars) {
                    if let Some(tap) = tap {
                        (0..4).for_each(|k| out[tap.at[k] as usize] += tap.shares[k] * bar);
                    }
                }
            }
        });
        out
    }
}
