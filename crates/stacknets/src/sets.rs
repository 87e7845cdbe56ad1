//! Networks whose inputs are sets: *items*, and *choices* among which the network decides. There may be few or many of
//! both, and their order means nothing.
//!
//! Every item goes through the same encoder. A choice sees its own features, the sum over its own items, once for each
//! way in which items can belong to it, and the sum over all items. One scorer makes a number of that, for each choice.
//! The value sees the sum over all items, and what the choices see that have a mark. So one network fits any number of
//! items and choices: the parameters depend on the widths of the features alone.
//!
//! Source: Zaheer et al. 2017, "Deep Sets".

use super::product::{Before, Matrix, affine, multiply, resized, sum_rows};
use super::shape::Block;

/// Places of the items and choices in the inputs: items, then choices, then the weights with which items belong to
/// choices, `[choices, ways, items]`. What is not there has zeros, and no influence.
///
/// The first feature of an item or a choice is 1 if it is there. The second feature of a choice is its mark: the weight
/// with which the value sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sets {
    /// Number of items for which there is room.
    pub items: usize,
    /// Number of features of an item.
    pub item_features: usize,
    /// Number of choices for which there is room.
    pub choices: usize,
    /// Number of features of a choice, at least two.
    pub choice_features: usize,
    /// Number of ways in which items can belong to a choice.
    pub ways: usize,
}

/// Weight of the sum over all items, so that it is about as large as the sums over the items of a choice.
const OF_ALL: f32 = 0.25;

impl Sets {
    /// Returns the number of inputs.
    pub fn inputs(&self) -> usize {
        self.links().end
    }

    /// Returns the columns of an item.
    pub fn item(&self, item: usize) -> std::ops::Range<usize> {
        item * self.item_features..(item + 1) * self.item_features
    }

    /// Returns the columns of a choice.
    pub fn choice(&self, choice: usize) -> std::ops::Range<usize> {
        let first = self.items * self.item_features + choice * self.choice_features;
        first..first + self.choice_features
    }

    /// Returns the columns of the weights with which items belong to a choice in one way.
    pub fn belongs(&self, choice: usize, way: usize) -> std::ops::Range<usize> {
        let first = self.links().start + (choice * self.ways + way) * self.items;
        first..first + self.items
    }

    fn links(&self) -> std::ops::Range<usize> {
        let first = self.items * self.item_features + self.choices * self.choice_features;
        first..first + self.choices * self.ways * self.items
    }

    /// Returns the number of inputs and outputs of each linear layer, with the name of the part that it is in: the
    /// encoder's, the scorer's, the value's. `hidden`: widths of the encoder, then that of the scorer and the value.
    pub(crate) fn layers(&self, hidden: &[usize]) -> Vec<(&'static str, [usize; 2])> {
        let (&last, encoder) = hidden.split_last().expect("a hidden layer of the scorer");
        let mut layers = Vec::new();
        let mut width = self.item_features;
        for &next in encoder {
            layers.push(("items", [width, next]));
            width = next;
        }
        let seen = self.choice_features + (self.ways + 1) * width;
        layers.extend([("choices", [seen, last]), ("choices", [last, 1])]);
        layers.extend([("value", [seen, last]), ("value", [last, 1])]);
        layers
    }
}

/// Results of a forward pass that the backward pass needs, and the memory that both work in.
#[derive(Default)]
pub(crate) struct SetsTrace {
    /// Items and choices that are there, row by row: their numbers, and where those of each row begin.
    items: Present,
    choices: Present,
    /// Features of the items, then the values after each layer of the encoder.
    encoded: Vec<Vec<f32>>,
    /// Weights with which the encoded items belong to the choices, `[choices, ways, items of the row]`.
    belongs: Vec<f32>,
    scorer: HeadTrace,
    value: HeadTrace,
    by_items: [Vec<f32>; 2],
    by_total: Vec<f32>,
    outputs: Vec<f32>,
}

/// What is there.
#[derive(Default)]
struct Present {
    numbers: Vec<usize>,
    starts: Vec<usize>,
}

/// One hidden layer and one output.
#[derive(Default)]
struct HeadTrace {
    inputs: Vec<f32>,
    hidden: Vec<f32>,
    output: Vec<f32>,
    by_hidden: Vec<f32>,
    by_inputs: Vec<f32>,
}

impl Present {
    fn clear(&mut self) {
        self.numbers.clear();
        self.starts.clear();
        self.starts.push(0);
    }

