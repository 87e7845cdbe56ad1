//! The greens of a program: the states that an agent chooses from. *Cars* are all that drives here, bicycles too.

use std::collections::{BTreeSet, VecDeque};

use crate::network::roads::program::{Phase, Program};
use libsumo::SignalState;

/// Largest number of greens of a light. All changes between them are made beforehand.
pub(crate) const MOST_GREENS: usize = 64;
/// Longest phase without a green of its own that is a part of a change, in seconds.
const LONGEST_CLEARING_S: f64 = 5.0;

#[derive(Clone, Debug, PartialEq)]
pub struct Change<'a> {
    pub from: &'a SignalState,
    pub to: &'a SignalState,
    pub between: Vec<&'a Phase>,
}

/// Returns whether cars pass. `O` and `o` are signals that are off: cars go by the right of way.
pub(crate) fn goes(letter: char) -> bool {
    is_green(letter) || is_off(letter)
}

pub(crate) fn is_green(letter: char) -> bool {
    matches!(letter, 'G' | 'g')
}

fn is_off(letter: char) -> bool {
    matches!(letter, 'O' | 'o')
}

/// Returns whether a state is one of a change from green to green: yellow, or red and yellow.
pub fn is_yellow(state: &SignalState) -> bool {
    state.as_str().contains(['y', 'Y', 'u'])
}

/// Returns whether a state shows no yellow, and green for cars. `cars`: letters that cars obey.
fn shows_green(state: &SignalState, cars: &BTreeSet<usize>) -> bool {
    !is_yellow(state) && cars.iter().any(|&letter| is_green(state.as_str().as_bytes()[letter].into()))
}

#[derive(Clone, Debug, PartialEq)]
pub struct Greens<'a> {
    program: &'a Program,
    cars: &'a BTreeSet<usize>,
    states: Vec<SignalState>,
    /// Green of each phase, as an index into `states`; `None`: the phase is a part of a change.
    of_phase: Vec<Option<usize>>,
}

impl<'a> Greens<'a> {
    /// Finds the distinct phases with green and without yellow, at most one more than [`MOST_GREENS`]. Two phases that
    /// are the same for cars are one green. `cars`: letters that cars obey.
    pub fn of(program: &'a Program, cars: &'a BTreeSet<usize>) -> Greens<'a> {
        let letters =
            |state: &SignalState| -> Vec<u8> { cars.iter().map(|&letter| state.as_str().as_bytes()[letter]).collect() };
        let mut states: Vec<SignalState> = Vec::new();
        let mut green_of = |number: usize, state: &SignalState| {
            if !shows_green(state, cars) || is_clearing(program, number, cars) {
                return None;
            }
            let known = states.iter().position(|green| letters(green) == letters(state));
            if known.is_none() && states.len() <= MOST_GREENS {
                states.push(state.clone());
                return Some(states.len() - 1);
            }
            known
        };
        let of_phase =
            program.phases.iter().enumerate().map(|(number, phase)| green_of(number, &phase.state)).collect();
        Greens { program, cars, states, of_phase }
    }

    pub(crate) fn states(&self) -> &[SignalState] {
        &self.states
    }

    pub(crate) fn is_green(&self, phase: usize) -> bool {
        self.of_phase[phase].is_some()
    }

    /// Returns whether cars that lose green wait in a phase of a change: it has no yellow, no green for people on foot, and the
    /// light is not off.
    pub(crate) fn is_all_red(&self, phase: &Phase) -> bool {
        let letter = |number: &usize| phase.state.as_str().as_bytes()[*number].into();
        let mut letters = phase.state.as_str().chars().enumerate();
        !self.cars.iter().all(|number| is_off(letter(number)))
            && letters
                .all(|(number, letter)| !matches!(letter, 'y' | 'Y') && (self.cars.contains(&number) || !goes(letter)))
    }

    /// Returns the least seconds of a green that the program gives it, if it does.
    pub(crate) fn least_s(&self, green: &SignalState) -> Option<f64> {
        let phases = self.program.phases.iter().zip(&self.of_phase);
        let its = phases.filter(|(_, known)| known.is_some_and(|known| self.states[known] == *green));
        its.filter_map(|(phase, _)| phase.limits_s[0]).reduce(f64::max)
    }

    /// Returns the shortest ways of the program from each phase with green to the next greens.
    pub fn changes(&self) -> Vec<Change<'_>> {
        let mut changes = Vec::new();
        for (phase, green) in self.of_phase.iter().enumerate() {
            if let &Some(green) = green {
                self.add_changes(phase, green, &mut changes);
            }
        }
        changes
    }

    fn add_changes<'b>(&'b self, phase: usize, green: usize, changes: &mut Vec<Change<'b>>) {
        let mut seen = BTreeSet::from([phase]);
        let mut open: VecDeque<(usize, Vec<&Phase>)> = VecDeque::from([(phase, Vec::new())]);
        while let Some((last, between)) = open.pop_front() {
            for next in self.program.after(last).into_iter().filter(|next| seen.insert(*next)) {
                match self.of_phase[next] {
                    Some(other) if other == green => {}
                    Some(other) => {
                        let [from, to] = [&self.states[green], &self.states[other]];
                        changes.push(Change { from, to, between: between.clone() });
                    }
                    None => open.push_back((next, [&between[..], &[&self.program.phases[next]]].concat())),
                }
            }
        }
    }
}

