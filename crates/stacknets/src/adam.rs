//! Adam over a stack, network by network, in one pass over memory.

use std::borrow::Cow;

use multiversion::multiversion;
use serde::{Deserialize, Serialize};

use super::Rows;
use super::network::Network;
use super::shape::{Layout, Shape};
use super::{Parameters, Stack};

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Gradients, first moments and second moments below these count as 0.
///
/// The moments of a weight fade while its input is off. Without an end they stay among the subnormal numbers for ever,
/// where some processors are far slower. What is lost would move a weight by about 1e-8 learning rates per
/// step at most, because EPSILON is 1e-8.
const SMALLEST_GRADIENT: f32 = 1e-16;
const SMALLEST_FIRST: f32 = 1e-18;
const SMALLEST_SECOND: f32 = 1e-36;

/// The optimiser of one stack. It works element by element, so every network has its own Adam.
///
/// Constants: `beta1` 0.9, `beta2` 0.999; `epsilon` 1e-8 unless said otherwise, as torch's default. The learning rate
/// comes with each step.
///
/// Source: Kingma & Ba 2015, algorithm 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    moments: Moments,
    epsilon: f32,
}

/// The state of an optimiser, to be saved and restored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// First moments: `[networks, parameters]`.
    pub first: Rows<f32>,
    /// Second moments, same shape.
    pub second: Rows<f32>,
    /// Number of gradient steps taken.
    pub steps: u32,
}

impl Adam {
    /// Makes the optimiser of a stack with these parameters. It has seen no gradient yet.
    pub fn new(parameters: &Parameters) -> Self {
        let zeros = Rows::new(parameters.networks(), parameters.width());
        Adam { moments: Moments { first: zeros.clone(), second: zeros, steps: 0 }, epsilon: EPSILON }
    }

    /// Uses another epsilon: what is added to the root of the second moments.
    pub fn with_epsilon(self, epsilon: f64) -> Self {
        Adam { epsilon: epsilon as f32, ..self }
    }

    /// Returns its state.
    pub fn moments(&self) -> &Moments {
        &self.moments
    }

    /// Continues from moments of the same stack.
    ///
    /// # Panics
    /// If the moments have a different shape.
    pub fn restore(&mut self, moments: Moments) {
        let shape = |rows: &Rows<f32>| (rows.len(), rows.width());
        assert_eq!(shape(&moments.first), shape(&self.moments.first), "moments of another stack");
        self.moments = moments;
    }

    /// Forgets all gradients: the next step is again a first one.
    pub fn begin_again(&mut self) {
        self.moments.first.fill(0.0);
        self.moments.second.fill(0.0);
        self.moments.steps = 0;
    }

    /// Copies the moments of the first network to all others.
    pub fn spread_first(&mut self) {
        spread_first(&mut self.moments.first);
        spread_first(&mut self.moments.second);
    }

    /// Returns every network with its part of the optimiser, for `steps` gradient steps each.
    ///
    /// One trainer can take all its steps before the next one begins, while its network is in the cache. The trainers
    /// are `Send`: [`Threads::map`](crate::Threads::map) shares them among threads.
    ///
    /// All networks of a stack have the same number of steps behind them, which the optimiser counts once. So each
    /// trainer should take exactly `steps` steps.
    pub fn trainers<'a>(&'a mut self, stack: &'a mut Stack, steps: u32) -> Vec<Trainer<'a>> {
        let Adam { moments: Moments { first, second, steps: taken }, epsilon } = self;
        let epsilon = *epsilon;
        let begin = *taken;
        *taken += steps;
        let width = first.width();
        let moments = first.as_mut_slice().chunks_exact_mut(width).zip(second.as_mut_slice().chunks_exact_mut(width));
        let (shape, layout, values) = stack.parts_mut();
        let rows = values.as_mut_slice().chunks_exact_mut(width).zip(moments);
        let (step, end) = (begin, *taken);
        let trainer = |(values, (first, second)): (&'a mut [f32], (&'a mut [f32], &'a mut [f32]))| {
            let (shape, layout) = (Cow::Borrowed(shape), Cow::Borrowed(layout));
            Trainer { shape, layout, values, first, second, epsilon, step, end }
        };
        rows.map(trainer).collect()
    }
}

