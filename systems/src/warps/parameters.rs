//! The parameters of a deformation while its parts are made.

use super::network::Network;
use super::settings::refuse;
use crate::networks::parts;
use engine::system::SystemError;
use field_core::encoding::planes::Planes;
use field_core::init::Init;
use field_core::mlp::{Mlp, MlpConfig};
use field_core::rng::Rng;
use float_core::Simd;
use std::ops::Range;

/// Stream of the initial parameters.
const INIT: u64 = 0x6465_666f;
/// Largest weight that the last layer of a network begins with: points start where they are.
const SMALL: f32 = 1e-4;

/// The axis of time of planes.
pub(super) const TIME: usize = 3;

/// Streams of the parts' initial parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    /// What networks see of the time.
    Time = 0,
    /// The network that moves points.
    Warp = 1,
    /// The network of ambient coordinates.
    Ambient = 2,
    /// The first set of planes; the others follow.
    Planes = 8,
}

/// Inputs, hidden layers and outputs of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NetworkShape {
    pub(crate) inputs: usize,
    /// Hidden layers.
    pub(crate) depth: usize,
    /// Units of a hidden layer.
    pub(crate) width: usize,
    pub(crate) outputs: usize,
}

impl NetworkShape {
    /// ReLU layers with a skip of the input into the fifth, where there is a fifth.
    pub(super) fn mlp(self) -> Result<Mlp, SystemError> {
        let Self { inputs, depth, width, outputs } = self;
        let skips = if depth > 4 { vec![4] } else { vec![] };
        let refused = |e| {
            let value = format!("one of the networks has {depth} layers of {width}");
            refuse("warp_width, warp_depth, ambient_width, ambient_depth", value, e)
        };
        Mlp::new(&MlpConfig::new(inputs, vec![width; depth], outputs).with_skips(skips)).map_err(refused)
    }
}

/// The parameters of a deformation's parts, one after the other: those of networks, then those of planes.
#[derive(Debug)]
pub(crate) struct Parameters {
    rng: Rng,
    pub(super) simd: Simd,
    pub(super) values: Vec<f32>,
    /// Parameters of networks.
    pub(super) networks: usize,
}

impl Parameters {
    /// None yet.
    pub(crate) fn new(seed: u64) -> Self {
        Self { rng: Rng::new(seed, INIT), simd: Simd::best(), values: Vec::new(), networks: 0 }
    }

    /// Random numbers of a part.
    pub(super) fn rng(&self, stream: Stream) -> Rng {
        self.rng.substream(stream as u64)
    }

    /// A network whose outputs begin near 0.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a shape that cannot be.
    ///
    /// # Panics
    /// After planes: networks come first.
    pub(crate) fn network(&mut self, stream: Stream, shape: NetworkShape) -> Result<Network, SystemError> {
        let (mlp, rng) = (shape.mlp()?, self.rng(stream));
        let range = self.grow(mlp.param_count());
        assert_eq!(range.start, self.networks, "networks come before planes");
        self.networks = range.end;
        let params = &mut self.values[range.clone()];
        parts::init([&mlp], Init::XavierUniform, rng, params);
        if let Some(last) = mlp.layers().last() {
            rng.substream(u64::MAX).fill_uniform(0, &mut params[last.weights.clone()]);
            params[last.weights.clone()].iter_mut().for_each(|w| *w *= SMALL);
        }
        Ok(Network::new(mlp, range, self.simd))
    }

    /// Set `k` of planes of place and time, which begin as a product that does not depend on time: small factors in space, 1 in
    /// time (K-Planes, section 3.2).
    pub(super) fn planes(&mut self, k: usize, planes: &Planes) -> Range<usize> {
        let rng = self.rng.substream(Stream::Planes as u64 + k as u64);
        let range = self.grow(planes.params_len());
        let params = &mut self.values[range.clone()];
        for (k, pair) in planes.pairs().enumerate() {
            let params = &mut params[planes.plane_range(k)];
            if pair.contains(&TIME) {
                params.fill(1.0);
            } else {
                rng.substream(k as u64).fill_uniform(0, params);
                params.iter_mut().for_each(|p| *p = 0.1 + 0.4 * *p);
            }
        }
        range
    }

    fn grow(&mut self, len: usize) -> Range<usize> {
        let start = self.values.len();
        self.values.resize(start + len, 0.0);
        start..start + len
    }
}
