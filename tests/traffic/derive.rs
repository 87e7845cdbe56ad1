//! Lights and regions of the shipped scenarios, and of real networks that are not part of this program: those in the
//! folder that `DIALS_NETWORKS` names.

use std::collections::BTreeSet;
use std::io::{Write, stderr};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use dials_traffic::agents::derive::greens::{Change, Greens, is_yellow};
use dials_traffic::agents::derive::overrides::Overrides;
use dials_traffic::agents::derive::padding::Padding;
use dials_traffic::agents::derive::{Agent, Derived, Rules, clearing, derive, safety};
use dials_traffic::config::sumocfg::Sumocfg;
use dials_traffic::network::roads::{Function, Roads};
use libsumo::SignalState;

/// What is known of a network.
struct Known {
    name: &'static str,
    lights: usize,
    greens: RangeInclusive<usize>,
    /// Lanes at the stop lines of a light.
    controlled: RangeInclusive<usize>,
}

const SHIPPED: [Known; 3] = [
    Known { name: "grid_4x4_turns", lights: 16, greens: 8..=8, controlled: 10..=10 },
    Known { name: "town", lights: 20, greens: 2..=5, controlled: 3..=13 },
    Known { name: "arterial", lights: 6, greens: 3..=4, controlled: 6..=10 },
];

const REAL: [Known; 5] = [
    Known { name: "cologne1", lights: 1, greens: 4..=4, controlled: 8..=8 },
    Known { name: "cologne3", lights: 3, greens: 3..=4, controlled: 5..=8 },
    Known { name: "ingolstadt1", lights: 1, greens: 3..=3, controlled: 7..=7 },
    Known { name: "ingolstadt7", lights: 7, greens: 2..=4, controlled: 6..=12 },
    Known { name: "grid4x4", lights: 16, greens: 8..=8, controlled: 12..=12 },
];

/// Returns the networks with their roads and agents: the shipped ones, and the real ones if somebody named their folder.
fn networks() -> Vec<(&'static Known, Roads, Derived)> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let mut networks: Vec<_> = SHIPPED.iter().map(|known| opened(&shipped, known)).collect();
    match std::env::var_os("DIALS_NETWORKS").map(PathBuf::from) {
        Some(folder) => networks.extend(REAL.iter().map(|known| opened(&folder, known))),
        None => {
            // Not `eprintln`, which is hidden when a test passes.
            let line = "not tested: lights of real networks: DIALS_NETWORKS names no folder with them\n";
            stderr().write_all(line.as_bytes()).unwrap();
        }
    }
    networks
}

fn opened(folder: &Path, known: &'static Known) -> (&'static Known, Roads, Derived) {
    let scenario = folder.join(known.name).join(known.name).with_extension("sumocfg");
    let roads = Roads::of_file(&Sumocfg::read(&scenario).unwrap().net).unwrap();
    let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
    (known, roads, derived)
}

#[test]
fn lights_greens_and_lanes_are_those_that_are_known() {
    for (known, roads, derived) in networks() {
        let name = known.name;
        assert_eq!((derived.agents.len(), derived.keeping.len()), (known.lights, 0), "{name}");
        let lights: Vec<&str> = derived.agents.iter().map(|agent| agent.plan.light.as_str()).collect();
        assert_eq!(lights, roads.programs.iter().map(|program| program.light.as_str()).collect::<Vec<_>>(), "{name}");
        for Agent { plan, region, .. } in &derived.agents {
            let light = format!("{name}, light {}", plan.light);
            let greens = plan.phases.greens().len();
            assert!(known.greens.contains(&greens), "{light}: {greens} greens");
            let controlled = plan.region.approaches.iter().filter(|approach| approach.ahead_m == 0.0).count();
            assert!(known.controlled.contains(&controlled), "{light}: {controlled} controlled lanes");
            assert!(region.own.len() + region.passed.len() <= 8, "{light}: {region:?}");
        }
    }
}

#[test]
fn every_lane_that_an_agent_sees_leads_to_its_light() {
    for (known, roads, derived) in networks() {
        for Agent { plan, region, .. } in &derived.agents {
            let light = format!("{}, light {}", known.name, plan.light);
            let letters: BTreeSet<usize> = plan.region.links.iter().map(|link| link.letter).collect();
            let of_cars = roads.under_light(&plan.light).map(|link| link.signal.as_ref().unwrap().letter);
            assert_eq!(letters, of_cars.collect(), "{light}: all letters for cars have a link");
            for approach in &plan.region.approaches {
                let lane = roads.lane_named(&approach.lane).unwrap();
                assert!(roads.lane(lane).carries_cars && approach.ahead_m < 150.0, "{light}: {approach:?}");
                assert!(!approach.links.is_empty(), "{light}: {approach:?}");
            }
            let ends: BTreeSet<_> = region.ahead_m.keys().filter_map(|&lane| roads.end_of(lane)).collect();
            let within: BTreeSet<_> = region.own.iter().chain(&region.passed).copied().collect();
            assert!(ends.is_subset(&within), "{light}: a lane ends outside of the region");
            let columns = plan.columns();
            assert_eq!(columns.len(), plan.width(), "{light}");
            assert_eq!(
                columns.iter().collect::<BTreeSet<_>>().len(),
                columns.len(),
                "{light}: two columns of one name"
            );
        }
        let padding = Padding::of(derived.agents.iter().map(|agent| &agent.plan));
        println!("{}: {padding:?}", known.name);
        assert!(padding.padded < 0.5, "{padding:?}");
    }
}

/// Returns the letters that lose their green in a change.
fn losing(change: &Change) -> Vec<usize> {
    let letters = change.from.as_str().chars().zip(change.to.as_str().chars());
    letters.enumerate().filter(|(_, (old, new))| clearing::is_lost(*old, *new)).map(|(letter, _)| letter).collect()
}

