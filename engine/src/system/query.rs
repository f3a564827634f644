//! What a render may be asked for besides its rays.

use crate::halt::Halt;
use render_core::budget::SkipSet;
use std::sync::Arc;

/// Which layers a render should hold; colour, opacity and depth always come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerRequest {
    /// Surface normals, `-grad sigma` weighted along the ray and normalised. Costs about one more field evaluation.
    pub normals: Normals,
    /// Which point of the canonical scene is seen. Costs one evaluation of the deformation a ray.
    pub canonical: Canonical,
    /// Median depths of Gaussians. They cost a second walk through what was drawn; fields have them in any case.
    pub median: Median,
    /// Colours of what stands still behind what moves. They cost nothing more; only systems that know the two apart have them.
    pub behind: Behind,
}

/// Whether normals are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// Not computed.
    #[default]
    Skip,
    /// Computed.
    Compute,
}

/// Whether canonical points are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Canonical {
    /// Not computed.
    #[default]
    Skip,
    /// Computed.
    Compute,
}

/// Whether the median depth of Gaussians is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Median {
    /// The expected depth stands for it: enough for colours.
    Skip,
    /// Computed.
    #[default]
    Compute,
}

/// Whether the colours of what is behind are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Behind {
    /// Not kept.
    #[default]
    Skip,
    /// Kept.
    Compute,
}

/// In which photo's appearance a picture is rendered. Systems without appearance codes have one only.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Appearance {
    /// The mean of all training photos.
    #[default]
    Mean,
    /// That of a training view.
    View(usize),
    /// A code: fitted to a photo, or between two others.
    Code(Arc<[f32]>),
}

/// What a render may vary besides the rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    /// What is behind the scene.
    pub background: [f32; 3],
    /// Layers wanted besides colour, opacity and depth.
    pub layers: LayerRequest,
    /// Error a pixel may have from skipped work, in colour units; 0 skips nothing.
    pub error_budget: f32,
    /// In which appearance.
    pub appearance: Appearance,
    /// At which time, `0..=1`. Systems of scenes that stand still know one time only.
    pub time: f64,
    /// Ends the work early: layers are those of nothing then, from some ray on.
    pub halt: Halt,
}

/// A render that takes some of its skips only: what the table of skips compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trial {
    /// Skips it may take, as far as the query's error budget goes.
    pub skips: SkipSet,
    /// What is in cells that count as empty.
    pub empty: EmptyCells,
}

impl Trial {
    /// What [`System::render`](super::System::render) does.
    pub const USUAL: Self = Self { skips: SkipSet::ALL, empty: EmptyCells::Nothing };
}

/// What is in cells of an occupancy grid that count as empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmptyCells {
    /// Nothing: that is the model, as training never samples there.
    Nothing,
    /// What the field holds there, unless the cameras rule the cell out.
    Field,
}
