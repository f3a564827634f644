//! The table of skips, measured: what renders leave out, how often, what time that saves, what it may cost, and what it does.
//!
//! A fixed subset of the rays of the held-out views is rendered with nothing skipped, with each skip alone, and with all of
//! them; differences are against the first. The last row is not a skip but part of the model: cells that an occupancy
//! grid counts as empty hold nothing, and the row says what the field would show there if they did not.

use crate::data::Dataset;
use crate::system::{EmptyCells, Layers, Query, System, Trial};
use render_core::budget::{Entry, Ledger, Skip, SkipSet};
use render_core::ray::Ray;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Rays measured.
const RAYS: usize = 2048;
/// Renders shorter than this are timed three times, and the middle one counts.
const QUICK: f64 = 0.3;

/// A row of the table of skips, as `summary.json` and `eval.json` hold it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkipSummary {
    /// What is skipped.
    pub what: String,
    /// Units skipped.
    pub skipped: u64,
    /// Units there would have been.
    pub total: u64,
    /// The unit.
    pub unit: String,
    /// Bound on the error of a pixel.
    pub bound: String,
    /// Seconds saved, where measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds_saved: Option<f64>,
    /// Largest and mean error over pixels, colour units, where measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<[f64; 2]>,
}

/// The measured table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredSkips {
    /// Error budget of a pixel, colour units.
    pub budget: f64,
    /// Rays measured.
    pub rays: usize,
    /// Seconds for them with nothing skipped.
    pub seconds_full: f64,
    /// Seconds for them as renders are.
    pub seconds: f64,
    /// A row a skip; then all together; then what cells that count as empty would show.
    pub rows: Vec<SkipSummary>,
}

/// Measure the renders of `system` on rays of the views of `data`. `None` where renders skip nothing, or without rays.
pub fn measure(system: &dyn System, data: &Dataset, query: &Query) -> Option<MeasuredSkips> {
    let rays = subset(data, RAYS);
    if rays.is_empty() {
        return None;
    }
    let trial = |skips, empty| timed(system, &rays, query, &Trial { skips, empty });
    let (full, _, seconds_full) = trial(SkipSet::NONE, EmptyCells::Nothing)?;
    let (with_all, ledger, seconds) = trial(SkipSet::ALL, EmptyCells::Nothing)?;
    let row =
        |what: &str, (skipped, total): (u64, u64), unit: &str, bound: String, layers: &Layers, s: f64| SkipSummary {
            what: what.into(),
            skipped,
            total,
            unit: unit.into(),
            bound,
            seconds_saved: Some(seconds_full - s),
            error: Some(difference(layers, &full)),
        };
    let mut rows = Vec::new();
    for skip in Skip::ALL.into_iter().filter(|&skip| ledger.entry(skip).total > 0) {
        let (layers, alone, s) = trial(SkipSet::only(skip), EmptyCells::Nothing)?;
        let (entry, unit) = (alone.entry(skip), if skip == Skip::Faint { "colours" } else { "samples" });
        let what = format!("{}, alone", skip.name());
        rows.push(row(&what, (entry.skipped, entry.total), unit, bound_of(&entry), &layers, s));
    }
    // Of all colours that the full sum asks for, those that were not.
    let (faint, empty) = (ledger.entry(Skip::Faint), ledger.entry(Skip::Empty));
    let all = empty.total.max(ledger.entry(Skip::Behind).total);
    let bound = format!("<= {:.1e}, the budget", query.error_budget);
    let left_out = all.saturating_sub(faint.total - faint.skipped);
    rows.push(row("all together", (left_out, all), "colours", bound, &with_all, seconds));
    if empty.skipped > 0 {
        let (layers, seen, s) = trial(SkipSet::ALL, EmptyCells::Field)?;
        rows.push(row(
            "the field in cells that count as empty (part of the model)",
            (empty.skipped, empty.total),
            "samples",
            format!("none promised; by its thickness there {}", bound_of(&seen.entry(Skip::Empty))),
            &layers,
            s,
        ));
    }
    Some(MeasuredSkips { budget: f64::from(query.error_budget), rays: rays.len(), seconds_full, seconds, rows })
}

