//! Check a pair of your own: the weight of one interval, `w = 1 - exp(-sigma dt)`, and its derivative.
//!
//! Run with `cargo run -p wildfield-testkit --example own_pair`. The same functions, called from `#[test]`s, make a test suite.

use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_kinked, check_pair, cotangent};
use testkit::strategies::{any_densities, any_edges};

/// The pair under test, in `f32`. Inputs `x = [sigma, dt]` of all intervals, output `w`, all feature-major.
fn weight(x: &[f32], w: &mut [f32]) {
    let (sigma, dt) = x.split_at(w.len());
    for (i, w) in w.iter_mut().enumerate() {
        *w = -(-sigma[i] * dt[i]).exp_m1();
    }
}

/// Adds to `x_bar`: `dw / dsigma = dt exp(-sigma dt)`, `dw / ddt = sigma exp(-sigma dt)`.
fn weight_backward(x: &[f32], w_bar: &[f32], x_bar: &mut [f32]) {
    let n = w_bar.len();
    for i in 0..n {
        let (sigma, dt) = (x[i], x[n + i]);
        let trans = (-sigma * dt).exp();
        x_bar[i] += w_bar[i] * dt * trans;
        x_bar[n + i] += w_bar[i] * sigma * trans;
    }
}

/// The specification: the same in `f64`, from the definition.
fn weight_twin(x: &[f64], w: &mut [f64]) {
    let (sigma, dt) = x.split_at(w.len());
    for (i, w) in w.iter_mut().enumerate() {
        *w = 1.0 - (-sigma[i] * dt[i]).exp();
    }
}

fn weight_backward_twin(x: &[f64], w_bar: &[f64], x_bar: &mut [f64]) {
    let n = w_bar.len();
    for i in 0..n {
        let (sigma, dt) = (x[i], x[n + i]);
        x_bar[i] += w_bar[i] * dt * (-sigma * dt).exp();
        x_bar[n + i] += w_bar[i] * sigma * (-sigma * dt).exp();
    }
}

fn main() {
    // 1. At one point: the f32 pair against its twin, the twin against central differences.
    let x = [0.5, 3.0, 0.0, 0.2, 0.01, 1.0];
    let w_bar: Vec<f32> = cotangent(3, 7).iter().map(|&b| b as f32).collect();
    let single = (weight, weight_backward);
    let twin = (weight_twin, weight_backward_twin);
    check_f32_pair(&x, &w_bar, single, twin, PairTolerances::default()).expect("weight is a right pair");
    println!("right pair: passed");

    // 2. On what the strategies come up with: empty and one-ulp intervals, densities from 0 to 1e30.
    //    (In a `#[test]` the macro `proptest!` does this; here nobody shall write files of failed cases.)
    let config = ProptestConfig { failure_persistence: None, ..testkit::property::cases(256) };
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let intervals = (0..16_usize).prop_flat_map(|n| (any_edges(n), any_densities(n)));
    let result = runner.run(&intervals, |(t, sigma)| {
        let dt = t.windows(2).map(|t| t[1] - t[0]);
        let x: Vec<f32> = sigma.iter().copied().chain(dt).collect();
        let mut w = vec![f32::NAN; sigma.len()];
        weight(&x, &mut w);
        prop_assert!(w.iter().all(|w| (0.0..=1.0).contains(w)), "{w:?}");
        let mut x_bar = vec![0.0; x.len()];
        weight_backward(&x, &vec![1.0; sigma.len()], &mut x_bar);
        prop_assert!(x_bar.iter().all(|g| g.is_finite()), "{x_bar:?}");
        Ok(())
    });
    result.expect("weights are in [0, 1] and gradients finite");
    println!("any densities on any intervals: passed");

    // 3. A mistake is found, and named.
    let forgets_dt = |x: &[f64], w_bar: &[f64], x_bar: &mut [f64]| {
        x_bar[0] += w_bar[0] * (-x[0] * x[1]).exp();
        x_bar[1] += w_bar[0] * x[0] * (-x[0] * x[1]).exp();
    };
    match check_pair(&[0.5, 0.2], &[1.0], weight_twin, forgets_dt, Tolerance::TWIN) {
        Err(mismatch) => println!("wrong pair: {mismatch}"),
        Ok(()) => unreachable!("a missing factor must be found"),
    }

    // 4. Corners: relu is 0 on the left, 1 on the right, and whatever lies between at 0. One of three may sit there.
    let relu = |x: &[f64], y: &mut [f64]| y.iter_mut().zip(x).for_each(|(y, x)| *y = x.max(0.0));
    let relu_backward = |x: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
        for i in 0..x.len() {
            x_bar[i] += if x[i] > 0.0 { y_bar[i] } else { 0.0 };
        }
    };
    let flips = check_kinked(&[-1.0, 0.0, 2.0], &cotangent(3, 1), relu, relu_backward, Tolerance::TWIN, 0.34)
        .expect("relu is right beside its corner");
    println!("kinked pair: passed, {} of {} at a corner", flips.flipped, flips.of);
}