    fn of(&self, row: usize) -> std::ops::Range<usize> {
        self.starts[row]..self.starts[row + 1]
    }
}

impl SetsTrace {
    /// Returns the outputs, `[rows, choices + 1]`: a number for each choice, 0 for those that are not there, and the value.
    pub(crate) fn outputs(&self) -> &[f32] {
        &self.outputs
    }
}

/// A network over sets: its layout, the blocks and the values of its parameters.
#[derive(Clone, Copy)]
pub(crate) struct OverSets<'a> {
    pub(crate) sets: Sets,
    pub(crate) hidden: &'a [usize],
    pub(crate) blocks: &'a [Block],
    pub(crate) values: &'a [f32],
}

impl OverSets<'_> {
    fn encoder(&self) -> usize {
        self.hidden.len() - 1
    }

    /// Returns the width of an encoded item.
    fn width(&self) -> usize {
        self.hidden.len().checked_sub(2).map_or(self.sets.item_features, |last| self.hidden[last])
    }

    fn weight_and_bias(&self, layer: usize) -> [&[f32]; 2] {
        [2 * layer, 2 * layer + 1].map(|block| &self.values[self.blocks[block].place.clone()])
    }

    pub(crate) fn forward(self, inputs: &[f32], trace: &mut SetsTrace) {
        let Sets { choices, choice_features, ways, .. } = self.sets;
        let rows = inputs.len() / self.sets.inputs();
        self.gather(inputs, trace);
        self.encode(trace);
        let SetsTrace { items, choices: there, encoded, belongs, scorer, value, outputs, .. } = trace;
        let (encoded, width) = (&encoded[self.encoder()], self.width());
        let pooled = ways * width;
        let seen = choice_features + pooled + width;
        resized(&mut scorer.inputs, there.numbers.len() * seen).fill(0.0);
        resized(&mut value.inputs, rows * seen).fill(0.0);
        let (mut sum, mut marked) = (vec![0.0_f64; width], vec![0.0_f64; choice_features + pooled]);
        let mut belongs = &belongs[..];
        for (row, input) in inputs.chunks_exact(self.sets.inputs()).enumerate() {
            let items = items.of(row);
            let total = &mut value.inputs[row * seen + choice_features + pooled..][..width];
            add_up(&mut sum, encoded, items.clone().map(|item| (item, 1.0)), total);
            total.iter_mut().for_each(|value| *value *= OF_ALL);
            let total = total.to_vec();
            marked.fill(0.0);
            for number in there.of(row) {
                let into = &mut scorer.inputs[number * seen..][..seen];
                let features = &input[self.sets.choice(there.numbers[number])];
                into[..choice_features].copy_from_slice(features);
                for way in 0..ways {
                    let (weights, rest) = belongs.split_at(items.len());
                    belongs = rest;
                    let into = &mut into[choice_features + way * width..][..width];
                    add_up(&mut sum, encoded, items.clone().zip(weights.iter().copied()), into);
                }
                into[choice_features + pooled..].copy_from_slice(&total);
                let mark = features[1];
                marked.iter_mut().zip(&*into).for_each(|(sum, value)| *sum += f64::from(mark * value));
            }
            let seen = &mut value.inputs[row * seen..][..choice_features + pooled];
            seen.iter_mut().zip(&marked).for_each(|(value, sum)| *value = *sum as f32);
        }
        self.run_head(self.encoder(), scorer);
        self.run_head(self.encoder() + 2, value);
        resized(outputs, rows * (choices + 1)).fill(0.0);
        for (row, output) in outputs.chunks_exact_mut(choices + 1).enumerate() {
            there.of(row).for_each(|number| output[there.numbers[number]] = scorer.output[number]);
            output[choices] = value.output[row];
        }
    }

    /// Finds what is there, and writes it down without gaps.
    fn gather(self, inputs: &[f32], trace: &mut SetsTrace) {
        let sets = self.sets;
        let SetsTrace { items, choices, encoded, belongs, .. } = trace;
        items.clear();
        choices.clear();
        belongs.clear();
        encoded.resize_with(self.encoder() + 1, Vec::new);
        encoded[0].clear();
        for row in inputs.chunks_exact(sets.inputs()) {
            let first = items.numbers.len();
            items.numbers.extend((0..sets.items).filter(|&item| row[sets.item(item).start] != 0.0));
            items.starts.push(items.numbers.len());
            let here = &items.numbers[first..];
            here.iter().for_each(|&item| encoded[0].extend_from_slice(&row[sets.item(item)]));
            let first = choices.numbers.len();
            choices.numbers.extend((0..sets.choices).filter(|&choice| row[sets.choice(choice).start] != 0.0));
            choices.starts.push(choices.numbers.len());
            for &choice in &choices.numbers[first..] {
                for way in 0..sets.ways {
                    let weights = &row[sets.belongs(choice, way)];
                    belongs.extend(here.iter().map(|&item| weights[item]));
                }
            }
        }
    }

    fn encode(self, trace: &mut SetsTrace) {
        let count = trace.items.numbers.len();
        for layer in 0..self.encoder() {
            let (before, after) = trace.encoded.split_at_mut(layer + 1);
            let after = resized(&mut after[0], count * self.hidden[layer]);
            let [weight, bias] = self.weight_and_bias(layer);
            affine(&before[layer], weight, bias, after);
            close(after);
        }
    }

    fn run_head(self, first_layer: usize, head: &mut HeadTrace) {
        let [weight, bias] = self.weight_and_bias(first_layer);
        let rows = head.inputs.len() * bias.len() / weight.len();
        affine(&head.inputs, weight, bias, resized(&mut head.hidden, rows * bias.len()));
        close(&mut head.hidden);
        let [weight, bias] = self.weight_and_bias(first_layer + 1);
        affine(&head.hidden, weight, bias, resized(&mut head.output, rows));
    }

    /// Writes the gradient of the loss by all parameters, summed over the rows. `by_output`: `[rows, choices + 1]`.
    pub(crate) fn backward(self, by_output: &[f32], trace: &mut SetsTrace, gradient: &mut [f32]) {
        let Sets { choices, choice_features, ways, .. } = self.sets;
        let (encoder, width) = (self.encoder(), self.width());
        let SetsTrace { items, choices: there, encoded, belongs, scorer, value, by_items, by_total, .. } = trace;
        let rows = by_output.len() / (choices + 1);
        let pooled = ways * width;
        let seen = choice_features + pooled + width;
        let of_choices: Vec<f32> = (0..rows)
            .flat_map(|row| {
                there.numbers[there.of(row)].iter().map(move |choice| by_output[row * (choices + 1) + choice])
            })
            .collect();
        let of_values: Vec<f32> = by_output.chunks_exact(choices + 1).map(|row| row[choices]).collect();
        self.through_head(encoder, &of_choices, scorer, gradient);
        self.through_head(encoder + 2, &of_values, value, gradient);
        let [by_encoded, by_before] = by_items;
        resized(by_encoded, items.numbers.len() * width).fill(0.0);
        let mut belongs = &belongs[..];
        for row in 0..rows {
            let by_value = &value.by_inputs[row * seen..][..seen];
            let of_total = resized(by_total, width);
            of_total.copy_from_slice(&by_value[choice_features + pooled..]);
            for number in there.of(row) {
                let by_choice = &scorer.by_inputs[number * seen..][..seen];
                of_total.iter_mut().zip(&by_choice[choice_features + pooled..]).for_each(|(sum, by)| *sum += by);
                let mark = scorer.inputs[number * seen + 1];
                for way in 0..ways {
                    let columns = choice_features + way * width..choice_features + (way + 1) * width;
                    let [by_choice, by_value] = [by_choice, by_value].map(|by| &by[columns.clone()]);
                    for item in items.of(row) {
                        let (&weight, rest) = belongs.split_first().expect("a weight for each item");
                        belongs = rest;
                        if weight != 0.0 {
                            let by_item = by_encoded[item * width..][..width].iter_mut();
                            by_item.zip(by_choice.iter().zip(by_value)).for_each(|(by_item, (by_choice, by_value))| {
                                *by_item += weight * (by_choice + mark * by_value);
                            });
                        }
                    }
                }
            }
            for item in items.of(row) {
                let by_item = by_encoded[item * width..][..width].iter_mut();
                by_item.zip(&*of_total).for_each(|(by_item, by)| *by_item += OF_ALL * by);
            }
        }
        for layer in (0..encoder).rev() {
            let inputs = if layer == 0 { self.sets.item_features } else { self.hidden[layer - 1] };
            only_open(by_encoded, &encoded[layer + 1]);
            let below = (layer > 0).then_some(&mut *by_before);
            self.through_layer(layer, inputs, &encoded[layer], by_encoded, below, gradient);
            std::mem::swap(by_encoded, by_before);
        }
    }

    /// Goes back through a scorer. `by_output`: gradient by its outputs, one per row of its inputs.
    fn through_head(self, first_layer: usize, by_output: &[f32], head: &mut HeadTrace, gradient: &mut [f32]) {
        let hidden = self.hidden[self.hidden.len() - 1];
        self.through_layer(first_layer + 1, hidden, &head.hidden, by_output, Some(&mut head.by_hidden), gradient);
        only_open(&mut head.by_hidden, &head.hidden);
        let seen = self.values[self.blocks[2 * first_layer].place.clone()].len() / hidden;
        self.through_layer(first_layer, seen, &head.inputs, &head.by_hidden, Some(&mut head.by_inputs), gradient);
    }

    /// Writes the gradient by the weight and the bias of a layer, and, if it is asked for, that by what goes into it.
    fn through_layer(
        self,
        layer: usize,
        inputs: usize,
        before: &[f32],
        by_after: &[f32],
        by_before: Option<&mut Vec<f32>>,
        gradient: &mut [f32],
    ) {
        let [weight, bias] = [2 * layer, 2 * layer + 1].map(|block| self.blocks[block].place.clone());
        let outputs = bias.len();
        let after = Matrix::new(by_after, outputs);
        multiply(Matrix::new(before, inputs).transposed(), after, &mut gradient[weight.clone()], Before::Overwrite);
        sum_rows(by_after, &mut gradient[bias]);
        if let Some(by_before) = by_before {
            let weight = Matrix::new(&self.values[weight], outputs);
            multiply(after, weight.transposed(), resized(by_before, before.len()), Before::Overwrite);
        }
    }
}

