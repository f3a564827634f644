//! What becomes of the rows of a cloud.

use alloc::{vec, vec::Vec};

use crate::{Gaussians, SplatError};

/// What a fresh row holds at first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresh {
    /// What its source holds: parameters, features, codes.
    Copied,
    /// A number: 0 for an optimiser's moments and for statistics.
    Is(f32),
}

/// Where each row comes from after a change, for everything that has a row for each Gaussian.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    before: usize,
    from: Vec<u32>,
    fresh: Vec<bool>,
}

impl Rows {
    /// Nothing changes.
    ///
    /// # Errors
    /// [`SplatError::TooMany`] for more than an index can count.
    pub fn unchanged(n: usize) -> Result<Self, SplatError> {
        Self::keep(n, |_| true)
    }

    /// Those of `n` rows that `keeps` says, in their order.
    ///
    /// # Errors
    /// [`SplatError::TooMany`] for more than an index can count.
    pub fn keep(n: usize, keeps: impl Fn(usize) -> bool) -> Result<Self, SplatError> {
        countable(n)?;
        let from: Vec<u32> = (0..n as u32).filter(|&i| keeps(i as usize)).collect();
        let fresh = vec![false; from.len()];
        Ok(Self { before: n, from, fresh })
    }

    /// From sources and marks that are known to be right.
    pub(super) fn of(before: usize, rows: impl Iterator<Item = (u32, bool)>) -> Self {
        let (from, fresh) = rows.unzip();
        Self { before, from, fresh }
    }

    /// Rows before.
    #[must_use]
    pub fn before(&self) -> usize {
        self.before
    }

    /// Rows afterwards.
    #[must_use]
    pub fn len(&self) -> usize {
        self.from.len()
    }

    /// None left?
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.from.is_empty()
    }

    /// Source of each row afterwards.
    #[must_use]
    pub fn from(&self) -> &[u32] {
        &self.from
    }

    /// Marks rows whose history is that of another: their moments start anew.
    #[must_use]
    pub fn fresh(&self) -> &[bool] {
        &self.fresh
    }

    /// Whether every row stays where it is, with its history.
    #[must_use]
    pub fn is_unchanged(&self) -> bool {
        self.before == self.len()
            && self.from.iter().enumerate().all(|(i, &from)| i == from as usize)
            && !self.fresh.contains(&true)
    }

    /// `rows` `[components][before]` to `[components][len]`.
    ///
    /// # Errors
    /// [`SplatError::Shape`] naming `what`.
    ///
    /// # Panics
    /// May do so where `components` times the rows does not fit `usize`.
    pub fn apply(
        &self,
        what: &'static str,
        rows: &[f32],
        components: usize,
        fresh: Fresh,
    ) -> Result<Vec<f32>, SplatError> {
        if rows.len() != components * self.before {
            return Err(SplatError::Shape { what, want: components * self.before, got: rows.len() });
        }
        let mut out = Vec::with_capacity(components * self.len());
        for k in 0..components {
            let row = &rows[k * self.before..][..self.before];
            let copied = self.from.iter().map(|&i| row[i as usize]);
            match fresh {
                Fresh::Copied => out.extend(copied),
                Fresh::Is(x) => out.extend(copied.zip(&self.fresh).map(|(old, &fresh)| if fresh { x } else { old })),
            }
        }
        Ok(out)
    }

    /// The cloud with its rows changed, fresh ones copied.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn follow(&self, cloud: &Gaussians) -> Result<Gaussians, SplatError> {
        cloud.check()?;
        if cloud.len() != self.before {
            return Err(SplatError::Shape { what: "cloud", want: self.before, got: cloud.len() });
        }
        let mut out = Gaussians::new(self.len(), cloud.degree())?;
        for ((_, to), (field, from)) in out.fields_mut().into_iter().zip(cloud.fields()) {
            let components = from.len().checked_div(self.before).unwrap_or(0);
            to.copy_from_slice(&self.apply(field.name(), from, components, Fresh::Copied)?);
        }
        Ok(out)
    }

    /// This change and `next` after it, as one.
    ///
    /// # Errors
    /// [`SplatError::Shape`] where `next` starts with another number of rows.
    pub fn then(&self, next: &Self) -> Result<Self, SplatError> {
        if next.before != self.len() {
            return Err(SplatError::Shape { what: "rows", want: self.len(), got: next.before });
        }
        let joined = next.from.iter().zip(&next.fresh).map(|(&i, &fresh)| {
            let i = i as usize;
            (self.from[i], fresh || self.fresh[i])
        });
        Ok(Self::of(self.before, joined))
    }
}

/// A cloud after a change, and what became of its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Afterwards.
    pub cloud: Gaussians,
    /// For everything else that has a row for each Gaussian.
    pub rows: Rows,
}

/// Whether indices can count so many Gaussians.
pub(super) fn countable(n: usize) -> Result<(), SplatError> {
    match u32::try_from(n) {
        Ok(_) => Ok(()),
        Err(_) => Err(SplatError::TooMany { what: "Gaussians", got: n }),
    }
}
