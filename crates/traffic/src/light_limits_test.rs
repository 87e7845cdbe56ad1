//! Random actions, and no rule is broken: a million seconds of the lights of the shipped scenarios and of a junction with crossings.

use std::path::Path;

use rand::Rng;

use crate::agents::derive::overrides::Overrides;
use crate::agents::derive::{Agent, Derived, Rules, derive};
use crate::agents::phase_plan::{Choice, Interval, PhasePlan};
use crate::config::Actions;
use crate::light::Signal;
use crate::network::roads::Roads;
use crate::network::tree::parse;
use crate::watchdog::Watchdog;
use dials_core::base::{Dice, Seed};
use dials_core::domain::Action;
use libsumo::SignalState;

/// A junction of four arms with lanes for left turns, and a crossing over each arm. Made with netgenerate.
pub(crate) const CROSSING: &str = include_str!("agents/derive/crossing.net.xml");

pub(crate) fn crossing_roads() -> Roads {
    Roads::read(&parse(CROSSING).unwrap()).unwrap()
}

fn networks() -> Vec<(&'static str, Roads)> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sumo_nets");
    let of_file = |name: &'static str, path: &str| (name, Roads::of_file(&shipped.join(path)).unwrap());
    vec![
        of_file("town", "town/town.net.xml"),
        of_file("grid_4x4_turns", "grid_4x4_turns/grid_4x4_turns.net.xml"),
        of_file("arterial", "arterial/arterial.net.xml"),
        of_file("busy_road", "busy_road/grid_3x3.net.xml"),
        ("crossing", crossing_roads()),
    ]
}

fn derived(roads: &Roads, actions: Actions, overrides: &str) -> anyhow::Result<Derived> {
    derive(roads, &Rules { actions, ..Rules::default() }, &Overrides::parse(overrides).unwrap())
}

/// Returns a file of overrides with the tightest longest red that each light can keep, and a longest green.
fn tight(roads: &Roads, actions: Actions) -> String {
    let lights = derived(roads, actions, "").unwrap().agents;
    let of_light = |Agent { plan, .. }: &Agent| {
        let greens = 0..plan.phases.greens().len();
        let longest = greens.map(|green| plan.phases.least_longest(green)).max().unwrap() + 3;
        let phases = PhasePlan::clone(&plan.phases).with_max_greens(vec![Some(longest); plan.phases.greens().len()]);
        let letters: Vec<usize> =
            roads.of_light(&plan.light).filter_map(|link| Some(link.signal.as_ref()?.letter)).collect();
        let fits = |most: u32| {
            let limits: Vec<(usize, u32)> = letters.iter().map(|&letter| (letter, most)).collect();
            phases.clone().with_red_limits(&limits).map_err(|short| short.needed_steps)
        };
        let mut most = 1;
        while let Err(needed) = fits(most) {
            assert!(needed > most, "an error names more seconds than there were");
            most = needed;
        }
        assert!(fits(most - 1).is_err(), "one second less is too short");
        format!("[light.\"{}\"]\nmax_red_s = {most}\nmax_green_s = {longest}\n", plan.light)
    };
    lights.iter().map(of_light).collect()
}

/// Plays random actions. `masked`: only those that are allowed, every 5 seconds as agents do; or anything every second.
fn play(roads: &Roads, agent: &Agent, seconds: usize, masked: bool, dice: &mut Dice) -> Watchdog {
    let plan = &*agent.plan.phases;
    let (mut signal, mut watchdog) = (Signal::at_the_beginning(plan), Watchdog::new(roads, agent));
    let mut action: Action = 0;
    for second in 0..seconds {
        if masked && second % 5 == 0 {
            let allowed = |&action: &usize| signal.allows(plan, plan.asked_for(signal.shown(), action as Action));
            let allowed: Vec<usize> = (0..plan.actions()).filter(allowed).collect();
            assert!(!allowed.is_empty(), "{}: some action is allowed", agent.plan.light);
            action = allowed[dice.random_range(0..allowed.len())] as Action;
            let asked = plan.asked_for(signal.shown(), action);
            let before = signal.clone();
            signal.act(plan, action);
            let target = signal.shown().target();
            assert_eq!(target, asked, "{}: an allowed action is done: {before:?}", agent.plan.light);
        } else {
            if !masked && dice.random_bool(0.3) {
                // One action more than there are.
                action = dice.random_range(0..=plan.actions()) as Action;
            }
            signal.act(plan, action);
        }
        let seen = watchdog.see(signal.state(plan));
        seen.unwrap_or_else(|why| panic!("light {}, second {second}: {why}", agent.plan.light));
    }
    watchdog
}

