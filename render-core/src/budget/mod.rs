//! Work that may be left out, and what that costs at most.
//!
//! A pixel has an **error budget** in colour units: no channel may end further from the full sum than that. [`Budget`]
//! holds it and each ray deals it out through its [`Account`]: a skip is taken only where the account can pay for its
//! bound. A budget of 0 skips nothing, not even what is free. [`Ledger`] adds up what was skipped and what it may have cost.
//!
//! | skip | left out | bound on a channel |
//! | --- | --- | --- |
//! | [`Skip::Behind`] | samples behind a transmittance `T` | `T * spread`, [`termination_bound`] |
//! | [`Skip::Faint`] | the colour of a sample of weight `w` | `w * largest radiance`, [`faint_bound`] |
//! | [`Skip::Empty`] | intervals of optical thickness `tau` together | `(1 - exp(-tau)) * spread`, [`empty_bound`] |
//! | [`Skip::Branch`] | the side of a blend that has weight `a` | `a * distance of the sides`, [`blend_bound`] |
//! | [`Skip::Window`] | levels or bands whose window is 0 | 0, [`open_levels`] |
//! | [`Skip::Harmonics`] | spherical harmonics above a degree | what their energy allows, [`harmonics_bound`] |
//!
//! # Why the bounds hold
//! `C = sum(w[i] * c[i]) + T_end * background` is the mean of the colour that a photon sent back along the ray meets first.
//! Taking intervals away changes what it meets only if it would have met one of *them* first, which happens with
//! probability `sum(w[i], i taken away) <= 1 - exp(-sum(tau[i]))`; what it meets instead differs by at most the **spread**,
//! the largest difference between any two of the radiances and the background. For what lies behind `T` the probability is
//! `T` at most. Bounds of several skips add (triangle inequality), because each holds for every ray.
//!
//! # What is a bound, and what an estimate
//! All of these are bounds in terms of what they are given. An optical thickness that was *measured some time ago, at
//! some points* is an estimate, and what is computed from it is one too: a table that shows it must say so.
//!
//! # Rounding
//! Bounds hold for real numbers. [`Budget`] keeps [`ROUNDING`] back, for a renderer that adds up in `f64` and rounds
//! weights and pixels to `f32`: the pixels themselves stay inside the budget. A budget below it skips nothing.

mod bounds;
mod ledger;
mod terminate;

pub use bounds::{
    Sides, blend_bound, blend_sides, empty_bound, faint_bound, harmonics_bound, harmonics_degree, open_levels,
};
pub use ledger::{Entry, Ledger, Skip, SkipSet};
pub use terminate::{depth_limit, terminate, termination_bound};

/// Part of a budget kept back for rounding: four units in the last place of a pixel of 1, once in the weights' sum, once in
/// the pixel of either picture.
pub const ROUNDING: f64 = 4.0 / (1 << 23) as f64;

/// Part of a ray's budget that may go to faint samples; all that is left when the ray stops pays for what lies behind.
const FAINT_SHARE: f64 = 0.5;

/// Between what the radiances of a field lie, in every channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radiance {
    /// Smallest.
    pub low: f32,
    /// Largest.
    pub high: f32,
}

impl Radiance {
    /// `[0, 1]`: what a logistic gives.
    pub const UNIT: Self = Self { low: 0.0, high: 1.0 };

    /// Largest difference between any two of the radiances and the background.
    #[must_use]
    pub fn spread(&self, background: [f32; 3]) -> f64 {
        let spread = |b: f32| f64::from(self.high.max(b)) - f64::from(self.low.min(b));
        background.into_iter().map(spread).fold(0.0, f64::max)
    }

    /// Largest radiance, sign aside.
    #[must_use]
    pub fn largest(&self) -> f64 {
        f64::from(self.low.abs().max(self.high.abs()))
    }
}

/// The error budget of a pixel and how it is dealt out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Colour units, less [`ROUNDING`]; 0 skips nothing.
    total: f64,
    spread: f64,
    largest: f64,
    skips: SkipSet,
}

/// What one ray has spent of its budget, colour units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Account {
    spent: f64,
}

impl Account {
    /// Nothing spent yet.
    pub const NEW: Self = Self { spent: 0.0 };

    /// Colour units.
    #[must_use]
    pub fn spent(&self) -> f64 {
        self.spent
    }
}

impl Budget {
    /// A budget of `eps` colour units a pixel, for radiances and a background as given. Negative and NaN count as 0.
    #[must_use]
    pub fn new(eps: f32, radiance: Radiance, background: [f32; 3]) -> Self {
        let total = (f64::from(eps) - ROUNDING).max(0.0);
        Self { total, spread: radiance.spread(background), largest: radiance.largest(), skips: SkipSet::ALL }
    }

    /// The same with no skips but those of `skips`.
    #[must_use]
    pub fn only(self, skips: SkipSet) -> Self {
        Self { skips, ..self }
    }

    /// Whether a skip may be taken at all.
    #[inline(always)]
    #[must_use]
    pub fn takes(&self, skip: Skip) -> bool {
        self.total > 0.0 && self.skips.has(skip)
    }

    /// What stopping at the transmittance `trans` costs at most, colour units.
    #[inline(always)]
    #[must_use]
    pub fn stop_cost(&self, trans: f64) -> f64 {
        trans * self.spread
    }

    /// Whether a ray may stop where its transmittance is `trans`: what that costs, if so, goes on its account. Then
    /// the background gets all of `trans`; nothing is renormalised.
    #[inline(always)]
    pub fn stops(&self, account: &mut Account, trans: f64) -> bool {
        let cost = self.stop_cost(trans);
        let stops = self.takes(Skip::Behind) && cost <= self.total - account.spent;
        if stops {
            account.spent += cost;
        }
        stops
    }

    /// Whether the colour of a sample of weight `w` may be left out (it counts as black): what that costs, if so, goes on the
    /// account. `left` samples of the ray are still to come, this one among them: each may take an equal part of what
    /// is there, and what the faintest do not need goes to the others.
    #[inline(always)]
    pub fn drops(&self, account: &mut Account, w: f32, left: u32) -> bool {
        let cost = f64::from(w) * self.largest;
        let room = FAINT_SHARE * self.total - account.spent;
        let drops = self.takes(Skip::Faint) && cost * f64::from(left.max(1)) <= room;
        if drops {
            account.spent += cost;
        }
        drops
    }

    /// Whether a skip that costs at most `cost` may be taken: if so it goes on the account.
    #[inline(always)]
    pub fn affords(&self, account: &mut Account, skip: Skip, cost: f64) -> bool {
        let affords = self.takes(skip) && cost <= self.total - account.spent;
        if affords {
            account.spent += cost;
        }
        affords
    }
}
