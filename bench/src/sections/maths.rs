//! Vector functions against the standard library's and against `f64`.

use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, interleaved};
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series, Style};
use crate::table::{Cell, Table};
use float_core::Simd;
use float_core::vecmath::Function;
use std::hint::black_box;

/// Arguments of one timed call: in and out stay in the first-level cache.
const TIMED: usize = 2048;

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "maths",
        "One thread, arguments spread over [-10, 10] (positive where the function wants that), in the first-level cache. Largest \
         error in units in the last place of the exact value, over arguments sampled evenly among the bit patterns of all \
         finite numbers; the stated error holds for every one of them.",
        &["function", "version", "M/s", "times std f32", "largest error, ulp", "stated, ulp"],
    );
    let levels: Vec<Simd> = Simd::available().collect();
    // A prime step: no pattern of the bits is missed.
    let arguments = arguments(bench.pick(400_009, 4_001));
    let mut series: Vec<Series> = levels.iter().map(|s| Series::line(level_name(s.level()), Vec::new())).collect();
    series.push(Series { name: "std f32".into(), style: Style::Cross, points: Vec::new() });
    series.push(Series { name: "std f64".into(), style: Style::Cross, points: Vec::new() });
    let points = series.len();
    for function in Function::ALL {
        let positive = matches!(function, Function::ExpNeg | Function::Ln);
        let x: Vec<f32> = (0..TIMED)
            .map(|i| {
                let x = (i * 7919 % TIMED) as f32 / TIMED as f32 * 20.0 - 10.0;
                if positive { x.abs() + 1e-3 } else { x }
            })
            .collect();
        let x = &x;
        let mut cases: Vec<Case<'_>> = levels
            .iter()
            .map(|&simd| {
                let mut y = vec![0.0; TIMED];
                Case::new(move || function.map(simd, black_box(x), black_box(&mut y)))
            })
            .collect();
        let mut y = vec![0.0_f32; TIMED];
        cases.push(Case::new(move || {
            for (y, &x) in y.iter_mut().zip(black_box(x)) {
                *y = function.plain(x);
            }
            black_box(&mut y);
        }));
        let mut y = vec![0.0_f64; TIMED];
        cases.push(Case::new(move || {
            for (y, &x) in y.iter_mut().zip(black_box(x)) {
                *y = function.exact(f64::from(x));
            }
            black_box(&mut y);
        }));
        let seconds = interleaved(bench.effort, &mut cases);
        let of_std = seconds[levels.len()];
        let domain: Vec<f32> = arguments.iter().copied().filter(|x| !positive || *x > 0.0).collect();
        let exact: Vec<f64> = domain.iter().map(|&x| function.exact(f64::from(x))).collect();
        for (k, seconds) in seconds.iter().enumerate() {
            let rate = TIMED as f64 / seconds;
            let (version, error, stated) = match levels.get(k) {
                Some(&simd) => {
                    let (error, stated) = (function.worst(simd, &domain, &exact).ulp, function.bound(simd.level()));
                    (level_name(simd.level()), Cell::from(error), Cell::from(stated))
                }
                None if k == levels.len() => {
                    let worst = domain.iter().zip(&exact).map(|(&x, &exact)| ulp(function.plain(x), exact));
                    // `sin(pi * x)` overflows before the sine is taken.
                    let worst = worst.fold(0.0, f64::max);
                    let cell = if worst.is_finite() { Cell::from(worst) } else { "overflows".into() };
                    ("std f32", cell, Cell::Missing)
                }
                None => ("std f64, rounded", Cell::from(0.5), Cell::Missing),
            };
            if let Cell::Number(error) = error
                && k < points
            {
                series[k].points.push((seconds / TIMED as f64 * 1e9, error.max(0.1)));
            }
            let name = function.name();
            table.row([name.into(), version.into(), (rate * 1e-6).into(), (of_std / seconds).into(), error, stated])?;
        }
    }
    // A cloud for each version: neighbours on a line would be neighbours in the list only.
    series.iter_mut().for_each(|s| s.style = Style::Cross);
    let plot = Plot {
        name: "time",
        title: "Functions: time against largest error".into(),
        x: Axis { label: "nanoseconds a value, one thread", scale: Scale::Log },
        y: Axis { label: "largest error, ulp", scale: Scale::Log },
        series,
    };
    Ok(Section {
        title: "Fast and exact functions",
        intro: "Each vector function at every level of this CPU, beside the standard library in f32 and in f64.",
        items: vec![Item::Plot(plot), Item::Table(table)],
        goals: Vec::new(),
    })
}

/// Finite numbers of both signs, every `step`th bit pattern.
fn arguments(step: usize) -> Vec<f32> {
    (0..f32::INFINITY.to_bits()).step_by(step).flat_map(|bits| [f32::from_bits(bits), -f32::from_bits(bits)]).collect()
}

/// Distance in units in the last place of `want`, of the smallest normal number below it. Values that `f32` does not
/// hold count as right when they are infinite.
fn ulp(got: f32, want: f64) -> f64 {
    let near = (want.abs() as f32).max(f32::MIN_POSITIVE);
    if !near.is_finite() || got.is_nan() {
        return if got == want as f32 || (got.is_nan() && want.is_nan()) { 0.0 } else { f64::INFINITY };
    }
    (f64::from(got) - want).abs() / (f64::from(near.next_up()) - f64::from(near))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ulps_count_numbers_in_between() {
        assert_eq!(ulp(1.0_f32.next_up(), 1.0), 1.0);
        assert_eq!(ulp(1.0, 1.0), 0.0);
        assert_eq!(ulp(f32::INFINITY, 1e300), 0.0);
        assert!(ulp(f32::NAN, 1.0).is_infinite());
        assert!(arguments(400_009).len() > 10_000 && arguments(400_009).iter().all(|x| x.is_finite()));
    }
}