/// Writes the weighted sum of some encoded items. It is added up in f64, so that the order of the items does not show.
fn add_up(sum: &mut [f64], encoded: &[f32], items: impl Iterator<Item = (usize, f32)>, into: &mut [f32]) {
    sum.fill(0.0);
    for (item, weight) in items.filter(|(_, weight)| *weight != 0.0) {
        let encoded = &encoded[item * sum.len()..][..sum.len()];
        sum.iter_mut().zip(encoded).for_each(|(sum, value)| *sum += f64::from(weight * value));
    }
    into.iter_mut().zip(&*sum).for_each(|(into, sum)| *into = *sum as f32);
}

/// ReLU. Not `max`, which would hide a NaN.
fn close(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value });
}

/// The gradient passes if the ReLU's output is positive.
fn only_open(by_after: &mut [f32], after: &[f32]) {
    by_after.iter_mut().zip(after).for_each(|(by, &value)| *by = if value > 0.0 { *by } else { 0.0 });
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::testing::{dice, stack};
    use crate::{Rows, Sequences, Shape, Trace};

    const SETS: Sets = Sets { items: 4, item_features: 3, choices: 3, choice_features: 2, ways: 2 };

    fn shape(sets: Sets, hidden: &[usize]) -> Shape {
        Shape::over_sets(sets, hidden.to_vec())
    }

    /// Returns a row with this number of items and choices, in this order of both.
    fn row(sets: Sets, seed: u64, items: &[usize], choices: &[usize]) -> Vec<f32> {
        let mut dice = dice(seed);
        let mut draw = |_| dice.random_range(-1.0..1.0_f32);
        let of_items: Vec<Vec<f32>> =
            (0..items.len()).map(|_| (1..sets.item_features).map(&mut draw).collect()).collect();
        let of_choices: Vec<Vec<f32>> =
            (0..choices.len()).map(|_| (1..sets.choice_features).map(&mut draw).collect()).collect();
        let links: Vec<f32> = (0..items.len() * choices.len() * sets.ways).map(&mut draw).collect();
        let mut row = vec![0.0; sets.inputs()];
        for (number, &place) in items.iter().enumerate() {
            row[sets.item(place)].copy_from_slice(&[&[1.0], &of_items[number][..]].concat());
        }
        for (number, &place) in choices.iter().enumerate() {
            row[sets.choice(place)].copy_from_slice(&[&[1.0], &of_choices[number][..]].concat());
            for way in 0..sets.ways {
                for (item, &at) in items.iter().enumerate() {
                    row[sets.belongs(place, way)][at] = links[(number * sets.ways + way) * items.len() + item];
                }
            }
        }
        row
    }

    #[test]
    fn a_light_of_one_lane_and_one_green_is_worked_out_by_hand() {
        // No encoder: an item stands for itself. x = (1, 3), choice k = (1, 0.5), it has 2 of the item.
        let sets = Sets { items: 1, item_features: 2, choices: 1, choice_features: 2, ways: 1 };
        let mut stack = stack(shape(sets, &[1]), &[0]);
        // Seen: k, then 2 x = (2, 6), then all = x / 4 = (0.25, 0.75). Scorer: 1 0 | 1 0.5 | 4 0, bias -1: 1 + 2 + 3 + 1 - 1
        // = 6; output 2 * 6 + 0.5 = 12.5. Value sees 0.5 k = (0.5, 0.25), 0.5 * (2, 6) = (1, 3), all: weights 1 everywhere,
        // bias 0: 0.75 + 4 + 1 = 5.75; output -5.75.
        let scorer = [1.0, 0.0, 1.0, 0.5, 4.0, 0.0, -1.0, 2.0, 0.5];
        let value = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, -1.0, 0.0];
        stack.parameters_mut().load(&Rows::from_vec([scorer, value].concat(), 18));
        let mut trace = Trace::default();
        let inputs = [1.0, 3.0, 1.0, 0.5, 2.0];
        stack.network(0).forward(&inputs, Sequences::NONE, &mut trace);
        assert_eq!(trace.output(), [12.5, -5.75]);
        stack.network(0).backward(&[1.0, 1.0], &mut trace);
        // By the scorer's weight: 2 x what is seen; its bias 2; by its output's weight 6, and its bias 1.
        let of_scorer = [2.0, 1.0, 4.0, 12.0, 0.5, 1.5, 2.0, 6.0, 1.0];
        let of_value = [-0.5, -0.25, -1.0, -3.0, -0.25, -0.75, -1.0, 5.75, 1.0];
        assert_eq!(trace.gradient(), [of_scorer, of_value].concat());
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let inputs =
            [row(SETS, 1, &[0, 1, 2], &[0, 1]), row(SETS, 2, &[0, 1, 2, 3], &[0, 1, 2]), row(SETS, 3, &[0], &[0])];
        let inputs = inputs.concat();
        let mut dice = dice(9);
        let by_output: Vec<f32> = (0..12).map(|_| dice.random_range(-1.0..1.0)).collect();
        for hidden in [&[7][..], &[6, 7], &[6, 5, 7]] {
            let mut stack = stack(shape(SETS, hidden), &[5]);
            let mut trace = Trace::default();
            stack.network(0).forward(&inputs, Sequences::NONE, &mut trace);
            stack.network(0).backward(&by_output, &mut trace);
            let gradient = trace.gradient().to_vec();
            for (parameter, &found) in gradient.iter().enumerate() {
                let mut at = |shift: f32| -> f64 {
                    stack.parameters_mut().values_mut().as_mut_slice()[parameter] += shift;
                    stack.network(0).forward(&inputs, Sequences::NONE, &mut trace);
                    stack.parameters_mut().values_mut().as_mut_slice()[parameter] -= shift;
                    trace.output().iter().zip(&by_output).map(|(y, w)| f64::from(y * w)).sum()
                };
                let step = 2e-3_f32;
                let slope = (at(step) - at(-step)) / f64::from(2.0 * step);
                let found = f64::from(found);
                assert!((slope - found).abs() < 1e-2, "{hidden:?}, parameter {parameter}: {slope} {found}");
            }
        }
    }

    #[test]
    fn neither_the_order_nor_the_room_for_more_shows() {
        let wide = Sets { items: 9, choices: 5, ..SETS };
        let networks = [stack(shape(SETS, &[16, 16]), &[4]), stack(shape(wide, &[16, 16]), &[4])];
        assert_eq!(networks[0].parameters().values(), networks[1].parameters().values());
        let outputs = |wide: bool, inputs: &[f32]| {
            let mut trace = Trace::default();
            networks[usize::from(wide)].network(0).forward(inputs, Sequences::NONE, &mut trace);
            trace.output().to_vec()
        };
        let first = outputs(false, &row(SETS, 7, &[0, 1, 2, 3], &[0, 1, 2]));
        let other = outputs(false, &row(SETS, 7, &[2, 3, 0, 1], &[1, 2, 0]));
        assert_eq!([other[1], other[2], other[0], other[3]], first[..]);
        let wider = outputs(true, &row(wide, 7, &[8, 0, 3, 5], &[4, 1, 2]));
        assert_eq!([wider[4], wider[1], wider[2], wider[5]], first[..]);
        assert_eq!([wider[0], wider[3]], [0.0, 0.0], "what is not there has no score");
    }
}
