//! Contraction, NDC, boxes, rigs and paths.

mod bounds;
mod contract;
mod ndc;
mod paths;
