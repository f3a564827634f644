//! Contraction, NDC, the way back to the world, boxes, rigs and paths.

mod arcs;
mod bounds;
mod contract;
mod contract_gaussians;
mod coverage;
mod ndc;
mod paths;
mod world;
