//! Buffers that one pass after another works in, without new memory.

/// Returns the buffer with this length. Its contents are undefined.
pub(crate) fn resized(buffer: &mut Vec<f32>, length: usize) -> &mut [f32] {
    buffer.resize(length, 0.0);
    buffer
}
