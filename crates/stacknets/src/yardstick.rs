//! The speed of libtorch's matrix products in one thread, to compare with ours.

use std::time::Duration;

use tch::{Device, Kind, Tensor};

use super::flops::{SIDE, fastest};

/// Returns the operations per second of libtorch's products at their best.
pub(crate) fn libtorch_peak(time: Duration) -> f64 {
    tch::set_num_threads(1);
    let size = [SIDE as i64, SIDE as i64];
    let tensor = Tensor::rand(&size, (Kind::Float, Device::Cpu));
    let out = Tensor::empty(&size, (Kind::Float, Device::Cpu));
    fastest(time, || drop(tensor.matmul_out(&out, &tensor)))
}
