//! Crossings of a light, and how long people on foot need for each.
//!
//! Source: MUTCD 2009, section 4E.06, and HCM 2010, chapter 18. The walk interval lasts 7 s (4 s where few people walk). People
//! who start at its end then need the length of the crossing over 3.5 ft/s (1.07 m/s). A green lasts as long as both. The walk
//! signal ends so early that the way across is over when cars of another green get theirs; yellow and all red count, as the
//! manuals let them.

use super::greens::is_green;
use crate::network::roads::{Function, Roads};
use libsumo::SignalState;

/// How people on foot cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walking {
    pub speed_mps: f64,
    /// Seconds in which people may start to cross.
    pub walk_s: f64,
}

impl Default for Walking {
    fn default() -> Walking {
        Walking { speed_mps: 1.07, walk_s: 7.0 }
    }
}

impl Walking {
    /// Returns the whole seconds of green that a crossing of this length needs, at most an hour.
    fn needed_s(self, length_m: f64) -> u32 {
        whole_s(self.walk_s + length_m / self.speed_mps)
    }

    /// Returns the whole seconds that people need who begin to cross when their green ends, at most an hour.
    fn across_s(self, length_m: f64) -> u32 {
        whole_s(length_m / self.speed_mps)
    }
}

fn whole_s(seconds: f64) -> u32 {
    const LONGEST_S: f64 = 3600.0;
    // The lengths of a net have two decimals. Without this, a round number could become a second more.
    const ROUNDING: f64 = 1e-9;
    (seconds - ROUNDING).ceil().min(LONGEST_S) as u32
}

/// A crossing under a light.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedCrossing {
    pub edge: String,
    /// Index of its letter in the light's state.
    pub letter: usize,
    pub length_m: f64,
    /// Seconds of green that people need for it.
    pub needed_s: u32,
    /// Seconds for the way across, from the end of the walk signal on. At most [`needed_s`](Self::needed_s).
    pub across_s: u32,
}

impl TimedCrossing {
    /// Returns whether people may walk in this state.
    pub fn walks(&self, state: &SignalState) -> bool {
        state.as_str().as_bytes().get(self.letter).is_some_and(|&letter| is_green(letter.into()))
    }
}

/// Returns the crossings under a light in the order of its letters. People walk along the lane of a crossing.
pub fn of(roads: &Roads, light: &str, walking: Walking) -> Vec<TimedCrossing> {
    let mut found: Vec<TimedCrossing> = Vec::new();
    for link in roads.of_light(light) {
        let Some(signal) = &link.signal else { continue };
        let lane = roads.lane(link.to);
        let edge = roads.edge(lane.edge);
        if edge.function != Function::Crossing {
            continue;
        }
        let known = found.iter().any(|known| known.edge == edge.id && known.letter == signal.letter);
        if !known {
            let (edge, length_m) = (edge.id.clone(), lane.length_m);
            let [needed_s, across_s] = [walking.needed_s(length_m), walking.across_s(length_m)];
            found.push(TimedCrossing { edge, letter: signal.letter, length_m, needed_s, across_s });
        }
    }
    found.sort_by_key(|crossing| crossing.letter);
    found
}

/// Returns the crossing that needs the longest of those on which people may walk in this state; the first of equals.
pub fn slowest<'a>(crossings: &'a [TimedCrossing], state: &SignalState) -> Option<&'a TimedCrossing> {
    let walked = crossings.iter().filter(|crossing| crossing.walks(state));
    walked.rev().max_by_key(|crossing| crossing.needed_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crossing_needs_the_walk_interval_and_its_length_over_the_walking_speed() {
        let needed = |walk_s, speed_mps, length_m| Walking { walk_s, speed_mps }.needed_s(length_m);
        // 7 + 12.8 / 1.07 = 18.96; 7 + 19.2 / 1.07 = 24.94.
        let Walking { walk_s, speed_mps } = Walking::default();
        assert_eq!([12.8, 19.2].map(|length| needed(walk_s, speed_mps, length)), [19, 25]);
        assert_eq!(needed(4.0, 1.2, 12.0), 14, "a whole number stays what it is");
        assert_eq!(needed(4.0, 1.2, 12.1), 15);
        assert_eq!(needed(4.0, 0.5, 1e9), 3600);
    }

    #[test]
    fn the_slowest_crossing_of_those_with_green_counts() {
        let crossing = |edge: &str, letter, needed_s| TimedCrossing {
            edge: edge.into(),
            letter,
            length_m: 1.0,
            needed_s,
            across_s: needed_s - 7,
        };
        let all = [crossing("a", 2, 20), crossing("b", 3, 25), crossing("c", 4, 20)];
        let slowest = |letters: &str| slowest(&all, &SignalState::new(letters).unwrap()).map(|it| &*it.edge);
        assert_eq!(slowest("GGGrr"), Some("a"));
        assert_eq!(slowest("GGggr"), Some("b"));
        assert_eq!(slowest("GGGrG"), Some("a"), "the first of equals");
        assert_eq!([slowest("GGrrr"), slowest("GGyrr")], [None, None]);
    }
}