/// Returns whether a phase is all red but for links that keep green: it is short, follows yellow, and gives green to no
/// car that did not have it. netconvert writes such phases with `--tls.allred.time`.
fn is_clearing(program: &Program, phase: usize, cars: &BTreeSet<usize>) -> bool {
    let phases = &program.phases;
    let count = phases.len();
    let state = |number: usize| &phases[number % count].state;
    let after_yellow = is_yellow(state(phase + count - 1));
    let mut earlier = (1..count).map(|back| state(phase + count - back));
    let mut later = (1..count).map(|on| state(phase + on));
    let neighbours = [earlier.find(|state| shows_green(state, cars)), later.find(|state| shows_green(state, cars))];
    let [Some(before), Some(after)] = neighbours else { return false };
    let goes_in = |state: &SignalState, letter: usize| goes(state.as_str().as_bytes()[letter].into());
    let keeps = |&letter: &usize| !goes_in(state(phase), letter) || (goes_in(before, letter) && goes_in(after, letter));
    after_yellow && phases[phase].duration_s <= LONGEST_CLEARING_S && cars.iter().all(keeps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    /// `phases`: states and their seconds.
    fn program(phases: &str) -> Program {
        let phase = |phase: &str| {
            let (state, seconds) = phase.split_once(' ').unwrap();
            format!("<phase state='{state}' duration='{seconds}'/>")
        };
        let phases: String = phases.split(", ").map(phase).collect();
        Program::read(&parse(&format!("<tlLogic id='a'>{phases}</tlLogic>")).unwrap()).unwrap()
    }

    fn read(program: &Program, cars: usize) -> (Vec<String>, Vec<String>) {
        let cars = (0..cars).collect();
        let greens = Greens::of(program, &cars);
        let change = |change: Change| {
            let between: Vec<&str> = change.between.iter().map(|phase| phase.state.as_str()).collect();
            format!("{} {} {}", change.from, between.join(" "), change.to)
        };
        let changes = greens.changes().into_iter().map(change).collect();
        (greens.states().iter().map(SignalState::to_string).collect(), changes)
    }

    #[test]
    fn greens_are_distinct_phases_with_green_and_without_yellow_in_their_order() {
        let phases = "rryy 3, GGrr 20, yyrr 3, rrrr 2, rrGg 20, rrYY 3, GGrr 10, yGrr 3, uruu 1, rGgg 9";
        let (greens, changes) = read(&program(phases), 4);
        assert_eq!(greens, ["GGrr", "rrGg", "rGgg"]);
        // The last green of the cycle goes over the first yellow of the file.
        assert_eq!(changes, ["GGrr yyrr rrrr rrGg", "rrGg rrYY GGrr", "GGrr yGrr uruu rGgg", "rGgg rryy GGrr"]);
    }

    #[test]
    fn all_red_but_for_those_who_keep_green_is_a_part_of_the_change() {
        let with = |phase: &str| read(&program(&format!("GGgr 20, yygr 3, {phase}, rrGG 20, rryy 3")), 4).0;
        assert_eq!(with("rrgr 2"), ["GGgr", "rrGG"]);
        assert_eq!(with("rrgr 6"), ["GGgr", "rrgr", "rrGG"], "it is long");
        assert_eq!(with("rrgg 2"), ["GGgr", "rrgg", "rrGG"], "somebody gains green");
        let no_yellow = program("GGgr 20, rrgr 2, rrGG 20, rryy 3");
        assert_eq!(read(&no_yellow, 4).0, ["GGgr", "rrgr", "rrGG"]);
    }

    #[test]
    fn phases_that_name_their_next_ones_are_followed_there() {
        let mut program = program("Grr 9, yrr 3, rGr 9, ryr 3, rrG 9, rry 3");
        program.phases[1].next = vec![4, 2];
        program.phases[3].next = vec![3];
        let (_, changes) = read(&program, 3);
        assert_eq!(changes, ["Grr yrr rrG", "Grr yrr rGr", "rrG rry Grr"], "a ring without a green leads nowhere");
    }

    #[test]
    fn phases_that_differ_for_people_on_foot_are_one_green() {
        // The last letter is a crossing: green with the first green, then clearing, then a phase of its own.
        let program = program("GrG 20, Grr 5, yrr 3, rGr 20, ryr 3, rrG 15");
        let (greens, changes) = read(&program, 2);
        assert_eq!(greens, ["GrG", "rGr"]);
        assert_eq!(changes, ["GrG yrr rGr", "rGr ryr rrG GrG"]);
        let cars = BTreeSet::from([0, 1]);
        let greens = Greens::of(&program, &cars);
        let red: Vec<bool> = program.phases.iter().map(|phase| greens.is_all_red(phase)).collect();
        assert_eq!(red, [false, true, false, true, false, false], "neither yellow nor people on foot");
        assert_eq!(read(&program, 3).0, ["GrG", "Grr", "rGr", "rrG"], "cars on the crossing");
    }
}
