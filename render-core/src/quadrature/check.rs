//! The boundary checks that the kernels leave out.

use core::fmt;

/// A value that must not reach the quadrature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadValue {
    /// Name of the array.
    pub what: &'static str,
    /// Where in it.
    pub index: usize,
    /// What is there.
    pub value: f32,
}

impl fmt::Display for BadValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, index, value } = self;
        let why = if value.is_finite() { "must not be negative" } else { "must be finite" };
        write!(f, "`{what}[{index}]` is {value}: it {why}")
    }
}

impl core::error::Error for BadValue {}

/// Every value is finite.
///
/// # Errors
/// [`BadValue`] with the first that is NaN or infinite.
pub fn check_finite(what: &'static str, values: &[f32]) -> Result<(), BadValue> {
    check(what, values, |x| x.is_finite())
}

/// Every value is finite and not negative: densities and optical depths.
///
/// # Errors
/// [`BadValue`] with the first that is NaN, infinite or negative.
pub fn check_density(what: &'static str, values: &[f32]) -> Result<(), BadValue> {
    check(what, values, |x| (0.0..f32::INFINITY).contains(&x))
}

fn check(what: &'static str, values: &[f32], good: impl Fn(f32) -> bool) -> Result<(), BadValue> {
    // Whole chunks first, without a branch inside: this runs over every batch of a training step.
    for (chunk, part) in values.chunks(256).enumerate() {
        if !part.iter().fold(true, |all, &x| all & good(x)) {
            let at = part.iter().position(|&x| !good(x)).unwrap_or(0);
            return Err(BadValue { what, index: chunk * 256 + at, value: part[at] });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    extern crate alloc;
    use super::*;
    use alloc::{string::ToString, vec};

    #[test]
    fn the_first_bad_value_is_named() {
        let mut x = vec![1.0_f32; 600];
        assert_eq!(check_finite("rgb", &x), Ok(()));
        x[513] = f32::NAN;
        x[514] = f32::INFINITY;
        let e = check_finite("rgb", &x).unwrap_err();
        assert_eq!((e.what, e.index), ("rgb", 513));
        assert_eq!(e.to_string(), "`rgb[513]` is NaN: it must be finite");
        x[2] = -1.0;
        assert_eq!(check_density("sigma", &x).unwrap_err().to_string(), "`sigma[2]` is -1: it must not be negative");
        assert_eq!(check_density("sigma", &[0.0, -0.0, f32::MAX]), Ok(()));
        assert!(check_density("sigma", &[f32::INFINITY]).is_err());
        assert_eq!(check_finite("none", &[]), Ok(()));
    }
}
