//! Every function against the golden vectors of its topic.

mod cameras;
mod composite;
mod composite_blend;
mod composite_two;
mod encodings;
mod lighting;
mod losses_depth;
mod losses_dssim;
mod losses_elastic;
mod losses_rays;
mod losses_simple;
mod losses_wild;
mod metrics;
mod mlp;
mod optim;
mod sampling;
mod splats;