/// Bound of a skip in words: the largest over pixels, and the mean.
pub fn bound_of(entry: &Entry) -> String {
    if entry.most() == 0.0 {
        return "0".into();
    }
    format!("<= {:.1e}, mean {:.1e}", entry.most(), entry.spent() / entry.pixels.max(1) as f64)
}

fn timed(system: &dyn System, rays: &[Ray], query: &Query, trial: &Trial) -> Option<(Layers, Ledger, f64)> {
    let clock = Instant::now();
    let (layers, ledger) = system.render_trial(rays, query, trial)?;
    let mut seconds = [clock.elapsed().as_secs_f64(); 3];
    if seconds[0] < QUICK {
        for seconds in &mut seconds[1..] {
            let clock = Instant::now();
            let _ = system.render_trial(rays, query, trial);
            *seconds = clock.elapsed().as_secs_f64();
        }
        seconds.sort_by(f64::total_cmp);
    }
    Some((layers, ledger, seconds[1]))
}

/// At most `count` rays, evenly spread over the pixels of all views.
fn subset(data: &Dataset, count: usize) -> Vec<Ray> {
    let size = |i: usize| [data.view(i).camera.width, data.view(i).camera.height].map(|n| n as usize);
    let pixels: usize = (0..data.len()).map(|i| size(i)[0] * size(i)[1]).sum();
    let count = count.min(pixels);
    let (mut rays, mut view, mut before) = (Vec::with_capacity(count), 0, 0);
    let mut prepared = (!data.is_empty()).then(|| data.view(0).camera.prepare());
    for k in 0..count {
        let at = (2 * k + 1) * pixels / (2 * count);
        while at - before >= size(view)[0] * size(view)[1] {
            before += size(view)[0] * size(view)[1];
            view += 1;
            prepared = Some(data.view(view).camera.prepare());
        }
        let (x, y) = ((at - before) % size(view)[0], (at - before) / size(view)[0]);
        let ray = prepared.as_ref().and_then(|p| p.ray(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5)));
        rays.extend(ray);
    }
    rays
}

/// Largest and mean over pixels of the largest difference of a channel.
fn difference(a: &Layers, b: &Layers) -> [f64; 2] {
    let channel = |(a, b): (f32, f32)| (f64::from(a) - f64::from(b)).abs();
    let pixel = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().copied().zip(*b).map(channel).fold(0.0, f64::max);
    let (mut most, mut sum) = (0.0_f64, 0.0);
    for error in a.rgb.iter().zip(&b.rgb).map(pixel) {
        most = most.max(error);
        sum += error;
    }
    [most, sum / a.rgb.len().max(1) as f64]
}

impl MeasuredSkips {
    /// One line above the table.
    #[must_use]
    pub fn heading(&self) -> String {
        format!(
            "{} rays of held-out views, error budget {:.2e}: {:.3} s with nothing skipped, {:.3} s as rendered ({:.1} times as fast)",
            self.rays,
            self.budget,
            self.seconds_full,
            self.seconds,
            self.seconds_full / self.seconds.max(1e-9)
        )
    }

    /// The table for a terminal.
    #[must_use]
    pub fn table(&self) -> String {
        let widest = self.rows.iter().map(|r| r.what.chars().count()).max().unwrap_or(4);
        let mut out = format!("{}\n", self.heading());
        out += &format!(
            "{:widest$}  {:>8}  {:>8}  {:>9}  {:>9}  bound\n",
            "skipped", "share", "saved s", "error max", "mean"
        );
        for r in &self.rows {
            let share = 100.0 * r.skipped as f64 / r.total.max(1) as f64;
            let [most, mean] = r.error.unwrap_or([f64::NAN; 2]);
            out += &format!(
                "{:widest$}  {share:>6.1} %  {:>8.3}  {most:>9.1e}  {mean:>9.1e}  {}\n",
                r.what,
                r.seconds_saved.unwrap_or(f64::NAN),
                r.bound
            );
        }
        out
    }
}
