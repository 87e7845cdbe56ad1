//! A watchdog for tests: it sees nothing but the letters that a light shows, second by second, and finds what must not be.
//!
//! It knows the limits from the plan and who crosses whom from the net. It knows nothing of how a light decides.

use std::collections::{BTreeMap, BTreeSet};

use crate::agents::derive::Agent;
use crate::agents::derive::crossings::TimedCrossing;
use crate::agents::derive::safety::conflicts;
use crate::agents::phase_plan::Interval;
use crate::network::roads::Roads;
use libsumo::SignalState;

pub(crate) struct Watchdog {
    greens: Vec<SignalState>,
    cars: BTreeSet<usize>,
    /// Crossings with letters of their own, each with the seconds since its walk signal ended.
    crossings: Vec<(TimedCrossing, u32)>,
    /// Pairs of letters whose ways cross, also those of people on foot.
    ways: BTreeSet<[usize; 2]>,
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
        let cars = phases.cars().clone();
        let lost = |(from, to): (usize, usize)| {
            let still_green = |it: &Interval| of_cars(&cars, &it.state) == of_cars(&cars, &phases.greens()[from]);
            phases.clearing(from, to).iter().filter(|it| !still_green(it)).cloned().collect::<Vec<_>>()
        };
        let clearings: Vec<Vec<Interval>> = pairs.map(lost).filter(|between| !between.is_empty()).collect();
        let least = |of: fn(&str) -> bool| {
            let seconds = |between: &Vec<Interval>| -> u32 {
                between.iter().filter(|interval| of(interval.state.as_str())).map(|interval| interval.steps).sum()
            };
            clearings.iter().map(seconds).min().unwrap_or(0)
        };
        let letters = greens[0].links();
        let crossings = agent.crossings.iter().filter(|it| !cars.contains(&it.letter));
        Watchdog {
            crossings: crossings.map(|crossing| (crossing.clone(), u32::MAX)).collect(),
            ways: roads.crossing_letters_of_all(&agent.plan.light).unwrap(),
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
            cars,
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
        self.on_foot(state)?;
        self.last = Some(state.clone());
        Ok(())
    }

    fn durations(&mut self, state: &SignalState) -> Result<(), String> {
        let shown = of_cars(&self.cars, state);
        let now = self.greens.iter().position(|green| of_cars(&self.cars, green) == shown);
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

    /// Errors: cars get green across a crossing on which somebody may still be who began with the walk signal.
    fn on_foot(&mut self, state: &SignalState) -> Result<(), String> {
        let goes = |state: &SignalState, letter: usize| matches!(state.as_str().as_bytes()[letter], b'G' | b'g');
        let opens = |letter: usize| goes(state, letter) && self.last.as_ref().is_some_and(|last| !goes(last, letter));
        for (TimedCrossing { edge, letter, across_s, .. }, since) in &mut self.crossings {
            *since = if goes(state, *letter) { 0 } else { since.saturating_add(1) };
            let foes = self.ways.iter().filter(|pair| pair.contains(letter) && pair[0] != pair[1]);
            let mut foes = foes.map(|pair| if pair[0] == *letter { pair[1] } else { pair[0] });
            // The second in which the light shows this is not over.
            if let Some(foe) =
                foes.find(|foe| self.cars.contains(foe) && opens(*foe) && *since <= *across_s && *since > 0)
            {
                return Err(format!("letter {foe} has green {} s after the walk on {edge}, of {across_s}", *since - 1));
            }
        }
        Ok(())
    }

    fn letter(&mut self, letter: usize, state: &SignalState) -> Result<(), String> {
        let of = |state: &SignalState| state.as_str().as_bytes()[letter];
        let (now, before) = (of(state), self.last.as_ref().map(of));
        let goes = |letter: u8| matches!(letter, b'G' | b'g');
        let on_foot = self.crossings.iter().any(|(crossing, _)| crossing.letter == letter);
        if before.is_some_and(goes) && matches!(now, b'r') && !on_foot {
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

fn of_cars(cars: &BTreeSet<usize>, state: &SignalState) -> Vec<u8> {
    cars.iter().map(|&letter| state.as_str().as_bytes()[letter]).collect()
}