fn is_yellow_at(state: &SignalState, letter: usize) -> bool {
    matches!(state.as_str().as_bytes()[letter], b'y' | b'Y')
}

#[test]
fn every_link_that_loses_green_is_yellow_in_the_derived_state_as_in_the_own_program() {
    let (mut compared, mut equal) = (0, 0);
    for (known, roads, derived) in networks() {
        for Agent { plan, program, .. } in &derived.agents {
            let greens = plan.phases.greens();
            let cars = roads.letters_of_vehicles(&plan.light);
            for change in Greens::of(program, &cars).changes() {
                let place = |state| greens.iter().position(|green| green == state).unwrap();
                let [from, to] = [change.from, change.to].map(place);
                let shown = plan.phases.clearing(from, to);
                let own: Vec<&SignalState> =
                    change.between.iter().map(|phase| &phase.state).filter(|state| is_yellow(state)).collect();
                for letter in losing(&change) {
                    let told = format!("{}, light {}, {} to {}", known.name, plan.light, change.from, change.to);
                    assert!(is_yellow_at(&shown[0].state, letter), "{told}: letter {letter} of {}", shown[0].state);
                    // The programs of one light go from green to green without yellow where nobody loses it.
                    assert!(own.iter().any(|state| is_yellow_at(state, letter)), "{told}: letter {letter}");
                }
                if let (Some(shown), Some(own)) = (shown.first(), own.first()) {
                    compared += 1;
                    equal += usize::from(shown.state == **own);
                }
            }
        }
    }
    println!("{equal} of {compared} derived states are those of the own programs");
    assert!(equal * 2 > compared, "{equal} of {compared}");
}

#[test]
fn whatever_green_comes_next_a_link_that_loses_green_is_yellow_before_it_is_red() {
    for (known, _, derived) in networks() {
        for Agent { plan, .. } in &derived.agents {
            let greens = plan.phases.greens();
            for (from, old) in greens.iter().enumerate() {
                for (to, new) in greens.iter().enumerate().filter(|(to, _)| *to != from) {
                    let told = format!("{}, light {}, {old} to {new}", known.name, plan.light);
                    let shown = plan.phases.clearing(from, to);
                    let lost = losing(&Change { from: old, to: new, between: Vec::new() });
                    // Between two greens nothing is shown only if nobody loses green.
                    assert_eq!(shown.is_empty(), lost.is_empty(), "{told}");
                    let Some((yellow, later)) = shown.split_first() else { continue };
                    // All programs of our networks have 3 s.
                    let is_ours = SHIPPED.iter().any(|ours| ours.name == known.name);
                    assert!(if is_ours { yellow.steps == 3 } else { yellow.steps > 0 }, "{told}");
                    for letter in 0..old.as_str().len() {
                        let letter_of = |state: &SignalState| state.as_str().as_bytes()[letter];
                        let (was, then) = (letter_of(old), later.iter().map(|next| letter_of(&next.state)));
                        let is_lost = lost.contains(&letter);
                        assert_eq!(letter_of(&yellow.state), if is_lost { b'y' } else { was }, "{told}: {letter}");
                        assert!({ then }.all(|now| now == if is_lost { b'r' } else { was }), "{told}: {letter}");
                    }
                }
            }
        }
    }
}

#[test]
fn no_two_cars_that_cross_get_green_at_once_unless_the_own_program_does_so() {
    for (known, roads, derived) in networks() {
        let mut states = 0;
        for Agent { plan, program, .. } in &derived.agents {
            let crossing = roads.crossing_letters(&plan.light).unwrap();
            assert!(!crossing.is_empty(), "{}, light {}: nobody crosses", known.name, plan.light);
            let own: Vec<&SignalState> = program.phases.iter().map(|phase| &phase.state).collect();
            for state in safety::states(&plan.phases) {
                states += 1;
                let bad = safety::conflicts(&crossing, &own, state);
                assert!(bad.is_empty(), "{}, light {}, state {state}: {bad:?}", known.name, plan.light);
            }
            // The check sees something: with green for all, those who cross have it at once.
            let all: SignalState = "G".repeat(program.letters().unwrap()).parse().unwrap();
            assert!(!safety::conflicts(&crossing, &own, &all).is_empty(), "{}, light {}", known.name, plan.light);
        }
        println!("{}: {states} states", known.name);
    }
}

#[test]
fn the_requests_of_every_junction_are_those_of_its_links() {
    for (known, roads, _) in networks() {
        let outside = roads.edges.iter().filter(|edge| edge.function == Function::Road);
        let ends: BTreeSet<_> = outside.filter_map(|edge| edge.ends).map(|[_, to]| to).collect();
        for junction in ends {
            let links = roads.links_of(junction).len();
            let requests = roads.junction(junction).requests.len();
            assert!(requests == links || requests == 0, "{}: {}", known.name, roads.junction(junction).id);
        }
    }
}

#[test]
fn the_grids_of_this_program_have_agents_too() {
    let net = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/grid_2x2.net.xml");
    let roads = Roads::of_file(&net).unwrap();
    let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
    for Agent { plan, .. } in &derived.agents {
        assert_eq!(plan.phases.greens().iter().map(SignalState::as_str).collect::<Vec<_>>(), ["GrGr", "rGrG"]);
        // Four lanes of 100 m, two greens, one bit and one clock.
        assert_eq!((plan.region.approaches.len(), plan.width()), (4, 44), "{}", plan.light);
    }
    assert_eq!((derived.agents.len(), derived.keeping.len()), (4, 0));
}
