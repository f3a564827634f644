//! Numbers that are not what they should be.

/// A number that is not what it should be.
pub(crate) struct Wrong {
    pub(crate) what: &'static str,
    pub(crate) got: f64,
    pub(crate) want: f64,
}

/// `|got - want| <= tolerance * (1 + |want|)`; NaN is wrong.
pub(crate) fn near(what: &'static str, got: impl Into<f64>, want: impl Into<f64>, tolerance: f64) -> Result<(), Wrong> {
    let (got, want) = (got.into(), want.into());
    if (got - want).abs() <= tolerance * (1.0 + want.abs()) { Ok(()) } else { Err(Wrong { what, got, want }) }
}
