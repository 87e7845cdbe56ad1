//! Greens of a light with two rings and a barrier, as NEMA controllers have: pairs of a phase of ring 1 and one of ring 2 on the
//! same side of the barrier that do not conflict.
//!
//! A program of type `NEMA` says what its rings are. For a junction of four arms with lanes for left turns they follow from the
//! net: phases 2 and 6 are the two directions of one street, 4 and 8 those of the other one, and 1, 5, 3 and 7 the left turns
//! against them. Rings are `1 2 | 3 4` and `5 6 | 7 8`.
//!
//! Source: NCHRP Report 812, "Signal Timing Manual", 2nd edition, 2015, section 4.1; SUMO 1.15, `NEMAController`.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};

use super::safety::conflicts;
use crate::network::roads::program::{Phase, Program};
use crate::network::roads::{EdgeNo, Function, Roads};
use libsumo::SignalState;

pub(super) struct RingGreens {
    pub(super) greens: Vec<SignalState>,
    /// Shortest duration of each green that a program of type NEMA gives its phases.
    pub(super) least_s: Vec<Option<f64>>,
    /// Longest yellow and all red of the phases of such a program.
    pub(super) yellow_s: Option<u32>,
    pub(super) all_red_s: Option<u32>,
}

/// One phase of a ring: what it opens, and how long it lasts at least.
struct RingPhase {
    state: SignalState,
    least_s: Option<f64>,
}

/// Phases of one side of the barrier, those of ring 1 and those of ring 2.
type Side = [Vec<RingPhase>; 2];

/// Returns the greens of a light. An error names the light, says why it has no rings, and what to do.
pub(super) fn greens(roads: &Roads, program: &Program) -> Result<RingGreens> {
    let light = &program.light;
    let why = || {
        format!(
            "traffic.actions = \"ring-barrier\": light `{light}` has no rings; choose another traffic.actions, write its \
             greens into agents.toml, or let it keep its program there (keep)"
        )
    };
    if program.kind == "NEMA" {
        return of_program(roads, program).with_context(why);
    }
    of_junction(roads, program).with_context(why)
}

fn of_program(roads: &Roads, program: &Program) -> Result<RingGreens> {
    let parameter = |key: &str| program.parameters.iter().find(|(known, _)| known == key).map(|(_, value)| &**value);
    let names = |text: &str| text.split(',').map(|name| name.trim().to_owned()).collect::<Vec<_>>();
    let ring = |key: &str| {
        let text = parameter(key).with_context(|| format!("its program of type NEMA has no <param key=\"{key}\">"))?;
        Ok::<_, anyhow::Error>(names(text))
    };
    let rings = [ring("ring1")?, ring("ring2")?];
    // Either name is SUMO's.
    let keys = ["barrierPhases", "barrier2Phases", "coordinatePhases"];
    let barriers: BTreeSet<String> = keys.into_iter().filter_map(parameter).flat_map(names).collect();
    let sides = rings.each_ref().map(|ring| {
        let parts: Vec<&[String]> = ring.split_inclusive(|name| barriers.contains(name)).collect();
        parts
    });
    ensure!(
        sides[0].len() == sides[1].len(),
        "ring1 has {} sides and ring2 has {}: barrierPhases and barrier2Phases cut them so",
        sides[0].len(),
        sides[1].len()
    );
    let phase = |name: &String| -> Result<Option<RingPhase>> {
        if name == "0" {
            return Ok(None);
        }
        let found = program.phases.iter().find(|phase| phase.name.as_deref() == Some(name));
        let found = found.with_context(|| format!("a ring names phase {name}, but no <phase> has this name"))?;
        Ok(Some(RingPhase { state: found.state.clone(), least_s: found.limits_s[0] }))
    };
    let phases = |names: &[String]| names.iter().filter_map(|name| phase(name).transpose()).collect::<Result<Vec<_>>>();
    let both = sides[0].iter().zip(&sides[1]).map(|(one, other)| Ok([phases(one)?, phases(other)?]));
    let sides = both.collect::<Result<Vec<Side>>>()?;
    let longest = |of_phase: fn(&Phase) -> Option<f64>| {
        program.phases.iter().filter_map(of_phase).reduce(f64::max).map(|seconds| seconds.ceil() as u32)
    };
    let mut found = pairs(roads, program, &sides)?;
    found.yellow_s = longest(|phase| phase.change_s[0]);
    found.all_red_s = longest(|phase| phase.change_s[1]);
    Ok(found)
}

