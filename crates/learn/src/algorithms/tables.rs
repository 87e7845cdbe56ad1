//! What learners keep between periods, named tables with a row per agent, and what they report, [`Metrics`]. Workers and
//! checkpoints carry both without knowing what they mean.

use std::collections::BTreeMap;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::state::stream::Part;
use dials_core::base::{AgentId, Dice, Ragged, RandomPurpose, Seed, is_stuck};
use dials_core::domain::Result;
use stacknets::{Adam, Moments, Parameters};

/// Names of the tables of a [`Base`], as in checkpoints.
const FIRST_MOMENTS: &str = "first_moments";
const SECOND_MOMENTS: &str = "second_moments";
const ACTING: &str = "acting";
const MINIBATCHES: &str = "minibatches";
const GRADIENT_STEPS: &str = "gradient_steps";

/// Tables of some agents, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tables {
    /// Numbers, one row per agent.
    pub numbers: BTreeMap<String, Ragged<f32>>,
    /// States of dice, one list per agent.
    pub dice: BTreeMap<String, Vec<Vec<Dice>>>,
    /// Counts that are the same for all agents.
    pub counts: BTreeMap<String, u64>,
    /// What a learner outside of this program keeps for all agents together: only that can read it.
    pub bytes: Vec<u8>,
}

/// What every learner keeps: its optimiser and its dice.
pub(super) struct Base {
    pub(super) adam: Adam,
    /// Dice for the actions, one per row of each part.
    pub(super) acting: Vec<Vec<Dice>>,
    pub(super) parts: Vec<Part>,
    pub(super) copies: usize,
    /// Dice for the minibatches, one per agent.
    pub(super) minibatches: Vec<Dice>,
}

impl Base {
    pub(super) fn new(config: &Config, agents: &[AgentId], parameters: &Parameters, parts: &[Part]) -> Base {
        let seed = |purpose: RandomPurpose, agent: &AgentId| Seed::new(config.seed).fork(purpose).for_agent(*agent);
        let of_row = |part: &Part, row: usize| {
            let (agent, copy) = part.place(row);
            seed(RandomPurpose::Acting, &agents[agent]).for_copy(copy).dice()
        };
        Base {
            adam: Adam::new(parameters),
            acting: parts.iter().map(|part| (0..part.rows()).map(|row| of_row(part, row)).collect()).collect(),
            parts: parts.to_vec(),
            copies: config.copies(),
            minibatches: agents.iter().map(|agent| seed(RandomPurpose::PolicyMinibatches, agent).dice()).collect(),
        }
    }

    /// Returns the layout of its tables. `parameters`: number of those of an agent's policy.
    pub(super) fn layout(config: &Config, parameters: usize, gradient_steps: u64) -> Layout {
        let moments =
            NumberTable { name: FIRST_MOMENTS, width: parameters, averaged: true, squares: false, learnt: true };
        Layout {
            numbers: vec![moments, NumberTable { name: SECOND_MOMENTS, squares: true, ..moments }],
            dice: vec![(ACTING, config.copies()), (MINIBATCHES, 1)],
            counts: vec![(GRADIENT_STEPS, gradient_steps)],
            bytes: false,
        }
    }

    /// Returns number and row of the part in which each row is, ordered by agent, then by copy.
    pub(super) fn places(&self) -> impl Iterator<Item = (usize, usize)> {
        let rows = (0..self.minibatches.len()).flat_map(|agent| (0..self.copies).map(move |copy| (agent, copy)));
        rows.map(|(agent, copy)| {
            let mut parts = self.parts.iter().enumerate();
            parts.find_map(|(part, rows)| Some((part, rows.row(agent, copy)?))).expect("a row is in a part")
        })
    }

    pub(super) fn tables(&self) -> Tables {
        let Moments { first, second, steps } = self.adam.moments().clone();
        let acting: Vec<Dice> = self.places().map(|(part, row)| self.acting[part][row].clone()).collect();
        let acting = acting.chunks(self.copies).map(<[Dice]>::to_vec).collect();
        let minibatches = self.minibatches.iter().map(|dice| vec![dice.clone()]).collect();
        Tables {
            numbers: [(FIRST_MOMENTS.to_owned(), first.into()), (SECOND_MOMENTS.to_owned(), second.into())].into(),
            dice: [(ACTING.to_owned(), acting), (MINIBATCHES.to_owned(), minibatches)].into(),
            counts: [(GRADIENT_STEPS.to_owned(), u64::from(steps))].into(),
            bytes: Vec::new(),
        }
    }

