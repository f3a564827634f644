//! What settings of parts may be: an error names the setting, its value and what it must be.

use engine::system::SystemError;
use std::fmt::Display;
use std::ops::RangeInclusive;

/// What a part says of a value of a setting that nothing can be made of.
pub(crate) fn refusal(field: &'static str, value: impl Display, problem: impl Display) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.to_string() }
}

/// Refuse the value of a setting.
pub(crate) fn refuse<T>(
    field: &'static str,
    value: impl Display,
    problem: impl Into<String>,
) -> Result<T, SystemError> {
    Err(SystemError::Config { field, value: value.to_string(), problem: problem.into() })
}

/// The setting lies in `range`.
pub(crate) fn within<T: PartialOrd + Display>(
    field: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), SystemError> {
    if range.contains(&value) {
        return Ok(());
    }
    refuse(field, value, format!("must be in {}..={}", range.start(), range.end()))
}

/// The setting is positive and at most `most`.
pub(crate) fn above_0(field: &'static str, value: f32, most: f32) -> Result<(), SystemError> {
    if value > 0.0 && value <= most {
        return Ok(());
    }
    refuse(field, value, format!("must be above 0 and at most {most}"))
}

/// The setting is positive and finite.
pub(crate) fn positive<T: Into<f64> + Display + Copy>(field: &'static str, value: T) -> Result<(), SystemError> {
    let number: f64 = value.into();
    if number > 0.0 && number.is_finite() { Ok(()) } else { refuse(field, value, "must be positive and finite") }
}

/// The setting is finite and not negative.
pub(crate) fn at_least_0(field: &'static str, value: f32) -> Result<(), SystemError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { refuse(field, value, "must be at least 0 and finite") }
}

/// The setting, a count, is not 0.
pub(crate) fn at_least_1(field: &'static str, value: u64) -> Result<(), SystemError> {
    if value > 0 { Ok(()) } else { refuse(field, value, "must be at least 1") }
}

/// Largest factor of a loss, and largest learning rate relative to that of the field's networks.
pub(crate) const MOST: f32 = 1e3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_belong_to_what_is_accepted_and_numbers_that_are_not_do_not() {
        assert!(within("a", 0, 0..=3).is_ok() && within("a", 3, 0..=3).is_ok());
        assert!(above_0("a", MOST, MOST).is_ok() && positive("a", 3e38).is_ok() && at_least_1("a", 1).is_ok());
        assert!(at_least_0("a", 0.0).is_ok() && positive("a", 1e-300).is_ok());
        let refused = |result: Result<(), SystemError>| result.unwrap_err().to_string();
        assert_eq!(refused(within("a", 4, 0..=3)), "`a` = 4: must be in 0..=3");
        assert_eq!(refused(within("a", f32::NAN, 1e-6..=MOST)), "`a` = NaN: must be in 0.000001..=1000");
        assert_eq!(refused(above_0("a", 0.0, 1.0)), "`a` = 0: must be above 0 and at most 1");
        assert_eq!(refused(positive("a", f32::INFINITY)), "`a` = inf: must be positive and finite");
        assert_eq!(refused(at_least_1("a", 0)), "`a` = 0: must be at least 1");
        assert_eq!(refused(at_least_0("a", -1.0)), "`a` = -1: must be at least 0 and finite");
        assert_eq!(refused(at_least_0("a", f32::NAN)), "`a` = NaN: must be at least 0 and finite");
    }
}
