//! Changes of a cloud's rows.

use alloc::{vec, vec::Vec};

use crate::{Gaussians, SplatError};

/// The value of fresh rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresh {
    /// A copy of their source: for parameters, features and codes.
    Copied,
    /// This number: 0 for an optimiser's moments and for statistics.
    Is(f32),
}

/// A change of rows: the source of each new row. Everything that has one row per Gaussian follows it with [`Rows::apply`].
///
/// A row is *fresh* if it is a copy or was changed, so that statistics of its past do not apply to it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    /// Number of rows before the change.
    before: usize,
    from: Vec<u32>,
    fresh: Vec<bool>,
}

impl Rows {
    /// The identity: nothing changes.
    ///
    /// # Errors
    /// [`SplatError::TooMany`] if `n` does not fit `u32`.
    pub fn unchanged(n: usize) -> Result<Self, SplatError> {
        Self::keep(n, |_| true)
    }

    /// Keep the rows of `n` for which `keeps` is true, in their order.
    ///
    /// # Errors
    /// [`SplatError::TooMany`] if `n` does not fit `u32`.
    pub fn keep(n: usize, keeps: impl Fn(usize) -> bool) -> Result<Self, SplatError> {
        countable(n)?;
        let from: Vec<u32> = (0..n as u32).filter(|&i| keeps(i as usize)).collect();
        let fresh = vec![false; from.len()];
        Ok(Self { before: n, from, fresh })
    }

    /// All `n` rows, then `more` fresh ones: copies of the last, to be overwritten. There are none of no rows.
    ///
    /// # Errors
    /// [`SplatError::TooMany`] if their number does not fit `u32`.
    pub fn and_fresh(n: usize, more: usize) -> Result<Self, SplatError> {
        countable(n.saturating_add(more))?;
        let Some(last) = n.checked_sub(1) else { return Self::unchanged(0) };
        Ok(Self::of(n, (0..n as u32).map(|i| (i, false)).chain((0..more).map(|_| (last as u32, true)))))
    }

    /// From pairs of source and fresh mark, which are not checked.
    pub(super) fn of(before: usize, rows: impl Iterator<Item = (u32, bool)>) -> Self {
        let (from, fresh) = rows.unzip();
        Self { before, from, fresh }
    }

    /// Number of rows before the change.
    #[must_use]
    pub fn before(&self) -> usize {
        self.before
    }

    /// Number of rows after the change.
    #[must_use]
    pub fn len(&self) -> usize {
        self.from.len()
    }

    /// Whether no rows are left.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.from.is_empty()
    }

    /// `[len]` source of each new row.
    #[must_use]
    pub fn from(&self) -> &[u32] {
        &self.from
    }

    /// `[len]` whether each new row is fresh: its moments start at 0.
    #[must_use]
    pub fn fresh(&self) -> &[bool] {
        &self.fresh
    }

    /// Whether nothing changes: every row keeps its place, none is fresh.
    #[must_use]
    pub fn is_unchanged(&self) -> bool {
        self.before == self.len()
            && self.from.iter().enumerate().all(|(i, &from)| i == from as usize)
            && !self.fresh.contains(&true)
    }

    /// Apply the change to `rows` `[components][before]`; the result is `[components][len]`.
    ///
    /// # Errors
    /// [`SplatError::Shape`] naming `what`.
    ///
    /// # Panics
    /// May panic if `components` times the number of rows does not fit `usize`.
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

    /// Apply the change to a cloud; fresh rows are copies.
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

    /// This change followed by `next`, as one change.
    ///
    /// # Errors
    /// [`SplatError::Shape`] if `next` starts with another number of rows.
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

/// A cloud after a change, and the change of its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The new cloud.
    pub cloud: Gaussians,
    /// For everything else that has one row per Gaussian.
    pub rows: Rows,
}

/// Whether `u32` indices can count `n` Gaussians.
pub(super) fn countable(n: usize) -> Result<(), SplatError> {
    match u32::try_from(n) {
        Ok(_) => Ok(()),
        Err(_) => Err(SplatError::TooMany { what: "Gaussians", got: n }),
    }
}

/// Rows of `n` where those of `split` are replaced by two children each: those that stay, copies of `cloned`, then the pairs of children,
/// each in the order of their sources. Both lists are ascending.
pub(super) fn split_and_cloned(n: usize, split: &[u32], cloned: &[u32]) -> Result<Rows, SplatError> {
    countable(n + split.len() + cloned.len())?;
    let mut parents = split.iter().copied().peekable();
    let stay = (0..n as u32).filter(|&i| parents.next_if_eq(&i).is_none());
    let fresh = cloned.iter().copied().chain(split.iter().flat_map(|&i| [i, i]));
    Ok(Rows::of(n, stay.map(|i| (i, false)).chain(fresh.map(|i| (i, true)))))
}

/// The rows with a score of at least `threshold`, in order. Of more than `room` those with the largest scores, ties by index.
pub(super) fn hottest(scores: &[f32], threshold: f32, room: usize) -> Vec<u32> {
    let mut hot: Vec<u32> = (0..scores.len() as u32).filter(|&i| scores[i as usize] >= threshold).collect();
    if hot.len() > room {
        hot.sort_by(|&a, &b| scores[b as usize].total_cmp(&scores[a as usize]).then(a.cmp(&b)));
        hot.truncate(room);
        hot.sort_unstable();
    }
    hot
}