/// Returns all pairs of the sides, in their order, without those that conflict.
fn pairs(roads: &Roads, program: &Program, sides: &[Side]) -> Result<RingGreens> {
    let crossing = roads.crossing_letters(&program.light)?;
    let own: Vec<&SignalState> = sides.iter().flatten().flatten().map(|phase| &phase.state).collect();
    let mut found = RingGreens { greens: Vec::new(), least_s: Vec::new(), yellow_s: None, all_red_s: None };
    for [one, other] in sides {
        // A ring without a phase on this side leaves it to the other one.
        let some = |ring: &'_ [RingPhase]| -> Vec<Option<usize>> {
            if ring.is_empty() { vec![None] } else { (0..ring.len()).map(Some).collect() }
        };
        for first in some(one) {
            for second in some(other) {
                let pair: Vec<&RingPhase> =
                    [first.map(|place| &one[place]), second.map(|place| &other[place])].into_iter().flatten().collect();
                let Some(state) = together(pair.iter().map(|phase| &phase.state)) else { continue };
                if conflicts(&crossing, &own, &state).is_empty() && !found.greens.contains(&state) {
                    found.greens.push(state);
                    found.least_s.push(pair.iter().filter_map(|phase| phase.least_s).reduce(f64::max));
                }
            }
        }
    }
    for link in roads.under_light(&program.light) {
        let letter = link.signal.as_ref().expect("a light controls it").letter;
        let opens = |state: &SignalState| matches!(state.as_str().as_bytes()[letter], b'G' | b'g');
        let is_served = found.greens.iter().any(opens);
        let is_known = own.iter().any(|state| opens(state));
        ensure!(is_served || !is_known, "all pairs that open link {letter} conflict");
    }
    Ok(found)
}

/// Returns what phases show together: for each link the greenest letter.
fn together<'a>(states: impl Iterator<Item = &'a SignalState>) -> Option<SignalState> {
    let rank = |letter: u8| [b'G', b'g'].iter().rposition(|&green| green == letter).map_or(0, |place| 2 - place);
    let greenest = |one: Vec<u8>, other: Vec<u8>| {
        one.iter().zip(other).map(|(&one, other)| if rank(other) > rank(one) { other } else { one }).collect()
    };
    let letters = states.map(|state| state.as_str().as_bytes().to_vec()).reduce(greenest)?;
    let letters = String::from_utf8(letters).expect("letters of states are ASCII");
    Some(SignalState::new(letters).expect("all letters are of a state"))
}

/// Letters of one arm.
#[derive(Default)]
struct Arm {
    /// Direction in which cars come, in radians.
    heading: f64,
    through: BTreeSet<usize>,
    right: BTreeSet<usize>,
    left: BTreeSet<usize>,
    around: BTreeSet<usize>,
}

