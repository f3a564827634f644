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

    /// Nothing yet, with room for `n` rays: what grows ray by ray is kept twice each time it outgrows its room.
    #[must_use]
    pub fn with_room(n: usize, query: &Query) -> Self {
        fn room<T>(n: usize, is_wanted: bool) -> Vec<T> {
            Vec::with_capacity(if is_wanted { n } else { 0 })
        }
        Self {
            rgb: room(n, true),
            opacity: room(n, true),
            depth: room(n, true),
            median_depth: room(n, true),
            normal: room(n, query.layers.normals == Normals::Compute),
            canonical: room(n, query.layers.canonical == Canonical::Compute),
            // Which systems know it is seen by their first batch.
            behind: Vec::new(),
        }
    }

    /// A copy of all rays from the one of this number on.
    #[must_use]
    pub fn since(&self, first: usize) -> Self {
        fn part<T: Copy>(all: &[T], first: usize) -> Vec<T> {
            all.get(first..).unwrap_or_default().to_vec()
        }
        Self {
            rgb: part(&self.rgb, first),
            opacity: part(&self.opacity, first),
            depth: part(&self.depth, first),
            median_depth: part(&self.median_depth, first),
            normal: part(&self.normal, first),
            canonical: part(&self.canonical, first),
            behind: part(&self.behind, first),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::plain_query;

    #[test]
    fn a_part_begins_at_its_ray_and_has_the_layers_that_were_asked_for() {
        let mut query = plain_query([0.5; 3], 0.0);
        query.layers.normals = Normals::Compute;
        let mut all = Layers::with_room(5, &query);
        assert!(all.rgb.is_empty() && all.rgb.capacity() >= 5 && all.normal.capacity() >= 5);
        assert_eq!(all.canonical.capacity(), 0);
        for k in 0..5_u8 {
            let mut one = Layers::nothing(1, &query);
            one.opacity[0] = k.into();
            all.extend(one);
        }
        let part = all.since(3);
        assert_eq!(part.opacity, [3.0, 4.0]);
        assert_eq!((part.rgb.len(), part.normal.len(), part.canonical.len()), (2, 2, 0));
        assert!(all.since(5).rgb.is_empty() && all.since(6).rgb.is_empty());
        assert_eq!(all.since(0).opacity, all.opacity);
    }
}