#[test]
fn a_million_seconds_of_random_actions_break_no_rule() {
    let mut dice = Seed::new(7).dice();
    let (mut seconds, mut changes, mut at_limit, mut limited) = (0, 0, 0, 0);
    for (name, roads) in networks() {
        for actions in [Actions::Greens, Actions::FixedOrder, Actions::RingBarrier] {
            // Not every light of these nets has rings.
            if derived(&roads, actions, "").is_err() {
                assert!(actions == Actions::RingBarrier && !["crossing", "grid_4x4_turns"].contains(&name), "{name}");
                continue;
            }
            for overrides in [String::new(), tight(&roads, actions)] {
                for agent in &derived(&roads, actions, &overrides).unwrap().agents {
                    for masked in [true, false] {
                        let seen = play(&roads, agent, 3000, masked, &mut dice);
                        (seconds, changes) = (seconds + seen.seconds, changes + seen.changes);
                        let most = agent.plan.phases.max_red_steps().map(|(_, most)| most).max();
                        limited += usize::from(most.is_some());
                        at_limit += usize::from(most == Some(seen.longest_red_s));
                    }
                }
            }
        }
    }
    assert!(seconds >= 1_000_000, "{seconds} seconds");
    assert!(changes > 50_000, "{changes} changes");
    assert!(at_limit > limited / 2, "the limits bind: {at_limit} of {limited}");
}

/// Makes a light of random greens, with random limits that it can keep. Returns its longest red, too.
fn random_light(dice: &mut Dice) -> (PhasePlan, u32) {
    let state = |letters: &str| SignalState::new(letters).unwrap();
    let letters = dice.random_range(4..9);
    // The last letters are crossings.
    let cars = letters - dice.random_range(0..3);
    let mut greens: Vec<String> = Vec::new();
    let count = dice.random_range(2..8);
    while greens.len() < count {
        let green: String = (0..letters).map(|_| ['r', 'r', 'G', 'g'][dice.random_range(0..4)]).collect();
        if green[..cars].contains(['G', 'g']) && !greens.iter().any(|known| known[..cars] == green[..cars]) {
            greens.push(green);
        }
    }
    let [walk_end, yellow, all_red] = [0..8, 1..5, 0..3].map(|range| dice.random_range(range));
    let clearing = |from: usize, to: usize| {
        let shown = |instead: Option<char>| -> String {
            let letters = greens[from].chars().zip(greens[to].chars()).enumerate();
            let shown = |(letter, (old, new)): (usize, (char, char))| match instead {
                _ if old == 'r' || new != 'r' => old,
                instead => {
                    if letter < cars {
                        instead.unwrap_or(old)
                    } else {
                        'r'
                    }
                }
            };
            letters.map(shown).collect()
        };
        let between = [(shown(None), walk_end), (shown(Some('y')), yellow), (shown(Some('r')), all_red)];
        let between = between.iter().filter(|(letters, steps)| *steps > 0 && *letters != greens[from]);
        between.map(|(letters, steps)| Interval { state: state(letters), steps: *steps }).collect()
    };
    let choice = if dice.random() { Choice::Target } else { Choice::InOrder };
    let plan = PhasePlan::new(greens.iter().map(|green| state(green)).collect(), choice, 1, clearing);
    let plan = plan.for_cars((0..cars).collect());
    let longest = |from: usize| (0..count).map(|to| plan.walk_end_steps(from, to)).max().unwrap_or(0);
    let least: Vec<u32> = (0..count).map(|green| longest(green) + dice.random_range(1..20)).collect();
    let plan = plan.with_min_greens(least);
    let most = |green| dice.random::<bool>().then(|| plan.least_longest(green) + dice.random_range(0..10));
    let most = (0..count).map(most).collect();
    let plan = plan.with_max_greens(most);
    let mut red = 1;
    let limits = |red: u32| (0..letters).map(|letter| (letter, red)).collect::<Vec<_>>();
    while let Err(short) = plan.clone().with_red_limits(&limits(red)) {
        red = short.needed_steps;
    }
    red += [0, 0, 5, 40][dice.random_range(0..4)];
    (plan.with_red_limits(&limits(red)).unwrap(), red)
}

