//! Contraction, NDC, boxes, rigs and paths.

mod arcs;
mod bounds;
mod contract;
mod coverage;
mod ndc;
mod paths;
