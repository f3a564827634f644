//! A checker that always passes is the worst bug: each check here is shown to fail on a wrong gradient.

use super::*;

/// `out = [x0 * x1, exp(x0), 3]`.
fn forward(x: &[f64], out: &mut [f64]) {
    out[0] = x[0] * x[1];
    out[1] = x[0].exp();
    out[2] = 3.0;
}

fn backward(x: &[f64], out_bar: &[f64], x_bar: &mut [f64]) {
    x_bar[0] += out_bar[0] * x[1] + out_bar[1] * x[0].exp();
    x_bar[1] += out_bar[0] * x[0];
}

fn forward32(x: &[f32], out: &mut [f32]) {
    out[0] = x[0] * x[1];
    out[1] = x[0].exp();
    out[2] = 3.0;
}

fn backward32(x: &[f32], out_bar: &[f32], x_bar: &mut [f32]) {
    x_bar[0] += out_bar[0] * x[1] + out_bar[1] * x[0].exp();
    x_bar[1] += out_bar[0] * x[0];
}

const X: [f64; 2] = [0.7, -3.0];
const BAR: [f64; 3] = [1.5, -0.5, 2.0];

#[test]
fn a_right_pair_passes() {
    check_pair(&X, &BAR, forward, backward, Tolerance::TWIN).unwrap();
    check_pair(&[], &[], |_, _| (), |_, _, _| (), Tolerance::TWIN).unwrap();
}

#[test]
fn every_kind_of_wrong_gradient_fails() {
    type Backward = fn(&[f64], &[f64], &mut [f64]);
    let wrong: [(&str, usize, Backward); 6] = [
        ("sign", 1, |x, b, g| {
            g[0] += b[0] * x[1] + b[1] * x[0].exp();
            g[1] -= b[0] * x[0];
        }),
        ("a term is missing", 0, |x, b, g| {
            g[0] += b[0] * x[1];
            g[1] += b[0] * x[0];
        }),
        ("one part in a million", 0, |x, b, g| {
            backward(x, b, g);
            g[0] += 1e-5;
        }),
        ("cotangent left out", 1, |x, b, g| {
            g[0] += b[0] * x[1] + b[1] * x[0].exp();
            g[1] += x[0];
        }),
        ("NaN", 0, |x, b, g| {
            backward(x, b, g);
            g[0] = f64::NAN;
        }),
        ("nothing", 0, |_, _, _| ()),
    ];
    for (what, index, backward) in wrong {
        let mismatch = check_pair(&X, &BAR, forward, backward, Tolerance::TWIN).expect_err(what);
        assert_eq!((mismatch.index, mismatch.of), (index, 2), "{what}: {mismatch}");
    }
}

#[test]
fn a_backward_that_writes_fails() {
    let writes = |x: &[f64], b: &[f64], g: &mut [f64]| {
        g.fill(0.0);
        backward(x, b, g);
    };
    let mismatch = check_pair(&X, &BAR, forward, writes, Tolerance::TWIN).unwrap_err();
    assert!(mismatch.what.contains("add"), "{mismatch}");
}

#[test]
fn an_output_that_is_not_written_fails() {
    let forgets = |x: &[f64], out: &mut [f64]| out[0] = x[0] * x[1];
    assert!(check_pair(&X, &BAR, forgets, backward, Tolerance::TWIN).is_err());
    // Unless it carries no cotangent.
    check_pair(&X, &[1.5, 0.0, 0.0], forgets, backward, Tolerance::TWIN).unwrap();
}

#[test]
fn the_message_holds_index_both_values_and_the_bound() {
    let wrong = |x: &[f64], b: &[f64], g: &mut [f64]| {
        backward(x, b, g);
        g[1] += 1.0;
    };
    let message = check_pair(&X, &BAR, forward, wrong, Tolerance::TWIN).unwrap_err().to_string();
    for part in ["[1]: got 2.0", "want 1.0", "difference 1.000e0 > bound 5.", "1 of 2 wrong"] {
        assert!(message.contains(part), "`{message}` lacks `{part}`");
    }
}

#[test]
fn f32_pairs_pass_when_right_and_fail_in_every_part() {
    let x = [0.7_f32, -3.0];
    let bar = [1.5_f32, -0.5, 2.0];
    let tolerances = PairTolerances::default();
    check_f32_pair(&x, &bar, (forward32, backward32), (forward, backward), tolerances).unwrap();

    let bad_forward = |x: &[f32], out: &mut [f32]| {
        forward32(x, out);
        out[1] *= 1.001;
    };
    let bad_backward = |x: &[f32], b: &[f32], g: &mut [f32]| {
        backward32(x, b, g);
        g[0] *= 1.001;
    };
    let bad_twin = |x: &[f64], b: &[f64], g: &mut [f64]| {
        backward(x, b, g);
        g[0] *= 1.000_01;
    };
    let writes = |x: &[f32], b: &[f32], g: &mut [f32]| {
        g.fill(0.0);
        backward32(x, b, g);
    };
    let what = |r: Result<(), Mismatch>| r.unwrap_err().what;
    assert_eq!(
        what(check_f32_pair(&x, &bar, (bad_forward, backward32), (forward, backward), tolerances)),
        "f32 forward against the twin"
    );
    assert_eq!(
        what(check_f32_pair(&x, &bar, (forward32, bad_backward), (forward, backward), tolerances)),
        "f32 backward against the twin"
    );
    assert_eq!(
        what(check_f32_pair(&x, &bar, (forward32, backward32), (forward, bad_twin), tolerances)),
        "backward against central differences"
    );
    assert_eq!(
        what(check_f32_pair(&x, &bar, (forward32, writes), (forward, backward), tolerances)),
        "backward must add into x_bar"
    );
}