#[test]
fn lights_of_random_greens_keep_their_limits_and_have_some_action_at_any_time() {
    let mut dice = Seed::new(11).dice();
    for case in 0..400 {
        let (plan, most) = random_light(&mut dice);
        let mut signal = Signal::at_the_beginning(&plan);
        let letters = plan.greens()[0].links();
        let (mut red, mut steps) = (vec![0; letters], plan.min_green_steps()[0]);
        for second in 0..500 {
            let before = signal.shown();
            let allowed = |&action: &usize| signal.allows(&plan, plan.asked_for(before, action as Action));
            let allowed: Vec<usize> = (0..plan.actions()).filter(allowed).collect();
            assert!(!allowed.is_empty(), "case {case}, second {second}: nothing is allowed");
            let any = dice.random_range(0..plan.actions());
            let action = if dice.random() { allowed[dice.random_range(0..allowed.len())] } else { any };
            signal.act(&plan, action as Action);
            let lasted = steps;
            steps = if signal.shown() == before { steps + 1 } else { 1 };
            if let Some(green) = before.green().filter(|_| signal.shown() != before) {
                let least = plan.min_green_steps()[green];
                let lasted = lasted + plan.walk_end_steps(green, signal.shown().target());
                let longest = plan.max_green_steps()[green];
                // An episode begins with a green of its least length.
                let is_first = second == 0;
                assert!(
                    is_first || longest.is_none_or(|most| lasted <= most),
                    "case {case}, second {second}: green {green}"
                );
                assert!(lasted >= least, "case {case}, second {second}: green {green} lasted {lasted} s of {least}");
            }
            if let Some(green) = signal.shown().green() {
                let longest = plan.max_green_steps()[green];
                assert!(longest.is_none_or(|most| steps <= most), "case {case}, second {second}: green {green}");
            }
            for (letter, red) in red.iter_mut().enumerate() {
                let opens = |state: &SignalState| matches!(state.as_str().as_bytes()[letter], b'G' | b'g');
                *red = if opens(signal.state(&plan)) { 0 } else { *red + 1 };
                let is_limited = plan.greens().iter().any(opens);
                assert!(
                    !is_limited || *red <= most,
                    "case {case}, second {second}: letter {letter}: {red} s of {most}"
                );
            }
        }
    }
}

#[test]
fn the_watchdog_finds_what_it_looks_for() {
    let roads = crossing_roads();
    let file = "[light.A0]\nmax_green_s = 20\nmax_red_s = 80\n";
    let derived = derived(&roads, Actions::Greens, file).unwrap();
    let agent = &derived.agents[0];
    let plan = &*agent.plan.phases;
    let states = |from: usize, to: usize| plan.clearing(from, to).to_vec();
    let found = |shown: &[(&str, u32)]| {
        let mut watchdog = Watchdog::new(&roads, agent);
        let all = shown.iter().flat_map(|(state, steps)| vec![SignalState::new(*state).unwrap(); *steps as usize]);
        all.map(|state| watchdog.see(&state)).find_map(Result::err).unwrap_or_default()
    };
    let greens: Vec<&str> = plan.greens().iter().map(|green| green.as_str()).collect();
    let change = states(0, 2);
    let [walk_end, yellow] = [0, 1].map(|place: usize| change[place].state.as_str());
    assert!(found(&[(greens[0], 21)]).contains("longer than its longest"));
    assert!(found(&[(greens[0], 15), (walk_end, 6)]).contains("longer than its longest"));
    assert!(found(&[(greens[0], 16), (greens[2], 1)]).contains("without yellow"));
    assert!(found(&[(greens[0], 10), (walk_end, 6), (yellow, 2), (greens[2], 1)]).contains("was yellow for 2 s of 3"));
    let people = found(&[(greens[0], 11), (walk_end, 5), (yellow, 3), (greens[2], 1)]);
    assert!(people.contains("after the walk on"), "{people}");
    let still = [(greens[0], 10), (walk_end, 6), (yellow, 3), (greens[2], 5)];
    let short = found(&[&still[..], &[(&greens[2].replace(['G', 'g'], "y"), 1)]].concat());
    assert!(short.contains("lasted 5 s, and 16 are the least"), "{short}");
    assert!(found(&[("GGGGGGGGGGGGrrrr", 1)]).contains("have G at once"));
    assert!(found(&[("rrrrrrrrrrrrrrrr", 81)]).contains("is red for more than 80 s"));
}
