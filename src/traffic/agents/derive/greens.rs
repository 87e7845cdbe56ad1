//! The greens of a program: the states that an agent chooses from.

use std::collections::{BTreeSet, VecDeque};

use crate::sumo::SignalState;
use crate::traffic::network::roads::program::{Phase, Program};

/// Longest phase without a green of its own that is taken for a part of a change, in seconds.
const LONGEST_CLEARING_S: f64 = 5.0;

/// A way of a program from one green to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Change<'a> {
    pub from: &'a SignalState,
    pub to: &'a SignalState,
    /// Phases in between, such as yellow and all red.
    pub between: Vec<&'a Phase>,
}

/// Returns the distinct greens of a program, in the order in which they first appear.
pub fn greens(program: &Program) -> Vec<SignalState> {
    let mut greens: Vec<SignalState> = Vec::new();
    for (number, phase) in program.phases.iter().enumerate() {
        if is_green(program, number) && !greens.contains(&phase.state) {
            greens.push(phase.state.clone());
        }
    }
    greens
}

/// Returns whether a letter lets cars go.
pub fn goes(letter: char) -> bool {
    matches!(letter, 'G' | 'g')
}

/// Returns whether a state is one of a change from green to green: yellow, or red and yellow.
pub fn is_yellow(state: &SignalState) -> bool {
    state.as_str().contains(['y', 'Y', 'u'])
}

/// Returns whether a state shows green and no yellow.
pub fn shows_green(state: &SignalState) -> bool {
    !is_yellow(state) && state.as_str().contains(goes)
}

/// Returns whether a phase is a green, and not a part of the change between two others.
fn is_green(program: &Program, phase: usize) -> bool {
    shows_green(&program.phases[phase].state) && !is_clearing(program, phase)
}

/// Returns whether a phase is all red but for links that have green before, during and after the change.
///
/// It is short, follows yellow, and gives green to nobody who did not have it. netconvert writes such phases with
/// `--tls.allred.time`.
fn is_clearing(program: &Program, phase: usize) -> bool {
    let phases = &program.phases;
    let count = phases.len();
    let state = |number: usize| &phases[number % count].state;
    let after_yellow = is_yellow(state(phase + count - 1));
    let mut earlier = (1..count).map(|back| state(phase + count - back));
    let mut later = (1..count).map(|on| state(phase + on));
    let neighbours = [earlier.find(|state| shows_green(state)), later.find(|state| shows_green(state))];
    let [Some(before), Some(after)] = neighbours else { return false };
    let letters = state(phase).as_str().chars().zip(before.as_str().chars()).zip(after.as_str().chars());
    let keeps = |((now, before), after)| !goes(now) || (goes(before) && goes(after));
    after_yellow && phases[phase].duration_s <= LONGEST_CLEARING_S && letters.into_iter().all(keeps)
}

/// Returns the ways of a program from each of its greens to the next ones; from one to another, the one with the fewest
/// phases.
pub fn changes(program: &Program) -> Vec<Change<'_>> {
    let mut changes = Vec::new();
    for from in (0..program.phases.len()).filter(|&phase| is_green(program, phase)) {
        let mut seen = BTreeSet::from([from]);
        let mut open: VecDeque<(usize, Vec<&Phase>)> = VecDeque::from([(from, Vec::new())]);
        while let Some((last, between)) = open.pop_front() {
            for next in program.after(last).into_iter().filter(|next| seen.insert(*next)) {
                let phase = &program.phases[next];
                if is_green(program, next) {
                    changes.push(Change {
                        from: &program.phases[from].state,
                        to: &phase.state,
                        between: between.clone(),
                    });
                } else {
                    open.push_back((next, [&between[..], &[phase]].concat()));
                }
            }
        }
    }
    changes.retain(|change| change.from != change.to);
    changes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program of phases, each a state and its seconds.
    fn program(phases: &[(&str, f64)]) -> Program {
        let phase = |&(letters, duration_s): &(&str, f64)| Phase {
            duration_s,
            limits_s: [duration_s; 2],
            state: SignalState::new(letters).unwrap(),
            next: Vec::new(),
        };
        Program {
            light: "a".to_owned(),
            id: "0".to_owned(),
            kind: "static".to_owned(),
            offset_s: 0.0,
            phases: phases.iter().map(phase).collect(),
        }
    }

    fn told(program: &Program) -> (Vec<String>, Vec<String>) {
        let change = |change: Change| {
            let between: Vec<&str> = change.between.iter().map(|phase| phase.state.as_str()).collect();
            format!("{} {} {}", change.from, between.join(" "), change.to)
        };
        let changes = changes(program).into_iter().map(change).collect();
        (greens(program).iter().map(SignalState::to_string).collect(), changes)
    }

    #[test]
    fn greens_are_distinct_phases_with_green_and_without_yellow_in_their_order() {
        let (greens, changes) = told(&program(&[
            ("rryy", 3.0),
            ("GGrr", 20.0),
            ("yyrr", 3.0),
            ("rrrr", 2.0),
            ("rrGg", 20.0),
            ("rrYY", 3.0),
            ("GGrr", 10.0),
            ("yGrr", 3.0),
            ("uruu", 1.0),
            ("rGgg", 9.0),
        ]));
        assert_eq!(greens, ["GGrr", "rrGg", "rGgg"]);
        // The last green of the cycle goes over the first yellow of the file.
        assert_eq!(changes, ["GGrr yyrr rrrr rrGg", "rrGg rrYY GGrr", "GGrr yGrr uruu rGgg", "rGgg rryy GGrr"]);
    }

    #[test]
    fn all_red_but_for_those_who_keep_green_is_a_part_of_the_change() {
        let with = |state: &'static str, seconds: f64| {
            told(&program(&[("GGgr", 20.0), ("yygr", 3.0), (state, seconds), ("rrGG", 20.0), ("rryy", 3.0)])).0
        };
        assert_eq!(with("rrgr", 2.0), ["GGgr", "rrGG"]);
        assert_eq!(with("rrgr", 6.0), ["GGgr", "rrgr", "rrGG"], "it is long");
        assert_eq!(with("rrgg", 2.0), ["GGgr", "rrgg", "rrGG"], "somebody gains green");
        let no_yellow = program(&[("GGgr", 20.0), ("rrgr", 2.0), ("rrGG", 20.0), ("rryy", 3.0)]);
        assert_eq!(told(&no_yellow).0, ["GGgr", "rrgr", "rrGG"]);
    }

    #[test]
    fn phases_that_name_their_next_ones_are_followed_there() {
        let mut program =
            program(&[("Grr", 9.0), ("yrr", 3.0), ("rGr", 9.0), ("ryr", 3.0), ("rrG", 9.0), ("rry", 3.0)]);
        program.phases[1].next = vec![4, 2];
        program.phases[3].next = vec![3];
        let (_, changes) = told(&program);
        assert_eq!(changes, ["Grr yrr rrG", "Grr yrr rGr", "rrG rry Grr"], "a ring without a green leads nowhere");
    }
}
