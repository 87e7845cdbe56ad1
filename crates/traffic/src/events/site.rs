//! The phases and detectors of a light, from its net.
//!
//! Tools of signal engineers count for each detector what one phase shows. So a phase is what all cars of a lane obey:
//! lanes of one road that have green at the same times, in each green of the agent and each state of the programs. A
//! lane has green if one of its ways has. So a detector belongs to exactly one phase, and that phase serves its lane.

use std::collections::{BTreeMap, BTreeSet};

use super::detectors::Places;
use crate::agents::plan::AgentPlan;
use crate::network::roads::{Connection, Function, LaneNo, Roads};
use libsumo::SignalState;

/// A light with its phases and detectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    pub light: String,
    /// Phases, the first of which has number 1.
    pub phases: Vec<Phase>,
    /// Detectors, the first of which has number 1.
    pub detectors: Vec<Detector>,
    /// Greens of the light, in the order of its program.
    pub greens: Vec<SignalState>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    pub kind: PhaseKind,
    /// Edge of the lanes, or the crossing.
    pub edge: String,
    /// Name of the street in the net; may be empty.
    pub street: String,
    /// Directions of its ways in SUMO's letters, such as `s` and `l`. A crossing has none.
    pub directions: BTreeSet<String>,
    pub lanes: Vec<String>,
    /// Letters of the light's state that it obeys.
    pub letters: Vec<usize>,
    /// Greens of the light in which it has green, as indices into [`Site::greens`].
    pub greens: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseKind {
    Vehicles,
    /// A crossing. Its events are those of pedestrians only.
    Pedestrians,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Detector {
    pub lane: String,
    pub place: DetectorPlace,
    /// Its beginning, in metres from the lane's beginning.
    pub begin_m: f64,
    /// Distance from its beginning to the stop line in metres.
    pub setback_m: f64,
    /// Number of its phase.
    pub phase: u16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DetectorPlace {
    /// From its beginning to the stop line.
    StopBar,
    /// A line across the lane.
    Advance,
}

/// Returns all lights of a net that cars obey: those of the agents in their order, then those that keep their program.
pub(crate) fn sites(roads: &Roads, agents: &[AgentPlan]) -> Vec<Site> {
    let mut lights: Vec<&str> = agents.iter().map(|agent| &*agent.light).collect();
    for program in &roads.programs {
        if !lights.contains(&&*program.light) {
            lights.push(&program.light);
        }
    }
    let sites = lights.into_iter().enumerate().map(|(number, light)| {
        let programs = roads.programs.iter().filter(|program| program.light == light);
        let of_programs: Vec<&SignalState> =
            programs.clone().flat_map(|program| &program.phases).map(|phase| &phase.state).collect();
        let greens: Vec<SignalState> = match agents.get(number) {
            Some(agent) => agent.phases.greens().to_vec(),
            None => of_programs.iter().map(|&state| state.clone()).collect(),
        };
        let states: Vec<&SignalState> = greens.iter().chain(of_programs).collect();
        site(roads, light, &greens, &states)
    });
    sites.filter(|site| !site.phases.is_empty()).collect()
}

fn site(roads: &Roads, light: &str, greens: &[SignalState], states: &[&SignalState]) -> Site {
    let mut lanes: BTreeMap<LaneNo, BTreeSet<usize>> = BTreeMap::new();
    for link in roads.under_light(light).filter(|link| roads.is_road(link.from)) {
        lanes.entry(link.from).or_default().insert(letter(link));
    }
    // Lanes of one edge and one pattern, in the order of the lanes.
    let mut groups: Vec<(Vec<bool>, Vec<LaneNo>, BTreeSet<usize>)> = Vec::new();
    for (&lane, letters) in &lanes {
        let pattern: Vec<bool> = states.iter().map(|state| has_green(state, letters)).collect();
        let edge = roads.lane(lane).edge;
        let same = groups.iter_mut().find(|(other, of, _)| *other == pattern && roads.lane(of[0]).edge == edge);
        match same {
            Some((_, of, all)) => {
                of.push(lane);
                all.extend(letters);
            }
            None => groups.push((pattern, vec![lane], letters.clone())),
        }
    }
    let in_greens = |letters: &BTreeSet<usize>| -> Vec<usize> {
        (0..greens.len()).filter(|&green| has_green(&greens[green], letters)).collect()
    };
    groups.sort_by_key(|(_, lanes, letters)| {
        (in_greens(letters).first().copied().unwrap_or(usize::MAX), letters.first().copied(), lanes[0])
    });
    let vehicles = groups.iter().map(|(_, lanes, letters)| {
        let edge = roads.edge(roads.lane(lanes[0]).edge);
        let links = roads.under_light(light).filter(|link| lanes.contains(&link.from));
        Phase {
            kind: PhaseKind::Vehicles,
            street: edge.street.clone().unwrap_or_default(),
            edge: edge.id.clone(),
            directions: links.filter_map(|link| link.direction).map(String::from).collect(),
            lanes: lanes.iter().map(|&lane| roads.lane(lane).id.clone()).collect(),
            letters: letters.iter().copied().collect(),
            greens: in_greens(letters),
        }
    });
    let phases: Vec<Phase> = vehicles.chain(crossings(roads, light, in_greens)).collect();
    let numbered =
        groups.iter().zip(1..).flat_map(|((_, lanes, _), phase)| lanes.iter().map(move |&lane| (lane, phase)));
    let detectors = numbered.flat_map(|(lane, phase)| detectors(roads, lane, phase)).collect();
    Site { light: light.to_owned(), phases, detectors, greens: greens.to_vec() }
}

fn crossings(roads: &Roads, light: &str, in_greens: impl Fn(&BTreeSet<usize>) -> Vec<usize>) -> Vec<Phase> {
    let mut letters: BTreeMap<_, BTreeSet<usize>> = BTreeMap::new();
    for link in roads.of_light(light) {
        let edges = [link.from, link.to].map(|lane| roads.lane(lane).edge);
        if let Some(crossing) = edges.into_iter().find(|&edge| roads.edge(edge).function == Function::Crossing) {
            letters.entry(crossing).or_default().insert(letter(link));
        }
    }
    let phase = |(crossing, letters): (_, BTreeSet<usize>)| Phase {
        kind: PhaseKind::Pedestrians,
        edge: roads.edge(crossing).id.clone(),
        street: String::new(),
        directions: BTreeSet::new(),
        lanes: Vec::new(),
        greens: in_greens(&letters),
        letters: letters.into_iter().collect(),
    };
    letters.into_iter().map(phase).collect()
}

fn detectors(roads: &Roads, lane: LaneNo, phase: u16) -> Vec<Detector> {
    let lane = roads.lane(lane);
    let places = Places::on(lane.length_m);
    let detector = |place, begin_m: f64| Detector {
        lane: lane.id.clone(),
        place,
        begin_m,
        setback_m: lane.length_m - begin_m,
        phase,
    };
    let advance = places.advance_m.map(|begin_m| detector(DetectorPlace::Advance, begin_m));
    [detector(DetectorPlace::StopBar, places.stop_bar_m)].into_iter().chain(advance).collect()
}

fn letter(link: &Connection) -> usize {
    link.signal.as_ref().expect("a light controls it").letter
}

/// Returns whether one of these letters is green. A state may have fewer letters than the net, in a program that is
/// never shown.
fn has_green<'a>(state: &SignalState, letters: impl IntoIterator<Item = &'a usize>) -> bool {
    letters
        .into_iter()
        .any(|&letter| state.as_str().as_bytes().get(letter).is_some_and(|letter| b"Gg".contains(letter)))
}
