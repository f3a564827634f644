//! What a training did and did not do: seconds by part, samples skipped.

use super::driver::RaySystem;
use super::render;
use crate::warps::Deform;
use engine::system::SkipRow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Rows of the table of skips.
pub(super) fn skips(driver: &RaySystem) -> Vec<SkipRow> {
    let faint = driver.faint();
    let read = |a: &AtomicU64| a.load(Ordering::Relaxed);
    let (placed, dense) = (read(&driver.skipped.placed), read(&driver.skipped.dense));
    let space = if let Some(occupancy) = driver.sampler.occupancy() {
        SkipRow::counted(
            "training: empty space",
            dense.saturating_sub(placed),
            dense,
            "samples",
            format!(
                "optical thickness < {} per cell at the smallest step, as last seen",
                occupancy.config().occupancy_threshold
            ),
        )
    } else {
        let proposed = read(&driver.skipped.proposed);
        SkipRow::counted(
            "training: weighed by proposals alone",
            proposed,
            proposed + placed,
            "samples",
            "weights that the proposals bound (interlevel loss)".into(),
        )
    };
    let mut rows = vec![
        space,
        SkipRow::counted(
            if faint > 0.0 { "training: faint, or behind what is opaque" } else { "training: behind what is opaque" },
            placed.saturating_sub(read(&driver.skipped.kept)),
            placed,
            "samples",
            if faint > 0.0 {
                format!("at most {faint} of a ray's weight, and transmittance < {}", driver.config.batch.train_stop)
            } else {
                format!("transmittance < {}", driver.config.batch.train_stop)
            },
        ),
    ];
    if driver.field.moving.is_some() {
        let (moving, all) = (read(&driver.skipped.moving), read(&driver.skipped.beside_moving));
        rows.push(SkipRow::counted(
            "training: the moving part where nothing moves",
            all.saturating_sub(moving),
            all,
            "samples",
            "what fewer than 6 % of the views that see it, or than 2 of them, see err to one side; or as motion masks say".into(),
        ));
    }
    rows.extend(driver.field.deform().into_iter().flat_map(Deform::skips));
    rows.extend(driver.skipped.left_out.ignored_row());
    rows.extend(driver.skipped.left_out.occluders_row());
    rows.extend(render::skip_rows(&driver.skipped.renders));
    rows
}

/// Seconds by part.
pub(super) fn timings(driver: &RaySystem) -> Vec<(&'static str, f64)> {
    let s = &driver.seconds;
    let proposed = driver.sampler.proposals().is_some();
    vec![
        ("draw rays", s.draw),
        (if proposed { "proposals (all threads)" } else { "march (all threads)" }, s.march),
        ("encode (all threads)", s.encode),
        ("networks and compositing (all threads)", s.networks),
        ("grid gradient and Adam", s.scatter),
        ("network Adam", s.optimise),
        if proposed { ("proposals backwards (all threads)", s.proposals) } else { ("occupancy", s.occupancy) },
    ]
}
