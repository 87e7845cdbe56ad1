//! What influences the regions of a scenario from outside, as the global simulator observes it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

use dials_core::base::{RandomPurpose, Seed};
use dials_core::domain::{Action, Controller, Domain, GlobalSimulator, JointPercept};
use dials_learn::predictors::Dataset;
use dials_learn::steps::collect::collect_episode;
use dials_traffic::Traffic;
use dials_traffic::agents::border_plan::{BLOCK_M, BLOCK_MPS, BorderPlan};
use dials_traffic::agents::plan::Border;
use dials_traffic::config::ScenarioConfig;
use dials_traffic::controllers::HandCoded;
use rand::Rng;

use super::play::{opened, shipped};
use crate::plain_sumo;

/// Chooses one of the allowed greens of every light.
struct RandomGreens(dials_core::base::Dice);

impl RandomGreens {
    fn new() -> RandomGreens {
        RandomGreens(Seed::new(0).dice())
    }
}

impl Controller for RandomGreens {
    fn begin(&mut self, episode: Seed) {
        self.0 = episode.fork(RandomPurpose::Acting).dice();
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> anyhow::Result<()> {
        for (mask, action) in percept.masks.iter().zip(actions) {
            let allowed: Vec<usize> = (0..mask.len()).filter(|&action| mask[action]).collect();
            *action = allowed[self.0.random_range(0..allowed.len())].try_into().unwrap();
        }
        Ok(())
    }
}

/// A car in a second, as SUMO writes it: lane, position and speed.
type Seen = BTreeMap<String, (String, f64, f64)>;

/// What each light shows in a second, by its name.
type Shown = BTreeMap<String, String>;

/// Plays a scenario in plain SUMO. Returns the cars of each second, and what the lights showed.
fn seconds_of_plain_sumo(scenario: &Path, lights: &[String], seconds: u64, seed: u32) -> Vec<(Seen, Shown)> {
    let dir = tempfile::tempdir().unwrap();
    let [cars, states, more] = ["cars.xml", "states.xml", "more.add.xml"].map(|name| dir.path().join(name));
    let event =
        |light: &String| format!("<timedEvent type='SaveTLSStates' source='{light}' dest='{}'/>", states.display());
    fs::write(&more, format!("<additional>{}</additional>", lights.iter().map(event).collect::<String>())).unwrap();
    let status = Command::new(plain_sumo())
        .args([
            "--additional-files",
            more.to_str().unwrap(),
            "-c",
            scenario.to_str().unwrap(),
            "--fcd-output",
            cars.to_str().unwrap(),
            "--precision",
            "6",
        ])
        .args(["--no-step-log", "true", "--seed", &seed.to_string(), "--end", &seconds.to_string()])
        .status()
        .unwrap();
    assert!(status.success());
    let text = fs::read_to_string(cars).unwrap();
    let value = |line: &str, name: &str| {
        line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().to_owned()
    };
    let mut found: Vec<Seen> = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("<timestep ") {
            found.push(Seen::new());
        } else if line.starts_with("<vehicle ") {
            let number = |name: &str| value(line, name).parse::<f64>().unwrap();
            let seen = (value(line, "lane"), number("pos"), number("speed"));
            found.last_mut().unwrap().insert(value(line, "id"), seen);
        }
    }
    let mut shown = vec![Shown::new(); found.len()];
    let states = fs::read_to_string(states).unwrap_or_default();
    for line in states.lines().filter(|line| line.contains("<tlsState ")) {
        let second = value(line, "time").parse::<f64>().unwrap() as usize;
        shown[second].insert(value(line, "id"), value(line, "state"));
    }
    found.into_iter().zip(shown).collect()
}

/// Returns whether a car on a lane of the region has just come. `before`: its lane on the region a second ago. On a road
/// that begins outside it came from there, if it was not on this road.
fn comes(border: &BorderPlan, before: Option<&str>, lane: &str) -> bool {
    let Some(before) = before else { return true };
    let road = road_of(lane);
    let begins_outside = border.roads.iter().any(|other| other.begins_outside && Some(other.road.as_str()) == road);
    begins_outside && road_of(before) != road
}

