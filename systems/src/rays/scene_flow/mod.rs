//! Scene flow: the moving part of a field says where its samples are in the frames beside, and is held to what it shows there.
//!
//! ```text
//! (r, g, gate, S_next, S_previous, p) = network(features(x, t))     rows after the gate: `head`
//! x_j = x + S_j, seen at the time of frame j                        `elsewhere`
//! C_j: colours at x_j, along the ray of this frame                  `rendered`
//! ```
//!
//! The moving part alone is rendered four times along a ray: here, in the next frame, in the previous one, and where it is time for that
//! two frames on or back, by flow upon flow. Where nothing may move a ray has its still part, held: so does the "dynamic render" of a
//! part that is not there. What these renders cost is said by [`FlowTerm`]s, which a paper's file chooses; this driver names none.
//!
//! * `config`: settings, and what a step knows; `film`: which frames follow each other, their cameras and priors;
//! * `head`: scene flow and what is hidden, from rows of the network, and back;
//! * `chosen`: rays that take part; `elsewhere`, `rendered`: a pass forwards and backwards; `passes`: all those of a chunk;
//! * `both_parts`: how much of what a ray shows of both parts together is the moving part's;
//! * `term`: what terms read, and the gradients that they add; `learn`: a step, and depth, which is compared over a whole batch.
//!
//! Source: Li, Niklaus, Snavely, Wang, "Neural Scene Flow Fields for Space-Time View Synthesis of Dynamic Scenes", 2021; Gao, Saraf, Kopf,
//! Huang, "Dynamic View Synthesis from Dynamic Monocular Video", 2021.

mod both_parts;
mod chosen;
mod config;
mod elsewhere;
mod film;
mod head;
mod learn;
mod passes;
mod rendered;
mod term;
#[cfg(test)]
mod term_tests;
#[cfg(test)]
mod tests;

pub(super) use chosen::KeptSamples;
pub(super) use config::FlowContext;
pub(crate) use config::{FlowConfig, FlowSettings};
#[cfg(test)]
pub(super) use film::FramePriors;
pub(crate) use film::{BEYOND, Film, HERE, NEXT, PASSES, PREVIOUS};
pub(super) use passes::FlowChunk;
pub(crate) use term::{FlowRays, FlowTerm, SeenBars};
