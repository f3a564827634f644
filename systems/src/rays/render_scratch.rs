//! Memory of a task of a render, and a ray on its way.

use crate::fields::{Mixed, MovingBars, MovingPoints, Placing};
use crate::samplers::Proposed;
use crate::space::InternalRay;
use crate::warps::{DeformGrad, DeformScratch};
use render_core::budget::Account;

/// Buffers of a task.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) t: Vec<f32>,
    pub(super) dt: Vec<f32>,
    /// Samples in cells that count as empty; only where those are visited.
    pub(super) empty: Vec<bool>,
    pub(super) occupied: Vec<f32>,
    pub(super) offsets: Vec<u32>,
    pub(super) rays: Vec<InternalRay>,
    pub(super) views: Vec<f32>,
    pub(super) basis: Vec<f32>,
    pub(super) alive: Vec<u32>,
    /// Sample, weight: those of the round that carry weight.
    pub(super) kept: Vec<Kept>,
    /// The first of each ray among those.
    pub(super) runs: Vec<u32>,
    pub(super) p: Vec<f32>,
    pub(super) x: Vec<f32>,
    /// `[3][n]`, positions before they were canonical, and their time steps; only for normals where something moves.
    pub(super) was: Vec<f32>,
    pub(super) which: Vec<u32>,
    pub(super) placing: Placing,
    /// Samples at which something moves, where a part of the field is for these.
    pub(super) moving: MovingPoints,
    pub(super) mixed: Mixed,
    pub(super) moving_bars: MovingBars,
    pub(super) deform: (DeformGrad, DeformScratch),
    pub(super) features: Vec<f32>,
    pub(super) acts: Vec<f32>,
    pub(super) raw: Vec<f32>,
    pub(super) input: Vec<f32>,
    pub(super) rgb: Vec<f32>,
    pub(super) mlp: Vec<f32>,
    pub(super) bar: Vec<f32>,
    pub(super) features_bar: Vec<f32>,
    pub(super) raw_bar: Vec<f32>,
    pub(super) x_bar: Vec<f32>,
    pub(super) times: Vec<f32>,
    pub(super) grad: Vec<f32>,
    pub(super) proposed: Proposed,
}

#[derive(Clone, Copy)]
pub(super) struct Kept {
    pub(super) ray: u32,
    /// Column in the round's buffers.
    pub(super) column: u32,
    pub(super) t: f32,
    pub(super) w: f32,
    pub(super) sigma: f32,
}

/// A ray on its way.
#[derive(Clone, Copy)]
pub(super) struct Progress {
    pub(super) account: Account,
    pub(super) depth: f64,
    /// `exp(-depth)`
    pub(super) trans: f64,
    /// Optical depth of the samples in cells that count as empty.
    pub(super) hidden: f64,
    pub(super) stopped: bool,
    pub(super) rgb: [f64; 3],
    pub(super) opacity: f32,
    pub(super) distance: f32,
    pub(super) median: f32,
    pub(super) normal: [f32; 3],
}

impl Progress {
    pub(super) const START: Self = Self {
        account: Account::NEW,
        depth: 0.0,
        trans: 1.0,
        hidden: 0.0,
        stopped: false,
        rgb: [0.0; 3],
        opacity: 0.0,
        distance: 0.0,
        median: f32::INFINITY,
        normal: [0.0; 3],
    };
}
