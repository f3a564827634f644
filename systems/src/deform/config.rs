//! What a deformation is made of. A system of moving scenes is a choice of these parts.

use serde::{Deserialize, Serialize};

/// How a scene moves: how a moment is told to the networks, how points of that moment find their way to the canonical
/// scene, and what else the density there depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct DeformConfig {
    /// How a moment is told.
    pub moment: Moment,
    /// Where a point of a moment is in the canonical scene; `None`: where it was.
    pub warp: Option<Warp>,
    /// Coordinates beyond space; `None`: there are none.
    pub ambient: Option<Ambient>,
    /// Features of place and time; `None`: there are none.
    pub planes: Option<PlanesOfTime>,
    /// What the density network sees besides the features of the warped point and its ambient coordinates.
    pub sees: Sees,
    /// Factor of the elastic loss, and its scale; 0: none.
    pub elastic: f32,
    /// See `elastic`.
    pub elastic_scale: f32,
    /// Which samples of a ray the elastic loss looks at.
    pub elastic_at: ElasticAt,
    /// Factor of the background loss; 0: none.
    pub background: f32,
    /// Points of a step for it.
    pub background_points: usize,
    /// Steps after which all training views have come in, in the order of time; 0: they are there from the start.
    pub curriculum: u64,
    /// Learning rate of these networks, a factor of the field's.
    pub rate: f64,
    /// Learning rate of the codes, a factor of the networks'.
    pub code_rate: f64,
}

/// Which samples of a ray an elastic loss looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ElasticAt {
    /// The one where half of the light is gone.
    #[default]
    Middle,
    /// All, by their weights; those of next to no weight are left out.
    All,
}

/// How a moment is told to networks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// `t` and its sines and cosines.
    Time {
        /// Octaves.
        octaves: usize,
    },
    /// The same through a small network (TiNeuVox).
    TimeNetwork {
        /// Octaves.
        octaves: usize,
        /// Width of its hidden layer.
        width: usize,
        /// Numbers it makes of them.
        dims: usize,
    },
    /// A free code of each moment trained on, linear in between.
    Codes {
        /// Length of a code.
        dims: usize,
    },
}

/// Planes of features of place and time (k-planes): a network that sees them need not tell one place from another by its
/// coordinates alone.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanesOfTime {
    /// Cells along an axis of each set of planes.
    pub cells: Vec<usize>,
    /// Features of a set.
    pub features: usize,
    /// Cells along the axis of time.
    pub times: usize,
    /// Learning rate, a factor of that of the networks.
    pub rate: f64,
    /// Factors of the variation of their features, along axes of space and along that of time; 0: none.
    pub variation: [f32; 2],
    /// Who sees them.
    pub seen_by: SeenBy,
}

/// Who sees planes of place and time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeenBy {
    /// The network of the warp.
    #[default]
    Warp,
    /// The density network.
    Density,
    /// Both.
    Both,
}

/// The network that says where a point came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warp {
    /// Octaves of the position; with itself.
    pub octaves: usize,
    /// Steps over which they come in, coarse to fine (Nerfies, section 3.5); 0: all from the start.
    pub anneal: u64,
    /// Width of the hidden layers.
    pub width: usize,
    /// Number of hidden layers.
    pub depth: usize,
    /// What the network says.
    pub motion: Motion,
    /// What happens at `t = 0`.
    pub origin: Origin,
}

/// What a warp says of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// A displacement.
    Translation,
    /// A rotation about the origin and a translation, through the exponential map.
    Rigid,
}

/// What a warp does at `t = 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Nothing: the canonical scene is that of `t = 0`, exactly (D-NeRF).
    Canonical,
    /// What it does at any other time.
    Free,
}

/// The network of ambient coordinates (HyperNeRF's bendy sheet).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// Ambient coordinates.
    pub dims: usize,
    /// Octaves of the position, without itself.
    pub octaves: usize,
    /// Width of the hidden layers.
    pub width: usize,
    /// Number of hidden layers.
    pub depth: usize,
    /// Octaves of the ambient coordinates that the density network sees.
    pub seen_octaves: usize,
    /// Steps before the first of them comes in, and steps until all are there.
    pub anneal: [u64; 2],
}

/// What the density network sees besides features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sees {
    /// Nothing.
    Place,
    /// The moment.
    Moment,
    /// The moment, and the octaves of the point where it is now.
    MomentAndPoint {
        /// Octaves of the point; with itself.
        octaves: usize,
    },
}

#[cfg(test)]
impl DeformConfig {
    /// Nothing but moments: no part sees them yet.
    pub(crate) fn of_moments(moment: Moment) -> Self {
        Self {
            moment,
            warp: None,
            ambient: None,
            planes: None,
            sees: Sees::Place,
            elastic: 0.0,
            elastic_scale: 0.03,
            elastic_at: ElasticAt::Middle,
            background: 0.0,
            background_points: 0,
            curriculum: 0,
            rate: 1.0,
            code_rate: 1.0,
        }
    }
}
