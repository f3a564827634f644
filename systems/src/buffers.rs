//! Buffers that grow when they must and keep their memory.

use field_core::FieldError;

/// The first `n` numbers of a buffer.
pub(crate) fn sized(buffer: &mut Vec<f32>, n: usize) -> &mut [f32] {
    if buffer.len() < n {
        buffer.resize(n, 0.0);
    }
    &mut buffer[..n]
}

/// A result that cannot be an error: the callers cut buffers to the shapes of the field.
pub(crate) fn shapes_hold(result: Result<(), FieldError>) {
    result.expect("buffers are cut to the shapes of the field");
}
