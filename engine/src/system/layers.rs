//! What a render gives back, ray by ray.

use super::query::{Canonical, Normals, Query};

/// Canonical point of a ray that hit nothing; infinite, as its depth is.
pub const NOWHERE: [f64; 3] = [f64::INFINITY; 3];

/// Rendered layers of a batch of rays, one entry a ray. Colours are not clamped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Colour, composited on the query's background.
    pub rgb: Vec<[f32; 3]>,
    /// Accumulated opacity in `[0, 1]`.
    pub opacity: Vec<f32>,
    /// Expected distance along the ray, world units; `f32::INFINITY` where nothing was hit.
    pub depth: Vec<f32>,
    /// Distance at which the transmittance passes one half; `f32::INFINITY` where it never does. As `depth` for Gaussians where
    /// [`Median::Skip`](super::Median::Skip) was asked for.
    pub median_depth: Vec<f32>,
    /// Unit normals, empty unless asked for; zero where nothing was hit.
    pub normal: Vec<[f32; 3]>,
    /// Canonical point of what is seen at `median_depth`, the scene's frame, world units (see
    /// [`canonical`](crate::canonical)). Empty unless asked for; infinite where nothing was hit.
    pub canonical: Vec<[f64; 3]>,
    /// Colours of what stands still alone, composited on the query's background. Empty unless asked for, and of systems that do not know
    /// it apart.
    pub behind: Vec<[f32; 3]>,
}

impl Layers {
    /// `n` rays that hit nothing.
    #[must_use]
    pub fn nothing(n: usize, query: &Query) -> Self {
        Self {
            rgb: vec![query.background; n],
            opacity: vec![0.0; n],
            depth: vec![f32::INFINITY; n],
            median_depth: vec![f32::INFINITY; n],
            normal: if query.layers.normals == Normals::Compute { vec![[0.0; 3]; n] } else { Vec::new() },
            canonical: if query.layers.canonical == Canonical::Compute { vec![NOWHERE; n] } else { Vec::new() },
            behind: Vec::new(),
        }
    }

    /// Append another batch's layers.
    pub fn extend(&mut self, more: Self) {
        self.rgb.extend(more.rgb);
        self.opacity.extend(more.opacity);
        self.depth.extend(more.depth);
        self.median_depth.extend(more.median_depth);
        self.normal.extend(more.normal);
        self.canonical.extend(more.canonical);
        self.behind.extend(more.behind);
    }
}
