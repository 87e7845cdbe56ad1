//! The greens of a program: the states that an agent chooses from.

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

/// Returns the ways of a program from each of its greens to the next ones.
pub fn changes(program: &Program) -> Vec<Change<'_>> {
    let mut changes = Vec::new();
    for from in (0..program.phases.len()).filter(|&phase| is_green(program, phase)) {
        let ways = program.after(from).into_iter().map(|next| vec![next]);
        let mut open: Vec<Vec<usize>> = ways.collect();
        while let Some(way) = open.pop() {
            let last = *way.last().expect("a way has a first phase");
            if is_green(program, last) {
                let between = way[..way.len() - 1].iter().map(|&phase| &program.phases[phase]).collect();
                let [from, to] = [from, last].map(|phase| &program.phases[phase].state);
                changes.push(Change { from, to, between });
                continue;
            }
            // A ring of phases without a green leads nowhere.
            let on = program.after(last).into_iter().filter(|next| !way.contains(next));
            open.extend(on.map(|next| [&way[..], &[next]].concat()));
        }
    }
    changes.retain(|change| change.from != change.to);
    changes
}
