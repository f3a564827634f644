//! How a training goes, for the page: the curve, where it stands, how long it still takes.

use engine::log::Row;
use engine::run::planned_stop;
use engine::summary::Summary;
use engine::train::Stop;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Points of the curve that are sent: more than a page has pixels for is waste.
const POINTS: usize = 400;

/// Rows that say how fast the training is now.
const RECENT: usize = 12;

/// A training that has written nothing for so long has stopped; rows come every few seconds, and wait for evaluations.
const SILENT: Duration = Duration::from_secs(300);

/// The message `training` about the run in `folder`; empty where there are no rows.
pub(crate) fn message(folder: &Path, rows: &[Row]) -> String {
    let Some(last) = rows.last() else { return String::new() };
    let stop = planned_stop(folder);
    let runs = is_running(folder);
    let eta = runs.then(|| eta(rows, stop?)).flatten();
    let points: Vec<Value> = thinned(rows, POINTS)
        .map(|row| json!([row.step, row.loss.map(short), row.psnr_train.map(short), row.psnr_test.map(short)]))
        .collect();
    json!({
        "type": "training",
        "runs": runs,
        "step": last.step,
        "of": match stop { Some(Stop::Steps(n)) => Some(n), _ => None },
        "seconds": last.seconds,
        "eta": eta.map(f64::round),
        "rows": points,
    })
    .to_string()
}

/// Whether a training still writes: nothing says so directly.
pub(crate) fn is_running(folder: &Path) -> bool {
    let written = |name: &str| fs::metadata(folder.join(name)).and_then(|m| m.modified()).ok();
    let Some(row) = written("metrics.csv") else { return false };
    // Written after the last row, at the end.
    if written(Summary::FILE).is_some_and(|summary| summary >= row) {
        return false;
    }
    SystemTime::now().duration_since(row).is_ok_and(|age| age < SILENT)
}

/// Training seconds still to go.
fn eta(rows: &[Row], stop: Stop) -> Option<f64> {
    let last = rows.last()?;
    match stop {
        Stop::Seconds(s) => Some((s - last.seconds).max(0.0)),
        Stop::Steps(n) => {
            let first = &rows[rows.len().saturating_sub(RECENT)];
            // Of a run of one row so far: since the start.
            let (step, seconds) = if first.step < last.step { (first.step, first.seconds) } else { (0, 0.0) };
            let steps = last.step.checked_sub(step).filter(|steps| *steps > 0)?;
            Some((last.seconds - seconds) / steps as f64 * n.saturating_sub(last.step) as f64)
        }
    }
}

/// One row of every few, so that about `most` are left; those with a held-out score stay, and so does the last.
fn thinned(rows: &[Row], most: usize) -> impl Iterator<Item = &Row> {
    let every = rows.len().div_ceil(most).max(1);
    let n = rows.len();
    rows.iter()
        .enumerate()
        .filter(move |(i, row)| i % every == 0 || i + 1 == n || row.psnr_test.is_some())
        .map(|(_, r)| r)
}

/// Four digits are enough for a curve.
fn short(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(n: u64) -> Vec<Row> {
        (1..=n).map(|i| Row { step: i * 10, seconds: i as f64, loss: Some(1.0 / i as f64), ..Row::default() }).collect()
    }

    #[test]
    fn time_to_go_is_that_of_recent_steps() {
        assert_eq!(eta(&rows(20), Stop::Steps(300)), Some(10.0));
        assert_eq!(eta(&rows(1), Stop::Steps(30)), Some(2.0));
        assert_eq!(eta(&rows(20), Stop::Steps(100)), Some(0.0));
        assert_eq!(eta(&rows(20), Stop::Seconds(50.0)), Some(30.0));
        assert_eq!(eta(&[], Stop::Steps(1)), None);
    }

    #[test]
    fn a_long_curve_is_thinned_and_keeps_its_scores_and_its_end() {
        let mut all = rows(1003);
        all[500].psnr_test = Some(30.0);
        let left: Vec<u64> = thinned(&all, 100).map(|row| row.step).collect();
        assert!(left.len() <= 102 && left.contains(&5010) && left.last() == Some(&10030), "{left:?}");
        assert_eq!(thinned(&rows(7), 100).count(), 7);
    }

    #[test]
    fn a_run_is_going_until_its_summary_is_written() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(message(folder.path(), &[]), "");
        fs::write(folder.path().join("metrics.csv"), "rows").unwrap();
        let said: Value = serde_json::from_str(&message(folder.path(), &rows(3))).unwrap();
        assert_eq!((&said["runs"], &said["step"], &said["eta"]), (&true.into(), &30.into(), &Value::Null));
        fs::write(folder.path().join(Summary::FILE), "{}").unwrap();
        let said: Value = serde_json::from_str(&message(folder.path(), &rows(3))).unwrap();
        assert_eq!((&said["runs"], said["rows"].as_array().unwrap().len()), (&false.into(), 3));
    }
}
