//! Peak speed of matrix products on this machine.

use std::time::Duration;

use super::flops::{SIDE, fastest};
use super::product::{Before, Matrix, multiply};

/// Peak speed of matrix products on this machine, in floating-point operations per second on one thread.
///
/// With [`Shape::forward_flops`](crate::Shape::forward_flops) and [`Shape::backward_flops`](crate::Shape::backward_flops)
/// it gives a lower bound for the time of a training.
#[derive(Clone, Copy, Debug)]
pub struct Peak {
    /// Speed of the products that this crate uses.
    pub ours: f64,
    /// Speed of libtorch, which most software of this kind uses; `None` in a build without the feature `torch`.
    pub libtorch: Option<f64>,
}

impl Peak {
    /// Measures products of 1024 x 1024 x 1024 in f32: the fastest of those that fit into `time`.
    pub fn measure(time: Duration) -> Peak {
        let matrix = vec![0.5; SIDE * SIDE];
        let mut product = vec![0.0; SIDE * SIDE];
        let square = Matrix::new(&matrix, SIDE);
        let ours = fastest(time / 2, || multiply(square, square, &mut product, Before::Overwrite));
        #[cfg(feature = "torch")]
        let libtorch = Some(super::yardstick::libtorch_peak(time / 2));
        #[cfg(not(feature = "torch"))]
        let libtorch = None;
        Peak { ours, libtorch }
    }
}
