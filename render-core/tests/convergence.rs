//! Measured orders of convergence: each rule and sampler on densities whose pixel is known.

use testkit::analytic::Field;
use testkit::convergence::{Method, Row, Sampler, Study, order};

fn field(name: &str) -> Field {
    Field::all().into_iter().find(|f| f.name == name).unwrap_or_else(|| panic!("no field {name}"))
}

fn rows(name: &str, method: Method, sampler: Sampler, samples: &[usize]) -> Vec<Row> {
    let field = field(name);
    samples.iter().map(|&n| Study::default().measure(&field, method, sampler, n)).collect()
}

#[track_caller]
fn check_order(name: &str, method: Method, sampler: Sampler, samples: &[usize], want: std::ops::Range<f64>) {
    let rows = rows(name, method, sampler, samples);
    let got = order(&rows);
    let errors: Vec<String> = rows.iter().map(|r| format!("{:.0}: {:.2e}", r.samples, r.error)).collect();
    println!("{name} {} {}: order {got:.2}, errors {errors:?}", method.name(), sampler.name());
    assert!(want.contains(&got), "{name} {} {}: order {got:.3}, errors {errors:?}", method.name(), sampler.name());
}

/// Where the asymptotic order shows and `f32` does not yet end it.
const MIDDLE: [usize; 4] = [32, 64, 128, 256];

#[test]
fn the_left_point_rule_is_of_the_first_order() {
    for name in ["constant", "linear", "fog"] {
        check_order(name, Method::LeftPoint, Sampler::Uniform, &MIDDLE, 0.9..1.15);
    }
    // Of the second where the density is nothing at both ends: its samples are then those of the trapezoids.
    check_order("gaussian", Method::LeftPoint, Sampler::Uniform, &MIDDLE, 1.75..2.5);
}

#[test]
fn mid_points_trapezoids_and_lines_are_of_the_second_order_on_smooth_densities() {
    for name in ["constant", "linear", "fog", "gaussian", "bumps"] {
        for method in [Method::MidPoint, Method::Trapezoid, Method::PiecewiseLinear] {
            check_order(name, method, Sampler::Uniform, &[16, 32, 64, 128], 1.75..2.5);
        }
    }
}

#[test]
fn every_rule_is_of_the_first_order_where_the_density_jumps() {
    for name in ["slab", "steps"] {
        for method in Method::ALL {
            check_order(name, method, Sampler::Uniform, &[128, 256, 512, 1024], 0.75..1.3);
        }
    }
}

#[test]
fn stratified_samples_in_bins_are_off_by_a_variance_of_the_third_order() {
    // Each bin is off by O(h^2) with random sign, so that n of them are off by O(h^2 sqrt(n)) = O(n^-3/2).
    for name in ["fog", "gaussian", "bumps"] {
        check_order(name, Method::MidPoint, Sampler::Stratified, &MIDDLE, 1.3..1.75);
    }
    // Where the density jumps only the bins with a jump are off by more: O(h).
    check_order("slab", Method::MidPoint, Sampler::Stratified, &[128, 256, 512, 1024], 0.75..1.3);
}

#[test]
fn stratified_samples_leave_the_order_of_the_rules_that_join_them() {
    check_order("fog", Method::LeftPoint, Sampler::Stratified, &MIDDLE, 0.8..1.3);
    check_order("gaussian", Method::LeftPoint, Sampler::Stratified, &MIDDLE, 1.2..1.8);
    for method in [Method::Trapezoid, Method::PiecewiseLinear] {
        check_order("gaussian", method, Sampler::Stratified, &[16, 32, 64, 128], 1.7..2.5);
    }
}

#[test]
fn two_passes_pay_where_a_dense_slab_is_seen_by_the_first() {
    for sampler in [Sampler::CoarseToFine, Sampler::CoarseToFineLinear] {
        for method in [Method::MidPoint, Method::Trapezoid, Method::PiecewiseLinear] {
            let error = |sampler| rows("steps", method, sampler, &[384])[0].error;
            let (uniform, fine) = (error(Sampler::Uniform), error(sampler));
            println!("steps {} {}: {fine:.2e}, uniform {uniform:.2e}", method.name(), sampler.name());
            assert!(fine < 0.7 * uniform, "{} {}: {fine:e}, uniform {uniform:e}", method.name(), sampler.name());
        }
    }
}

#[test]
fn two_passes_keep_the_order_of_the_rule_on_smooth_densities() {
    for sampler in [Sampler::CoarseToFine, Sampler::CoarseToFineLinear] {
        for method in [Method::Trapezoid, Method::PiecewiseLinear] {
            check_order("bumps", method, sampler, &MIDDLE, 1.4..2.6);
        }
    }
}

#[test]
fn marching_occupied_cells_gives_the_error_of_equal_steps_for_fewer_samples() {
    for name in ["surface", "slab"] {
        for method in Method::ALL {
            for n in [64, 128, 256] {
                let [all] = &rows(name, method, Sampler::Uniform, &[n])[..] else { panic!("one row") };
                let [some] = &rows(name, method, Sampler::Occupancy, &[n])[..] else { panic!("one row") };
                let what = format!(
                    "{name} {} {n}: {:.1} {:.2e}, {:.1} {:.2e}",
                    method.name(),
                    all.samples,
                    all.error,
                    some.samples,
                    some.error
                );
                println!("{what}");
                assert!(some.samples < 0.8 * all.samples, "{what}");
                // What the empty cells hide: 1e-4 of optical depth at most, times colours of at most 1. And a step more or
                // less meets the surface or the slab.
                assert!(some.error <= 3.0 * all.error + 1.5e-4, "{what}");
            }
        }
    }
}

#[test]
fn a_line_between_samples_is_worth_most_where_intervals_are_dense() {
    // Few samples through thick fog: a trapezoid shines from the middle of the interval, light comes from the front of it.
    let error = |method| rows("fog", method, Sampler::Uniform, &[16])[0].error;
    let (trapezoid, line) = (error(Method::Trapezoid), error(Method::PiecewiseLinear));
    println!("fog 16: trapezoid {trapezoid:.2e}, piecewise-linear {line:.2e}");
    assert!(line < trapezoid);
    // Linear density and colours of low degree: the line is right but for the curvature of the colours.
    let error = |method| rows("linear", method, Sampler::Uniform, &[16])[0].error;
    let (trapezoid, line) = (error(Method::Trapezoid), error(Method::PiecewiseLinear));
    println!("linear 16: trapezoid {trapezoid:.2e}, piecewise-linear {line:.2e}");
    assert!(line < 0.8 * trapezoid);
}

#[test]
fn rows_cover_everything_and_are_reproducible() {
    let study = Study { rays: 3, ..Study::default() };
    // Numbers, not times, are compared.
    let all = study.rows(16);
    assert_eq!(all.len(), Field::all().len() * Sampler::ALL.len() * Method::ALL.len() * 2);
    for (a, b) in all.iter().zip(study.rows(16)) {
        assert!(a.error.is_finite() && a.worst >= a.error && a.samples > 0.0 && a.seconds >= 0.0, "{a:?}");
        assert_eq!(
            (a.rule, a.sampler, a.density, a.samples, a.error),
            (b.rule, b.sampler, b.density, b.samples, b.error)
        );
    }
}
