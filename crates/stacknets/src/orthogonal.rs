//! Weights that begin orthogonal: a layer then changes no length and no angle, but by its gain.
//!
//! Source: Saxe et al. 2014; as `torch.nn.init.orthogonal_`: signs and directions are uniform.

use rand::Rng;
use rand_distr::StandardNormal;

/// By how much layers lengthen what goes through them at first.
#[derive(Clone, Debug)]
pub struct Gains {
    /// The gain of every hidden layer. A GRU always has 1.
    pub hidden: f32,
    /// The gain of each output, in order.
    pub outputs: Vec<f32>,
}

/// Fills a weight of `columns` columns with orthogonal columns of length 1. If it has more columns than rows, its rows are
/// orthogonal, and of length 1.
pub(crate) fn fill<R: Rng>(weight: &mut [f32], columns: usize, generator: &mut R) {
    let rows = weight.len() / columns;
    let (count, length) = (columns.min(rows), columns.max(rows));
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    for _ in 0..count {
        let mut vector: Vec<f64> = (0..length).map(|_| generator.sample(StandardNormal)).collect();
        // Twice: what the first time leaves of the others is rounding.
        for _ in 0..2 {
            for other in &basis {
                let shadow: f64 = vector.iter().zip(other).map(|(a, b)| a * b).sum();
                vector.iter_mut().zip(other).for_each(|(a, b)| *a -= shadow * b);
            }
        }
        let size = vector.iter().map(|value| value * value).sum::<f64>().sqrt();
        vector.iter_mut().for_each(|value| *value /= size);
        basis.push(vector);
    }
    for (index, value) in weight.iter_mut().enumerate() {
        let (row, column) = (index / columns, index % columns);
        *value = if rows >= columns { basis[column][row] } else { basis[row][column] } as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::dice;
    use crate::{Shape, Stack};

    #[test]
    fn the_shorter_side_is_orthonormal() {
        for (rows, columns) in [(5, 3), (3, 5), (4, 4), (1, 6), (6, 1)] {
            let mut weight = vec![0.0; rows * columns];
            fill(&mut weight, columns, &mut dice(1));
            let line = |which: usize| -> Vec<f32> {
                if rows >= columns {
                    weight.iter().skip(which).step_by(columns).copied().collect()
                } else {
                    weight[which * columns..][..columns].to_vec()
                }
            };
            for (one, other) in (0..rows.min(columns)).flat_map(|one| (0..=one).map(move |other| (one, other))) {
                let product: f32 = line(one).iter().zip(line(other)).map(|(a, b)| a * b).sum();
                let expected = if one == other { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < 1e-6, "{rows} x {columns}: {one}, {other}: {product}");
            }
        }
    }

    #[test]
    fn layers_have_their_gains_each_output_its_own_and_no_bias_begins_with_anything() {
        for apart in [0, 1] {
            let shape = Shape { inputs: 8, recurrent: Some(4), hidden: vec![6], outputs: 3, apart, sets: None };
            let gains = Gains { hidden: 1.5, outputs: vec![0.01, 0.01, 2.0] };
            let stack = Stack::orthogonal(shape, &gains, [dice(3), dice(4)]);
            let rows = stack.parameters().values();
            assert!(rows.row(0) != rows.row(1));
            let length = |block: &str, column: usize| {
                let mut blocks = stack.parameters().layout().blocks(1);
                let (_, shape, place) = blocks.find(|(name, ..)| *name == block).unwrap();
                let column = rows.row(0)[place].iter().skip(column).step_by(shape[2]);
                column.map(|value| value * value).sum::<f32>().sqrt()
            };
            let value = if apart == 1 { ("critic.layers.1.weight", 0) } else { ("layers.1.weight", 2) };
            for ((block, column), expected) in [
                (("layers.1.weight", 0), 0.01),
                (("layers.1.weight", 1), 0.01),
                (value, 2.0),
                (("layers.0.bias", 0), 0.0),
            ] {
                assert!((length(block, column) - expected).abs() < 1e-6, "{block}");
            }
            // 4 rows and 6 columns: the rows have length 1.5, so all squares are 4 x 2.25.
            let squares: f32 = (0..6).map(|column| length("layers.0.weight", column).powi(2)).sum();
            assert!((squares - 9.0).abs() < 1e-4, "{squares}");
            let of_gru: f32 = (0..12).map(|column| length("gru.input_weight", column).powi(2)).sum();
            assert!((of_gru - 8.0).abs() < 1e-4, "{of_gru}");
        }
    }
}
