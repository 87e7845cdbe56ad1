//! Peak speed of matrix products on this machine.

use std::time::Duration;

use super::flops::{SIDE, fastest_product};
use super::product::{Before, Matrix, multiply};

/// Returns the peak speed of this crate's matrix products on this machine, in floating-point operations per second on one
/// thread: that of products of 1024 x 1024 x 1024 in f32, the fastest of those that fit into `time`.
///
/// With [`Shape::forward_flops`](crate::Shape::forward_flops) and [`Shape::backward_flops`](crate::Shape::backward_flops)
/// it gives a lower bound for the time of a training.
pub fn peak(time: Duration) -> f64 {
    let matrix = vec![0.5; SIDE * SIDE];
    let mut product = vec![0.0; SIDE * SIDE];
    let square = Matrix::new(&matrix, SIDE);
    fastest_product(time, || multiply(square, square, &mut product, Before::Overwrite))
}
