//! Measured orders of convergence: each rule and sampler on densities whose pixel is known.

use convergence::{Method, Row, Sampler, Study, order};
use testkit::analytic::{Density, Field, integrate};

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
    // Compositing asks for lengths and not for places: left points of `[near, far]` are the mid-points of bins that begin
    // half a step earlier. Where the density is nothing at both ends those cover the same field: the second order.
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
    // Left points: a shift by a mean of 7/12 steps, which costs O(h) where the density does not end; and O(h^2) at random
    // for each of n samples, O(n^-3/2), which is all that is left where it does.
    check_order("fog", Method::LeftPoint, Sampler::Stratified, &MIDDLE, 0.8..1.3);
    check_order("gaussian", Method::LeftPoint, Sampler::Stratified, &MIDDLE, 1.2..1.8);
    // Joined, each interval is off by O(h^3) only, always to the same side: the mean of `dt^3` is larger, the order stays.
    for method in [Method::Trapezoid, Method::PiecewiseLinear] {
        check_order("gaussian", method, Sampler::Stratified, &[16, 32, 64, 128], 1.7..2.5);
    }
}

/// NeRF's two passes, with bins of even weight and with linear density.
const TWO_PASSES: [Sampler; 2] = [Sampler::CoarseToFine, Sampler::CoarseToFineLinear];

/// Errors of two passes, of equal steps with as many samples, and of equal steps with those of the coarse pass only.
fn two_passes(name: &str, method: Method, sampler: Sampler, n: usize) -> [f64; 3] {
    let [fine, uniform] = [sampler, Sampler::Uniform].map(|s| rows(name, method, s, &[n])[0].error);
    let coarse = rows(name, method, Sampler::Uniform, &[n / 3])[0].error;
    println!("{name} {} {} {n}: {fine:.2e}, {uniform:.2e}, {coarse:.2e}", method.name(), sampler.name());
    [fine, uniform, coarse]
}

#[test]
fn two_passes_pay_on_a_surface_that_the_first_one_sees() {
    // Steps of the coarse pass are half of the surface's width, and all fine ones fall into it: shorter intervals where the
    // light comes from, at the second order.
    for sampler in TWO_PASSES {
        for method in [Method::Trapezoid, Method::PiecewiseLinear] {
            let [fine, uniform, _] = two_passes("surface", method, sampler, 192);
            assert!(fine < 0.4 * uniform, "{} {}: {fine:e}, uniform {uniform:e}", method.name(), sampler.name());
        }
    }
}

#[test]
fn two_passes_miss_what_the_first_one_does_not_see() {
    // A coarse step of 1/8 walks over the dense slab, 0.076 thick, on two rays of five; equal steps of 1/24 never do.
    for sampler in TWO_PASSES {
        for method in Method::ALL {
            let [fine, uniform, _] = two_passes("steps", method, sampler, 96);
            assert!(fine > 5.0 * uniform, "{} {}: {fine:e}, uniform {uniform:e}", method.name(), sampler.name());
        }
    }
}

#[test]
fn two_passes_do_not_pay_where_the_density_jumps() {
    // The interval that holds a jump has an empty side, where next to no fine samples fall: it stays about as long as the
    // coarse pass made it. Hence no better than equal steps by much, and no worse than the coarse pass alone.
    for name in ["slab", "steps"] {
        for sampler in TWO_PASSES {
            for method in Method::ALL {
                let [fine, uniform, coarse] = two_passes(name, method, sampler, 384);
                let what = format!("{name} {} {}: {fine:e}, {uniform:e}, {coarse:e}", method.name(), sampler.name());
                assert!(fine > 0.6 * uniform && fine < 1.2 * coarse, "{what}");
            }
        }
    }
}

#[test]
fn two_passes_keep_the_order_of_the_rule_on_smooth_densities() {
    // From where the coarse pass resolves the bumps.
    for sampler in TWO_PASSES {
        for method in [Method::Trapezoid, Method::PiecewiseLinear] {
            check_order("bumps", method, sampler, &[96, 192, 384, 768], 1.75..2.25);
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
fn a_line_between_samples_is_closer_where_intervals_are_dense() {
    // Few samples through thick fog: a trapezoid shines from the middle of the interval, light comes from the front of it.
    // Both have the error of the optical depth, `h^2 sigma'' / 12`, so that the better one is not better by much.
    let error = |method| rows("fog", method, Sampler::Uniform, &[16])[0].error;
    let (trapezoid, line) = (error(Method::Trapezoid), error(Method::PiecewiseLinear));
    println!("fog 16: trapezoid {trapezoid:.2e}, piecewise-linear {line:.2e}");
    assert!(line < trapezoid);
}

#[test]
fn errors_on_linear_density_are_their_leading_terms() {
    // Optical depths are exact then. A line adds what the colours curve, `h^2 / 12 int(T sigma c'')`; a trapezoid also what
    // the mean position of absorption is not the middle, `h^2 / 12 int(T (sigma^2 - sigma') c')`.
    let all = field("linear");
    let Density::Linear { slope, .. } = all.density else { panic!("not linear") };
    let n = 32;
    // Over the ends that rays have: each moved inwards by up to a sixteenth.
    let ends: Vec<[f64; 2]> = (0..16).map(|k| [k % 4, k / 4].map(|k| (f64::from(k) + 0.5) / 16.0)).collect();
    for channel in 0..3 {
        let colour = &all.colour[channel];
        let study = Field { colour: [colour.clone(), colour.clone(), colour.clone()], ..all.clone() };
        let mean_square = |term: &dyn Fn(f64) -> f64| {
            let one = |&[u, v]: &[f64; 2]| {
                let (near, far) = (all.span[0] + u, all.span[1] - v);
                let h = (far - near) / f64::from(n - 1);
                let trans = |t| (-all.density.depth(near, t)).exp();
                (h * h / 12.0 * integrate(near, far, 1e-12, |t| trans(t) * term(t))).powi(2)
            };
            (ends.iter().map(one).sum::<f64>() / ends.len() as f64).sqrt()
        };
        let derivative = |p: &[f64]| p.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c).collect::<Vec<f64>>();
        let (first, second) = (derivative(colour), derivative(&derivative(colour)));
        let at = |p: &[f64], t: f64| p.iter().rev().fold(0.0, |sum, c| sum * t + c);
        let curve = |t: f64| all.density.at(t) * at(&second, t);
        let place = |t: f64| (all.density.at(t).powi(2) - slope) * at(&first, t);
        let wanted = [
            (Method::PiecewiseLinear, mean_square(&curve)),
            (Method::Trapezoid, mean_square(&|t| curve(t) + place(t))),
        ];
        for (method, want) in wanted {
            let got = Study::default().measure(&study, method, Sampler::Uniform, n as usize).error;
            println!("linear, channel {channel} {}: {got:.3e}, leading term {want:.3e}", method.name());
            // The ends of the rays differ, and 3e-7 is where `f32` ends: all there is of the line on the linear channel.
            assert!((got - want).abs() < 0.05 * want + 3e-7, "channel {channel} {}: {got:e} {want:e}", method.name());
        }
    }
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