    pub(super) fn load(&mut self, tables: &mut Tables) {
        self.adam.restore(Moments {
            first: tables.take_numbers(FIRST_MOMENTS).into_rows(),
            second: tables.take_numbers(SECOND_MOMENTS).into_rows(),
            steps: u32::try_from(tables.counts[GRADIENT_STEPS]).expect("the layout gives this number"),
        });
        let mut dice = |name| tables.dice.remove(name).expect("a learner keeps these dice").concat();
        let acting = dice(ACTING);
        self.minibatches = dice(MINIBATCHES);
        let places: Vec<(usize, usize)> = self.places().collect();
        places.into_iter().zip(acting).for_each(|((part, row), dice)| self.acting[part][row] = dice);
    }
}

/// Names and sizes of the tables of one agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    pub numbers: Vec<NumberTable>,
    /// Names of the dice, and how many an agent has.
    pub(crate) dice: Vec<(&'static str, usize)>,
    /// Names of the counts, and their values.
    pub(crate) counts: Vec<(&'static str, u64)>,
    /// Whether there are bytes that only the learner can read.
    pub bytes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberTable {
    pub name: &'static str,
    pub width: usize,
    /// Whether agents that get the mean of their policies get the mean of this, too.
    pub(crate) averaged: bool,
    /// Whether no value may be negative.
    pub(crate) squares: bool,
    /// Whether values that are not finite mean that learning has diverged. If not, training cannot continue from them,
    /// but a good file may be replaced by them.
    pub learnt: bool,
}

impl Tables {
    /// Returns the numbers of a name. Panics if there are none: the caller checked the layout, or made them.
    pub(crate) fn take_numbers(&mut self, name: &str) -> Ragged<f32> {
        self.numbers.remove(name).unwrap_or_else(|| panic!("a learner keeps the table `{name}`"))
    }

    pub(crate) fn share(&self, agents: impl IntoIterator<Item = usize> + Clone) -> Tables {
        let numbers = self.numbers.iter().map(|(name, table)| (name.clone(), table.pick(agents.clone())));
        let dice = self
            .dice
            .iter()
            .map(|(name, dice)| (name.clone(), agents.clone().into_iter().map(|agent| dice[agent].clone()).collect()));
        Tables {
            numbers: numbers.collect(),
            dice: dice.collect(),
            counts: self.counts.clone(),
            bytes: self.bytes.clone(),
        }
    }

    pub(crate) fn replace(&mut self, first: usize, part: &Tables) {
        self.counts.clone_from(&part.counts);
        self.bytes.clone_from(&part.bytes);
        for (name, table) in &part.numbers {
            self.numbers.entry(name.clone()).or_default().splice(first, table);
        }
        for (name, dice) in &part.dice {
            let all = self.dice.entry(name.clone()).or_default();
            all[first..][..dice.len()].clone_from_slice(dice);
        }
    }

    pub(crate) fn extend(&mut self, other: Tables) {
        self.counts = other.counts;
        self.bytes = other.bytes;
        for (name, table) in other.numbers {
            self.numbers.entry(name).or_default().extend(&table);
        }
        for (name, dice) in other.dice {
            self.dice.entry(name).or_default().extend(dice);
        }
    }

    /// Returns an error if the names are not those of a layout.
    pub(crate) fn check_names(&self, layout: &Layout) -> Result<()> {
        fn same<'a>(kind: &str, has: impl Iterator<Item = &'a String>, wanted: Vec<&'static str>) -> Result<()> {
            let has: Vec<&str> = has.map(String::as_str).collect();
            let mut wanted = wanted;
            wanted.sort_unstable();
            ensure!(has == wanted, "it has the {kind} {has:?}, and this algorithm keeps {wanted:?}");
            Ok(())
        }
        same("tables", self.numbers.keys(), layout.numbers.iter().map(|table| table.name).collect())?;
        same("dice", self.dice.keys(), layout.dice.iter().map(|(name, _)| *name).collect())?;
        same("counts", self.counts.keys(), layout.counts.iter().map(|(name, _)| *name).collect())
    }

    /// Returns an error if the row of an agent does not fit a layout. `index`: place of the agent in these tables.
    pub(crate) fn check_agent(&self, index: usize, layout: &Layout) -> Result<()> {
        for NumberTable { name, width, .. } in &layout.numbers {
            let found = self.numbers[*name].row(index).len();
            ensure!(found == *width, "its table `{name}` has {found} values, not {width}");
        }
        for (name, count) in &layout.dice {
            let dice = &self.dice[*name][index];
            ensure!(dice.len() == *count, "it has {} dice `{name}`, not {count}", dice.len());
            ensure!(
                !dice.iter().any(is_stuck),
                "the dice `{name}` are all zeros, and would show the same number for ever"
            );
        }
        Ok(())
    }

    /// Returns an error if training cannot continue from the numbers of an agent, whose row fits the layout.
    pub(crate) fn check_numbers(&self, index: usize, layout: &Layout) -> Result<()> {
        for NumberTable { name, squares, .. } in &layout.numbers {
            let row = self.numbers[*name].row(index);
            check_finite(name, row)?;
            if let Some(bad) = row.iter().find(|&&value| *squares && value < 0.0) {
                anyhow::bail!("its table `{name}` holds {bad}, but they are squares");
            }
        }
        Ok(())
    }
}

/// Returns an error if an agent's row of a table holds what is no finite number.
pub(crate) fn check_finite(name: &str, row: &[f32]) -> Result<()> {
    match row.iter().find(|value| !value.is_finite()) {
        Some(bad) => anyhow::bail!("its table `{name}` holds {bad}, which is not a finite number"),
        None => Ok(()),
    }
}

/// Figures of one update, or their sums over several. Their names are columns of `training.csv`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Figures with a value per agent, such as losses.
    pub of_agents: Vec<(String, Vec<f64>)>,
    /// Settings that were the same for all agents, such as the learning rate.
    pub settings: Vec<(String, f64)>,
}

