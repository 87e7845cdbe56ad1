//! The phases of one light: the greens that its agent chooses from, and what the light shows between two of them.

use std::collections::BTreeSet;

use super::red_limits::{RedLimits, TooShort};
use dials_core::domain::Action;
use libsumo::SignalState;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhasePlan {
    greens: Vec<SignalState>,
    /// Letters by which greens are recognised in other programs.
    cars: BTreeSet<usize>,
    /// What is shown between two greens, `[from][to]`; empty where nothing has to be cleared.
    clearings: Vec<Vec<Vec<Interval>>>,
    /// Steps at the beginning of it in which cars keep their green, and people on foot who lose theirs have red, `[from][to]`.
    walk_ends: Vec<Vec<u32>>,
    /// Ways of its program from green to green. Without any, a green is followed by the next one.
    pub(crate) program: Vec<ProgramChange>,
    /// Least number of steps for which cars have each green, with the end of the walk.
    min_green_steps: Vec<u32>,
    /// Part of it that timings of lights that go by the clock are raised to; 0 for a green whose minimum they only wait for.
    strict_min_steps: Vec<u32>,
    /// Largest number of steps for which cars have each green; `None`: no limit.
    max_green_steps: Vec<Option<u32>>,
    red_limits: Option<RedLimits>,
    /// Number of steps after which the light leaves a green by itself, until it is switched in an episode.
    pub(crate) own_green_steps: Option<u32>,
    choice: Choice,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interval {
    pub state: SignalState,
    pub steps: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ProgramChange {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) between: Vec<SignalState>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    Green(usize),
    Between { from: usize, to: usize },
}

impl Shown {
    pub(crate) fn is_green(self) -> bool {
        matches!(self, Shown::Green(_))
    }

    pub(crate) fn green(self) -> Option<usize> {
        match self {
            Shown::Green(green) => Some(green),
            Shown::Between { .. } => None,
        }
    }

    /// Returns the green that is shown or comes next.
    pub(crate) fn target(self) -> usize {
        match self {
            Shown::Green(green) => green,
            Shown::Between { to, .. } => to,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Choice {
    /// 0 keeps the green, 1 goes to the next one. The paper's actions.
    KeepOrSwitch,
    /// The index of a green: the light goes to it or stays there.
    Target,
    /// The same as `KeepOrSwitch`, for a light of any net with any number of greens.
    InOrder,
}

impl PhasePlan {
    /// Makes a plan of at least two greens. `clearing(from, to)` returns what is shown between two different greens.
    pub(crate) fn new(
        greens: Vec<SignalState>,
        choice: Choice,
        min_green_steps: u32,
        clearing: impl Fn(usize, usize) -> Vec<Interval>,
    ) -> PhasePlan {
        assert!(greens.len() >= 2, "a light with something to choose");
        assert!(min_green_steps >= 1, "a green is shown");
        let between = |from: usize, to: usize| if from == to { Vec::new() } else { clearing(from, to) };
        let clearings = (0..greens.len()).map(|from| (0..greens.len()).map(|to| between(from, to)).collect()).collect();
        let (min_green_steps, count) = (vec![min_green_steps; greens.len()], greens.len());
        let cars = (0..greens[0].links()).collect();
        let plan = PhasePlan {
            greens,
            cars: BTreeSet::new(),
            clearings,
            walk_ends: Vec::new(),
            program: Vec::new(),
            min_green_steps,
            strict_min_steps: vec![0; count],
            max_green_steps: vec![None; count],
            red_limits: None,
            own_green_steps: None,
            choice,
        };
        plan.for_cars(cars)
    }

    /// Sets the letters that cars obey. By them the plan recognises states of other programs, and knows how long cars keep a
    /// green. Without it all count.
    pub(crate) fn for_cars(self, cars: BTreeSet<usize>) -> PhasePlan {
        let plan = PhasePlan { cars, ..self };
        let kept = |from: usize, between: &Vec<Interval>| {
            let green = &plan.greens[from];
            let cars = plan.of_cars(green);
            let go = cars.iter().any(|letter| letter.eq_ignore_ascii_case(&b'g'));
            let for_people = |state: &SignalState| go && state != green && plan.of_cars(state) == cars;
            between.iter().take_while(|it| for_people(&it.state)).map(|it| it.steps).sum()
        };
        let of_green = |(from, ways): (usize, &Vec<Vec<Interval>>)| ways.iter().map(|it| kept(from, it)).collect();
        let walk_ends = plan.clearings.iter().enumerate().map(of_green).collect();
        PhasePlan { walk_ends, ..plan }
    }

    /// Raises the least duration of each green, in steps, to these numbers where they are larger.
    pub(crate) fn with_min_greens(mut self, steps: impl IntoIterator<Item = u32>) -> PhasePlan {
        self.min_green_steps.iter_mut().zip(steps).for_each(|(known, least)| *known = least.max(*known));
        self
    }

    /// Sets what timings of lights that go by the clock must give each green at least. It is no more than the least duration.
    pub(crate) fn with_strict_min_greens(self, steps: impl IntoIterator<Item = u32>) -> PhasePlan {
        PhasePlan { strict_min_steps: steps.into_iter().collect(), ..self }
    }

    /// Sets the most steps of each green; none is less than its least. `None`: no limit.
    pub(crate) fn with_max_greens(self, steps: Vec<Option<u32>>) -> PhasePlan {
        let fits = |(green, most): (usize, &Option<u32>)| most.is_none_or(|most| self.least_longest(green) <= most);
        assert!(steps.iter().enumerate().all(fits), "the caller has checked the limits");
        PhasePlan { max_green_steps: steps, ..self }
    }

    /// Limits the steps for which letters are without green. The least durations must be set before.
    pub(crate) fn with_red_limits(self, limits: &[(usize, u32)]) -> Result<PhasePlan, TooShort> {
        let red_limits = RedLimits::of(&self, limits)?;
        Ok(PhasePlan { red_limits, ..self })
    }

    pub(crate) fn cars(&self) -> &BTreeSet<usize> {
        &self.cars
    }

    /// Returns the greens, at least two, in the order of their program.
    pub fn greens(&self) -> &[SignalState] {
        &self.greens
    }

    pub fn clearing(&self, from: usize, to: usize) -> &[Interval] {
        &self.clearings[from][to]
    }

    /// Returns the number of steps after which a light has left the green `from` for `to`, but cars still have it: people on
    /// foot end their way across. They are a part of the clearing.
    pub(crate) fn walk_end_steps(&self, from: usize, to: usize) -> u32 {
        self.walk_ends[from][to]
    }

    /// Returns the longest and the shortest end of the walk of a green, over all greens that may follow.
    fn walk_end_range(&self, green: usize) -> [u32; 2] {
        let follows = |&to: &usize| if self.keeps_order() { to == self.next(green) } else { to != green };
        let ends = (0..self.greens.len()).filter(follows).map(|to| self.walk_ends[green][to]);
        [ends.clone().max().unwrap_or(0), ends.min().unwrap_or(0)]
    }

    /// Returns the least number of steps for which a light shows a green before it leaves it for another one.
    pub fn least_before(&self, green: usize, to: usize) -> u32 {
        self.min_green_steps[green].saturating_sub(self.walk_ends[green][to])
    }

    /// Returns the number of steps after which a light must leave a green, wherever it goes. `None`: it may stay.
    pub(crate) fn longest_stay(&self, green: usize) -> Option<u32> {
        self.max_green_steps[green].map(|most| most - self.walk_end_range(green)[0])
    }

    /// Returns the least number of steps that a longest green must allow, so that the light can go to any other one.
    pub(crate) fn least_longest(&self, green: usize) -> u32 {
        let [longest, shortest] = self.walk_end_range(green);
        self.min_green_steps[green].max(longest + 1) + longest - shortest
    }

    /// Returns the least number of steps for which cars have each green.
    pub fn min_green_steps(&self) -> &[u32] {
        &self.min_green_steps
    }

    /// Returns the steps that a timing must give each green at least, if it shows it. They are no more than
    /// [`PhasePlan::min_green_steps`].
    pub(crate) fn strict_min_steps(&self) -> &[u32] {
        &self.strict_min_steps
    }

    /// Returns the lengths of greens of a timing, as cars have them, within the limits. A green of no length stays left out.
    pub(crate) fn fitted(&self, greens: &[u32]) -> Vec<u32> {
        let fit = |(green, &steps): (usize, &u32)| {
            let [longest, shortest] = self.walk_end_range(green);
            let most = self.max_green_steps[green].map_or(u32::MAX, |most| most + shortest - longest);
            if steps == 0 { 0 } else { steps.max(self.strict_min_steps[green]).max(longest + 1).min(most) }
        };
        greens.iter().enumerate().map(fit).collect()
    }

    /// Returns why a light cannot show greens of these lengths in turn, if it cannot.
    pub(crate) fn misfit(&self, greens: &[u32]) -> Option<String> {
        if self.choice == Choice::InOrder
            && let Some(green) = greens.iter().position(|&steps| steps == 0)
        {
            return Some(format!("green {green} is left out, but traffic.actions = \"fixed-order\" shows all"));
        }
        let fitted = self.fitted(greens);
        let (green, fits) = fitted.iter().enumerate().find(|&(green, fits)| *fits != greens[green])?;
        let (has, limit) = (greens[green], if *fits > greens[green] { "least" } else { "most" });
        Some(format!("green {green} has {has} steps, but {fits} are the {limit}"))
    }

    /// Returns the most steps for which cars have each green; `None`: no limit.
    pub fn max_green_steps(&self) -> &[Option<u32>] {
        &self.max_green_steps
    }

    pub(crate) fn red_limits(&self) -> Option<&RedLimits> {
        self.red_limits.as_ref()
    }

    /// Returns the letters that have a longest red, each with its steps.
    pub fn max_red_steps(&self) -> impl Iterator<Item = (usize, u32)> {
        self.red_limits.iter().flat_map(RedLimits::letters)
    }

    pub(crate) fn choice(&self) -> Choice {
        self.choice
    }

    /// Returns whether a green can only be followed by the next one.
    pub(crate) fn keeps_order(&self) -> bool {
        self.choice != Choice::Target
    }

    pub fn actions(&self) -> usize {
        match self.choice {
            Choice::KeepOrSwitch | Choice::InOrder => 2,
            Choice::Target => self.greens.len(),
        }
    }

    pub(crate) fn next(&self, green: usize) -> usize {
        (green + 1) % self.greens.len()
    }

    pub(crate) fn clearing_steps(&self, from: usize, to: usize) -> u32 {
        self.clearings[from][to].iter().map(|interval| interval.steps).sum()
    }

    /// Returns the steps between two greens in which a letter of the first one is closed.
    pub(crate) fn closed_steps(&self, from: usize, to: usize, letter: usize) -> u32 {
        let is_closed = |it: &&Interval| !it.state.as_str().as_bytes()[letter].eq_ignore_ascii_case(&b'g');
        self.clearings[from][to].iter().filter(is_closed).map(|interval| interval.steps).sum()
    }

    /// Returns the steps between two greens in which cars have neither of them.
    pub(crate) fn lost_steps(&self, from: usize, to: usize) -> u32 {
        self.clearing_steps(from, to) - self.walk_ends[from][to]
    }

    /// Returns the action that makes a light that shows `shown` go to a green, or stay there.
    pub(crate) fn towards(&self, shown: Shown, green: usize) -> Action {
        match self.choice {
            Choice::KeepOrSwitch | Choice::InOrder => Action::from(shown.target() != green),
            Choice::Target => Action::try_from(green).expect("a plan has at most 256 greens"),
        }
    }

    /// Returns the green that an action asks for at a light that shows `shown`.
    pub(crate) fn asked_for(&self, shown: Shown, action: Action) -> usize {
        match self.choice {
            Choice::KeepOrSwitch | Choice::InOrder if action == 0 => shown.target(),
            Choice::KeepOrSwitch | Choice::InOrder => self.next(shown.target()),
            Choice::Target => usize::from(action),
        }
    }

    /// Returns the green that a state of another program is for cars, if it is one.
    pub(crate) fn green_of(&self, state: &SignalState) -> Option<usize> {
        self.recognise(state, 0).green()
    }

    /// Returns what a state of another program means after the green `last`. Letters of people on foot do not matter.
    pub(crate) fn recognise(&self, state: &SignalState, last: usize) -> Shown {
        if let Some(green) = self.greens.iter().position(|green| green == state) {
            return Shown::Green(green);
        }
        let shown = self.of_cars(state);
        let goes = shown.iter().any(|letter| letter.eq_ignore_ascii_case(&b'g'));
        let mut likely = [last].into_iter().chain(0..self.greens.len());
        if let Some(green) = likely.find(|&green| goes && self.of_cars(&self.greens[green]) == shown) {
            return Shown::Green(green);
        }
        Shown::Between { from: last, to: self.next_of_program(state, last) }
    }

    fn of_cars(&self, state: &SignalState) -> Vec<u8> {
        let letters = state.as_str().as_bytes();
        self.cars.iter().map(|&letter| letters[letter]).collect()
    }

    /// Returns the green to which the program is on the way if it shows this state after the green `last`.
    ///
    /// The state alone does not say it: all red, and often the yellow, is the same on the way to any green.
    fn next_of_program(&self, state: &SignalState, last: usize) -> usize {
        let mut changes = self.program.iter().filter(|change| change.from == last);
        let shown = changes.clone().find(|change| change.between.contains(state));
        shown.or_else(|| changes.next()).map_or_else(|| self.next(last), |change| change.to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(letters: &str) -> SignalState {
        SignalState::new(letters).unwrap()
    }

    #[test]
    fn a_program_is_on_the_way_to_its_next_green_although_the_yellow_is_the_same_on_all_ways() {
        let clearing = |from: usize, _| {
            let yellow = Interval { state: state(["yrr", "ryr", "rry"][from]), steps: 3 };
            vec![yellow, Interval { state: state("rrr"), steps: 1 }]
        };
        let plan = PhasePlan::new(["Grr", "rGr", "rrG"].map(state).to_vec(), Choice::Target, 5, clearing);
        let ways = |plan: &PhasePlan, shown: &[(&str, usize)]| -> Vec<usize> {
            shown.iter().map(|&(letters, last)| plan.recognise(&state(letters), last).target()).collect()
        };
        let shown = [("yrr", 0), ("rrr", 0), ("ryr", 1), ("rrr", 1), ("rry", 2), ("rrr", 2)];
        assert_eq!(ways(&plan, &shown), [1, 1, 2, 2, 0, 0]);
        // A program that shows green 0 between all others: 0, 1, 0, 2. Its yellow before green 2 is another one.
        let change = |from, to, letters: &str| ProgramChange { from, to, between: vec![state(letters)] };
        let program = vec![change(0, 1, "yrr"), change(1, 0, "ryr"), change(0, 2, "Yrr"), change(2, 0, "rry")];
        let plan = PhasePlan { program, ..plan };
        let shown = [("yrr", 0), ("Yrr", 0), ("ryr", 1), ("rry", 2), ("rrr", 1)];
        assert_eq!(ways(&plan, &shown), [1, 2, 0, 0, 0]);
    }

    #[test]
    fn a_green_is_recognised_whatever_people_on_foot_have() {
        // The last letter is a crossing.
        let clearing = |from: usize, _| vec![Interval { state: state(["yyry", "rryr"][from]), steps: 3 }];
        let plan = PhasePlan::new(["GGrG", "rrGr"].map(state).to_vec(), Choice::Target, 5, clearing);
        let recognise = |plan: &PhasePlan, letters: &str, last| plan.recognise(&state(letters), last);
        assert_eq!(recognise(&plan, "GGrr", 0), Shown::Between { from: 0, to: 1 }, "all letters count");
        let plan = plan.for_cars([0, 1, 2].into());
        assert_eq!(recognise(&plan, "GGrr", 0), Shown::Green(0));
        assert_eq!(recognise(&plan, "rrGG", 0), Shown::Green(1));
        for (letters, last) in [("yyrr", 0), ("rrrG", 0), ("rryG", 1)] {
            assert_eq!(recognise(&plan, letters, last), Shown::Between { from: last, to: 1 - last }, "{letters}");
        }
    }
}
