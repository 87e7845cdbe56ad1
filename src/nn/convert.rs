//! Between tensors and Rust memory.

use tch::{Device, Kind, Tensor};

use crate::base::Rows;

/// Copies rows ordered agent-major into a tensor `[agents, rows / agents, width]`.
pub fn rows_to_tensor(rows: &Rows<f32>, agents: usize) -> Tensor {
    assert_eq!(rows.len() % agents, 0, "{} rows for {agents} agents", rows.len());
    let shape = [agents as i64, (rows.len() / agents) as i64, rows.width() as i64];
    Tensor::of_slice(rows.as_slice()).view(&shape[..])
}

/// The values of a contiguous f32 tensor on the CPU, in place.
pub fn tensor_to_slice(tensor: &Tensor) -> &[f32] {
    let (pointer, len) = storage(tensor);
    // SAFETY: `storage` checked that `len` f32 values are contiguous there; the borrow of `tensor` keeps them alive.
    unsafe { std::slice::from_raw_parts(pointer, len) }
}

/// The values of a contiguous f32 tensor on the CPU, to be written in place.
///
/// Takes the tensor mutably because `tch` lets shared handles write: whoever owns it must hold no other handle to its
/// storage while the slice lives. The owners in this room are [`super::Parameters`] and freshly made tensors.
pub(super) fn tensor_to_slice_mut(tensor: &mut Tensor) -> &mut [f32] {
    let (pointer, len) = storage(tensor);
    // SAFETY: `storage` checked that `len` f32 values are contiguous there; the owner holds the only handle in use.
    unsafe { std::slice::from_raw_parts_mut(pointer, len) }
}

fn storage(tensor: &Tensor) -> (*mut f32, usize) {
    assert_eq!((tensor.kind(), tensor.device()), (Kind::Float, Device::Cpu), "not an f32 tensor on the CPU");
    let (shape, strides) = (tensor.size(), tensor.stride());
    let dense =
        (0..shape.len()).all(|axis| shape[axis] == 1 || strides[axis] == shape[axis + 1..].iter().product::<i64>());
    assert!(dense, "a tensor that is not contiguous: {shape:?} with strides {strides:?}");
    (tensor.data_ptr().cast(), tensor.numel())
}
