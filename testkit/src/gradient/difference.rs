//! Central differences in `f64`.

/// The step at `x`: `1e-6 * max(1, |x|)`. The error of a central difference is then about `1e-12 f'''` from the
/// neglected term and `1e-10 |f|` from rounding.
#[must_use]
pub fn step(x: f64) -> f64 {
    1e-6 * x.abs().max(1.0)
}

/// `df / dx[i]` for each `i`, as `(f(x + h) - f(x - h)) / 2h`.
#[must_use]
pub fn central_difference(x: &[f64], mut f: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    let mut moved = x.to_vec();
    let mut slope = |i: usize| {
        let (below, above) = (x[i] - step(x[i]), x[i] + step(x[i]));
        moved[i] = above;
        let f_above = f(&moved);
        moved[i] = below;
        let f_below = f(&moved);
        moved[i] = x[i];
        // The distance which was really travelled, after rounding.
        (f_above - f_below) / (above - below)
    };
    (0..x.len()).map(&mut slope).collect()
}

/// `J x_dot`: the derivative of every output along `x_dot`.
///
/// # Panics
/// If `x` and `x_dot` differ in length.
#[must_use]
pub fn directional_difference(
    x: &[f64],
    x_dot: &[f64],
    outputs: usize,
    mut forward: impl FnMut(&[f64], &mut [f64]),
) -> Vec<f64> {
    assert_eq!(x.len(), x_dot.len(), "x and x_dot differ in length");
    let longest = x_dot.iter().fold(0.0_f64, |m, d| m.max(d.abs())).max(1e-300);
    let h = x.iter().fold(1.0_f64, |m, x| m.max(x.abs())) * 1e-6 / longest;
    let mut at = |sign: f64| {
        let moved: Vec<f64> = x.iter().zip(x_dot).map(|(x, d)| x + sign * h * d).collect();
        let mut out = vec![f64::NAN; outputs];
        forward(&moved, &mut out);
        out
    };
    let (above, below) = (at(1.0), at(-1.0));
    above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * h)).collect()
}
