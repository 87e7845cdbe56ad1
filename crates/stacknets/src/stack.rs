//! A stack: equal networks side by side.

use std::ops::Range;

use rand::Rng;

use super::adam::spread_first;
use super::network::{Network, Sequences, Trace};
use super::orthogonal::{self, Gains};
use super::shape::{Block, Layout, Shape};
use super::{Parameters, Rows, States, Threads};

/// Smallest number of networks for which several threads pay (about 4 us per network).
const NETWORKS_WORTH_THREADS: usize = 32;

/// Most rows that networks with the same parameters take at once. With more than 256 rows, a product with one column adds up in another
/// order (the test `order_of_sums`).
const ROWS_AT_ONCE: usize = 128;

/// Networks of the same [`Shape`] side by side, each with its own parameters.
///
/// They are numbered from 0. Nothing couples them: a stack of N networks computes what N stacks of one network compute,
/// bit for bit, with any number of [`Threads`].
pub struct Stack {
    shape: Shape,
    parameters: Parameters,
    threads: Threads,
    /// Whether all networks promise to have the parameters of the first when they run.
    alike: bool,
}

impl Stack {
    /// Makes one network from each generator. Each draws its parameters from its own generator, so a network begins the same
    /// way alone or in a stack.
    ///
    /// Weights and biases are uniform in `-b..b`, as those of torch's `Linear` and `GRU`: `b` is one by the square root
    /// of the number of inputs of a layer, and of the width of a GRU.
    pub fn new<R: Rng>(shape: Shape, generators: impl IntoIterator<Item = R>) -> Self {
        let generators: Vec<R> = generators.into_iter().collect();
        let mut stack = Stack::blank(generators.len(), shape);
        let (shape, width) = (&stack.shape, stack.parameters.width());
        let rows = stack.parameters.values_mut().as_mut_slice().chunks_exact_mut(width);
        for (row, mut generator) in rows.zip(generators) {
            let mut rest = row;
            for (length, bound) in shape.initial_bounds() {
                let (stretch, after) = rest.split_at_mut(length);
                stretch.iter_mut().for_each(|value| *value = generator.random_range(-bound..bound));
                rest = after;
            }
        }
        stack
    }

    /// Makes one network from each generator, as [`Stack::new`] does, but with orthogonal weights of these gains, and with
    /// biases of 0.
    ///
    /// # Panics
    /// If there is not a gain per output.
    pub fn orthogonal<R: Rng>(shape: Shape, gains: &Gains, generators: impl IntoIterator<Item = R>) -> Self {
        assert_eq!(gains.outputs.len(), shape.outputs, "a gain for each output");
        let generators: Vec<R> = generators.into_iter().collect();
        let mut stack = Stack::blank(generators.len(), shape);
        let (shape, width) = (&stack.shape, stack.parameters.width());
        let layout = shape.layout();
        let rows = stack.parameters.values_mut().as_mut_slice().chunks_exact_mut(width);
        for (row, mut generator) in rows.zip(generators) {
            let mut outputs = &gains.outputs[..];
            if let Some(sets) = shape.sets {
                let weights = layout.blocks.iter().filter(|block| block.is_weight());
                for (block, (part, [_, columns])) in weights.zip(sets.layers(&shape.hidden)) {
                    let weight = &mut row[block.place.clone()];
                    orthogonal::fill(weight, columns, &mut generator);
                    let gain = match part {
                        _ if columns > 1 => gains.hidden,
                        "value" => outputs[outputs.len() - 1],
                        _ => outputs[0],
                    };
                    weight.iter_mut().for_each(|value| *value *= gain);
                }
                continue;
            }
            for (index, tower) in shape.towers().iter().enumerate() {
                let weights: Vec<&Block> =
                    layout.of_tower(shape, index).iter().filter(|block| block.is_weight()).collect();
                let of_gru = weights.len() - (tower.hidden.len() + 1);
                for (number, block) in weights.iter().enumerate() {
                    let columns = block.columns();
                    let weight = &mut row[block.place.clone()];
                    orthogonal::fill(weight, columns, &mut generator);
                    let gain = |column: usize| match number {
                        _ if number < of_gru => 1.0,
                        _ if number + 1 < weights.len() => gains.hidden,
                        _ => outputs[column],
                    };
                    weight.iter_mut().enumerate().for_each(|(index, value)| *value *= gain(index % columns));
                }
                outputs = &outputs[tower.outputs..];
            }
        }
        stack
    }

    /// Makes networks whose parameters are all zero, to be filled by [`Parameters::load`].
    pub fn blank(networks: usize, shape: Shape) -> Self {
        Stack { parameters: Parameters::new(networks, shape.layout()), shape, threads: Threads::one(), alike: false }
    }