fn of_junction(roads: &Roads, program: &Program) -> Result<RingGreens> {
    let light = &program.light;
    let junctions = roads.junctions_of(light).len();
    ensure!(junctions == 1, "it stands at {junctions} junctions, and its program is not of type NEMA");
    let mut arms: BTreeMap<EdgeNo, Arm> = BTreeMap::new();
    for link in roads.under_light(light) {
        let letter = link.signal.as_ref().expect("a light controls it").letter;
        let lane = roads.lane(link.from);
        let arm = arms.entry(lane.edge).or_default();
        if let [.., from, to] = lane.shape[..] {
            arm.heading = (to[1] - from[1]).atan2(to[0] - from[0]);
        }
        let letters = match link.direction {
            Some('l' | 'L') => &mut arm.left,
            Some('r' | 'R') => &mut arm.right,
            Some('t') => &mut arm.around,
            _ => &mut arm.through,
        };
        letters.insert(letter);
    }
    ensure!(arms.len() == 4, "cars come to it from {} roads, and not from four", arms.len());
    for (edge, Arm { through, right, left, .. }) in &arms {
        let name = &roads.edge(*edge).id;
        ensure!(!left.is_empty(), "from road `{name}` nobody turns left");
        ensure!(!through.is_empty(), "from road `{name}` nobody drives straight on");
        let shared = left.iter().any(|letter| through.contains(letter) || right.contains(letter));
        let mixed = roads.edge(*edge).lanes.iter().any(|&lane| {
            let directions: BTreeSet<bool> = roads
                .links_from(lane)
                .filter(|link| link.signal.is_some() && roads.carries_cars(link) && !link.turns_around())
                .map(|link| matches!(link.direction, Some('l' | 'L')))
                .collect();
            directions.len() == 2
        });
        ensure!(!shared && !mixed, "on road `{name}` left turns share a lane or a signal with others");
    }
    let mut arms: Vec<Arm> = arms.into_values().collect();
    arms.sort_by(|one, other| one.heading.total_cmp(&other.heading));
    for street in 0..2 {
        let turn = (arms[street + 2].heading - arms[street].heading).abs();
        ensure!((2.0..4.3).contains(&turn), "its roads do not face each other in pairs");
    }
    // The street that has green first in the program is that of phases 2 and 6.
    let first = |street: usize| {
        let opens = |phase: &Phase| {
            arms[street].through.iter().any(|&letter| matches!(phase.state.as_str().as_bytes()[letter], b'G' | b'g'))
        };
        program.phases.iter().position(opens).unwrap_or(usize::MAX)
    };
    let streets = if first(1) < first(0) { [1, 0] } else { [0, 1] };
    let letters = program.letters().context("its program has no phases")?;
    let crossing = roads.crossing_letters_of_all(light)?;
    let of_letters = |green: &[&BTreeSet<usize>], around: &BTreeSet<usize>| {
        let mut state = vec![b'r'; letters];
        green.iter().copied().flatten().for_each(|&letter| state[letter] = b'G');
        around
            .iter()
            .filter(|&&letter| state[letter] == b'r')
            .collect::<Vec<_>>()
            .into_iter()
            .for_each(|&it| state[it] = b'g');
        SignalState::new(String::from_utf8(state).expect("letters are ASCII"))
            .expect("r, g and G are letters of a state")
    };
    let through = |arm: usize| {
        let Arm { through, right, .. } = &arms[arm];
        RingPhase { state: of_letters(&[through, right], &BTreeSet::new()), least_s: None }
    };
    let left = |arm: usize| {
        let Arm { left, around, .. } = &arms[arm];
        RingPhase { state: of_letters(&[left], around), least_s: None }
    };
    // Ring 1 first turns left from the arm that faces the one of its through phase. So both rings clear the same road.
    let side = |street: usize| -> Side {
        let [one, other] = [street, street + 2];
        [vec![left(other), through(one)], vec![left(one), through(other)]]
    };
    let mut found = pairs(roads, program, &streets.map(side))?;
    let rights: BTreeSet<usize> = arms.iter().flat_map(|arm| arm.right.iter().copied()).collect();
    let walks: BTreeSet<usize> = crossings(roads, light);
    for green in &mut found.greens {
        *green = with_people(green, &walks, &rights, &crossing);
    }
    ensure!(
        walks.iter().all(|&walk| found.greens.iter().any(|green| green.as_str().as_bytes()[walk] != b'r')),
        "some crossing has a walk signal in none of its greens"
    );
    Ok(found)
}

fn crossings(roads: &Roads, light: &str) -> BTreeSet<usize> {
    let crossing = |lane| roads.edge(roads.lane(lane).edge).function == Function::Crossing;
    let links = roads.of_light(light).filter(|link| crossing(link.to));
    links.filter_map(|link| Some(link.signal.as_ref()?.letter)).collect()
}

/// Lets people walk where only cars that turn right have green, and lets these yield.
fn with_people(
    green: &SignalState,
    walks: &BTreeSet<usize>,
    rights: &BTreeSet<usize>,
    crossing: &BTreeSet<[usize; 2]>,
) -> SignalState {
    let mut letters = green.as_str().as_bytes().to_vec();
    let foes = |walk: usize| {
        let its = crossing.iter().filter(move |pair| pair.contains(&walk));
        its.map(move |pair| if pair[0] == walk { pair[1] } else { pair[0] })
    };
    for &walk in walks {
        let driving: Vec<usize> = foes(walk).filter(|&foe| letters[foe] != b'r' && !walks.contains(&foe)).collect();
        if driving.iter().all(|foe| rights.contains(foe)) {
            letters[walk] = b'G';
            driving.into_iter().for_each(|foe| letters[foe] = b'g');
        }
    }
    let letters = String::from_utf8(letters).expect("letters are ASCII");
    SignalState::new(letters).expect("letters of a state")
}

