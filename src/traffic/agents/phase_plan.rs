//! The phases of one light: the greens that its agent chooses from, and what the light shows between two of them.

use crate::domain::Action;
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

/// What a light shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The green of this index.
    Green(usize),
    /// Yellow or all red between two greens.
    Between { from: usize, to: usize },
}

impl Shown {
    pub fn is_green(self) -> bool {
        matches!(self, Shown::Green(_))
    }

    /// Returns the green that is shown; `None` between greens.
    pub fn green(self) -> Option<usize> {
        match self {
            Shown::Green(green) => Some(green),
            Shown::Between { .. } => None,
        }
    }

    /// Returns the green that is shown or comes next.
    pub fn target(self) -> usize {
        match self {
            Shown::Green(green) => green,
            Shown::Between { to, .. } => to,
        }
    }
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

    /// Returns the number of steps between two greens.
    pub fn clearing_steps(&self, from: usize, to: usize) -> u32 {
        self.clearings[from][to].iter().map(|interval| interval.steps).sum()
    }

    /// Returns the action that makes a light that shows `shown` go to a green, or stay there.
    pub fn towards(&self, shown: Shown, green: usize) -> Action {
        match self.choice {
            Choice::KeepOrSwitch => Action::from(shown.target() != green),
            Choice::Target => Action::try_from(green).expect("a plan has at most 256 greens"),
        }
    }

    /// Returns the green that an action asks for at a light that shows `shown`.
    pub fn asked_for(&self, shown: Shown, action: Action) -> usize {
        match self.choice {
            Choice::KeepOrSwitch if action == 0 => shown.target(),
            Choice::KeepOrSwitch => self.next(shown.target()),
            Choice::Target => usize::from(action),
        }
    }

    /// Returns what a state means that another program shows, if the last green was `last`.
    pub fn recognise(&self, state: &SignalState, last: usize) -> Shown {
        if let Some(green) = self.greens.iter().position(|green| green == state) {
            return Shown::Green(green);
        }
        let leads_to = |to: &usize| self.clearings[last][*to].iter().any(|interval| interval.state == *state);
        // A program may clear in its own way. Then its next green is the likely one.
        let to = (0..self.greens.len()).find(leads_to).unwrap_or_else(|| self.next(last));
        Shown::Between { from: last, to }
    }
}