    /// Returns the shape of each network.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Returns the parameters of all networks.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Returns the parameters of all networks, for writing.
    pub fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    /// Copies the parameters of the first network to all others.
    pub fn spread_first(&mut self) {
        spread_first(self.parameters.values_mut());
    }

    /// Promises that all networks will have the same parameters whenever they run. Then [`step`](Self::step) takes the rows of
    /// several networks at once, which is faster and gives the same bits.
    pub fn keep_alike(&mut self) {
        self.alike = true;
    }

    /// Uses these threads in [`step`](Self::step) from now on. A new stack uses the calling thread only.
    pub fn use_threads(&mut self, threads: Threads) {
        self.threads = threads;
    }

    /// Returns the threads in use.
    pub fn threads(&self) -> &Threads {
        &self.threads
    }

    /// Returns the network of this number.
    pub fn network(&self, number: usize) -> Network<'_> {
        Network { shape: &self.shape, layout: self.parameters.layout(), values: self.parameters.values().row(number) }
    }

    pub(crate) fn parts_mut(&mut self) -> (&Shape, &Layout, &mut Rows<f32>) {
        (&self.shape, &self.parameters.layout, &mut self.parameters.values)
    }

    /// Adds `bias` to the biases of the first tower's last layer in all networks: one value per output, or per each of the
    /// first outputs.
    ///
    /// # Panics
    /// If a choice of networks over sets is to be shifted: all have one bias.
    pub fn shift_output(&mut self, bias: &[f32]) {
        if self.shape.sets.is_some() {
            return assert!(bias.iter().all(|&shift| shift == 0.0), "choices have no biases of their own");
        }
        let layout = self.parameters.layout();
        let range = layout.of_tower(&self.shape, 0)[self.shape.blocks_per_tower() - 1].place.clone();
        let width = self.parameters.width();
        for row in self.parameters.values_mut().as_mut_slice().chunks_exact_mut(width) {
            row[range.clone()].iter_mut().zip(bias).for_each(|(value, shift)| *value += shift);
        }
    }

    /// Makes hidden states of zeros for this number of rows: the number of networks times the rows of each.
    pub fn states(&self, rows: usize) -> States {
        States::new(rows, self.shape.state_width())
    }

    /// Runs one step of all networks and returns the outputs, row by row. Replaces `states` by the states after the step.
    ///
    /// `inputs`: `[networks x rows of each, inputs]`, the rows of a network together; `states`: from
    /// [`Stack::states`], one per row of the inputs. Returns `[networks x rows of each, outputs]`.
    ///
    /// # Panics
    /// If `inputs` is not as wide as the networks' inputs, if the networks do not have equally many rows, or if there is not
    /// a state per row.
    pub fn step(&self, inputs: &Rows<f32>, states: &mut States) -> Rows<f32> {
        self.step_of(0..self.parameters.networks(), &self.threads, inputs, states)
    }

    /// Runs one step of some networks, as [`Stack::step`] does, in these threads.
    pub fn step_of(
        &self,
        networks: Range<usize>,
        threads: &Threads,
        inputs: &Rows<f32>,
        states: &mut States,
    ) -> Rows<f32> {
        let Shape { inputs: width, outputs, .. } = self.shape;
        let (first, networks) = (networks.start, networks.len());
        let (copies, state_width) = (inputs.len() / networks, self.shape.state_width());
        assert_eq!(inputs.width(), width, "rows of inputs of another width");
        assert_eq!(inputs.len(), networks * copies, "rows that cannot be shared equally among {networks} networks");
        assert_eq!(states.as_slice().len(), inputs.len() * state_width, "a state for each row");
        // A single row of a network has another order of sums than two. Over sets, a row is many.
        let can_join = self.alike && copies > 1 && self.shape.sets.is_none();
        let joined = if can_join { (ROWS_AT_ONCE / copies).max(1) } else { 1 };
        let parameters = self.parameters.values();
        let are_alike = || (1..parameters.len()).all(|number| parameters.row(number) == parameters.row(0));
        debug_assert!(joined == 1 || are_alike(), "the promise of `keep_alike`");
        let mut out = Rows::new(inputs.len(), outputs);
        let starts = vec![false; joined * copies];
        let work = |trace: &mut Trace, (number, inputs, out, states): (usize, &[f32], &mut [f32], &mut [f32])| {
            let starts = &starts[..inputs.len() / width];
            self.network(first + number).forward(inputs, Sequences { steps: 1, states, starts }, trace);
            out.copy_from_slice(trace.output());
            states.copy_from_slice(trace.last_states(states.len()));
        };
        let mut rest = states.as_mut_slice();
        let mut items = Vec::with_capacity(networks.div_ceil(joined));
        let most = joined * copies;
        let rows = inputs.as_slice().chunks(most * width).zip(out.as_mut_slice().chunks_mut(most * outputs));
        for (number, (inputs, out)) in rows.enumerate() {
            let (states, others) = rest.split_at_mut(inputs.len() / width * state_width);
            rest = others;
            items.push((number * joined, inputs, out, states));
        }
        let worth = if networks >= NETWORKS_WORTH_THREADS { 2 } else { usize::MAX };
        threads.map(items, worth, work);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{dice, stack};
    use crate::{Adam, Trainer};

    fn feed_forward(sizes: &[usize]) -> Shape {
        let (inputs, outputs) = (sizes[0], sizes[sizes.len() - 1]);
        Shape { inputs, recurrent: None, hidden: sizes[1..sizes.len() - 1].to_vec(), outputs, apart: 0, sets: None }
    }

    fn random_rows(rows: usize, width: usize, seed: u64) -> Rows<f32> {
        let mut dice = dice(seed);
        Rows::from_vec((0..rows * width).map(|_| dice.random_range(-1.0..1.0)).collect(), width)
    }

    /// Sequences of some networks, with random states that are cleared in one row of four; rows ordered network, step,
    /// sequence.
    #[derive(Clone)]
    struct Material {
        networks: usize,
        inputs: Rows<f32>,
        steps: usize,
        states: States,
        starts: Vec<bool>,
        by_output: Vec<f32>,
    }

    impl Material {
        fn new(shape: &Shape, networks: usize, steps: usize, batch: usize) -> Material {
            let rows = networks * steps * batch;
            let mut dice = dice(12);
            let mut states = States::new(networks * batch, shape.state_width());
            states.as_mut_slice().iter_mut().for_each(|value| *value = dice.random_range(-1.0..1.0));
            Material {
                networks,
                inputs: random_rows(rows, shape.inputs, 17),
                steps,
                states,
                starts: (0..rows).map(|_| dice.random_bool(0.25)).collect(),
                by_output: random_rows(rows, shape.outputs, 19).into_vec(),
            }
        }

        /// Returns the part of a table that belongs to a network.
        fn share<'a, T>(&self, table: &'a [T], number: usize) -> &'a [T] {
            &table[number * table.len() / self.networks..(number + 1) * table.len() / self.networks]
        }

        fn forward(&self, network: Network<'_>, number: usize, trace: &mut Trace) {
            let [states, inputs] =
                [self.states.as_slice(), self.inputs.as_slice()].map(|table| self.share(table, number));
            let sequences = Sequences { steps: self.steps, states, starts: self.share(&self.starts, number) };
            network.forward(inputs, sequences, trace);
        }

        /// Returns the outputs of all networks.
        fn outputs(&self, stack: &Stack) -> Vec<f32> {
            let mut trace = Trace::default();
            let of_network = |number| {
                self.forward(stack.network(number), number, &mut trace);
                trace.output().to_vec()
            };
            (0..self.networks).flat_map(of_network).collect()
        }

        /// Returns outputs and gradient of one network.
        fn outputs_and_gradient(&self, network: Network<'_>, number: usize) -> (Vec<f32>, Vec<f32>) {
            let mut trace = Trace::default();
            self.forward(network, number, &mut trace);
            network.backward(self.share(&self.by_output, number), &mut trace);
            (trace.output().to_vec(), trace.gradient().to_vec())
        }
    }

    #[test]
    fn one_hidden_unit_is_worked_out_by_hand() {
        // w1 = (1, -2), b1 = 0.5, w2 = 3, b2 = -1; x = (2, 0.5): h = relu(2 - 1 + 0.5) = 1.5, y = 3 * 1.5 - 1 = 3.5.
        // dL/dy = 2: dw2 = 2 * 1.5 = 3, db2 = 2, dh = 2 * 3 = 6, dw1 = 6 * (2, 0.5) = (12, 3), db1 = 6.
        let open = ([1.0, -2.0, 0.5, 3.0, -1.0], 3.5, [12.0, 3.0, 6.0, 3.0, 2.0]);
        // h = relu(-2 - 1 + 0.5) = 0: a closed ReLU lets no gradient through.
        let closed = ([-1.0, -2.0, 0.5, 3.0, -1.0], -1.0, [0.0, 0.0, 0.0, 0.0, 2.0]);
        let mut stack = stack(feed_forward(&[2, 1, 1]), &[0]);
        for (parameters, output, gradient) in [open, closed] {
            stack.parameters_mut().load(&Rows::from_vec(parameters.to_vec(), 5));
            let mut trace = Trace::default();
            stack.network(0).forward(&[2.0, 0.5], Sequences::NONE, &mut trace);
            stack.network(0).backward(&[2.0], &mut trace);
            assert_eq!((trace.output(), trace.gradient()), (&[output][..], &gradient[..]));
        }
    }

    #[test]
    fn a_gru_of_width_one_is_worked_out_by_hand() {
        let shape = Shape { inputs: 1, recurrent: Some(1), hidden: vec![], outputs: 1, apart: 0, sets: None };
        let mut stack = stack(shape, &[0]);
        // Weights of r, z, n: input (0, 0, 1), state (0, 0, 2), biases input (0, ln 3, 0), state (0, 0, 0.5);
        // output weight 1, bias 0.
        let weights = [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 3_f32.ln(), 0.0], [0.0, 0.0, 0.5]].concat();
        stack.parameters_mut().load(&Rows::from_vec([&weights[..], &[1.0, 0.0]].concat(), 14));
        // r = s(0) = 1/2, z = s(ln 3) = 3/4. x = 0.3, h = 0.4: n = tanh(0.3 + 0.5 * (0.8 + 0.5)) = tanh(0.95) =
        // 0.739783, h' = 0.25 * 0.739783 + 0.75 * 0.4 = 0.484946
        let mut states = stack.states(1);
        states.set_row(0, &[0.4]);
        let output = stack.step(&Rows::from_vec(vec![0.3], 1), &mut states);
        assert!((output.row(0)[0] - 0.484_946).abs() < 1e-6, "{output:?}");
        assert_eq!(states.row(0), output.row(0), "the state is updated");
        // dL/dh' = 1: dn = 0.25 * (1 - 0.547279) = 0.113180, dz = (0.4 - 0.739783) * 0.1875 = -0.063709,
        // dr = dn * 1.3 * 0.25 = 0.036784
        let mut trace = Trace::default();
        stack.network(0).forward(&[0.3], Sequences { steps: 1, states: &[0.4], starts: &[false] }, &mut trace);
        stack.network(0).backward(&[1.0], &mut trace);
        let gradients = trace.gradient();
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
    fn two_towers_compute_what_two_networks_with_their_parameters_compute() {
        for recurrent in [None, Some(6)] {
            let both = Shape { inputs: 5, recurrent, hidden: vec![7], outputs: 3, apart: 1, sets: None };
            let material = Material::new(&both, 1, 4, 3);
            let stack = stack(both.clone(), &[8]);
            let row = stack.parameters().values().row(0);
            let (outputs, gradient) = material.outputs_and_gradient(stack.network(0), 0);
            let (mut first_parameter, mut first_output) = (0, 0);
            for (tower, shape) in both.towers().into_iter().enumerate() {
                let mut alone = Stack::blank(1, shape.clone());
                let width = alone.parameters().width();
                let own = first_parameter..first_parameter + width;
                alone.parameters_mut().load(&Rows::from_vec(row[own.clone()].to_vec(), width));
                let mut states = States::new(3, shape.state_width());
                for sequence in 0..3 {
                    let whole = material.states.row(sequence);
                    states.set_row(sequence, &whole[tower * shape.state_width()..][..shape.state_width()]);
                }
                let columns = |table: &[f32]| -> Vec<f32> {
                    table.chunks_exact(3).flat_map(|row| &row[first_output..][..shape.outputs]).copied().collect()
                };
                let its = Material { states, by_output: columns(&material.by_output), ..material.clone() };
                let (of_alone, gradient_alone) = its.outputs_and_gradient(alone.network(0), 0);
                assert_eq!(of_alone, columns(&outputs), "tower {tower}");
                assert_eq!(gradient_alone, gradient[own], "tower {tower}");
                first_parameter += width;
                first_output += shape.outputs;
            }
        }
    }

    #[test]
    fn networks_that_are_alike_run_together_with_the_same_bits() {
        for (recurrent, apart, copies) in [(None, 1, 2), (None, 0, 3), (Some(6), 1, 2), (None, 1, 50), (None, 1, 1)] {
            let shape = Shape { inputs: 37, recurrent, hidden: vec![64, 64], outputs: 3, apart, sets: None };
            let mut stack = stack(shape, &[5; 90]);
            let inputs = random_rows(90 * copies, 37, 2);
            let mut run = |alike: bool| {
                stack.alike = alike;
                let mut states = stack.states(90 * copies);
                let first = stack.step(&inputs, &mut states);
                (first, stack.step(&inputs, &mut states), states)
            };
            assert_eq!(run(false), run(true), "{recurrent:?} {apart} {copies}");
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        for (recurrent, apart) in [(None, 0), (Some(6), 0), (None, 1), (Some(6), 1)] {
            let shape = Shape { inputs: 5, recurrent, hidden: vec![7, 6], outputs: 3, apart, sets: None };
            let material = Material::new(&shape, 2, 4, 3);
            // A seed with which no ReLU changes sides within the shifts.
            let mut stack = stack(shape, &[0, 1]);
            let loss = |stack: &Stack| -> f64 {
                material.outputs(stack).iter().zip(&material.by_output).map(|(y, w)| f64::from(y * w)).sum()
            };
            let gradients =
                [0, 1].map(|number| material.outputs_and_gradient(stack.network(number), number).1).concat();
            let step = 2e-3_f32;
            for parameter in (0..gradients.len()).step_by(7) {
                let mut at = |shift: f32| {
                    stack.parameters_mut().values_mut().as_mut_slice()[parameter] += shift;
                    let value = loss(&stack);
                    stack.parameters_mut().values_mut().as_mut_slice()[parameter] -= shift;
                    value
                };
                let slope = (at(step) - at(-step)) / f64::from(2.0 * step);
                let gradient = f64::from(gradients[parameter]);
                assert!(
                    (slope - gradient).abs() < 1e-2,
                    "{recurrent:?}, {apart} apart, parameter {parameter}: {slope} {gradient}"
                );
            }
        }
    }

    #[test]
    fn a_packed_sequence_equals_a_loop_over_its_steps() {
        let shape = Shape { inputs: 37, recurrent: Some(64), hidden: vec![32], outputs: 5, apart: 0, sets: None };
        let (steps, batch) = (8, 4);
        let material = Material::new(&shape, 1, steps, batch);
        let stack = stack(shape, &[0]);
        let packed = material.outputs(&stack);
        let mut states = material.states.clone();
        for step in 0..steps {
            let mut inputs = Rows::new(0, 37);
            for sequence in 0..batch {
                inputs.push(material.inputs.row(step * batch + sequence));
                if material.starts[step * batch + sequence] {
                    states.clear(sequence);
                }
            }
            let single = stack.step(&inputs, &mut states);
            let together = &packed[step * batch * 5..][..batch * 5];
            assert!(single.as_slice().iter().zip(together).all(|(a, b)| (a - b).abs() < 1e-6), "step {step}");
        }
    }

    #[test]
    fn a_stack_of_networks_equals_single_networks_bit_for_bit() {
        let networks = [4, 0, 9];
        let layers = feed_forward(&[40, 256, 128, 3]);
        let gru = Shape { inputs: 37, recurrent: Some(256), hidden: vec![128], outputs: 5, apart: 0, sets: None };
        for (shape, steps, batch) in
            [(&layers, 1, 1), (&layers, 1, 8), (&layers, 1, 32), (&gru, 1, 1), (&gru, 5, 1), (&gru, 8, 4)]
        {
            let material = Material::new(shape, networks.len(), steps, batch);
            // All outputs and gradients of three gradient steps, network by network, and the values after them.
            let run = |places: &[usize], threads: Threads| {
                let seeds: Vec<u64> = places.iter().map(|&place| networks[place]).collect();
                let mut stack = stack(shape.clone(), &seeds);
                let mut adam = Adam::new(stack.parameters());
                let trainers = adam.trainers(&mut stack, 3).into_iter().zip(places).collect();
                let passes = threads.map(trainers, 1, |(): &mut (), (mut trainer, &place): (Trainer<'_>, _)| {
                    let pass = |_| {
                        let (outputs, gradient) = material.outputs_and_gradient(trainer.network(), place);
                        trainer.descend(&gradient, 1e-3);
                        (outputs, gradient)
                    };
                    (0..3).map(pass).collect::<Vec<_>>()
                });
                (passes, stack.parameters().values().clone())
            };
            let (passes, values) = run(&[0, 1, 2], Threads::one());
            assert_eq!(run(&[0, 1, 2], Threads::new(2).unwrap()), (passes.clone(), values.clone()));
            for (place, pass) in passes.iter().enumerate() {
                let single = run(&[place], Threads::one());
                assert_eq!(&single.0[0], pass, "outputs and gradients, {steps} x {batch}");
                assert_eq!(single.1.row(0), values.row(place), "values, {steps} x {batch}");
            }
        }
    }
}
