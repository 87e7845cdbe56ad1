//! The networks of this software: an optional GRU, then linear layers with ReLU, stacked over agents.

use rand::Rng;
use tch::{Kind, Tensor};

use super::gru::{self, GruTrace, SequenceShape};
use super::product::{affine, backwards};
use super::states::States;
use super::{Layout, Parameters, rows_to_tensor, tensor_to_slice};
use crate::base::{AgentId, Rows, Seed};

/// What a network looks like: inputs -> GRU, if any -> hidden layers with ReLU -> linear outputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    pub inputs: usize,
    /// Width of the GRU.
    pub recurrent: Option<usize>,
    pub hidden: Vec<usize>,
    pub outputs: usize,
}

impl Shape {
    /// Width of the hidden state; 0 without a GRU.
    pub fn state_width(&self) -> usize {
        self.recurrent.unwrap_or(0)
    }

    /// Inputs and outputs of the linear layers.
    pub(super) fn layers(&self) -> Vec<(usize, usize)> {
        let first = self.recurrent.unwrap_or(self.inputs);
        let widths = [&[first], &self.hidden[..], &[self.outputs]].concat();
        widths.windows(2).map(|pair| (pair[0], pair[1])).collect()
    }

    /// Where the weights and biases lie.
    pub fn layout(&self) -> Layout {
        let mut blocks = Vec::new();
        if let Some(width) = self.recurrent {
            blocks.push(("gru.input_weight".to_owned(), vec![self.inputs, 3 * width]));
            blocks.push(("gru.state_weight".to_owned(), vec![width, 3 * width]));
            blocks.push(("gru.input_bias".to_owned(), vec![1, 3 * width]));
            blocks.push(("gru.state_bias".to_owned(), vec![1, 3 * width]));
        }
        for (index, (inputs, outputs)) in self.layers().into_iter().enumerate() {
            blocks.push((format!("layers.{index}.weight"), vec![inputs, outputs]));
            blocks.push((format!("layers.{index}.bias"), vec![1, outputs]));
        }
        Layout::new(blocks)
    }

    /// Bounds of the initial values of each stretch of a row, in order: (length, bound).
    ///
    /// As torch's `Linear` and `GRU`: U(-b, b) for weights and biases alike, `b = 1 / sqrt(inputs)` for a linear layer
    /// and `1 / sqrt(width)` for a GRU.
    fn initial_bounds(&self) -> Vec<(usize, f32)> {
        let gru = self.recurrent.map(|width| {
            let length = (self.inputs + width + 2) * 3 * width;
            (length, 1.0 / (width as f32).sqrt())
        });
        let layer = |(inputs, outputs): (usize, usize)| ((inputs + 1) * outputs, 1.0 / (inputs as f32).sqrt());
        gru.into_iter().chain(self.layers().into_iter().map(layer)).collect()
    }
}

/// One network per agent.
pub struct Net {
    shape: Shape,
    parameters: Parameters,
}

/// Sequences that networks run over: what [`Net::forward`] needs beside the inputs.
pub struct Sequences<'a> {
    /// Steps of each. Inputs are ordered agent, step, sequence.
    pub steps: usize,
    /// Before the first step, one row per (agent, sequence).
    pub states: &'a States,
    /// One per row of the inputs: an episode begins with this step.
    pub starts: &'a [bool],
}

/// What the backward pass needs of a forward pass.
pub struct Trace {
    gru: Option<GruTrace>,
    /// The input of every linear layer, `[agents, rows, in]`; after the first one the ReLU of the layer before.
    inputs: Vec<Tensor>,
    output: Tensor,
}

impl Trace {
    /// `[agents, rows, outputs]`, in place.
    pub fn output(&self) -> &[f32] {
        tensor_to_slice(&self.output)
    }
}

