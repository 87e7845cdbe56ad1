//! The product at the heart of every layer: `bias + inputs x weight`, agent by agent.

use multiversion::multiversion;
use tch::{Device, Kind, Tensor};

use super::Parameters;
use super::convert::{tensor_to_slice, tensor_to_slice_mut};

/// `bias + inputs x weight` for every agent. `inputs`: `[agents, rows, in]`; the weight is block `weight` of the
/// parameters, `[in, out]`, and the bias the block `bias`, `[1, out]`. Returns `[agents, rows, out]`.
///
/// BLAS copies a matrix before it multiplies, which pays for many rows but takes five times as long as the product
/// itself for one. And one row per agent is what acting on the GS asks for, in collection, evaluation and training.
pub fn affine(parameters: &Parameters, inputs: &Tensor, weight: usize, bias: usize) -> Tensor {
    if inputs.size()[1] > 1 {
        return parameters.view(bias).baddbmm(inputs, &parameters.view(weight), 1, 1);
    }
    let (weight, bias) = (parameters.block_range(weight), parameters.block_range(bias));
    let (agents, width) = (parameters.agents(), bias.len());
    let mut out = Tensor::empty(&[agents as i64, 1, width as i64], (Kind::Float, Device::Cpu));
    let inputs = inputs.contiguous(); // a step of a sequence is a view with gaps
    let inputs = tensor_to_slice(&inputs).chunks_exact(weight.len() / width);
    let rows = parameters.values().chunks_exact(parameters.width());
    for ((row, input), out) in rows.zip(inputs).zip(tensor_to_slice_mut(&mut out).chunks_exact_mut(width)) {
        out.copy_from_slice(&row[bias.clone()]);
        add_product(input, &row[weight.clone()], out);
    }
    out
}

/// Adds `input x weight` to `out`, four rows of the weight in one pass.
#[multiversion(targets("x86_64+avx2"))]
fn add_product(input: &[f32], weight: &[f32], out: &mut [f32]) {
    let width = out.len();
    let (fours, rest) = input.as_chunks::<4>();
    let (many, few) = weight.split_at(4 * fours.len() * width);
    for (x, rows) in fours.iter().zip(many.chunks_exact(4 * width)) {
        let (first, second) = rows.split_at(2 * width);
        let ((a, b), (c, d)) = (first.split_at(width), second.split_at(width));
        for ((out, (a, b)), (c, d)) in out.iter_mut().zip(a.iter().zip(b)).zip(c.iter().zip(d)) {
            *out += (x[0] * a + x[1] * b) + (x[2] * c + x[3] * d);
        }
    }
    for (x, row) in rest.iter().zip(few.chunks_exact(width)) {
        out.iter_mut().zip(row).for_each(|(out, weight)| *out += x * weight);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Seed;
    use crate::nn::Layout;
    use rand::Rng;

    #[test]
    fn one_row_and_the_first_of_two_give_the_same_product() {
        for inputs in [3, 4, 37, 256] {
            let blocks = [("w".to_owned(), vec![inputs, 19]), ("b".to_owned(), vec![1, 19])];
            let mut parameters = Parameters::new(2, Layout::new(blocks.to_vec()));
            let mut dice = Seed::new(1).dice();
            parameters.values_mut().iter_mut().for_each(|value| *value = dice.random_range(-1.0..1.0));
            let two: Vec<f32> = (0..2 * 2 * inputs).map(|_| dice.random_range(-1.0..1.0)).collect();
            let one: Vec<f32> = two.chunks(2 * inputs).flat_map(|rows| &rows[..inputs]).copied().collect();
            let shaped = |values: &[f32], rows: i64| Tensor::of_slice(values).view([2, rows, inputs as i64]);
            let own = affine(&parameters, &shaped(&one, 1), 0, 1);
            let blas = affine(&parameters, &shaped(&two, 2), 0, 1);
            for (own, blas) in tensor_to_slice(&own).chunks(19).zip(tensor_to_slice(&blas).chunks(2 * 19)) {
                assert!(own.iter().zip(blas).all(|(a, b)| (a - b).abs() < 1e-5), "{inputs} inputs");
            }
        }
    }
}
