//! The network of the paper (supplement, figure 7): eight layers of 256 with a skip into the sixth, density from the
//! eighth, colour from it and the viewing direction.

use super::NerfConfig;
use crate::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::init::Init;
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{EncodingOp, MlpOp, Node, Tape, TapeError};
use float_core::Simd;
use std::ops::Range;

/// Shapes; coarse and fine network share them.
pub(super) struct Shapes {
    pub(super) position: Frequency,
    pub(super) direction: Frequency,
    trunk: Mlp,
    density: Mlp,
    bottleneck: Mlp,
    colour: Mlp,
}

/// One network's parameters as the kernels read them.
#[derive(Default)]
pub(super) struct PackedNetwork([Packed; 4]);

/// The tape operations of one network.
pub(super) struct Ops<'a> {
    position: EncodingOp<Frequency>,
    direction: EncodingOp<Frequency>,
    parts: [(MlpOp<'a>, Range<usize>); 4],
}

impl Shapes {
    pub(super) fn new(config: &NerfConfig) -> Result<Self, SystemError> {
        let refuse =
            |e: String| SystemError::Config { field: "octaves, width, depth", value: String::new(), problem: e };
        let frequency =
            |octaves| Frequency::new(3, octaves, Base::One, Identity::Include).map_err(|e| refuse(e.to_string()));
        let (position, direction) = (frequency(config.position_octaves)?, frequency(config.direction_octaves)?);
        let mlp = |inputs, hidden: Vec<usize>, outputs, out, skips| {
            Mlp::new(&MlpConfig {
                inputs,
                hidden,
                outputs,
                bias: Bias::Zero,
                hidden_activation: Activation::Relu,
                output_activation: out,
                skips,
            })
            .map_err(|e| refuse(e.to_string()))
        };
        let (w, d) = (config.width, config.depth.max(1));
        // The paper's skip goes into the sixth of eight layers.
        let skips = if d > 5 { vec![5] } else { vec![] };
        Ok(Self {
            trunk: mlp(position.out_rows(), vec![w; d - 1], w, Activation::Relu, skips)?,
            density: mlp(w, vec![], 1, Activation::None, vec![])?,
            bottleneck: mlp(w, vec![], w, Activation::None, vec![])?,
            colour: mlp(w + direction.out_rows(), vec![w / 2], 3, Activation::LOGISTIC, vec![])?,
            position,
            direction,
        })
    }

    fn mlps(&self) -> [&Mlp; 4] {
        [&self.trunk, &self.density, &self.bottleneck, &self.colour]
    }

    /// Parameters of one network: 595 844 as published.
    pub(super) fn param_count(&self) -> usize {
        self.mlps().iter().map(|m| m.param_count()).sum()
    }

    /// Where each part's parameters lie.
    fn ranges(&self) -> [Range<usize>; 4] {
        let mut at = 0;
        self.mlps().map(|m| {
            at += m.param_count();
            at - m.param_count()..at
        })
    }

    /// Glorot-uniform weights, zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        params.fill(0.0);
        let mut stream = 0;
        for (mlp, range) in self.mlps().into_iter().zip(self.ranges()) {
            let params = &mut params[range];
            for l in mlp.layers() {
                let weights = &mut params[l.weights.clone()];
                Init::XavierUniform.fill(rng.substream(stream), l.inputs, l.outputs, weights);
                stream += 1;
            }
        }
    }

    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedNetwork) {
        for ((mlp, range), packed) in self.mlps().into_iter().zip(self.ranges()).zip(&mut packed.0) {
            mlp.pack(&params[range], packed);
        }
    }

    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedNetwork) -> Ops<'a> {
        let mut parts = self.mlps().into_iter().zip(&packed.0).zip(self.ranges());
        Ops {
            position: EncodingOp::new(self.position, simd),
            direction: EncodingOp::new(self.direction, simd),
            parts: std::array::from_fn(|_| {
                let ((mlp, packed), range) = parts.next().expect("four parts");
                (MlpOp { mlp, packed, simd }, range)
            }),
        }
    }
}

/// What the network says about a set of samples.
pub(super) struct Output {
    /// `[1 x n]` before the activation.
    pub(super) raw_density: Node,
    /// `[3 x n]`
    pub(super) rgb: Node,
}

impl<'a> Ops<'a> {
    /// Record the network: `x` `[3 x n]` positions in `[-1, 1]`, `d` `[3 x n]` unit directions.
    pub(super) fn record(&'a self, tape: &mut Tape<'a>, x: Node, d: Node) -> Result<Output, TapeError> {
        let [trunk, density, bottleneck, colour] = &self.parts;
        let apply = |tape: &mut Tape<'a>, part: &'a (MlpOp<'a>, Range<usize>), x| {
            let params = tape.param(part.1.start, part.1.len(), 1)?;
            tape.custom(&part.0, &[x, params])
        };
        let position = tape.custom(&self.position, &[x])?;
        let direction = tape.custom(&self.direction, &[d])?;
        let h = apply(tape, trunk, position)?;
        let raw_density = apply(tape, density, h)?;
        let features = apply(tape, bottleneck, h)?;
        let features = tape.concat(&[features, direction])?;
        let rgb = apply(tape, colour, features)?;
        Ok(Output { raw_density, rgb })
    }
}
