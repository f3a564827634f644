//! What is wrong with golden values.

use std::fmt;

/// What went wrong while a golden file was read: where in the file, and what.
#[derive(Debug)]
pub struct GoldenError(String);

impl fmt::Display for GoldenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for GoldenError {}

pub(super) fn error<T>(what: impl Into<String>) -> Result<T, GoldenError> {
    Err(GoldenError(what.into()))
}
