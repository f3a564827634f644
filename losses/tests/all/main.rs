//! The tests of this crate in one program: built and linked once. `cargo test -p wildfield-losses --test all MODULE::` runs one file of them.

mod anisotropy;
mod background;
mod coherence;
mod depth;
mod distortion;
mod dssim;
mod elastic;
mod heuristics;
mod interlevel;
mod irls;
mod kernels;
mod lpips;
mod metrics;
mod opacity;
mod photometric;
mod planes;
mod robust_kernels;
mod scene_flow;
mod segmentation;
mod settled;
mod superpixels;
mod trimmed;
mod uncertainty;
mod variation;
mod visibility;

use testkit::gradient::{PairTolerances, Tolerance};

/// How closely sums over many terms, and their gradients, agree with their twins in `f64`.
pub(crate) const SUMS: PairTolerances = PairTolerances {
    values: Tolerance::new(2e-6, 1e-6),
    twin: Tolerance::new(1e-6, 1e-7),
    gradients: Tolerance::new(2e-6, 1e-6),
};