impl Metrics {
    /// Adds the figures of a later update, and takes its settings.
    pub(crate) fn add(&mut self, update: Metrics) {
        for ((_, sums), (_, values)) in self.of_agents.iter_mut().zip(update.of_agents) {
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        self.settings = update.settings;
    }

    /// Returns those of some agents.
    pub(crate) fn share(&self, agents: impl IntoIterator<Item = usize> + Clone) -> Metrics {
        let of = |values: &[f64]| agents.clone().into_iter().map(|agent| values[agent]).collect();
        Metrics {
            of_agents: self.of_agents.iter().map(|(name, values)| (name.clone(), of(values))).collect(),
            settings: self.settings.clone(),
        }
    }

    pub(crate) fn extend(&mut self, other: Metrics) {
        for ((_, values), (_, others)) in self.of_agents.iter_mut().zip(other.of_agents) {
            values.extend(others);
        }
    }

    /// Returns the names of the figures, then of the settings.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let figures = self.of_agents.iter().map(|(name, _)| name.as_str());
        figures.chain(self.settings.iter().map(|(name, _)| name.as_str()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn losses(values: &[f64], rate: f64) -> Metrics {
        Metrics { of_agents: vec![("loss".into(), values.to_vec())], settings: vec![("rate".into(), rate)] }
    }

    #[test]
    fn updates_are_added_up_with_the_last_settings_and_the_agents_of_several_learners_are_joined() {
        let mut sum = losses(&[1.0, 4.0], 0.2);
        sum.add(losses(&[3.0, 0.0], 0.1));
        assert_eq!(sum, losses(&[4.0, 4.0], 0.1));
        assert_eq!(losses(&[1.0, 4.0, 9.0], 0.2).share([2, 0]), losses(&[9.0, 1.0], 0.2));
        let mut both = losses(&[1.0, 3.0], 0.1);
        both.extend(losses(&[2.0], 0.1));
        assert_eq!(both, losses(&[1.0, 3.0, 2.0], 0.1));
        assert_eq!(both.names().collect::<Vec<_>>(), ["loss", "rate"]);
    }
}
