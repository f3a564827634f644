//! Errors of settings.

use engine::system::SystemError;
use std::fmt::Display;
use std::ops::RangeInclusive;

/// A setting that cannot be, and why.
pub(super) fn bad(field: &'static str, value: impl Display, problem: impl Into<String>) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.into() }
}

/// Refuse what is not in a range, and NaN.
pub(super) fn in_range<T: PartialOrd + Display>(
    field: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), SystemError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(bad(field, value, format!("must be in {}..={}", range.start(), range.end())))
}

/// What an encoding or a network refuses of settings that were checked.
pub(super) fn refuse(field: &'static str, value: impl Display, e: impl Display) -> SystemError {
    bad(field, value, e.to_string())
}
