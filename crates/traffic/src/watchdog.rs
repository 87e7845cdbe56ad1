//! A watchdog for tests: it sees nothing but the letters that a light shows, second by second, and finds what must not be.
//!
//! It knows the limits from the plan and who crosses whom from the net. It knows nothing of how a light decides.

use std::collections::{BTreeMap, BTreeSet};

use crate::agents::derive::Agent;
use crate::agents::derive::safety::conflicts;
use crate::agents::phase_plan::Interval;
use crate::network::roads::Roads;
use libsumo::SignalState;

pub(crate) struct Watchdog {
    greens: Vec<SignalState>,
    min_s: Vec<u32>,
    max_s: Vec<Option<u32>>,
    max_red_s: BTreeMap<usize, u32>,
    /// Least yellow of any change, and least all red after it.
    yellow_s: u32,
    all_red_s: u32,
    crossing: BTreeSet<[usize; 2]>,
    own: Vec<SignalState>,
    last: Option<SignalState>,
    /// The green that is shown, and for how long. The first one of an episode may end at once.
    green: Option<(usize, u32)>,
    is_first: bool,
    /// For each letter: seconds of its yellow, seconds since it, and seconds without green.
    yellow: Vec<u32>,
    since_yellow: Vec<u32>,
    red: Vec<u32>,
    pub(crate) seconds: u64,
    pub(crate) changes: u64,
    pub(crate) longest_red_s: u32,
}

impl Watchdog {
    pub(crate) fn new(roads: &Roads, agent: &Agent) -> Watchdog {
        let phases = &agent.plan.phases;
        let greens = phases.greens().to_vec();
        let pairs = (0..greens.len()).flat_map(|from| (0..greens.len()).map(move |to| (from, to)));
        let clearings: Vec<_> =
            pairs.map(|(from, to)| phases.clearing(from, to)).filter(|between| !between.is_empty()).collect();
        let least = |of: fn(&str) -> bool| {
            let seconds = |between: &&[Interval]| -> u32 {
                between.iter().filter(|interval| of(interval.state.as_str())).map(|interval| interval.steps).sum()
            };
            clearings.iter().map(seconds).min().unwrap_or(0)
        };
        let letters = greens[0].links();
        Watchdog {
            min_s: phases.min_green_steps().to_vec(),
            max_s: phases.max_green_steps().to_vec(),
            max_red_s: phases.max_red_steps().collect(),
            yellow_s: least(|state| state.contains('y')),
            all_red_s: least(|state| !state.contains('y')),
            crossing: roads.crossing_letters(&agent.plan.light).unwrap(),
            own: agent.program.phases.iter().map(|phase| phase.state.clone()).collect(),
            last: None,
            green: None,
            is_first: true,
            yellow: vec![0; letters],
            since_yellow: vec![u32::MAX; letters],
            red: vec![0; letters],
            seconds: 0,
            changes: 0,
            longest_red_s: 0,
            greens,
        }
    }

    /// Looks at the state of one more second. Errors: the first rule that it breaks.
    pub(crate) fn see(&mut self, state: &SignalState) -> Result<(), String> {
        self.seconds += 1;
        let own: Vec<&SignalState> = self.own.iter().collect();
        if let Some([one, other]) = conflicts(&self.crossing, &own, state).first() {
            return Err(format!("{state}: {one} and {other} cross and have G at once"));
        }
        self.durations(state)?;
        for letter in 0..state.links() {
            self.letter(letter, state)?;
        }
        self.last = Some(state.clone());
        Ok(())
    }

    fn durations(&mut self, state: &SignalState) -> Result<(), String> {
        let now = self.greens.iter().position(|green| green == state);
        match (self.green, now) {
            (Some((green, seconds)), now) if now == Some(green) => {
                if self.max_s[green].is_some_and(|most| seconds >= most) {
                    return Err(format!("green {green} lasts longer than its longest, {:?} s", self.max_s[green]));
                }
                self.green = Some((green, seconds + 1));
            }
            (before, now) => {
                if let Some((green, seconds)) = before {
                    if seconds < self.min_s[green] && !self.is_first {
                        return Err(format!(
                            "green {green} lasted {seconds} s, and {} are the least",
                            self.min_s[green]
                        ));
                    }
                    (self.is_first, self.changes) = (false, self.changes + 1);
                }
                self.green = now.map(|green| (green, 1));
            }
        }
        Ok(())
    }

    fn letter(&mut self, letter: usize, state: &SignalState) -> Result<(), String> {
        let of = |state: &SignalState| state.as_str().as_bytes()[letter];
        let (now, before) = (of(state), self.last.as_ref().map(of));
        let goes = |letter: u8| matches!(letter, b'G' | b'g');
        if before.is_some_and(goes) && matches!(now, b'r') {
            return Err(format!("{state}: letter {letter} goes from green to red without yellow"));
        }
        if before == Some(b'y') && now != b'y' {
            if self.yellow[letter] < self.yellow_s {
                return Err(format!("letter {letter} was yellow for {} s of {}", self.yellow[letter], self.yellow_s));
            }
            self.since_yellow[letter] = 0;
        }
        self.yellow[letter] = if now == b'y' { self.yellow[letter] + 1 } else { 0 };
        if goes(now) && !before.is_some_and(goes) && before.is_some() {
            let foes = self.crossing.iter().filter(|pair| pair.contains(&letter) && pair[0] != pair[1]);
            for foe in foes.map(|pair| if pair[0] == letter { pair[1] } else { pair[0] }) {
                let foe_now = state.as_str().as_bytes()[foe];
                if foe_now == b'r' && self.since_yellow[foe] < self.all_red_s {
                    return Err(format!(
                        "letter {letter} has green {} s after {foe} was yellow",
                        self.since_yellow[foe]
                    ));
                }
                if foe_now == b'y' {
                    return Err(format!("{state}: letter {letter} gets green while {foe} is yellow"));
                }
            }
        }
        self.since_yellow[letter] = self.since_yellow[letter].saturating_add(u32::from(now != b'y'));
        self.red[letter] = if goes(now) { 0 } else { self.red[letter] + 1 };
        if let Some(&most) = self.max_red_s.get(&letter) {
            self.longest_red_s = self.longest_red_s.max(self.red[letter]);
            if self.red[letter] > most {
                return Err(format!("letter {letter} is red for more than {most} s"));
            }
        }
        Ok(())
    }
}