/// Works out the sources of a border from the cars of each second, by other code than the product's: `[decisions]`.
fn expected_sources(border: &BorderPlan, seconds: &[(Seen, Shown)]) -> Vec<Vec<u8>> {
    let lane_numbers: BTreeMap<&str, usize> =
        border.lanes.iter().enumerate().map(|(number, lane)| (lane.lane.as_str(), number)).collect();
    let mut ever: BTreeSet<&String> = BTreeSet::new();
    let mut before: BTreeMap<&String, &str> = BTreeMap::new();
    let mut waiting = vec![0; border.entries.len()];
    let mut decisions = Vec::new();
    for decision in seconds.chunks_exact(border.decision_s) {
        let mut sources = vec![0; border.sources()];
        let mut blocked = vec![Vec::new(); border.exits.len()];
        for (second, (cars, shown)) in decision.iter().enumerate() {
            let here: BTreeMap<&String, &str> = cars
                .iter()
                .map(|(car, (lane, ..))| (car, lane.as_str()))
                .filter(|(_, lane)| lane_numbers.contains_key(lane))
                .collect();
            for (&car, &lane) in here.iter().filter(|(car, lane)| comes(border, before.get(*car).copied(), lane)) {
                let lane = &border.lanes[lane_numbers[lane]];
                let departed = !ever.contains(car);
                let entry = if departed { lane.departures } else { lane.entry };
                waiting[entry.unwrap_or_else(|| panic!("{car} came to {} from nowhere", lane.lane))] += 1;
            }
            ever.extend(cars.keys());
            before = here;
            for (entry, waiting) in waiting.iter_mut().enumerate().filter(|(_, waiting)| **waiting > 0) {
                *waiting -= 1;
                sources[border.arrival(entry, second)] = 1;
            }
            for (exit, blocked) in blocked.iter_mut().enumerate() {
                let lane = &border.lanes[border.exits[exit]];
                let on_it = cars.values().filter(|(other, ..)| *other == lane.lane);
                let first = on_it.max_by(|one, other| one.1.total_cmp(&other.1));
                let crawls = first.is_some_and(|(_, at, speed)| *speed < BLOCK_MPS && lane.length_m - at <= BLOCK_M);
                let signals = border.exit_signals(exit);
                let red = |&(light, letter): &(&str, usize)| "rRu".contains(shown[light].as_bytes()[letter] as char);
                blocked.push(crawls || (!signals.is_empty() && signals.iter().all(red)));
            }
        }
        for (exit, blocked) in blocked.into_iter().enumerate() {
            for (part, seconds) in blocked.chunks(2).enumerate() {
                sources[border.blocked(exit, part)] = u8::from(seconds.iter().any(|&is| is));
            }
        }
        decisions.push(sources);
    }
    decisions
}

#[test]
fn arrivals_and_blocked_exits_are_those_of_plain_sumo() {
    for name in ["town", "grid_4x4_turns"] {
        let traffic = opened(&shipped(name), 400);
        let seed = Seed::new(3).for_episode(0);
        let exits = |border: &Border| -> Vec<String> {
            let signals = (0..border.plan.exits.len()).flat_map(|exit| border.plan.exit_signals(exit));
            signals.map(|(light, _)| light.to_owned()).collect()
        };
        let lights: BTreeSet<String> = traffic.borders().iter().flat_map(exits).collect();
        let lights: Vec<String> = lights.into_iter().collect();
        let seconds = seconds_of_plain_sumo(&shipped(name), &lights, 400, seed.for_sumo());
        let mut gs = traffic.global(traffic.everywhere(HandCoded::OwnProgram)).unwrap();
        gs.observe_influence().unwrap();
        gs.reset(seed).unwrap();
        let actions = vec![0; traffic.agents()];
        let expected: Vec<Vec<Vec<u8>>> =
            traffic.borders().iter().map(|border| expected_sources(&border.plan, &seconds)).collect();
        let mut counts = [0; 2];
        for decision in 0..80 {
            gs.step(&actions).unwrap();
            let expected: Vec<&Vec<u8>> = expected.iter().map(|of_region| &of_region[decision]).collect();
            let sample = gs.influence_sample();
            for (row, Border { plan, .. }) in traffic.borders().iter().enumerate() {
                let (own, padding) = sample.sources.row(row).split_at(plan.sources());
                assert_eq!(own, expected[row], "{name}: {} in decision {decision}", traffic.plans()[row].light);
                assert!(padding.iter().all(|&bit| bit == 0));
                let (arrivals, blocked) = own.split_at(plan.blocked(0, 0));
                counts[0] += arrivals.iter().filter(|&&bit| bit == 1).count();
                counts[1] += blocked.iter().filter(|&&bit| bit == 1).count();
            }
        }
        assert!(counts[0] > 200 && counts[1] > 20, "{name}: {counts:?}");
    }
}

