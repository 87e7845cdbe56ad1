//! The products at the heart of every layer, agent by agent: by BLAS for many rows, by loops of our own for few.
//!
//! BLAS copies a matrix into another order before it multiplies, which pays for many rows but costs more than the
//! product itself for a few. And few rows are what acting on the GS asks for (one per agent), and the recurrent half of a
//! GRU (one per sequence of a minibatch).
//!
//! Fused multiply-add rounds once and everywhere alike: where a machine lacks it, it is computed slowly and the same.

use multiversion::multiversion;
use tch::{Device, Kind, Tensor};

use super::Parameters;
use super::convert::{tensor_to_slice, tensor_to_slice_mut};

/// Up to so many rows per agent our loops are faster; measured for 256 x 768.
const FEW_ROWS: i64 = 6;
/// Numbers that are worked on at once.
const LANES: usize = 8;

/// `bias + inputs x weight` for every agent. `inputs`: `[agents, rows, in]`; the weight is block `weight` of the
/// parameters, `[in, out]`, and the bias the block `bias`, `[1, out]`. Returns `[agents, rows, out]`.
pub fn affine(parameters: &Parameters, inputs: &Tensor, weight: usize, bias: usize) -> Tensor {
    let rows = inputs.size()[1];
    if rows > FEW_ROWS {
        return parameters.view(bias).baddbmm(inputs, &parameters.view(weight), 1, 1);
    }
    let (weight, bias) = (parameters.block_range(weight), parameters.block_range(bias));
    let (agents, width) = (parameters.agents(), bias.len());
    let depth = weight.len() / width;
    let mut out = Tensor::empty(&[agents as i64, rows, width as i64], (Kind::Float, Device::Cpu));
    let inputs = inputs.contiguous(); // a step of a sequence is a view with gaps
    let inputs = tensor_to_slice(&inputs).chunks_exact(rows as usize * depth);
    let outs = tensor_to_slice_mut(&mut out).chunks_exact_mut(rows as usize * width);
    for ((of_agent, inputs), out) in parameters.values().chunks_exact(parameters.width()).zip(inputs).zip(outs) {
        out.chunks_exact_mut(width).for_each(|row| row.copy_from_slice(&of_agent[bias.clone()]));
        add_product(inputs, &of_agent[weight.clone()], out, depth, width);
    }
    out
}

/// `gradients x weight^T` for every agent: what flows back through the weight, block `weight` of the parameters.
/// `gradients`: `[agents, rows, out]`; returns `[agents, rows, in]`.
pub fn backwards(parameters: &Parameters, gradients: &Tensor, weight: usize) -> Tensor {
    let (rows, width) = (gradients.size()[1], gradients.size()[2] as usize);
    if rows > FEW_ROWS {
        return gradients.bmm(&parameters.view(weight).transpose(1, 2));
    }
    let (weight, agents) = (parameters.block_range(weight), parameters.agents());
    let depth = weight.len() / width;
    let mut out = Tensor::empty(&[agents as i64, rows, depth as i64], (Kind::Float, Device::Cpu));
    let gradients = gradients.contiguous();
    let gradients = tensor_to_slice(&gradients).chunks_exact(rows as usize * width);
    let outs = tensor_to_slice_mut(&mut out).chunks_exact_mut(rows as usize * depth);
    for ((of_agent, gradients), out) in parameters.values().chunks_exact(parameters.width()).zip(gradients).zip(outs) {
        write_transposed_product(gradients, &of_agent[weight.clone()], out, depth, width);
    }
    out
}

