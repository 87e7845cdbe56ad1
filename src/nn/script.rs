//! Stacks as TorchScript: a file that PyTorch and its C++ library open without this program.

use std::path::Path;

use anyhow::{Context, Result};
use tch::{CModule, Device, Kind, Tensor};

use super::Net;
use super::gru::{BLOCKS, INPUT, INPUT_BIAS, STATE, STATE_BIAS};

/// Writes the networks of all agents as one module, parameters included.
///
/// `forward(inputs)` takes `[agents, batch, in]`, for any batch, and returns the outputs, `[agents, batch, out]`. With a GRU
/// it is one step: `forward(inputs, states)` takes the states before it as well, `[agents, batch, hidden]`, and returns the
/// outputs and then the states after it in one table, `[agents, batch, out + hidden]`, because what is traced has a
/// single result.
pub fn write_script(net: &Net, path: &Path) -> Result<()> {
    let (shape, agents) = (net.shape(), net.parameters().agents() as i64);
    // Their values do not matter: the operations on them are written down.
    let table = |width: usize| Tensor::zeros(&[agents, 2, width as i64], (Kind::Float, Device::Cpu));
    let arguments: Vec<Tensor> = [shape.inputs].into_iter().chain(shape.recurrent).map(table).collect();
    let mut forward = |arguments: &[Tensor]| match arguments {
        [inputs] => vec![layers(net, inputs)],
        [inputs, states] => {
            let states = gru_step(net, inputs, states);
            vec![Tensor::cat(&[layers(net, &states), states], 2)]
        }
        _ => unreachable!("the arguments are inputs and perhaps states"),
    };
    let module = tch::no_grad(|| CModule::create_by_tracing("Networks", "forward", &arguments, &mut forward))?;
    module.save(path).with_context(|| format!("{}: cannot be written", path.display()))
}

/// `bias + inputs x weight` for every agent.
fn affine(net: &Net, inputs: &Tensor, weight: usize, bias: usize) -> Tensor {
    let block = |block: usize| {
        let parameters = net.parameters();
        let (shape, place) = parameters.layout().block(block, parameters.agents());
        let values: Vec<f32> = parameters.values().iter().flat_map(|row| &row[place.clone()]).copied().collect();
        Tensor::of_slice(&values).view(shape.iter().map(|&n| n as i64).collect::<Vec<_>>().as_slice())
    };
    block(bias).baddbmm(inputs, &block(weight), 1, 1)
}

/// The state after one step; the same arithmetic as [`super::gru::forward`].
fn gru_step(net: &Net, inputs: &Tensor, state: &Tensor) -> Tensor {
    let from_inputs = affine(net, inputs, INPUT, INPUT_BIAS).chunk(3, 2); // r, z, n: [agents, batch, hidden] each
    let from_state = affine(net, state, STATE, STATE_BIAS).chunk(3, 2);
    let r = (&from_inputs[0] + &from_state[0]).sigmoid();
    let z = (&from_inputs[1] + &from_state[1]).sigmoid();
    let n = (&from_inputs[2] + r * &from_state[2]).tanh();
    &n + z * (state - &n)
}

fn layers(net: &Net, inputs: &Tensor) -> Tensor {
    let (first, hidden) = (if net.shape().recurrent.is_some() { BLOCKS } else { 0 }, net.shape().hidden.len());
    let mut values = inputs.shallow_clone();
    for layer in 0..hidden {
        values = affine(net, &values, first + 2 * layer, first + 2 * layer + 1).relu();
    }
    affine(net, &values, first + 2 * hidden, first + 2 * hidden + 1)
}
