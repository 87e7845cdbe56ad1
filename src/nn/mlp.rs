//! Feed-forward networks with ReLU, stacked over agents.

use rand::Rng;
use tch::{Kind, Tensor};

use super::{Layout, Parameters, tensor_to_slice};
use crate::base::{AgentId, Seed};

/// One feed-forward network per agent: linear layers with ReLU between them, the last one linear.
pub struct Mlp {
    parameters: Parameters,
    layers: usize,
    outputs: usize,
}

/// What the backward pass needs of a forward pass.
pub struct Trace {
    /// The input of every layer, `[agents, batch, in]`; after the first one the ReLU of the layer before.
    inputs: Vec<Tensor>,
    output: Tensor,
}

impl Trace {
    /// `[agents, batch, out]`, in place.
    pub fn output(&self) -> &[f32] {
        tensor_to_slice(&self.output)
    }
}

impl Mlp {
    /// Where the weights and biases of a network `sizes[0] -> sizes[1] -> ...` lie.
    pub fn layout(sizes: &[usize]) -> Layout {
        let layer = |(layer, size): (usize, &[usize])| {
            let weight = (format!("layers.{layer}.weight"), vec![size[0], size[1]]);
            [weight, (format!("layers.{layer}.bias"), vec![1, size[1]])]
        };
        Layout::new(sizes.windows(2).enumerate().flat_map(layer).collect())
    }

    /// Networks `sizes[0] -> sizes[1] -> ...`, one per agent, initialised as torch's `Linear`: weights and biases from
    /// U(-1/sqrt(in), 1/sqrt(in)), each agent from its own stream.
    pub fn new(agents: &[AgentId], sizes: &[usize], seed: Seed) -> Self {
        let mut parameters = Parameters::new(agents.len(), Mlp::layout(sizes));
        let width = parameters.width();
        for (row, &agent) in parameters.values_mut().0.chunks_exact_mut(width).zip(agents) {
            let mut dice = seed.for_agent(agent).dice();
            let mut rest = row;
            for size in sizes.windows(2) {
                let bound = 1.0 / (size[0] as f32).sqrt();
                let (layer, after) = rest.split_at_mut((size[0] + 1) * size[1]);
                layer.iter_mut().for_each(|value| *value = dice.random_range(-bound..bound));
                rest = after;
            }
        }
        Mlp { parameters, layers: sizes.len() - 1, outputs: *sizes.last().expect("a network has sizes") }
    }

    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    pub fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Adds `bias` to the biases of the last layer, one value per output, for all agents.
    pub fn shift_output(&mut self, bias: &[f32]) {
        let range = self.parameters.block_range(2 * self.layers - 1);
        let width = self.parameters.width();
        for row in self.parameters.values_mut().0.chunks_exact_mut(width) {
            row[range.clone()].iter_mut().zip(bias).for_each(|(value, shift)| *value += shift);
        }
    }

    /// `inputs`: `[agents, batch, in]`; the trace holds the outputs `[agents, batch, out]`.
    pub fn forward(&self, inputs: Tensor) -> Trace {
        let mut trace = Vec::with_capacity(self.layers);
        let mut hidden = inputs;
        for layer in 0..self.layers {
            let (weight, bias) = (self.parameters.view(2 * layer), self.parameters.view(2 * layer + 1));
            let mut next = bias.baddbmm(&hidden, &weight, 1, 1); // [agents, batch, out]
            if layer + 1 < self.layers {
                let _ = next.relu_();
            }
            trace.push(std::mem::replace(&mut hidden, next));
        }
        Trace { inputs: trace, output: hidden }
    }