#[test]
fn observing_the_influence_changes_nothing_else_and_without_it_there_is_none() {
    let traffic = opened(&shipped("grid_4x4_turns"), 300);
    let play = |observed: bool| {
        let mut gs = traffic.global_simulator().unwrap();
        if observed {
            gs.observe_influence().unwrap();
        }
        let mut greens = RandomGreens::new();
        greens.begin(Seed::new(4));
        let mut percept = gs.reset(Seed::new(4)).unwrap().clone();
        let mut actions = vec![0; traffic.agents()];
        let (mut shown, mut d_sets, mut sources) = (Vec::new(), vec![percept.d_set.clone()], Vec::new());
        for _ in 0..60 {
            greens.act(&percept, &mut actions).unwrap();
            let transition = gs.step(&actions).unwrap();
            percept = transition.percept.clone();
            shown.push((percept.obs.clone(), percept.masks.clone(), transition.rewards.clone()));
            let sample = gs.influence_sample();
            assert!(sample.d_set == d_sets.last().unwrap(), "a sample has the d-set from before its step");
            sources.push(sample.sources.clone());
            d_sets.push(percept.d_set.clone());
        }
        (shown, d_sets, sources)
    };
    let (with, d_sets, sources) = play(true);
    let (without, no_d_sets, no_sources) = play(false);
    assert!(with == without);
    assert!(no_d_sets.iter().all(|d_set| d_set.as_slice().iter().all(|&x| x == 0.0)));
    assert!(no_sources.iter().all(|sources| sources.as_slice().iter().all(|&bit| bit == 0)));
    assert!(sources.iter().any(|sources| sources.as_slice().contains(&1)));
    for (row, Border { plan, d_set }) in traffic.borders().iter().enumerate() {
        let names = d_set.columns(plan);
        assert_eq!(names.len(), d_set.width(plan));
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "every column has a name of its own");
        for d_set in &d_sets {
            let (own, padding) = d_set.row(row).split_at(names.len());
            assert!(own.iter().all(|x| (0.0..=1.0).contains(x)) && padding.iter().all(|&x| x == 0.0));
        }
        // What happened in a decision stands in the d-set after it.
        let column = |name: String| names.iter().position(|other| *other == name).unwrap();
        for (exit, &lane) in plan.exits.iter().enumerate() {
            let blocked = column(format!("blocked {}", plan.lanes[lane].lane));
            for (after, sources) in d_sets[1..].iter().zip(&sources) {
                assert_eq!(after.row(row)[blocked], f32::from(sources.row(row)[plan.blocked(exit, 2)]));
            }
        }
        for entry in 0..plan.entries.len() {
            let arrivals = column(format!("arrivals {} in 5 s", plan.entry_name(entry)));
            for (after, sources) in d_sets[1..].iter().zip(&sources) {
                let own = &sources.row(row)[plan.arrival(entry, 0)..plan.arrival(entry, 5)];
                // A share of the 2.5 cars that 5 s have room for.
                let share = (own.iter().sum::<u8>() as f32 / 2.5).min(1.0);
                assert_eq!(after.row(row)[arrivals], share);
            }
        }
    }
}

#[test]
fn datasets_of_a_scenario_are_collected() {
    let config =
        ScenarioConfig { begin_s: Some(0), end_s: Some(1200), ..ScenarioConfig::new(shipped("grid_4x4_turns")) };
    let traffic = Traffic::open_scenario(&config).unwrap();
    let mut gs = traffic.global_simulator().unwrap();
    let mut datasets = Dataset::of_all(traffic.kinds());
    for episode in 0..2 {
        let seed = Seed::new(5).for_episode(episode);
        collect_episode(&mut *gs, &mut RandomGreens::new(), seed, &mut datasets).unwrap();
    }
    for (dataset, border) in datasets.iter().zip(traffic.borders()) {
        assert_eq!((dataset.len(), dataset.episodes(), dataset.own_sources), (480, 2, border.plan.sources()));
        assert!(dataset.sources.iter().all(|row| row[dataset.own_sources..].iter().all(|&u| u == 0)));
        assert!(dataset.sources.as_slice().contains(&1));
        let mut d_set = vec![0.0; dataset.d_sets.width()];
        // 1200 s are two parts of 600 s: 120 decisions each.
        for (sample, part) in [(0, 0), (119, 0), (120, 1), (239, 1), (240, 0)] {
            dataset.d_sets.read(sample, &mut d_set);
            assert_eq!((d_set[part], d_set[1 - part]), (1.0, 0.0), "sample {sample}");
        }
    }
}