impl Net {
    /// Randomly initialised networks, each agent's from its own stream.
    pub fn new(agents: &[AgentId], shape: Shape, seed: Seed) -> Self {
        let mut net = Net::blank(agents.len(), shape);
        let (shape, width) = (&net.shape, net.parameters.width());
        for (row, &agent) in net.parameters.values_mut().chunks_exact_mut(width).zip(agents) {
            let mut dice = seed.for_agent(agent).dice();
            let mut rest = row;
            for (length, bound) in shape.initial_bounds() {
                let (stretch, after) = rest.split_at_mut(length);
                stretch.iter_mut().for_each(|value| *value = dice.random_range(-bound..bound));
                rest = after;
            }
        }
        net
    }

    /// Networks whose parameters are all zero.
    pub fn blank(agents: usize, shape: Shape) -> Self {
        Net { parameters: Parameters::new(agents, shape.layout()), shape }
    }

    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    pub fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    /// Adds `bias` to the biases of the last layer, one value per output, for all agents.
    pub fn shift_output(&mut self, bias: &[f32]) {
        let range = self.parameters.block_range(self.first_layer() + 2 * self.shape.hidden.len() + 1);
        let width = self.parameters.width();
        for row in self.parameters.values_mut().chunks_exact_mut(width) {
            row[range.clone()].iter_mut().zip(bias).for_each(|(value, shift)| *value += shift);
        }
    }

    /// Cleared states for so many rows.
    pub fn states(&self, rows: usize) -> States {
        States::new(rows, self.shape.state_width())
    }

    /// One step. `inputs`: rows ordered agent-major, one per row of `states`, which move on.
    pub fn step(&self, inputs: &Rows<f32>, states: &mut States) -> Trace {
        let starts = vec![false; if self.shape.recurrent.is_some() { inputs.len() } else { 0 }];
        let trace = self.forward(inputs, &Sequences { steps: 1, states, starts: &starts });
        if let Some(gru) = &trace.gru {
            let after = tensor_to_slice(&gru.outputs).chunks_exact(self.shape.state_width());
            after.enumerate().for_each(|(row, state)| states.set_row(row, state));
        }
        trace
    }

    /// `inputs`: `[agents, steps, sequences, in]`; the trace holds outputs in the same order. Networks without a GRU take
    /// no notice of the sequences.
    pub fn forward(&self, inputs: &Rows<f32>, sequences: &Sequences<'_>) -> Trace {
        let agents = self.parameters.agents();
        let inputs = rows_to_tensor(inputs, agents);
        let (gru, mut hidden) = match self.shape.recurrent {
            None => (None, inputs),
            Some(_) => {
                let rows = inputs.size()[1] as usize;
                let shape = SequenceShape { agents, steps: sequences.steps, batch: rows / sequences.steps };
                let trace = gru::forward(&self.parameters, inputs, shape, sequences.states, sequences.starts);
                let outputs = trace.outputs.shallow_clone();
                (Some(trace), outputs)
            }
        };
        let layers = self.shape.hidden.len() + 1;
        let mut trace = Vec::with_capacity(layers);
        for layer in 0..layers {
            let block = self.first_layer() + 2 * layer;
            let mut next = affine(&self.parameters, &hidden, block, block + 1); // [agents, rows, out]
            if layer + 1 < layers {
                let _ = next.relu_();
            }
            trace.push(std::mem::replace(&mut hidden, next));
        }
        Trace { gru, inputs: trace, output: hidden }
    }