    /// Writes the gradients of all parameters, given the gradient of the loss with respect to the outputs
    /// (`[agents, batch, out]`). Gradients are overwritten, not added up.
    pub fn backward(&mut self, trace: &Trace, output_gradient: &[f32]) {
        let mut gradient = Tensor::of_slice(output_gradient).view(&trace.output.size()[..]);
        for layer in (0..self.layers).rev() {
            let inputs = &trace.inputs[layer];
            let _ = inputs.transpose(1, 2).bmm_out(&self.parameters.gradient_view(2 * layer), &gradient);
            let _ = gradient.sum_intlist_out(
                &self.parameters.gradient_view(2 * layer + 1),
                Some([1_i64].as_slice()),
                true,
                Kind::Float,
            );
            if layer > 0 {
                let weight = self.parameters.view(2 * layer);
                // The ReLU let through what is positive after it.
                gradient = inputs.threshold_backward(&gradient.bmm(&weight.transpose(1, 2)), 0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rows;
    use crate::nn::{Adam, rows_to_tensor};

    fn random_rows(rows: usize, width: usize, name: &str) -> Rows<f32> {
        let mut dice = Seed::new(11).fork(name).dice();
        Rows::from_vec((0..rows * width).map(|_| dice.random_range(-1.0..1.0)).collect(), width)
    }

    #[test]
    fn one_hidden_unit_is_worked_out_by_hand() {
        let mut net = Mlp::new(&[AgentId(0)], &[2, 1, 1], Seed::new(0));
        // w1 = (1, -2), b1 = 0.5, w2 = 3, b2 = -1; x = (2, 0.5): h = relu(2 - 1 + 0.5) = 1.5, y = 3 * 1.5 - 1 = 3.5
        net.parameters_mut().load(&Rows::from_vec(vec![1.0, -2.0, 0.5, 3.0, -1.0], 5));
        let trace = net.forward(rows_to_tensor(&Rows::from_vec(vec![2.0, 0.5], 2), 1));
        assert_eq!(trace.output(), [3.5]);
        // dL/dy = 2: dw2 = 2 * 1.5 = 3, db2 = 2, dh = 2 * 3 = 6, dw1 = 6 * (2, 0.5) = (12, 3), db1 = 6
        net.backward(&trace, &[2.0]);
        assert_eq!(net.parameters().gradients(), [12.0, 3.0, 6.0, 3.0, 2.0]);
    }

    #[test]
    fn a_closed_relu_lets_no_gradient_through() {
        let mut net = Mlp::new(&[AgentId(0)], &[1, 1, 1], Seed::new(0));
        // h = relu(-1 * 1 + 0) = 0, y = 5 * 0 + 2
        net.parameters_mut().load(&Rows::from_vec(vec![-1.0, 0.0, 5.0, 2.0], 4));
        let trace = net.forward(rows_to_tensor(&Rows::from_vec(vec![1.0], 1), 1));
        assert_eq!(trace.output(), [2.0]);
        net.backward(&trace, &[1.0]);
        assert_eq!(net.parameters().gradients(), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut net = Mlp::new(&AgentId::all(2), &[5, 7, 6, 3], Seed::new(5));
        let inputs = random_rows(2 * 4, 5, "inputs");
        let weights = random_rows(2 * 4, 3, "loss weights");
        let loss = |net: &Mlp| -> f64 {
            let trace = net.forward(rows_to_tensor(&inputs, 2));
            trace.output().iter().zip(weights.as_slice()).map(|(y, w)| f64::from(y * w)).sum()
        };
        let trace = net.forward(rows_to_tensor(&inputs, 2));
        net.backward(&trace, weights.as_slice());
        let gradients = net.parameters().gradients().to_vec();
        let step = 1e-2_f32;
        for parameter in (0..gradients.len()).step_by(7) {
            let mut at = |shift: f32| {
                net.parameters_mut().values_mut().0[parameter] += shift;
                let value = loss(&net);
                net.parameters_mut().values_mut().0[parameter] -= shift;
                value
            };
            let slope = (at(step) - at(-step)) / f64::from(2.0 * step);
            assert!(
                (slope - f64::from(gradients[parameter])).abs() < 2e-2,
                "parameter {parameter}: {slope} {}",
                gradients[parameter]
            );
        }
    }

    #[test]
    fn a_stack_of_networks_equals_single_networks_bit_for_bit() {
        let agents = [AgentId(4), AgentId(0), AgentId(9)];
        let sizes = [40, 256, 128, 3];
        for batch in [1, 8, 32] {
            let inputs = random_rows(3 * batch, 40, "inputs");
            let output_gradient = random_rows(3 * batch, 3, "gradient");
            let run = |agents: &[AgentId], inputs: &Rows<f32>, gradient: &[f32]| {
                let mut net = Mlp::new(agents, &sizes, Seed::new(3));
                let mut adam = Adam::new(net.parameters());
                let mut outputs = Vec::new();
                for _ in 0..3 {
                    let trace = net.forward(rows_to_tensor(inputs, agents.len()));
                    outputs.extend_from_slice(trace.output());
                    net.backward(&trace, gradient);
                    adam.step(net.parameters_mut(), 1e-3);
                }
                (outputs, net.parameters().gradients().to_vec(), net.parameters().values().to_vec())
            };
            let (outputs, gradients, values) = run(&agents, &inputs, output_gradient.as_slice());
            for (i, &agent) in agents.iter().enumerate() {
                let rows = |all: &[f32]| all[i * all.len() / 3..(i + 1) * all.len() / 3].to_vec();
                let single =
                    run(&[agent], &Rows::from_vec(rows(inputs.as_slice()), 40), &rows(output_gradient.as_slice()));
                assert_eq!(single.1, rows(&gradients), "gradients, batch {batch}");
                assert_eq!(single.2, rows(&values), "values, batch {batch}");
                let stacked: Vec<f32> = outputs.chunks(outputs.len() / 3).flat_map(rows).collect();
                assert_eq!(single.0, stacked, "outputs, batch {batch}");
            }
        }
    }
}
