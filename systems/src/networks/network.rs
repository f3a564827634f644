//! The network of NeRF (its paper's supplement, figure 7), and of most that came after: eight layers of 256 with a skip into the
//! sixth, density from the eighth, colour from it and the viewing direction.

use super::displacement::{Displaced, Displacement, DisplacementOps, DisplacementShape, PackedDisplacement};
use super::parts::{self, Part};
use super::when::When;
use crate::limits::refusal;
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
    /// What moves points before they are seen; `None`: nothing does. Points only, no cones.
    pub(crate) displacement: Option<DisplacementShape>,
}

/// Shapes; coarse and fine network share them. The colour sees the bottleneck, the direction, and the photo's code.
pub(super) struct Shapes<P> {
    position: P,
    direction: Frequency,
    trunk: Mlp,
    density: Mlp,
    bottleneck: Mlp,
    colour: Mlp,
    displacement: Option<Displacement>,
}

/// One network's parameters as the kernels read them.
#[derive(Default)]
pub(super) struct PackedNetwork {
    canonical: [Packed; 4],
    displacement: PackedDisplacement,
}

/// The tape operations of one network.
pub(super) struct Ops<'a, P> {
    position: EncodingOp<P>,
    direction: EncodingOp<Frequency>,
    parts: [Part<'a>; 4],
    displacement: Option<DisplacementOps<'a>>,
}

impl<P: Encoder + Copy> Shapes<P> {
    /// `appearance` is the length of a photo's code, 0 without.
    pub(super) fn new(config: &NetworkShape<P>, appearance: usize) -> Result<Self, SystemError> {
        let position = config.position;
        if config.displacement.is_some() && position.in_rows() != 3 {
            let problem = "points can be displaced, and these networks see more than points";
            return Err(refusal("position", format!("{} rows", position.in_rows()), problem));
        }
        let octaves = config.direction_octaves;
        let direction = Frequency::new(3, octaves, Base::One, Identity::Include)
            .map_err(|e| refusal("direction_octaves", octaves, e))?;
        let mlp = |inputs, hidden: Vec<usize>, outputs, out, skips| {
            Mlp::new(&MlpConfig::new(inputs, hidden, outputs).with_output_activation(out).with_skips(skips))
                .map_err(|e| refusal("width, depth", format!("{}, {}", config.width, config.depth), e))
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
            displacement: config.displacement.map(Displacement::new).transpose()?,
            position,
            direction,
        })
    }

    /// Whether points may move.
    pub(super) fn displaces(&self) -> bool {
        self.displacement.is_some()
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

    /// Parameters of one network: those of the canonical scene, then those of the displacement.
    pub(super) fn param_count(&self) -> usize {
        self.canonical_count() + self.displacement.as_ref().map_or(0, Displacement::param_count)
    }

    /// Parameters of the canonical scene.
    pub(super) fn canonical_count(&self) -> usize {
        parts::param_count(self.mlps())
    }

    /// Glorot-uniform weights, zero biases; points start where they are.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        let (canonical, rest) = params.split_at_mut(self.canonical_count());
        parts::init(self.mlps(), Init::XavierUniform, rng, canonical);
        if let Some(displacement) = &self.displacement {
            displacement.init(rng.substream(u64::MAX), rest);
        }
    }

    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedNetwork) {
        let (canonical, rest) = params.split_at(self.canonical_count());
        parts::pack(self.mlps(), canonical, &mut packed.canonical);
        if let Some(displacement) = &self.displacement {
            displacement.pack(rest, &mut packed.displacement);
        }
    }

    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedNetwork) -> Ops<'a, P> {
        let at = self.canonical_count();
        Ops {
            position: EncodingOp::new(self.position, simd),
            direction: EncodingOp::new(self.direction, simd),
            parts: parts::ops(self.mlps(), &packed.canonical, 0, simd),
            displacement: self.displacement.as_ref().map(|moved| moved.ops(simd, &packed.displacement, at)),
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
    /// The points where they are in the canonical scene; `None` where nothing moves.
    pub(super) displaced: Option<Displaced>,
}

/// What a network sees of a set of samples.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    /// What the position encoding sees.
    pub(super) x: Node,
    /// `[3 x n]` unit directions.
    pub(super) d: Node,
    /// Times; `None` where nothing moves.
    pub(super) when: Option<When>,
    /// `[dims x n]` code of the photo; `None` where colours depend on none.
    pub(super) code: Option<Node>,
}

impl<'a, P: Encoder> Ops<'a, P> {
    /// What moves points; `None`: nothing does.
    pub(super) fn displacement(&self) -> Option<&DisplacementOps<'a>> {
        self.displacement.as_ref()
    }

    /// One time for `n` samples; `None` where nothing moves.
    pub(super) fn at(&self, tape: &mut Tape<'_>, n: usize, time: f32) -> Option<When> {
        self.displacement.as_ref().and_then(|_| When::of_all(tape, n, time))
    }

    /// Record the network.
    pub(super) fn record(&'a self, tape: &mut Tape<'a>, seen: Seen) -> Result<Output, TapeError> {
        let [trunk, density, bottleneck, colour] = &self.parts;
        let displaced = match (&self.displacement, seen.when) {
            (Some(displacement), Some(when)) => Some(displacement.displaced(tape, seen.x, when)?),
            _ => None,
        };
        let position = tape.custom(&self.position, &[displaced.map_or(seen.x, |displaced| displaced.x)])?;
        let direction = tape.custom(&self.direction, &[seen.d])?;
        let h = trunk.apply(tape, position)?;
        let raw_density = density.apply(tape, h)?;
        let features = bottleneck.apply(tape, h)?;
        let colour_input = match seen.code {
            Some(code) => tape.concat(&[features, direction, code])?,
            None => tape.concat(&[features, direction])?,
        };
        let rgb = colour.apply(tape, colour_input)?;
        Ok(Output { raw_density, rgb, trunk: h, colour_input, displaced })
    }
}
