//! Quadrature rules and samplers on densities whose pixels are known: time against error.

use crate::bench::Bench;
use crate::error::BenchError;
use crate::measure::median;
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::{Cell, Table};
use convergence::{Method, Row, Sampler, Study, order};
use testkit::analytic::Field;

/// Samples at which rules and samplers are compared in one number.
const AT: usize = 64;

/// Rows of a field, a sampler and a method, by number of samples.
struct Curve {
    field: &'static str,
    sampler: Sampler,
    method: Method,
    rows: Vec<(usize, Row)>,
}

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let wanted: &[&str] = bench.pick(&["bumps", "surface", "slab"], &FIELDS);
    let sizes: Vec<usize> = bench.pick(vec![8, 16, 32, 64, 128, 256], (3..=11).map(|k| 1 << k).collect());
    let study = Study { repeats: 5, simd: bench.simd, rays: bench.pick(64, 128), ..Study::default() };
    let mut curves = Vec::new();
    for field in Field::all().iter().filter(|f| wanted.contains(&f.name)) {
        for sampler in Sampler::ALL {
            for method in Method::ALL {
                curves.push((field.clone(), Curve { field: field.name, sampler, method, rows: Vec::new() }));
            }
        }
    }
    // Errors are the same in every round; the times of all take turns.
    let mut times = vec![Vec::new(); curves.len() * sizes.len()];
    for round in 0..bench.pick(1, 3) {
        for (k, (field, curve)) in curves.iter_mut().enumerate() {
            for (i, &n) in sizes.iter().enumerate() {
                let row = study.measure(field, curve.method, curve.sampler, n);
                times[k * sizes.len() + i].push(row.seconds);
                if round == 0 {
                    curve.rows.push((n, row));
                }
            }
        }
    }
    for (k, (_, curve)) in curves.iter_mut().enumerate() {
        for (i, (_, row)) in curve.rows.iter_mut().enumerate() {
            row.seconds = median(&mut times[k * sizes.len() + i]);
        }
    }
    let curves: Vec<Curve> = curves.into_iter().map(|(_, curve)| curve).collect();
    section(wanted, &curves)
}

/// Fields of the full run; each has a plot of its name.
const FIELDS: [&str; 8] = ["constant", "linear", "fog", "gaussian", "bumps", "surface", "slab", "steps"];

fn section(fields: &[&'static str], curves: &[Curve]) -> Result<Section, BenchError> {
    let mut orders = Table::new(
        "orders",
        "Order: the error falls as the number of samples to this power (least squares on the logarithms, from 16 samples on and \
         while the error is above 3e-7, where f32 ends). Error: root mean square over rays and channels. Samples count every question to the \
         field, in all passes.",
        &["field", "sampler", "rule", "order", "samples", "error", "largest", "us a ray"],
    );
    let mut points = Table::new(
        "points",
        "Every point.",
        &["field", "sampler", "rule", "samples", "us a ray", "error", "largest", "bias"],
    );
    for Curve { field, sampler, method, rows } in curves {
        let falling: Vec<Row> = rows.iter().filter(|(n, _)| *n >= 16).map(|(_, row)| row.clone()).collect();
        // No number where the error is that of rounding from the start.
        let order = Some(order(&falling)).filter(|o| o.is_finite());
        let head = || [Cell::from(*field), sampler.name().into(), method.name().into()];
        if let Some((_, row)) = rows.iter().find(|(n, _)| *n == AT) {
            let [a, b, c] = head();
            let Row { samples, error, worst, seconds, .. } = *row;
            orders.row([a, b, c, order.into(), samples.into(), error.into(), worst.into(), (seconds * 1e6).into()])?;
        }
        for (_, row) in rows {
            let [a, b, c] = head();
            let Row { samples, error, worst, bias, seconds, .. } = *row;
            points.row([a, b, c, samples.into(), (seconds * 1e6).into(), error.into(), worst.into(), bias.into()])?;
        }
    }
    let mut items = vec![Item::Table(orders)];
    for field in fields {
        items.push(Item::Plot(plot(field, curves, Against::Time)));
    }
    items.extend(fields.first().map(|_| Item::Plot(plot(fields[fields.len() / 2], curves, Against::Samples))));
    items.push(Item::Table(points));
    Ok(Section {
        title: "Quadrature and samplers",
        intro: "Rays through densities whose pixels are known to 1e-13: `bumps` is smooth, `surface` a thin dense bump, `slab` \
                jumps. The time is that of placing samples, the rule and compositing on one thread, without the field: where \
                that is a network, the number of samples is the time.",
        items,
        goals: Vec::new(),
    })
}

/// What stands on the x axis.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Against {
    Time,
    Samples,
}

/// The curves of a field that say most: all rules on even samples, all samplers with the rule that suits them best.
fn plot(field: &'static str, curves: &[Curve], against: Against) -> Plot {
    let of_field = || curves.iter().filter(|c| c.field == field);
    let error_at = |c: &Curve| c.rows.iter().find(|(n, _)| *n == AT).map_or(f64::INFINITY, |(_, row)| row.error);
    let mut shown: Vec<&Curve> = of_field().filter(|c| c.sampler == Sampler::Uniform).collect();
    for sampler in Sampler::ALL.into_iter().filter(|&s| s != Sampler::Uniform) {
        let own = of_field().filter(|c| c.sampler == sampler);
        shown.extend(own.min_by(|a, b| error_at(a).total_cmp(&error_at(b))));
    }
    let x = |row: &Row| if against == Against::Time { row.seconds * 1e6 } else { row.samples };
    let series = shown.iter().map(|c| {
        let points = c.rows.iter().map(|(_, row)| (x(row), row.error.max(1e-8))).collect();
        Series::line(format!("{}, {}", c.sampler.name(), c.method.name()), points)
    });
    let (name, label) = match against {
        Against::Time => (field, "microseconds a ray, one thread, without the field"),
        Against::Samples => ("samples", "samples a ray"),
    };
    Plot {
        name,
        title: format!("{field}: {} against error", if against == Against::Time { "time" } else { "samples" }),
        x: Axis { label, scale: Scale::Log },
        y: Axis { label: "RMS error, colour units", scale: Scale::Log },
        series: series.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_of_the_testkit_has_its_place() {
        assert_eq!(Field::all().iter().map(|f| f.name).collect::<Vec<_>>(), FIELDS);
    }

    #[test]
    fn a_measured_curve_becomes_a_row_with_its_order() {
        let field = &Field::all()[3];
        let study = Study { rays: 16, ..Study::default() };
        let method = Method::Trapezoid;
        let rows = [16, 32, 64].map(|n| (n, study.measure(field, method, Sampler::Uniform, n))).to_vec();
        let curve = Curve { field: field.name, sampler: Sampler::Uniform, method, rows };
        let section = section(&["gaussian"], &[curve]).unwrap();
        let Item::Table(orders) = &section.items[0] else { panic!("orders come first") };
        let csv = orders.csv();
        let order: f64 = csv.lines().nth(1).unwrap().split(',').nth(3).unwrap().parse().unwrap();
        assert!((1.7..2.4).contains(&order), "{csv}");
    }
}