/// Copies the first row of a table to all others.
pub(crate) fn spread_first(rows: &mut Rows<f32>) {
    let width = rows.width();
    let (first, others) = rows.as_mut_slice().split_at_mut(width);
    others.chunks_exact_mut(width).for_each(|row| row.copy_from_slice(first));
}

/// One network and its part of the optimiser.
pub struct Trainer<'a> {
    shape: Cow<'a, Shape>,
    layout: Cow<'a, Layout>,
    values: &'a mut [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
    epsilon: f32,
    step: u32,
    end: u32,
}

impl<'a> Trainer<'a> {
    /// Returns a trainer for each tower: two if some outputs are apart. Each sees a network of its tower alone, and should take
    /// as many steps as the whole. All of its numbers are those of the whole, bit for bit, so the towers can be trained at the
    /// same time.
    pub fn towers(self) -> Vec<Trainer<'a>> {
        if self.shape.apart == 0 {
            return vec![self];
        }
        let Trainer { shape, mut values, mut first, mut second, epsilon, step, end, .. } = self;
        let towers = shape.towers().into_iter().map(|shape| {
            let layout = shape.layout();
            let next = |rest: &mut &'a mut [f32]| rest.split_off_mut(..layout.width()).expect("towers fill a row");
            let (values, first, second) = (next(&mut values), next(&mut first), next(&mut second));
            Trainer { shape: Cow::Owned(shape), layout: Cow::Owned(layout), values, first, second, epsilon, step, end }
        });
        towers.collect()
    }

    /// Returns the network as it is now.
    pub fn network(&self) -> Network<'_> {
        Network { shape: &self.shape, layout: &self.layout, values: self.values }
    }

    /// Returns the parameters, `[parameters]`.
    pub fn values(&self) -> &[f32] {
        self.values
    }

    /// Replaces the parameters, `[parameters]`. The optimiser's moments stay.
    ///
    /// # Panics
    /// If there are more or fewer values than parameters.
    pub fn load(&mut self, values: &[f32]) {
        self.values.copy_from_slice(values);
    }

    /// Makes all weights smaller by this share, and leaves the biases: weight decay apart from the gradient, before a
    /// step.
    ///
    /// Source: Loshchilov & Hutter 2019, algorithm 2.
    pub fn shrink_weights(&mut self, share: f64) {
        let factor = (1.0 - share) as f32;
        for range in self.layout.weights() {
            self.values[range].iter_mut().for_each(|weight| *weight *= factor);
        }
    }

    /// Takes one step against the gradient, `[parameters]`.
    ///
    /// # Panics
    /// If it is a step more than [`Adam::trainers`] was asked for, or if the gradient has another length.
    pub fn descend(&mut self, gradient: &[f32], learning_rate: f64) {
        assert!(self.step < self.end, "more gradient steps than were announced");
        assert_eq!(gradient.len(), self.values.len(), "a gradient of another network");
        self.step += 1;
        let correction1 = 1.0 - f64::from(BETA1).powi(self.step as i32);
        let correction2 = 1.0 - f64::from(BETA2).powi(self.step as i32);
        let step_size = (learning_rate / correction1) as f32;
        let root_correction = (1.0 / correction2.sqrt()) as f32;
        update(self.values, gradient, self.first, self.second, (step_size, root_correction, self.epsilon));
    }
}

/// Updates all parameters in one pass over memory. Compiled for several register widths. It uses no fused multiply-add:
/// `product` says why.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn update(
    values: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    (step_size, root_correction, epsilon): (f32, f32, f32),
) {
    let moments = first.iter_mut().zip(second);
    for ((value, &gradient), (first, second)) in values.iter_mut().zip(gradient).zip(moments) {
        let gradient = or_zero(gradient, SMALLEST_GRADIENT);
        *first = or_zero(BETA1 * *first + (1.0 - BETA1) * gradient, SMALLEST_FIRST);
        *second = or_zero(BETA2 * *second + (1.0 - BETA2) * gradient * gradient, SMALLEST_SECOND);
        *value -= step_size * *first / (second.sqrt() * root_correction + epsilon);
    }
}

