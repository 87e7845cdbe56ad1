//! What a light shows between two greens: yellow for the links that lose green, then all red for them if its program
//! does so.

use std::collections::HashMap;

use super::greens::{Greens, goes};
use crate::sumo::SignalState;
use crate::traffic::agents::phase_plan::Interval;

/// Durations of the states between the greens of a light.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Times {
    yellow_s: u32,
    /// Seconds of all red of the changes that the program has.
    own: HashMap<[SignalState; 2], u32>,
    /// Seconds of all red of all other changes.
    other: u32,
}

impl Times {
    /// Returns the durations of a light. `all_red_s`: that of all changes; without it the program's own.
    ///
    /// A change that the program does not have is as long as the longest that it has. So no light is less safe.
    pub fn of(greens: &Greens, yellow_s: u32, all_red_s: Option<u32>) -> Times {
        if let Some(other) = all_red_s {
            return Times { yellow_s, own: HashMap::new(), other };
        }
        let mut own: HashMap<[SignalState; 2], u32> = HashMap::new();
        for change in greens.changes() {
            let red = change.between.iter().filter(|phase| greens.is_all_red(phase));
            let seconds = red.map(|phase| phase.duration_s).sum::<f64>().ceil() as u32;
            let known = own.entry([change.from.clone(), change.to.clone()]).or_default();
            *known = seconds.max(*known);
        }
        let other = own.values().copied().max().unwrap_or(0);
        Times { yellow_s, own, other }
    }

    fn all_red_s(&self, from: &SignalState, to: &SignalState) -> u32 {
        self.own.get(&[from.clone(), to.clone()]).copied().unwrap_or(self.other)
    }
}

/// Returns what is shown between two greens. Links that go from green to red show yellow, and all others keep their
/// letter. If no link does, nothing has to be cleared.
pub fn between(from: &SignalState, to: &SignalState, times: &Times) -> Vec<Interval> {
    if !letters(from, to).any(|(old, new)| is_lost(old, new)) {
        return Vec::new();
    }
    let shown = |instead: char| {
        let state: String = letters(from, to).map(|(old, new)| if is_lost(old, new) { instead } else { old }).collect();
        SignalState::new(state).expect("the letters are those of a state, y and r")
    };
    let intervals = [('y', times.yellow_s), ('r', times.all_red_s(from, to))];
    let shown = intervals.map(|(instead, steps)| Interval { state: shown(instead), steps });
    shown.into_iter().filter(|interval| interval.steps > 0).collect()
}

/// Returns whether a link loses its green.
pub fn is_lost(old: char, new: char) -> bool {
    goes(old) && matches!(new, 'r' | 'R' | 's')
}

fn letters<'a>(from: &'a SignalState, to: &'a SignalState) -> impl Iterator<Item = (char, char)> + 'a {
    from.as_str().chars().zip(to.as_str().chars())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::network::roads::example;

    fn state(letters: &str) -> SignalState {
        SignalState::new(letters).unwrap()
    }

    fn shown(from: &str, to: &str, times: &Times) -> String {
        let intervals = between(&state(from), &state(to), times);
        let shown = intervals.iter().map(|Interval { state, steps }| format!("{state} {steps}"));
        shown.collect::<Vec<_>>().join(", ")
    }

    #[test]
    fn who_loses_green_shows_yellow_and_all_others_keep_their_letter() {
        let times = Times { yellow_s: 3, own: HashMap::new(), other: 0 };
        assert_eq!(shown("GGggrrrGGGg", "rrGGrrrrrrG", &times), "yyggrrryyyg 3");
        assert_eq!(shown("GgGGoO", "sRgGoO", &times), "yyGGoO 3");
        assert_eq!(shown("GgrG", "gGrG", &times), "", "only g and G change");
        assert_eq!(shown("Gr", "GG", &times), "", "nobody loses green");
    }

    #[test]
    fn all_red_is_as_long_as_in_the_program() {
        let roads = example::roads(&[]);
        let cars = roads.letters_of_vehicles("J");
        let greens = Greens::of(&roads.programs[0], &cars);
        let times = Times::of(&greens, 4, None);
        assert_eq!(shown("GGrr", "rrGG", &times), "yyrr 4, rrrr 2");
        assert_eq!(shown("rrGG", "GGrr", &times), "rryy 4", "the program has no all red here");
        assert_eq!(shown("GGrr", "Grrr", &times), "Gyrr 4, Grrr 2", "the program has no such change: the longest");
        let times = Times::of(&greens, 3, Some(1));
        assert_eq!(shown("rrGG", "GGrr", &times), "rryy 3, rrrr 1");
    }

    #[test]
    fn parts_of_seconds_are_rounded_up() {
        let roads = example::roads(&[("duration=\"2\"", "duration=\"1.2\"")]);
        let cars = roads.letters_of_vehicles("J");
        let greens = Greens::of(&roads.programs[0], &cars);
        assert_eq!(shown("GGrr", "rrGG", &Times::of(&greens, 3, None)), "yyrr 3, rrrr 2");
    }
}