/// Adds `inputs x weight` to `out`: `[rows, depth]`, `[depth, width]`, `[rows, width]`. Four rows of the weight go by at
/// once, and are used for all rows while they are near.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_product(inputs: &[f32], weight: &[f32], out: &mut [f32], depth: usize, width: usize) {
    let whole = width / LANES * LANES;
    for (k, rows) in (0..depth).step_by(4).zip(weight.chunks(4 * width)) {
        if k + 4 > depth || whole < width {
            // What does not come in fours and eights.
            let from = if k + 4 > depth { 0 } else { whole };
            for (input, out) in inputs.chunks_exact(depth).zip(out.chunks_exact_mut(width)) {
                for (x, row) in input[k..].iter().zip(rows.chunks_exact(width)) {
                    let pairs = out[from..].iter_mut().zip(&row[from..]);
                    pairs.for_each(|(out, weight)| *out = x.mul_add(*weight, *out));
                }
            }
        }
        if k + 4 > depth {
            break;
        }
        let (first, second) = rows.split_at(2 * width);
        let ((a, b), (c, d)) = (first.split_at(width), second.split_at(width));
        let lanes = a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0);
        let lanes = lanes.zip(c.as_chunks::<LANES>().0.iter().zip(d.as_chunks::<LANES>().0));
        for (chunk, ((a, b), (c, d))) in lanes.enumerate() {
            for (input, out) in inputs.chunks_exact(depth).zip(out.chunks_exact_mut(width)) {
                let x: &[f32; 4] = input[k..k + 4].try_into().expect("four of them");
                let out = &mut out[chunk * LANES..(chunk + 1) * LANES];
                for lane in 0..LANES {
                    let sum = x[0].mul_add(a[lane], out[lane]);
                    let sum = x[1].mul_add(b[lane], sum);
                    let sum = x[2].mul_add(c[lane], sum);
                    out[lane] = x[3].mul_add(d[lane], sum);
                }
            }
        }
    }
}

/// Writes `gradients x weight^T` to `out`: `[rows, width]`, `[depth, width]`, `[rows, depth]`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn write_transposed_product(gradients: &[f32], weight: &[f32], out: &mut [f32], depth: usize, width: usize) {
    for (k, weights) in weight.chunks_exact(width).enumerate() {
        for (gradients, out) in gradients.chunks_exact(width).zip(out.chunks_exact_mut(depth)) {
            // Several sums at once: one alone would wait for itself.
            let mut sums = [[0.0_f32; LANES]; 4];
            let (blocks, _) = weights.as_chunks::<{ 4 * LANES }>();
            for (weights, gradients) in blocks.iter().zip(gradients.as_chunks::<{ 4 * LANES }>().0) {
                for (part, sums) in sums.iter_mut().enumerate() {
                    for (lane, sum) in sums.iter_mut().enumerate() {
                        *sum = weights[part * LANES + lane].mul_add(gradients[part * LANES + lane], *sum);
                    }
                }
            }
            let rest = blocks.len() * 4 * LANES;
            let mut sum = weights[rest..].iter().zip(&gradients[rest..]).map(|(w, g)| w * g).sum::<f32>();
            #[expect(clippy::needless_range_loop, reason = "with iterators here the loop above is not vectorised")]
            for lane in 0..LANES {
                sum += (sums[0][lane] + sums[1][lane]) + (sums[2][lane] + sums[3][lane]);
            }
            out[k] = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{Dice, Seed};
    use crate::nn::Layout;
    use rand::Rng;

    fn random(count: usize, dice: &mut Dice) -> Vec<f32> {
        (0..count).map(|_| dice.random_range(-1.0..1.0)).collect()
    }

    fn close(own: &Tensor, exact: &Tensor) -> bool {
        own.size() == exact.size() && f64::from((own - exact).abs().max()) < 2e-5
    }

    #[test]
    fn few_rows_have_the_same_products_as_many() {
        let mut dice = Seed::new(1).dice();
        for (depth, width) in [(1, 1), (3, 5), (4, 8), (37, 19), (64, 33), (256, 768)] {
            let blocks = [("w".to_owned(), vec![depth, width]), ("b".to_owned(), vec![1, width])];
            let mut parameters = Parameters::new(2, Layout::new(blocks.to_vec()));
            let values = random(parameters.values().len(), &mut dice);
            parameters.values_mut().copy_from_slice(&values);
            for rows in 1..=FEW_ROWS {
                let table = |width: usize, dice: &mut Dice| {
                    Tensor::of_slice(&random(2 * rows as usize * width, dice)).view([2, rows, width as i64])
                };
                let (inputs, gradients) = (table(depth, &mut dice), table(width, &mut dice));
                let exact = parameters.view(1).baddbmm(&inputs, &parameters.view(0), 1, 1);
                assert!(close(&affine(&parameters, &inputs, 0, 1), &exact), "{rows} rows, {depth} x {width}");
                let exact = gradients.bmm(&parameters.view(0).transpose(1, 2));
                assert!(close(&backwards(&parameters, &gradients, 0), &exact), "{rows} rows, {depth} x {width}");
            }
        }
    }
}