/// Returns the number, or 0 if it is nearer to 0 than `smallest`.
#[inline(always)]
fn or_zero(number: f32, smallest: f32) -> f32 {
    if number.abs() < smallest { 0.0 } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;
    use crate::testing::stack;

    fn line() -> Stack {
        let mut stack =
            stack(Shape { inputs: 1, recurrent: None, hidden: vec![], outputs: 1, apart: 0, sets: None }, &[0]);
        stack.parameters_mut().load(&Rows::from_vec(vec![1.0, -1.0], 2));
        stack
    }

    #[test]
    fn two_steps_are_worked_out_by_hand() {
        // Two parameters, 1 and -1; the gradients of both are 2 then 1.
        let mut stack = line();
        let mut adam = Adam::new(stack.parameters());
        for gradient in [2.0, 1.0] {
            let mut trainers = adam.trainers(&mut stack, 1);
            trainers[0].descend(&[gradient; 2], 0.1);
        }
        // Step 1: m = 0.2, v = 0.004; corrected 2 and 4: w -= 0.1 * 2 / 2 = 0.1.
        // Step 2: m = 0.28, v = 0.004996; corrected 0.28 / 0.19 = 1.473684 and 0.004996 / 0.001999 = 2.499250,
        //         root 1.580902: w -= 0.1 * 1.473684 / 1.580902 = 0.093218.
        for (value, expected) in stack.parameters().values().as_slice().iter().zip([0.806_782, -1.193_218]) {
            assert!((value - expected).abs() < 1e-6, "{value} {expected}");
        }
    }

    #[test]
    fn moments_of_a_weight_without_gradients_fade_to_zero_and_are_never_subnormal() {
        let mut stack = line();
        let mut adam = Adam::new(stack.parameters());
        adam.trainers(&mut stack, 1)[0].descend(&[1e-3, 1e-20], 0.1);
        let fade = |adam: &mut Adam, stack: &mut Stack, steps| {
            let mut trainers = adam.trainers(stack, steps);
            (0..steps).for_each(|_| trainers[0].descend(&[0.0; 2], 0.1));
        };
        // A first moment of 1e-4 falls below 1e-18 after ln(1e14) / -ln(0.9) = 306 steps.
        fade(&mut adam, &mut stack, 300);
        let Moments { first, second, .. } = adam.moments();
        assert!(first.as_slice()[0] > 1e-18 && first.as_slice()[1] == 0.0, "{first:?}");
        // A second moment of 1e-9 needs ln(1e27) / -ln(0.999) = 62 139 steps to fall below 1e-36.
        assert!(second.as_slice()[0] > 1e-36 && second.as_slice()[1] == 0.0, "{second:?}");
        fade(&mut adam, &mut stack, 20);
        assert_eq!(adam.moments().first.as_slice(), [0.0; 2]);
        fade(&mut adam, &mut stack, 62_000);
        assert_eq!(adam.moments().second.as_slice(), [0.0; 2]);
    }

    #[test]
    fn weights_shrink_and_biases_stay_and_a_new_beginning_takes_its_first_step_again() {
        let mut stack = line();
        let mut adam = Adam::new(stack.parameters());
        let mut trainers = adam.trainers(&mut stack, 1);
        trainers[0].shrink_weights(0.25);
        assert_eq!(trainers[0].values(), [0.75, -1.0]);
        trainers[0].load(&[3.0, 4.0]);
        trainers[0].descend(&[2.0; 2], 0.1);
        adam.begin_again();
        assert_eq!(adam, Adam::new(stack.parameters()));
        adam.trainers(&mut stack, 1)[0].descend(&[-7.0; 2], 0.1);
        // A first step is as long as the learning rate, whatever the gradient: forth and back.
        let values = stack.parameters().values().as_slice();
        assert!((values[0] - 3.0).abs() < 1e-6 && (values[1] - 4.0).abs() < 1e-6, "{values:?}");
    }
}
