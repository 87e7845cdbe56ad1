//! Amount of arithmetic of a network, and the peak speed of this machine: the floor under its cost.

use std::time::{Duration, Instant};

use super::Shape;
use super::product::{Before, Matrix, multiply};
use super::sets::Sets;

impl Shape {
    /// Returns the floating-point operations in the matrix products of a forward pass, per row: a multiplication and an
    /// addition per weight. Biases and activations are not counted.
    ///
    /// Over sets: with as many items and choices as there is room for.
    pub fn forward_flops(&self) -> f64 {
        if let Some(sets) = self.sets {
            return 2.0 * self.weights_over_sets(&sets.layers(&self.hidden), sets);
        }
        let weights = |tower: &Shape| tower.input_weights() + tower.state_weights() + tower.layer_weights();
        2.0 * self.towers().iter().map(weights).sum::<usize>() as f64
    }

    /// Returns the operations of the gradients of all weights in sequences of `steps`, counted as in
    /// [`Shape::forward_flops`]: by every weight, and through every weight to the layer before it. Nothing flows to the
    /// inputs of the network nor to the state before the first step.
    pub fn backward_flops(&self, steps: usize) -> f64 {
        if let Some(sets) = self.sets {
            let layers = sets.layers(&self.hidden);
            let first = usize::from(self.hidden.len() > 1);
            return self.forward_flops() + 2.0 * self.weights_over_sets(&layers[first..], sets);
        }
        let of_tower = |tower: &Shape| {
            let first_layer = tower.layers().next().map_or(0, |(inputs, outputs)| inputs * outputs);
            let first = if tower.recurrent.is_none() { first_layer } else { 0 };
            let through_states = tower.state_weights() as f64 * (steps - 1) as f64 / steps as f64;
            tower.forward_flops() + 2.0 * ((tower.layer_weights() - first) as f64 + through_states)
        };
        self.towers().iter().map(of_tower).sum()
    }

    /// Returns the multiplications of these layers in a row: a layer runs for each item, each choice, or once.
    fn weights_over_sets(&self, layers: &[(&str, [usize; 2])], sets: Sets) -> f64 {
        let runs = |part: &str| match part {
            "items" => sets.items,
            "choices" => sets.choices,
            _ => 1,
        };
        layers.iter().map(|(part, [inputs, outputs])| (runs(part) * inputs * outputs) as f64).sum()
    }

    fn input_weights(&self) -> usize {
        3 * self.inputs * self.state_width()
    }

    fn state_weights(&self) -> usize {
        3 * self.state_width() * self.state_width()
    }

    fn layer_weights(&self) -> usize {
        self.layers().map(|(inputs, outputs)| inputs * outputs).sum()
    }
}

/// Side of the square matrices whose product shows the machine's peak speed.
pub const SIDE: usize = 1024;

/// Returns the peak speed of this crate's matrix products on this machine, in floating-point operations per second on one
/// thread: that of products of [`SIDE`] in f32, the fastest of those that fit into `time`.
///
/// With [`Shape::forward_flops`] and [`Shape::backward_flops`] it gives a lower bound for the time of a training.
pub fn peak(time: Duration) -> f64 {
    let matrix = vec![0.5; SIDE * SIDE];
    let mut product = vec![0.0; SIDE * SIDE];
    let square = Matrix::new(&matrix, SIDE);
    fastest_product(time, || multiply(square, square, &mut product, Before::Overwrite))
}

/// Returns the operations per second of the fastest product of [`SIDE`] among those that fit into `time`.
pub fn fastest_product(time: Duration, mut product: impl FnMut()) -> f64 {
    let begun = Instant::now();
    let mut fastest = f64::INFINITY;
    while begun.elapsed() < time || fastest.is_infinite() {
        let begun = Instant::now();
        product();
        fastest = fastest.min(begun.elapsed().as_secs_f64());
    }
    2.0 * (SIDE as f64).powi(3) / fastest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_products_of_small_networks_are_counted_by_hand() {
        let shape = Shape { inputs: 4, recurrent: None, hidden: vec![3], outputs: 2, apart: 0, sets: None };
        // Weights 4 x 3 + 3 x 2 = 18: forward 36. Gradients by the weights 36, through the last layer 2 x 6 = 12.
        assert_eq!((shape.forward_flops(), shape.backward_flops(1)), (36.0, 48.0));
        let shape = Shape { inputs: 4, recurrent: Some(2), hidden: vec![3], outputs: 1, apart: 0, sets: None };
        // Weights: inputs 4 x 6 = 24, states 2 x 6 = 12, layers 2 x 3 + 3 x 1 = 9, together 45: forward 90.
        // Backward in sequences of 4: 90, through the layers 2 x 9 = 18, through the states 2 x 12 x 3/4 = 18.
        assert_eq!((shape.forward_flops(), shape.backward_flops(4)), (90.0, 126.0));
        // Two towers of one output each cost twice as much as one.
        let apart = Shape { outputs: 2, apart: 1, ..shape };
        assert_eq!((apart.forward_flops(), apart.backward_flops(4)), (180.0, 252.0));
    }
}
