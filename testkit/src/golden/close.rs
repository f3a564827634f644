//! Comparing tensors.

/// Anything that is a number to compare in `f64`.
pub trait Number: Copy {
    /// As `f64`, exactly.
    fn to_f64(self) -> f64;
}

impl Number for f32 {
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Number for f64 {
    fn to_f64(self) -> f64 {
        self
    }
}

/// `Ok` if `|got - want| <= atol + rtol * max|want|` holds for every entry, with the maximum over the finite
/// values of the whole tensor. NaN is never close to anything, infinity only to itself.
///
/// # Errors
/// Says where it is worst: index, both values, difference and bound.
pub fn check_close<G: Number, W: Number>(got: &[G], want: &[W], rtol: f64, atol: f64) -> Result<(), String> {
    if got.len() != want.len() {
        return Err(format!("holds {} values, expected {}", got.len(), want.len()));
    }
    // Infinite wants stay out of the maximum: they would allow everything.
    let largest = want.iter().map(|w| w.to_f64().abs()).filter(|w| w.is_finite()).fold(0.0, f64::max);
    let bound = atol + rtol * largest;
    let mut worst: Option<(usize, f64)> = None;
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        let (g, w) = (g.to_f64(), w.to_f64());
        let difference = if g == w { 0.0 } else { (g - w).abs() };
        // Not `difference > bound`: a NaN has to fail.
        let close = difference <= bound;
        if !close && worst.is_none_or(|(_, d)| difference.is_nan() || difference > d) {
            worst = Some((i, difference));
        }
    }
    match worst {
        None => Ok(()),
        Some((i, d)) => Err(format!(
            "[{i}]: got {:e}, want {:e}, difference {d:.3e} > bound {bound:.3e} (rtol {rtol:e}, atol {atol:e})",
            got[i].to_f64(),
            want[i].to_f64()
        )),
    }
}

/// Assert that `got` is `want`: see [`check_close`] for the rule.
///
/// # Panics
/// With `what`, index, both values, difference and bound of the worst entry.
#[track_caller]
pub fn assert_close<G: Number, W: Number>(what: &str, got: &[G], want: &[W], rtol: f64, atol: f64) {
    if let Err(message) = check_close(got, want, rtol, atol) {
        panic!("{what} {message}");
    }
}
