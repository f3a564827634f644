//! What came out.

use serde::{Deserialize, Serialize};

/// Names of photos that are shown.
const SHOWN: usize = 8;
/// Share of flow vectors that can be relied on below which that is said.
const FEW: f64 = 0.3;

/// What was found out about one photo; it is kept in the marker of what is done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Found {
    /// Share of its flow vectors that can be relied on; `None` without neighbours.
    pub(super) seen: Option<f64>,
    /// Share of its pixels that were judged.
    pub(super) judged: f64,
    /// Share of its pixels that move.
    pub(super) moving: f64,
}

/// Priors that are made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PriorsSummary {
    /// Photos that have them now.
    pub photos: usize,
    /// Photos of which they were made before.
    pub kept: usize,
    /// Whether they are exact: those of a drawn scene.
    pub exact: bool,
    /// Mean share of flow vectors that can be relied on, or that are exactly known, over photos with neighbours.
    pub seen: f64,
    /// Share of the judged pixels that move.
    pub moving: f64,
    /// Photos without a neighbour in time of their size: they have no flow and an empty mask.
    pub alone: Vec<String>,
    /// Photos whose neighbours were taken from nearly the same place, or have hardly any flow that is known: what moves cannot be told by
    /// cameras, and the mask is empty.
    pub too_near: Vec<String>,
}

impl PriorsSummary {
    pub(super) fn of(photos: &[(&str, Found)], kept: usize, exact: bool) -> Self {
        let sum = |pick: fn(&Found) -> f64| photos.iter().map(|(_, found)| pick(found)).sum::<f64>();
        let names = |is: fn(&Found) -> bool| -> Vec<String> {
            photos.iter().filter(|(_, found)| is(found)).map(|(name, _)| (*name).to_owned()).collect()
        };
        let alone = names(|found| found.seen.is_none());
        let (seen, with_flow) = (sum(|found| found.seen.unwrap_or(0.0)), photos.len() - alone.len());
        let (moving, judged) = (sum(|found| found.moving), sum(|found| found.judged));
        Self {
            photos: photos.len(),
            kept,
            exact,
            seen: seen / with_flow.max(1) as f64,
            moving: if judged > 0.0 { moving / judged } else { 0.0 },
            alone,
            too_near: names(|found| found.seen.is_some() && found.judged == 0.0),
        }
    }

    /// What to be warned of, in one line each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.too_near.is_empty() {
            warnings.push(format!(
                "{} of {} photos were taken from nearly the same place as their neighbours, or have hardly any flow that can be \
                 relied on: what moves cannot be told, and their masks are empty: {}",
                self.too_near.len(),
                self.photos,
                listing(&self.too_near)
            ));
        }
        if !self.alone.is_empty() {
            warnings.push(format!(
                "{} of {} photos have no neighbour in time of their size and so no flow: {}",
                self.alone.len(),
                self.photos,
                listing(&self.alone)
            ));
        }
        if !self.exact && self.seen < FEW && self.alone.len() < self.photos {
            warnings.push(format!(
                "only {:.0} % of the flow can be relied on: photos are far apart in time, blurred, or without texture",
                100.0 * self.seen
            ));
        }
        warnings
    }
}

/// The first few names.
fn listing(names: &[String]) -> String {
    let more = names.len().saturating_sub(SHOWN);
    let shown = names[..names.len() - more].join(", ");
    if more > 0 { format!("{shown}, and {more} more") } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_photos_that_have_them() {
        let found = |seen, judged, moving| Found { seen, judged, moving };
        let photos =
            [("a", found(Some(0.8), 0.5, 0.1)), ("b", found(Some(0.6), 0.0, 0.0)), ("c", found(None, 0.0, 0.0))];
        let summary = PriorsSummary::of(&photos, 1, false);
        assert!((summary.seen - 0.7).abs() < 1e-12 && (summary.moving - 0.2).abs() < 1e-12, "{summary:?}");
        assert_eq!((summary.photos, summary.kept), (3, 1));
        assert!(summary.alone == ["c"] && summary.too_near == ["b"], "{summary:?}");
        assert_eq!(summary.warnings().len(), 2);
        // Exact flow that is seldom known is as it should be: its photos are far apart.
        let few = |exact| PriorsSummary { seen: 0.1, photos: 2, exact, ..PriorsSummary::default() };
        assert_eq!([false, true].map(|exact| few(exact).warnings().len()), [1, 0]);
    }

    #[test]
    fn long_lists_are_cut() {
        let names: Vec<String> = (0..10).map(|i| i.to_string()).collect();
        assert_eq!(listing(&names), "0, 1, 2, 3, 4, 5, 6, 7, and 2 more");
        assert_eq!(listing(&names[..2]), "0, 1");
    }
}