#[cfg(test)]
mod tests {
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Agent, Rules, derive};
    use crate::config::Actions;
    use crate::light_limits_test::CROSSING;
    use crate::network::roads::{Roads, example};
    use crate::network::tree::parse;

    fn made(net: &str) -> anyhow::Result<Agent> {
        let roads = Roads::read(&parse(net).unwrap()).unwrap();
        let rules = Rules { actions: Actions::RingBarrier, ..Rules::default() };
        Ok(derive(&roads, &rules, &Overrides::default())?.agents.remove(0))
    }

    fn greens(agent: &Agent) -> Vec<&str> {
        agent.plan.phases.greens().iter().map(|green| green.as_str()).collect()
    }

    #[test]
    fn a_junction_of_four_arms_has_eight_pairs_and_people_walk_where_only_right_turns_cross_them() {
        // Letters: right, through and left of top, right, bottom and left; crossings of top, right, bottom and left.
        let expected = [
            "rrGrrrrrGrrrrrrr", // both left turns of top and bottom
            "rrrrrrgGGrrrrGrr", // all of bottom; its right turn yields to people on the crossing of right
            "gGGrrrrrrrrrrrrG",
            "gGrrrrgGrrrrrGrG",
            "rrrrrGrrrrrGrrrr",
            "rrrgGGrrrrrrGrrr",
            "rrrrrrrrrgGGrrGr",
            "rrrgGrrrrgGrGrGr",
        ];
        let agent = made(CROSSING).unwrap();
        assert_eq!(greens(&agent), expected);
        assert_eq!(agent.plan.phases.min_green_steps(), [5, 16, 16, 16, 5, 16, 16, 16]);
    }

    #[test]
    fn the_rings_of_a_nema_program_are_its_own() {
        let phases = [
            ("1", "rrrrrrrrGrrrrrrr"),
            ("2", "gGrrrrrrrrrrrrrG"),
            ("3", "rrrrrGrrrrrrrrrr"),
            ("4", "rrrrrrrrrgGrrrGr"),
            ("5", "rrGrrrrrrrrrrrrr"),
            ("6", "rrrrrrgGrrrrrGrr"),
            ("8", "rrrgGrrrrrrrGrrr"),
        ];
        let phase = |(name, state): (&str, &str)| {
            format!("<phase duration='30' minDur='6' maxDur='40' name='{name}' state='{state}' yellow='4' red='1'/>")
        };
        let parameter = |(key, value): (&str, &str)| format!("<param key='{key}' value='{value}'/>");
        let rings = [("ring1", "1,2,3,4"), ("ring2", "5,6,0,8"), ("barrierPhases", "4,8"), ("barrier2Phases", "2,6")]
            .map(parameter);
        let program = |rings: &str| {
            let [begin, end] = ["<tlLogic", "</tlLogic>"].map(|tag| CROSSING.find(tag).unwrap());
            let phases = phases.map(phase).concat();
            let nema = format!("<tlLogic id='A0' type='NEMA' programID='0' offset='0'>{phases}{rings}");
            format!("{}{nema}{}", &CROSSING[..begin], &CROSSING[end..])
        };
        let agent = made(&program(&rings.concat())).unwrap();
        // Ring 2 has no phase 7, so phases 3 and 4 go with phase 8 only; phase 3 crosses none of it.
        let expected = [
            "rrGrrrrrGrrrrrrr",
            "rrrrrrgGGrrrrGrr",
            "gGGrrrrrrrrrrrrG",
            "gGrrrrgGrrrrrGrG",
            "rrrgGGrrrrrrGrrr",
            "rrrgGrrrrgGrGrGr",
        ];
        assert_eq!(greens(&agent), expected);
        assert_eq!(agent.plan.phases.min_green_steps(), [6, 16, 16, 16, 16, 16]);
        let between: Vec<(&str, u32)> =
            agent.plan.phases.clearing(0, 3).iter().map(|interval| (interval.state.as_str(), interval.steps)).collect();
        assert_eq!(between, [("rryrrrrryrrrrrrr", 4), ("rrrrrrrrrrrrrrrr", 1)]);
        let error = format!("{:#}", made(&program(&rings[1..].concat())).err().unwrap());
        assert!(error.ends_with("its program of type NEMA has no <param key=\"ring1\">"), "{error}");
    }

    #[test]
    fn a_light_without_rings_is_named_with_the_reason_and_the_way_out() {
        assert_eq!(
            format!("{:#}", made(&example::changed(&[])).err().unwrap()),
            "traffic.actions = \"ring-barrier\": light `J` has no rings; choose another traffic.actions, write its greens \
             into agents.toml, or let it keep its program there (keep): cars come to it from 2 roads, and not from four"
        );
    }
}
