//! What a light shows between two greens: yellow for the links that lose green, then all red for them if its program
//! does so. Both last as long as in the program, unless somebody set their seconds.
//!
//! People on foot who lose their green have red from the beginning. If yellow and all red are too short for their way across,
//! cars keep the old green until it is long enough.

use std::collections::HashMap;

use super::crossings::TimedCrossing;
use super::greens::{Change, Greens, goes};
use crate::agents::phase_plan::Interval;
use crate::config::Yellow;
use crate::network::roads::program::Phase;
use libsumo::SignalState;

/// Yellow of a light whose program shows none.
const YELLOW_S: u32 = 3;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Times {
    yellow: Seconds,
    all_red: Seconds,
}

/// How long a state lasts in the changes that the program has, and in all others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Seconds {
    own: HashMap<[SignalState; 2], u32>,
    other: u32,
}

impl Seconds {
    fn all(other: u32) -> Seconds {
        Seconds { own: HashMap::new(), other }
    }

    /// Returns the seconds of a program in whole ones, rounded up. `seconds`: those of the phases of a change.
    ///
    /// A change that the program does not have is as long as the longest that it has. So no light is less safe.
    fn of(changes: &[Change<'_>], seconds: impl Fn(&[&Phase]) -> f64) -> Seconds {
        let mut own: HashMap<[SignalState; 2], u32> = HashMap::new();
        for change in changes {
            let seconds = seconds(&change.between).ceil() as u32;
            let known = own.entry([change.from.clone(), change.to.clone()]).or_default();
            *known = seconds.max(*known);
        }
        let other = own.values().copied().max().unwrap_or(0);
        Seconds { own, other }
    }

    fn between(&self, from: &SignalState, to: &SignalState) -> u32 {
        self.own.get(&[from.clone(), to.clone()]).copied().unwrap_or(self.other)
    }
}

impl Times {
    /// Returns the durations of a light. `all_red_s`: that of all changes; without it the program's own.
    ///
    /// The yellow of a program that shows none in a change is the longest that it has, or else 3 s.
    pub(crate) fn of(greens: &Greens, yellow: Yellow, all_red_s: Option<u32>) -> Times {
        let changes = greens.changes();
        let yellow = match yellow {
            Yellow::Seconds(seconds) => Seconds::all(seconds),
            Yellow::Program => {
                let mut yellow = Seconds::of(&changes, longest_yellow_s);
                yellow.own.retain(|_, seconds| *seconds > 0);
                if yellow.own.is_empty() { Seconds::all(YELLOW_S) } else { yellow }
            }
        };
        let red = || Seconds::of(&changes, |between| lasting_s(between, |phase| greens.is_all_red(phase)));
        Times { yellow, all_red: all_red_s.map_or_else(red, Seconds::all) }
    }
}

/// Returns for how long the link that is yellow longest is so. Links may be yellow one after another.
fn longest_yellow_s(between: &[&Phase]) -> f64 {
    let links = between.first().map_or(0, |phase| phase.state.as_str().len());
    let of_link =
        |link: usize| lasting_s(between, |phase| matches!(phase.state.as_str().as_bytes()[link], b'y' | b'Y'));
    (0..links).map(of_link).fold(0.0, f64::max)
}

fn lasting_s(between: &[&Phase], is_such: impl Fn(&Phase) -> bool) -> f64 {
    between.iter().filter(|phase| is_such(phase)).map(|phase| phase.duration_s).sum()
}

/// Returns what is shown between two greens; nothing if no link goes from green to red. `crossings`: those whose walk signals
/// end early enough.
pub(crate) fn between(
    from: &SignalState,
    to: &SignalState,
    times: &Times,
    crossings: &[TimedCrossing],
) -> Vec<Interval> {
    if !letters(from, to).any(|(old, new)| is_lost(old, new)) {
        return Vec::new();
    }
    let ending: Vec<&TimedCrossing> = crossings.iter().filter(|it| it.walks(from) && !it.walks(to)).collect();
    let walked = |letter: usize| ending.iter().any(|crossing| crossing.letter == letter);
    // `None`: the letters of the old green.
    let shown = |instead: Option<char>| {
        let shown = |(letter, (old, new)): (usize, (char, char))| match instead {
            _ if walked(letter) => 'r',
            Some(instead) if is_lost(old, new) => instead,
            _ => old,
        };
        let state: String = letters(from, to).enumerate().map(shown).collect();
        SignalState::new(state).expect("the letters are those of a state, y and r")
    };
    let [yellow, all_red] = [times.yellow.between(from, to), times.all_red.between(from, to)];
    let across = ending.iter().map(|crossing| crossing.across_s).max().unwrap_or(0);
    let walk_end = across.saturating_sub(yellow + all_red);
    let intervals = [(None, walk_end), (Some('y'), yellow), (Some('r'), all_red)];
    let shown = intervals.map(|(instead, steps)| Interval { state: shown(instead), steps });
    shown.into_iter().filter(|interval| interval.steps > 0).collect()
}

pub fn is_lost(old: char, new: char) -> bool {
    goes(old) && matches!(new, 'r' | 'R' | 's')
}

fn letters<'a>(from: &'a SignalState, to: &'a SignalState) -> impl Iterator<Item = (char, char)> + 'a {
    from.as_str().chars().zip(to.as_str().chars())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example;

    fn state(letters: &str) -> SignalState {
        SignalState::new(letters).unwrap()
    }

    fn shown(from: &str, to: &str, times: &Times) -> String {
        on_foot(from, to, times, &[])
    }

    fn on_foot(from: &str, to: &str, times: &Times, crossings: &[TimedCrossing]) -> String {
        let intervals = between(&state(from), &state(to), times, crossings);
        let shown = intervals.iter().map(|Interval { state, steps }| format!("{state} {steps}"));
        shown.collect::<Vec<_>>().join(", ")
    }

    #[test]
    fn who_loses_green_shows_yellow_and_all_others_keep_their_letter() {
        let times = Times { yellow: Seconds::all(3), all_red: Seconds::all(0) };
        assert_eq!(shown("GGggrrrGGGg", "rrGGrrrrrrG", &times), "yyggrrryyyg 3");
        assert_eq!(shown("GgGGoO", "sRgGoO", &times), "yyGGoO 3");
        assert_eq!(shown("GgrG", "gGrG", &times), "", "only g and G change");
        assert_eq!(shown("Gr", "GG", &times), "", "nobody loses green");
    }

    #[test]
    fn walk_signals_end_so_early_that_people_are_across_when_others_get_green() {
        // The last two letters are crossings of 9 and 4 s.
        let crossing = |letter, across_s| TimedCrossing {
            edge: format!("c{letter}"),
            letter,
            length_m: 1.0,
            needed_s: 7 + across_s,
            across_s,
        };
        let all = [crossing(2, 9), crossing(3, 4)];
        let times = Times { yellow: Seconds::all(3), all_red: Seconds::all(1) };
        assert_eq!(on_foot("GrGr", "rGrr", &times, &all), "Grrr 5, yrrr 3, rrrr 1");
        assert_eq!(on_foot("GrGG", "rGrG", &times, &all), "GrrG 5, yrrG 3, rrrG 1", "the other one goes on");
        assert_eq!(on_foot("rGrG", "Grrr", &times, &all), "ryrr 3, rrrr 1", "yellow and all red are enough");
        assert_eq!(on_foot("GrGr", "GGrr", &times, &all), "Grrr 5, Grrr 3, Grrr 1", "only people lose green");
        assert_eq!(on_foot("GrGr", "rGGr", &times, &all), "yrGr 3, rrGr 1", "people keep their green");
    }

    fn times(changes: &[(&str, &str)], yellow: Yellow, all_red_s: Option<u32>) -> Times {
        let roads = example::roads(changes);
        let cars = roads.letters_of_vehicles("J");
        Times::of(&Greens::of(&roads.programs[0], &cars), yellow, all_red_s)
    }

    #[test]
    fn all_red_is_as_long_as_in_the_program_in_whole_seconds() {
        let own = times(&[], Yellow::Seconds(4), None);
        assert_eq!(shown("GGrr", "rrGG", &own), "yyrr 4, rrrr 2");
        assert_eq!(shown("rrGG", "GGrr", &own), "rryy 4", "the program has no all red here");
        assert_eq!(shown("GGrr", "Grrr", &own), "Gyrr 4, Grrr 2", "the program has no such change: the longest");
        let part = times(&[("duration=\"2\"", "duration=\"1.2\"")], Yellow::Seconds(3), None);
        assert_eq!(shown("GGrr", "rrGG", &part), "yyrr 3, rrrr 2");
        let other = times(&[], Yellow::Seconds(3), Some(1));
        assert_eq!(shown("rrGG", "GGrr", &other), "rryy 3, rrrr 1");
    }

    #[test]
    fn yellow_is_as_long_as_in_the_program() {
        let times = |changes: &[(&str, &str)]| times(changes, Yellow::Program, Some(0));
        // The first change has 5 s, the second one 3 s.
        let own = times(&[("duration=\"3\" state=\"yyrr\"", "duration=\"4.5\" state=\"yyrr\"")]);
        assert_eq!(shown("GGrr", "rrGG", &own), "yyrr 5");
        assert_eq!(shown("rrGG", "GGrr", &own), "rryy 3");
        assert_eq!(shown("GGrr", "Grrr", &own), "Gyrr 5", "the program has no such change: the longest");
        // Links that are yellow one after another.
        let turns = "duration=\"3\" state=\"yGrr\"/><phase duration=\"4\" state=\"ryrr\"";
        assert_eq!(shown("GGrr", "rrGG", &times(&[("duration=\"3\" state=\"yyrr\"", turns)])), "yyrr 4");
        let none = [("yyrr", "rrrr"), ("rryy", "rrrr")];
        assert_eq!(shown("GGrr", "rrGG", &times(&none)), "yyrr 3", "a program without any yellow");
    }
}