    /// Writes the gradients of all parameters, given the gradient of the loss with respect to the outputs
    /// (`[agents, rows, outputs]`). Gradients are overwritten, not added up.
    pub fn backward(&mut self, trace: &Trace, output_gradient: &[f32]) {
        self.parameters.need_gradients();
        let mut gradient = Tensor::of_slice(output_gradient).view(&trace.output.size()[..]);
        for layer in (0..=self.shape.hidden.len()).rev() {
            let inputs = &trace.inputs[layer];
            let block = self.first_layer() + 2 * layer;
            let _ = inputs.transpose(1, 2).bmm_out(&self.parameters.gradient_view(block), &gradient);
            let _ = gradient.sum_intlist_out(
                &self.parameters.gradient_view(block + 1),
                Some([1_i64].as_slice()),
                true,
                Kind::Float,
            );
            if layer > 0 || trace.gru.is_some() {
                gradient = backwards(&self.parameters, &gradient, block);
            }
            if layer > 0 {
                // The ReLU let through what is positive after it.
                gradient = inputs.threshold_backward(&gradient, 0.0);
            }
        }
        if let Some(gru_trace) = &trace.gru {
            gru::backward(&mut self.parameters, gru_trace, &gradient);
        }
    }

    /// The block of the first linear layer's weight.
    fn first_layer(&self) -> usize {
        if self.shape.recurrent.is_some() { gru::BLOCKS } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::Adam;

    fn feed_forward(sizes: &[usize]) -> Shape {
        let (inputs, outputs) = (sizes[0], sizes[sizes.len() - 1]);
        Shape { inputs, recurrent: None, hidden: sizes[1..sizes.len() - 1].to_vec(), outputs }
    }

    fn random_rows(rows: usize, width: usize, name: &str) -> Rows<f32> {
        let mut dice = Seed::new(11).fork(name).dice();
        Rows::from_vec((0..rows * width).map(|_| dice.random_range(-1.0..1.0)).collect(), width)
    }

    /// Sequences with random states and episodes that begin in one row of four.
    struct Material {
        inputs: Rows<f32>,
        steps: usize,
        states: States,
        starts: Vec<bool>,
        output_gradient: Vec<f32>,
    }

    impl Material {
        fn new(shape: &Shape, agents: usize, steps: usize, batch: usize) -> Material {
            let rows = agents * steps * batch;
            let mut dice = Seed::new(12).dice();
            let mut states = States::new(agents * batch, shape.state_width());
            for row in 0..agents * batch {
                let state: Vec<f32> = (0..shape.state_width()).map(|_| dice.random_range(-1.0..1.0)).collect();
                states.set_row(row, &state);
            }
            Material {
                inputs: random_rows(rows, shape.inputs, "inputs"),
                steps,
                states,
                starts: (0..rows).map(|_| dice.random_bool(0.25)).collect(),
                output_gradient: random_rows(rows, shape.outputs, "gradient").as_slice().to_vec(),
            }
        }

        fn forward(&self, net: &Net) -> Trace {
            net.forward(&self.inputs, &Sequences { steps: self.steps, states: &self.states, starts: &self.starts })
        }

        /// The share of one agent of `agents`.
        fn of_agent(&self, agent: usize, agents: usize) -> Material {
            let share = |length: usize| agent * length / agents..(agent + 1) * length / agents;
            let mut states = States::new(self.states.rows() / agents, self.states.row(0).len());
            share(self.states.rows()).enumerate().for_each(|(to, from)| states.set_row(to, self.states.row(from)));
            Material {
                inputs: self.inputs.slice(share(self.inputs.len())),
                steps: self.steps,
                states,
                starts: self.starts[share(self.starts.len())].to_vec(),
                output_gradient: self.output_gradient[share(self.output_gradient.len())].to_vec(),
            }
        }
    }

    #[test]
    fn one_hidden_unit_is_worked_out_by_hand() {
        let mut net = Net::new(&[AgentId(0)], feed_forward(&[2, 1, 1]), Seed::new(0));
        // w1 = (1, -2), b1 = 0.5, w2 = 3, b2 = -1; x = (2, 0.5): h = relu(2 - 1 + 0.5) = 1.5, y = 3 * 1.5 - 1 = 3.5
        net.parameters_mut().load(&Rows::from_vec(vec![1.0, -2.0, 0.5, 3.0, -1.0], 5));
        let trace = net.step(&Rows::from_vec(vec![2.0, 0.5], 2), &mut States::new(1, 0));
        assert_eq!(trace.output(), [3.5]);
        // dL/dy = 2: dw2 = 2 * 1.5 = 3, db2 = 2, dh = 2 * 3 = 6, dw1 = 6 * (2, 0.5) = (12, 3), db1 = 6
        net.backward(&trace, &[2.0]);
        assert_eq!(net.parameters().gradients(), [12.0, 3.0, 6.0, 3.0, 2.0]);
    }

    #[test]
    fn a_closed_relu_lets_no_gradient_through() {
        let mut net = Net::new(&[AgentId(0)], feed_forward(&[1, 1, 1]), Seed::new(0));
        // h = relu(-1 * 1 + 0) = 0, y = 5 * 0 + 2
        net.parameters_mut().load(&Rows::from_vec(vec![-1.0, 0.0, 5.0, 2.0], 4));
        let trace = net.step(&Rows::from_vec(vec![1.0], 1), &mut States::new(1, 0));
        assert_eq!(trace.output(), [2.0]);
        net.backward(&trace, &[1.0]);
        assert_eq!(net.parameters().gradients(), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_gru_of_width_one_is_worked_out_by_hand() {
        let shape = Shape { inputs: 1, recurrent: Some(1), hidden: vec![], outputs: 1 };
        let mut net = Net::new(&[AgentId(0)], shape, Seed::new(0));
        // Weights of r, z, n: input (0, 0, 1), state (0, 0, 2), biases input (0, ln 3, 0), state (0, 0, 0.5);
        // output weight 1, bias 0.
        let weights = [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 3_f32.ln(), 0.0], [0.0, 0.0, 0.5]].concat();
        net.parameters_mut().load(&Rows::from_vec([&weights[..], &[1.0, 0.0]].concat(), 14));
        // r = s(0) = 1/2, z = s(ln 3) = 3/4. x = 0.3, h = 0.4: n = tanh(0.3 + 0.5 * (0.8 + 0.5)) = tanh(0.95) =
        // 0.739783, h' = 0.25 * 0.739783 + 0.75 * 0.4 = 0.484946
        let mut states = net.states(1);
        states.set_row(0, &[0.4]);
        let trace = net.step(&Rows::from_vec(vec![0.3], 1), &mut states);
        assert!((trace.output()[0] - 0.484_946).abs() < 1e-6, "{:?}", trace.output());
        assert_eq!(states.row(0), trace.output(), "the state moves on");
        // dL/dh' = 1: dn = 0.25 * (1 - 0.547279) = 0.113180, dz = (0.4 - 0.739783) * 0.1875 = -0.063709,
        // dr = dn * 1.3 * 0.25 = 0.036784
        net.backward(&trace, &[1.0]);
        let gradients = net.parameters().gradients();
        let expected = [
            [0.011_035, -0.019_113, 0.033_954], // x * (dr, dz, dn)
            [0.014_713, -0.025_484, 0.022_636], // h * (dr, dz, r dn)
            [0.036_784, -0.063_709, 0.113_180],
            [0.036_784, -0.063_709, 0.056_590],
        ]
        .concat();
        for (gradient, expected) in gradients.iter().zip(expected) {
            assert!((gradient - expected).abs() < 2e-6, "{gradients:?}");
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        for recurrent in [None, Some(6)] {
            let shape = Shape { inputs: 5, recurrent, hidden: vec![7, 6], outputs: 3 };
            let material = Material::new(&shape, 2, 4, 3);
            // A seed with which no ReLU opens or closes within the shifts.
            let mut net = Net::new(&AgentId::all(2), shape, Seed::new(8));
            let loss = |net: &Net| -> f64 {
                let trace = material.forward(net);
                trace.output().iter().zip(&material.output_gradient).map(|(y, w)| f64::from(y * w)).sum()
            };
            let trace = material.forward(&net);
            net.backward(&trace, &material.output_gradient);
            let gradients = net.parameters().gradients().to_vec();
            let step = 2e-3_f32;
            for parameter in (0..gradients.len()).step_by(7) {
                let mut at = |shift: f32| {
                    net.parameters_mut().values_mut()[parameter] += shift;
                    let value = loss(&net);
                    net.parameters_mut().values_mut()[parameter] -= shift;
                    value
                };
                let slope = (at(step) - at(-step)) / f64::from(2.0 * step);
                let gradient = f64::from(gradients[parameter]);
                assert!((slope - gradient).abs() < 1e-2, "{recurrent:?}, parameter {parameter}: {slope} {gradient}");
            }
        }
    }

    #[test]
    fn a_packed_sequence_equals_a_loop_over_its_steps() {
        let shape = Shape { inputs: 37, recurrent: Some(64), hidden: vec![32], outputs: 5 };
        let (agents, steps, batch) = (2, 8, 4);
        let material = Material::new(&shape, agents, steps, batch);
        let net = Net::new(&AgentId::all(agents), shape, Seed::new(3));
        let packed = material.forward(&net);
        let mut states = material.states.clone();
        for step in 0..steps {
            let row = |agent: usize, sequence: usize| (agent * steps + step) * batch + sequence;
            let mut inputs = Rows::new(0, 37);
            for (agent, sequence) in (0..agents).flat_map(|agent| (0..batch).map(move |sequence| (agent, sequence))) {
                inputs.push(material.inputs.row(row(agent, sequence)));
                if material.starts[row(agent, sequence)] {
                    states.clear(agent * batch + sequence);
                }
            }
            let single = net.step(&inputs, &mut states);
            for (index, output) in single.output().chunks_exact(5).enumerate() {
                let at = row(index / batch, index % batch);
                let together = &packed.output()[at * 5..(at + 1) * 5];
                assert!(output.iter().zip(together).all(|(a, b)| (a - b).abs() < 1e-6), "step {step}");
            }
        }
    }

    #[test]
    fn a_stack_of_networks_equals_single_networks_bit_for_bit() {
        let agents = [AgentId(4), AgentId(0), AgentId(9)];
        let traffic = feed_forward(&[40, 256, 128, 3]);
        let warehouse = Shape { inputs: 37, recurrent: Some(256), hidden: vec![128], outputs: 5 };
        for (shape, steps, batch) in [
            (&traffic, 1, 1),
            (&traffic, 1, 8),
            (&traffic, 1, 32),
            (&warehouse, 1, 1),
            (&warehouse, 5, 1),
            (&warehouse, 8, 4),
        ] {
            let material = Material::new(shape, agents.len(), steps, batch);
            let run = |agents: &[AgentId], material: &Material| {
                let mut net = Net::new(agents, shape.clone(), Seed::new(3));
                let mut adam = Adam::new(net.parameters());
                let mut outputs = Vec::new();
                for _ in 0..3 {
                    let trace = material.forward(&net);
                    outputs.push(trace.output().to_vec());
                    net.backward(&trace, &material.output_gradient);
                    adam.step(net.parameters_mut(), 1e-3);
                }
                (outputs, net.parameters().gradients().to_vec(), net.parameters().values().to_vec())
            };
            let (outputs, gradients, values) = run(&agents, &material);
            for (i, &agent) in agents.iter().enumerate() {
                let rows = |all: &[f32]| all[i * all.len() / 3..(i + 1) * all.len() / 3].to_vec();
                let single = run(&[agent], &material.of_agent(i, agents.len()));
                assert_eq!(single.1, rows(&gradients), "gradients, {steps} x {batch}");
                assert_eq!(single.2, rows(&values), "values, {steps} x {batch}");
                let stacked: Vec<Vec<f32>> = outputs.iter().map(|output| rows(output)).collect();
                assert_eq!(single.0, stacked, "outputs, {steps} x {batch}");
            }
        }
    }
}
