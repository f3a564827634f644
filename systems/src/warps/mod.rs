//! Deformations: the seam between a radiance field and a scene that is not the same at all times.
//!
//! A field knows one scene, the *canonical* one. A [`Deform`] computes where in it the point of a time is, and what else the density
//! there depends on:
//!
//! 1. a time step is a row of numbers ([`time::TimeSteps`]): the time's sines and cosines, or a free code;
//! 2. [`Deform::place`]: points of a time, in the unit cube, to canonical points, and rows for the density network;
//! 3. the field learns; [`Deform::learn`]: the gradient of both, back to networks, time steps and points.
//!
//! A field without one does none of this. Where nothing is warped (`TimeSteps::still`) points stay as they are, bit for bit, and
//! no network runs.
//!
//! The equations are those of a paper: a [`Deformation`] records them on the tape. It is wired of parts, each with its settings:
//!
//! * `time`: what networks see of the time; `octaves`: what they see of points, coarse to fine (`window`); `network`: a network on the tape;
//! * `motion`: the network that moves points; `ambient`: coordinates beyond space; `planes`: features of place and time;
//! * `density`: what the density network sees besides;
//! * `elastic`, `coherence`, `background`: losses (settings in `regularisers`); `curriculum`: which views are drawn first.
//!
//! The driver is `deform` (parameters, optimiser), `pass` (tiles of `points`, forwards and backwards), `state` (checkpoints) and
//! `skips`.

mod ambient;
mod at;
mod background;
mod coherence;
#[cfg(test)]
mod coherence_tests;
mod curriculum;
mod deform;
mod deformation;
mod density;
mod elastic;
#[cfg(test)]
pub(crate) mod made;
mod motion;
mod network;
mod octaves;
mod parameters;
mod pass;
mod planes;
mod points;
mod regularisers;
mod settings;
mod skips;
mod state;
#[cfg(test)]
mod tests;
mod time;
#[cfg(test)]
mod warmup_tests;
mod window;

pub(crate) use ambient::{Ambient, AmbientSettings};
pub(crate) use at::{At, Moved, since_origin};
pub(crate) use background::StillWork;
#[cfg(test)]
pub(crate) use coherence::neighbour;
pub(crate) use curriculum::Curriculum;
pub(crate) use deform::Deform;
pub(crate) use deformation::{Deformation, Windows};
pub(crate) use density::{DensityInputs, DensitySettings, Sees};
pub(crate) use motion::{Motion, Origin, Warp, WarpSettings, moving};
pub(crate) use parameters::Parameters;
pub(crate) use planes::{PlaneFeatures, PlaneSettings, SeenBy, TimePlanes};
pub(crate) use points::{DeformGrad, DeformScratch, Points};
pub(crate) use regularisers::{BackgroundSettings, CoherenceSettings, ElasticAt, ElasticSettings};
pub(crate) use time::{Time, TimeKind, TimeSettings, TimeSteps, Times};