#[test]
fn tangents_are_checked() {
    let right = |x: &[f64], d: &[f64], out: &mut [f64]| {
        out[0] = d[0] * x[1] + x[0] * d[1];
        out[1] = d[0] * x[0].exp();
        out[2] = 0.0;
    };
    check_tangent(&X, &[1e-3, 2e-3], 3, forward, right, Tolerance::TWIN).unwrap();
    check_tangent(&X, &[0.0, 0.0], 3, forward, right, Tolerance::TWIN).unwrap();
    let wrong = |x: &[f64], d: &[f64], out: &mut [f64]| {
        right(x, d, out);
        out[0] -= x[0] * d[1];
    };
    assert_eq!(check_tangent(&X, &[1.0, 2.0], 3, forward, wrong, Tolerance::TWIN).unwrap_err().index, 0);
}

fn relu(x: &[f64], out: &mut [f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = x.max(0.0);
    }
}

fn relu_backward(x: &[f64], out_bar: &[f64], x_bar: &mut [f64]) {
    for ((x, b), g) in x.iter().zip(out_bar).zip(x_bar) {
        *g += if *x > 0.0 { *b } else { 0.0 };
    }
}

#[test]
fn kinks_are_excused_up_to_the_share() {
    // The second entry is on the corner, the third within a step of it.
    let x = [1.0, 0.0, 1e-7, -2.0];
    let bar = [1.0, 2.0, -1.0, 1.0];
    assert!(check_pair(&x, &bar, relu, relu_backward, Tolerance::TWIN).is_err());
    let flips = check_kinked(&x, &bar, relu, relu_backward, Tolerance::TWIN, 0.5).unwrap();
    assert_eq!(flips, Flips { flipped: 2, of: 4 });
    let mismatch = check_kinked(&x, &bar, relu, relu_backward, Tolerance::TWIN, 0.49).unwrap_err();
    assert!(mismatch.what.contains("too many") && mismatch.wrong == 2, "{mismatch}");
}

#[test]
fn wrong_gradients_are_not_excused_as_kinks() {
    let bar = [1.0, 1.0];
    // Wrong where the function is smooth.
    let wrong = |x: &[f64], b: &[f64], g: &mut [f64]| {
        relu_backward(x, b, g);
        g[1] += 0.5;
    };
    let mismatch = check_kinked(&[0.0, 3.0], &bar, relu, wrong, Tolerance::TWIN, 1.0).unwrap_err();
    assert_eq!(mismatch.index, 1, "{mismatch}");
    // At the corner, but not between the two slopes.
    let outside = |_: &[f64], b: &[f64], g: &mut [f64]| g[0] += -0.5 * b[0];
    assert!(check_kinked(&[0.0], &[1.0], relu, outside, Tolerance::TWIN, 1.0).is_err());
}

#[test]
fn flips_are_counted_and_limited() {
    let want: Vec<f64> = (0..100).map(f64::from).collect();
    let mut got = want.clone();
    got[7] = 8.0;
    got[50] = 0.0;
    let tolerance = Tolerance::new(1e-6, 0.0);
    assert_eq!(check_with_flips("cells", &got, &want, tolerance, 0.02).unwrap(), Flips { flipped: 2, of: 100 });
    let mismatch = check_with_flips("cells", &got, &want, tolerance, 0.019).unwrap_err();
    assert_eq!((mismatch.index, mismatch.wrong), (50, 2));
    got[0] = f64::NAN;
    assert!(check_with_flips("cells", &got, &want, tolerance, 0.02).is_err());
}

#[test]
fn cotangents_are_reproducible_exact_and_not_small() {
    let a = cotangent(500, 3);
    assert_eq!(a, cotangent(500, 3));
    assert_ne!(a, cotangent(500, 4));
    assert!(a.iter().all(|x| (0.125..=2.0).contains(&x.abs()) && f64::from(*x as f32) == *x));
    assert!(a.iter().filter(|x| **x > 0.0).count() > 200 && a.iter().filter(|x| **x < 0.0).count() > 200);
}

#[test]
fn central_differences_match_known_slopes() {
    let slopes = central_difference(&[2.0, 1e6], |x| x[0].powi(3) + 2.0 * x[1]);
    assert!((slopes[0] - 12.0).abs() < 1e-4 && (slopes[1] - 2.0).abs() < 1e-6, "{slopes:?}");
}
