//! What came out.

use crate::motion::{Fit, FitKind};
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
    /// What was found about the camera by the flow to each neighbour, where cameras are not known.
    #[serde(default)]
    pub(super) fits: Vec<Fit>,
}

/// By what it was told what moves, where cameras are not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FitSummary {
    /// Flows, one for each photo and neighbour, that a fundamental matrix fits best.
    pub fundamental: usize,
    /// Mean share of their vectors that it fits.
    pub fundamental_share: f64,
    /// Flows that a homography fits best.
    pub homography: usize,
    /// Mean share of their vectors that it fits.
    pub homography_share: f64,
    /// Flows that neither fits: they say nothing of what moves.
    pub neither: usize,
}

impl FitSummary {
    fn of<'a>(fits: impl Iterator<Item = &'a Fit> + Clone) -> Self {
        let by = |kind: FitKind| {
            let scores = fits.clone().filter(|fit| fit.by == Some(kind)).filter_map(Fit::score);
            let shares: Vec<f64> = scores.map(|score| score.share).collect();
            (shares.len(), shares.iter().sum::<f64>() / shares.len().max(1) as f64)
        };
        let (fundamental, fundamental_share) = by(FitKind::Fundamental);
        let (homography, homography_share) = by(FitKind::Homography);
        let neither = fits.clone().filter(|fit| fit.by.is_none()).count();
        Self { fundamental, fundamental_share, homography, homography_share, neither }
    }
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
    /// Photos without cameras whose flow neither a fundamental matrix nor a homography fits, or is hardly known: the mask is empty.
    pub unexplained: Vec<String>,
    /// By what it was told what moves; `None` where cameras are known.
    pub fits: Option<FitSummary>,
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
            too_near: names(|found| found.seen.is_some() && found.judged == 0.0 && found.fits.is_empty()),
            unexplained: names(|found| found.judged == 0.0 && !found.fits.is_empty()),
            fits: photos
                .iter()
                .any(|(_, found)| !found.fits.is_empty())
                .then(|| FitSummary::of(photos.iter().flat_map(|(_, found)| &found.fits))),
        }
    }

    /// By what it was told what moves, in one line; `None` where cameras are known.
    #[must_use]
    pub fn told_by(&self) -> Option<String> {
        let FitSummary { fundamental, fundamental_share, homography, homography_share, neither } = self.fits?;
        Some(format!(
            "no cameras: what moves leaves the epipolar lines of a fundamental matrix in {fundamental} flows ({:.0} % of their vectors fit) and a \
             homography in {homography} ({:.0} %), whichever has the lower GRIC; neither fits {neither}",
            100.0 * fundamental_share,
            100.0 * homography_share
        ))
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
        if !self.unexplained.is_empty() {
            warnings.push(format!(
                "{} of {} photos have flow that neither a fundamental matrix nor a homography fits, or hardly any that can be relied on: what moves \
                 cannot be told, and their masks are empty (127, not known): {}",
                self.unexplained.len(),
                self.photos,
                listing(&self.unexplained)
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
    use crate::motion::FitScore;

    #[test]
    fn shares_are_of_photos_that_have_them() {
        let found = |seen, judged, moving| Found { seen, judged, moving, fits: Vec::new() };
        let photos =
            [("a", found(Some(0.8), 0.5, 0.1)), ("b", found(Some(0.6), 0.0, 0.0)), ("c", found(None, 0.0, 0.0))];
        let summary = PriorsSummary::of(&photos, 1, false);
        assert!((summary.seen - 0.7).abs() < 1e-12 && (summary.moving - 0.2).abs() < 1e-12, "{summary:?}");
        assert_eq!((summary.photos, summary.kept), (3, 1));
        assert!(summary.alone == ["c"] && summary.too_near == ["b"], "{summary:?}");
        assert_eq!((summary.warnings().len(), summary.fits, summary.told_by()), (2, None, None));
        // Exact flow that is seldom known is as it should be: its photos are far apart.
        let few = |exact| PriorsSummary { seen: 0.1, photos: 2, exact, ..PriorsSummary::default() };
        assert_eq!([false, true].map(|exact| few(exact).warnings().len()), [1, 0]);
    }

    #[test]
    fn without_cameras_it_is_said_by_what_it_was_told_what_moves() {
        let fit = |by, share| {
            let score = Some(FitScore { share, gric: 3.0 });
            Fit { by, fundamental: score, homography: score }
        };
        let found = |judged, fits: Vec<Fit>| Found { seen: Some(0.9), judged, moving: 0.0, fits };
        let [lines, plane] = [FitKind::Fundamental, FitKind::Homography].map(Some);
        let photos = [
            ("a", found(0.9, vec![fit(lines, 0.9), fit(plane, 0.7)])),
            ("b", found(0.9, vec![fit(None, 0.2), fit(plane, 0.9)])),
            ("c", found(0.0, vec![fit(None, 0.2)])),
        ];
        let summary = PriorsSummary::of(&photos, 0, false);
        let fits = summary.fits.unwrap();
        assert_eq!((fits.fundamental, fits.homography, fits.neither), (1, 2, 2));
        assert!((fits.fundamental_share - 0.9).abs() < 1e-12 && (fits.homography_share - 0.8).abs() < 1e-12);
        assert!(summary.unexplained == ["c"] && summary.too_near.is_empty(), "{summary:?}");
        let line = summary.told_by().unwrap();
        assert!(
            line.contains("in 1 flows (90 %") && line.contains("in 2 (80 %)") && line.ends_with("fits 2"),
            "{line}"
        );
        assert!(summary.warnings()[0].starts_with("1 of 3 photos have flow that neither"), "{:?}", summary.warnings());
    }

    #[test]
    fn long_lists_are_cut() {
        let names: Vec<String> = (0..10).map(|i| i.to_string()).collect();
        assert_eq!(listing(&names), "0, 1, 2, 3, 4, 5, 6, 7, and 2 more");
        assert_eq!(listing(&names[..2]), "0, 1");
    }
}
