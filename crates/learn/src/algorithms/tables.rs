//! What learners keep between periods: named tables with a row per agent. Workers and checkpoints carry them without
//! knowing what they mean.

use std::collections::BTreeMap;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use dials_core::base::{Dice, Ragged, is_stuck};
use dials_core::domain::Result;

/// Tables of some agents, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tables {
    /// Numbers, one row per agent.
    pub numbers: BTreeMap<String, Ragged<f32>>,
    /// States of dice, one list per agent.
    pub dice: BTreeMap<String, Vec<Vec<Dice>>>,
    /// Counts that are the same for all agents.
    pub counts: BTreeMap<String, u64>,
}

/// Names and sizes of the tables of one agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    pub numbers: Vec<NumberTable>,
    /// Names of the dice, and how many an agent has.
    pub dice: Vec<(&'static str, usize)>,
    /// Names of the counts, and their values.
    pub(crate) counts: Vec<(&'static str, u64)>,
}

/// A table of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberTable {
    pub name: &'static str,
    /// Number of values of an agent.
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

    /// Returns the dice of a name, like [`Tables::take_numbers`].
    pub(crate) fn take_dice(&mut self, name: &str) -> Vec<Vec<Dice>> {
        self.dice.remove(name).unwrap_or_else(|| panic!("a learner keeps the dice `{name}`"))
    }

    /// Returns the tables of some of the agents, in this order.
    pub(crate) fn share(&self, agents: impl IntoIterator<Item = usize> + Clone) -> Tables {
        let numbers = self.numbers.iter().map(|(name, table)| (name.clone(), table.pick(agents.clone())));
        let dice = self
            .dice
            .iter()
            .map(|(name, dice)| (name.clone(), agents.clone().into_iter().map(|agent| dice[agent].clone()).collect()));
        Tables { numbers: numbers.collect(), dice: dice.collect(), counts: self.counts.clone() }
    }

    /// Overwrites the tables of the agents from `first` on.
    pub(crate) fn replace(&mut self, first: usize, part: &Tables) {
        self.counts.clone_from(&part.counts);
        for (name, table) in &part.numbers {
            self.numbers.entry(name.clone()).or_default().splice(first, table);
        }
        for (name, dice) in &part.dice {
            let all = self.dice.entry(name.clone()).or_default();
            all[first..][..dice.len()].clone_from_slice(dice);
        }
    }

    /// Appends the tables of further agents.
    pub(crate) fn extend(&mut self, other: Tables) {
        self.counts = other.counts;
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
            if let Some(bad) = row.iter().find(|value| !value.is_finite()) {
                anyhow::bail!("its table `{name}` holds {bad}, which is not a finite number");
            }
            if let Some(bad) = row.iter().find(|&&value| *squares && value < 0.0) {
                anyhow::bail!("its table `{name}` holds {bad}, but they are squares");
            }
        }
        Ok(())
    }
}
