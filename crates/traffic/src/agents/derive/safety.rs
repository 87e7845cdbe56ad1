//! No light shows what its own program would not: two links that cross each other never have the green `G` at once,
//! unless they have it in a phase of the program.

use std::collections::BTreeSet;

use anyhow::{Result, bail};

use crate::agents::phase_plan::PhasePlan;
use crate::network::roads::Roads;
use crate::network::roads::program::Program;
use libsumo::SignalState;

/// Checks greens and what is between them. Derived states are safe because they are made of the program's; greens that
/// a person wrote may not be.
pub(crate) fn check(roads: &Roads, program: &Program, phases: &PhasePlan) -> Result<()> {
    let crossing = roads.crossing_letters(&program.light)?;
    let own: Vec<&SignalState> = program.phases.iter().map(|phase| &phase.state).collect();
    for state in states(phases) {
        if let Some([one, other]) = conflicts(&crossing, &own, state).first() {
            bail!(
                "agents.toml: light `{}`: state `{state}` gives `G` to the letters {one} and {other}, whose cars cross \
                 each other, and no phase of its program does; give `g` to the one that yields, or `r`",
                program.light
            );
        }
    }
    Ok(())
}

pub fn states(phases: &PhasePlan) -> impl Iterator<Item = &SignalState> {
    let greens = 0..phases.greens().len();
    let pairs = greens.clone().flat_map(move |from| greens.clone().map(move |to| (from, to)));
    let between = pairs.flat_map(|(from, to)| phases.clearing(from, to)).map(|interval| &interval.state);
    phases.greens().iter().chain(between)
}

/// Returns the pairs of crossing letters that both go without yielding in a state, and in none of the program's.
pub fn conflicts(crossing: &BTreeSet<[usize; 2]>, own: &[&SignalState], state: &SignalState) -> Vec<[usize; 2]> {
    // `O` is what SUMO has for a signal that is off.
    let goes_first = |state: &SignalState, letter: usize| matches!(state.as_str().as_bytes()[letter], b'G' | b'O');
    let both = |state: &SignalState, pair: &[usize; 2]| {
        pair[0] != pair[1] && pair.iter().all(|&letter| goes_first(state, letter))
    };
    let bad = crossing.iter().filter(|pair| both(state, pair) && !own.iter().any(|own| both(own, pair)));
    bad.copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_that_cross_may_have_green_at_once_only_if_the_program_gives_it_to_both() {
        let crossing = BTreeSet::from([[0, 1], [1, 2], [2, 2]]);
        let state = |letters: &str| SignalState::new(letters).unwrap();
        let own = [state("GGr"), state("rGg")];
        let own: Vec<&SignalState> = own.iter().collect();
        let found = |letters: &str| conflicts(&crossing, &own, &state(letters));
        assert!(found("GGr").is_empty(), "the program does so");
        assert_eq!(found("GGG"), [[1, 2]]);
        assert_eq!(found("rOG"), [[1, 2]], "a signal that is off gives way to nobody");
        assert!(found("GrG").is_empty(), "0 and 2 do not cross; cars of one letter are no pair");
        assert!(found("rgG").is_empty(), "g yields");
    }
}