/// Returns the road of a lane; `None` within an intersection.
fn road_of(lane: &str) -> Option<&str> {
    (!lane.starts_with(':')).then(|| lane.rsplit_once('_').unwrap().0)
}

#[test]
fn visits_are_those_of_plain_sumo_and_their_ways_are_driven() {
    let traffic = opened(&shipped("town"), 600);
    let seed = Seed::new(0).fork(RandomPurpose::Visits);
    let seconds: Vec<Seen> =
        seconds_of_plain_sumo(&shipped("town"), &[], 600, seed.for_sumo()).into_iter().map(|(cars, _)| cars).collect();
    let tables = traffic.visits().unwrap();
    let visits = tables.visits();
    assert_eq!((visits.seconds, visits.of_agents.len()), (600, 20));
    let (mut whole, mut departures, mut ends) = (0, 0, 0);
    for (Border { plan, .. }, of_agent) in traffic.borders().iter().zip(&visits.of_agents) {
        let lanes: BTreeSet<&str> = plan.lanes.iter().map(|lane| lane.lane.as_str()).collect();
        let on_region = |car: &String, second: usize| {
            seconds.get(second)?.get(car).filter(|(lane, ..)| lanes.contains(lane.as_str()))
        };
        let came = |car: &String, second: usize| {
            let before =
                second.checked_sub(1).and_then(|before| on_region(car, before)).map(|(lane, ..)| lane.as_str());
            on_region(car, second).is_some_and(|(lane, ..)| comes(plan, before, lane))
        };
        // Everybody who is there visits.
        let expected: usize = (0..600).map(|at| seconds[at].keys().filter(|car| came(car, at)).count()).sum();
        assert_eq!(of_agent.len(), expected);
        for visit in of_agent {
            let car = &visits.driver(visit).name;
            let (lane, position_m, speed_mps) = on_region(car, visit.second).unwrap();
            assert_eq!(*lane, plan.lanes[visit.lane].lane);
            assert!((position_m - visit.position_m).abs() < 1e-5 && (speed_mps - visit.speed_mps).abs() < 1e-5);
            let has_left = |&second: &usize| on_region(car, second).is_none() || came(car, second);
            let end = (visit.second + 1..600).find(has_left).unwrap_or(600);
            let seen: Vec<&str> =
                (visit.second..end).filter_map(|second| road_of(&on_region(car, second).unwrap().0)).collect();
            // The roads on which it is seen stand in its way, in this order.
            let mut way = visit.way.iter();
            let mut last = "";
            for road in seen.into_iter().filter(|road| std::mem::replace(&mut last, road) != *road) {
                assert!(way.any(|other| other == road), "{car} on {road}, but its way is {:?}", visit.way);
            }
            if end < 600 {
                let later = (end..600).find_map(|second| road_of(&seconds[second].get(car)?.0));
                assert!(
                    later.is_none() || later == visit.next_roads.first().map(String::as_str),
                    "{car}: {later:?}, {visit:?}"
                );
                whole += usize::from(later.is_some());
                ends += usize::from(visit.next_roads.is_empty());
            }
            departures += usize::from(visit.second == 0 || !seconds[visit.second - 1].contains_key(car));
        }
    }
    assert!(whole > 100 && departures > 50 && ends > 20, "{whole} {departures} {ends}");
    // They are recorded once, and drawn from.
    assert!(std::sync::Arc::ptr_eq(&tables, &traffic.visits().unwrap()));
    let mut dice = Seed::new(1).dice();
    let first = visits.of_agents[0].iter().find(|visit| !visit.way.is_empty()).unwrap();
    for _ in 0..20 {
        let drawn = tables.draw(0, first.entry.unwrap(), 599, &mut dice).unwrap();
        assert_eq!((drawn.entry, &drawn.way[0]), (first.entry, &first.way[0]));
    }
}
