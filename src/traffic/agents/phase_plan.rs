//! The phases of one light: the greens that its agent chooses from, and what the light shows between two of them.

use crate::sumo::SignalState;

/// What a light can show, and what an action means to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhasePlan {
    greens: Vec<SignalState>,
    /// What is shown between two greens, `[from][to]`; empty where nothing has to be cleared.
    clearings: Vec<Vec<Vec<Interval>>>,
    /// Least number of steps of a green.
    min_green_steps: u32,
    choice: Choice,
}

/// A state that is shown for some steps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interval {
    pub state: SignalState,
    pub steps: u32,
}

/// The meaning of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// 0 keeps the green, 1 goes to the next one. The paper's actions.
    KeepOrSwitch,
    /// The index of a green: the light goes to it or stays there.
    Target,
}

impl PhasePlan {
    /// Makes a plan of at least two greens. `clearing(from, to)` returns what is shown between two different greens.
    pub fn new(
        greens: Vec<SignalState>,
        choice: Choice,
        min_green_steps: u32,
        clearing: impl Fn(usize, usize) -> Vec<Interval>,
    ) -> PhasePlan {
        assert!(greens.len() >= 2, "a light with something to choose");
        assert!(min_green_steps >= 1, "a green is shown");
        let between = |from: usize, to: usize| if from == to { Vec::new() } else { clearing(from, to) };
        let clearings = (0..greens.len()).map(|from| (0..greens.len()).map(|to| between(from, to)).collect()).collect();
        PhasePlan { greens, clearings, min_green_steps, choice }
    }

    /// Returns the greens, at least two, in the order of their program.
    pub fn greens(&self) -> &[SignalState] {
        &self.greens
    }

    /// Returns what is shown between two greens.
    pub fn clearing(&self, from: usize, to: usize) -> &[Interval] {
        &self.clearings[from][to]
    }

    pub fn min_green_steps(&self) -> u32 {
        self.min_green_steps
    }

    pub fn choice(&self) -> Choice {
        self.choice
    }

    /// Returns the number of actions.
    pub fn actions(&self) -> usize {
        match self.choice {
            Choice::KeepOrSwitch => 2,
            Choice::Target => self.greens.len(),
        }
    }

    /// Returns the green after this one, in the order of the program.
    pub fn next(&self, green: usize) -> usize {
        (green + 1) % self.greens.len()
    }
}
