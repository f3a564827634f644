//! The network of NeRF (its paper's supplement, figure 7), and of most that came after: eight layers of 256 with a skip into the
//! sixth, density from the eighth, colour from it and the viewing direction.

use super::parts::{self, Part};
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::init::Init;
use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{Encoder, EncodingOp, Node, Tape, TapeError};
use float_core::Simd;
use std::ops::Range;

/// What a network is made of.
pub struct NetworkShape<P> {
    /// Encoding of positions.
    pub(crate) position: P,
    /// Octaves of the direction.
    pub(crate) direction_octaves: usize,
    /// Width of the layers; the colour's has half of it.
    pub(crate) width: usize,
    /// Layers of the trunk.
    pub(crate) depth: usize,
    /// How far colours may leave `[0, 1]`.
    pub(crate) colour_pad: f32,
}

/// Shapes; coarse and fine network share them. The colour sees the bottleneck, the direction, and the photo's code.
pub(super) struct Shapes<P> {
    position: P,
    direction: Frequency,
    trunk: Mlp,
    density: Mlp,
    bottleneck: Mlp,
    colour: Mlp,
}

/// One network's parameters as the kernels read them.
#[derive(Default)]
pub(super) struct PackedNetwork([Packed; 4]);

/// The tape operations of one network.
pub(super) struct Ops<'a, P> {
    position: EncodingOp<P>,
    direction: EncodingOp<Frequency>,
    parts: [Part<'a>; 4],
}

/// Settings that no network can be made of.
pub(crate) fn refuse(e: impl ToString) -> SystemError {
    SystemError::Config { field: "octaves, width, depth", value: String::new(), problem: e.to_string() }
}

impl<P: Encoder + Copy> Shapes<P> {
    /// `appearance` is the length of a photo's code, 0 without.
    pub(super) fn new(config: &NetworkShape<P>, appearance: usize) -> Result<Self, SystemError> {
        let position = config.position;
        let direction = Frequency::new(3, config.direction_octaves, Base::One, Identity::Include).map_err(refuse)?;
        let mlp = |inputs, hidden: Vec<usize>, outputs, out, skips| {
            Mlp::new(&MlpConfig::new(inputs, hidden, outputs).with_output_activation(out).with_skips(skips))
                .map_err(refuse)
        };
        let (w, d) = (config.width, config.depth.max(1));
        // The paper's skip goes into the sixth of eight layers.
        let skips = if d > 5 { vec![5] } else { vec![] };
        Ok(Self {
            trunk: mlp(Encoder::out_rows(&position), vec![w; d - 1], w, Activation::Relu, skips)?,
            density: mlp(w, vec![], 1, Activation::None, vec![])?,
            bottleneck: mlp(w, vec![], w, Activation::None, vec![])?,
            colour: mlp(
                w + direction.out_rows() + appearance,
                vec![w / 2],
                3,
                Activation::Logistic { pad: config.colour_pad },
                vec![],
            )?,
            position,
            direction,
        })
    }

    /// Rows that the position encoding sees.
    pub(super) fn position_rows(&self) -> usize {
        self.position.in_rows()
    }

    /// Width of the trunk.
    pub(super) fn width(&self) -> usize {
        self.trunk.outputs()
    }

    /// The network of the colour, and where its parameters lie in those of a network.
    pub(super) fn colour(&self) -> (&Mlp, Range<usize>) {
        let [.., range] = parts::ranges(self.mlps(), 0);
        (&self.colour, range)
    }

    fn mlps(&self) -> [&Mlp; 4] {
        [&self.trunk, &self.density, &self.bottleneck, &self.colour]
    }

    /// Parameters of one network.
    pub(super) fn param_count(&self) -> usize {
        parts::param_count(self.mlps())
    }

    /// Glorot-uniform weights, zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        parts::init(self.mlps(), Init::XavierUniform, rng, params);
    }

    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedNetwork) {
        parts::pack(self.mlps(), params, &mut packed.0);
    }

    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedNetwork) -> Ops<'a, P> {
        Ops {
            position: EncodingOp::new(self.position, simd),
            direction: EncodingOp::new(self.direction, simd),
            parts: parts::ops(self.mlps(), &packed.0, 0, simd),
        }
    }
}

/// What the network says about a set of samples.
pub(super) struct Output {
    /// `[1 x n]` before the activation.
    pub(super) raw_density: Node,
    /// `[3 x n]`
    pub(super) rgb: Node,
    /// `[width x n]`, what the trunk makes of the positions.
    pub(super) trunk: Node,
    /// What the colour is made of: bottleneck, direction, code.
    pub(super) colour_input: Node,
}

/// What a network sees of a set of samples.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    /// What the position encoding sees.
    pub(super) x: Node,
    /// `[3 x n]` unit directions.
    pub(super) d: Node,
    /// `[dims x n]` code of the photo; `None` where colours depend on none.
    pub(super) code: Option<Node>,
}

impl<'a, P: Encoder> Ops<'a, P> {
    /// Record the network.
    pub(super) fn record(&'a self, tape: &mut Tape<'a>, seen: Seen) -> Result<Output, TapeError> {
        let [trunk, density, bottleneck, colour] = &self.parts;
        let position = tape.custom(&self.position, &[seen.x])?;
        let direction = tape.custom(&self.direction, &[seen.d])?;
        let h = trunk.apply(tape, position)?;
        let raw_density = density.apply(tape, h)?;
        let features = bottleneck.apply(tape, h)?;
        let colour_input = match seen.code {
            Some(code) => tape.concat(&[features, direction, code])?,
            None => tape.concat(&[features, direction])?,
        };
        let rgb = colour.apply(tape, colour_input)?;
        Ok(Output { raw_density, rgb, trunk: h, colour_input })
    }
}
