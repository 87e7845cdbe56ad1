//! Hand-coded controllers on the GS (global simulator): their lights keep their times, they can be mixed with policies,
//! and a user can add one.

use std::path::Path;

use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{Action, Baseline, Beginning, Domain, GlobalSimulator, LocalSimulator};
use dials_traffic::Traffic;
use dials_traffic::agents::phases::Light;
use dials_traffic::config::{EntryRule, TrafficConfig};
use dials_traffic::controllers::{Each, HandCoded, Intersection, Intersections, LightController};
use dials_traffic::light::{KEEP, SWITCH};
use dials_traffic::side::Side;

fn traffic() -> Traffic {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config =
        TrafficConfig { entry: EntryRule::Max, ..TrafficConfig::new(nets.join("grid_2x2"), nets.join("local")) };
    Traffic::open(&config).unwrap()
}

/// Returns what the light of an observation shows.
fn light(obs: &[f32]) -> Light {
    Light::ALL[obs[36..].iter().position(|&bit| bit == 1.0).unwrap()]
}

/// Returns what the lights show in the steps of an episode in which all agents take this action, light by light.
fn shown(gs: &mut dyn GlobalSimulator, action: Action) -> Vec<Vec<Light>> {
    let mut shown = vec![Vec::new(); 4];
    gs.reset(Seed::new(4).for_episode(0)).unwrap();
    for _ in 0..300 {
        let transition = gs.step(&[action; 4]).unwrap();
        shown.iter_mut().zip(transition.percept.obs.iter()).for_each(|(shown, obs)| shown.push(light(obs)));
    }
    shown
}

fn shown_by(name: &str) -> Vec<Vec<Light>> {
    let Baseline { mut simulator, .. } = traffic().baseline(name).unwrap();
    shown(&mut *simulator, KEEP)
}

/// Returns for how many steps each state was shown, without the last one, which the end of the episode cuts off.
fn runs(shown: &[Light]) -> Vec<(Light, usize)> {
    let mut runs: Vec<(Light, usize)> =
        shown.chunk_by(|one, other| one == other).map(|run| (run[0], run.len())).collect();
    runs.pop();
    runs
}

#[test]
fn fixed_time_shows_what_it_promises_from_the_offset_on() {
    let cycle = [
        (Light::VerticalGreen, 12),
        (Light::VerticalYellow, 3),
        (Light::HorizontalGreen, 8),
        (Light::HorizontalYellow, 3),
    ];
    for (agent, shown) in shown_by("fixed-time:vertical=12,horizontal=8,offsets=0-5-13-20").into_iter().enumerate() {
        // At the beginning, lights 0 and 5 steps late are in vertical green (or in the yellow before it, which is not
        // shown). The one 13 late is at step 13 of its cycle, and the one 20 late at step 6.
        let offset = [0, 5, 13, 20][agent];
        for (step, &shown) in shown.iter().enumerate().skip(26) {
            let mut place = (step + 26 - offset) % 26;
            let expected = cycle.iter().find(|&&(_, steps)| {
                let here = place < steps;
                place = place.wrapping_sub(steps);
                here
            });
            assert_eq!(shown, expected.unwrap().0, "agent {agent}, step {step}");
        }
    }
}

#[test]
fn the_clock_of_fixed_time_begins_with_every_episode() {
    let Baseline { mut simulator, .. } = traffic().baseline("fixed-time:green=7,offsets=checkerboard").unwrap();
    let first = shown(&mut *simulator, KEEP);
    assert_eq!(shown(&mut *simulator, KEEP), first);
}

#[test]
fn no_green_is_shorter_than_the_minimum_and_yellow_takes_three_steps() {
    for (name, least) in [("max-pressure", 10), ("max-pressure:min-green=4", 4), ("longest-queue:min-green=7", 7)] {
        for shown in shown_by(name) {
            let runs = runs(&shown);
            assert!(runs.len() > 10, "{name}: {runs:?}");
            for &(light, steps) in &runs {
                assert!(if light.is_green() { steps >= least } else { steps == 3 }, "{name}: {runs:?}");
            }
            assert!(runs.iter().any(|&(_, steps)| steps == least), "{name} keeps green for longer: {runs:?}");
        }
    }
}

#[test]
fn websters_greens_fit_the_flows_of_the_grid() {
    // 0.1 cars per second and edge against 1580 per hour give a ratio of 0.228 per phase. C = 14 / (1 - 0.456) = 25.7,
    // with greens of 9.9. A few percent fewer cars enter or arrive in time, and the busiest of two edges has a few
    // percent more.
    for shown in shown_by("webster") {
        let greens = runs(&shown).into_iter().skip(1).filter(|(light, _)| light.is_green());
        let greens: Vec<usize> = greens.map(|(_, steps)| steps).collect();
        assert!(greens.iter().all(|steps| (8..=12).contains(steps)), "{greens:?}");
    }
}

/// Checks Webster's saturation flow, 1580 cars per hour, for our vehicle type.
#[test]
fn a_standing_queue_lets_a_car_past_the_line_every_2_28_seconds() {
    let mut ls = traffic().local(1).unwrap();
    ls.reset(&Beginning::first([0])).unwrap();
    // West has red until its edge is full.
    let step = |ls: &mut dials_traffic::sim::local::LocalTraffic, action, arrives| {
        ls.step(&[action], &Rows::from_vec(vec![arrives, 0, 0, 0], 4)).unwrap();
        ls.cars_on(0).lane(0).len()
    };
    let mut waiting = 0;
    (0..120).for_each(|_| waiting = step(&mut ls, KEEP, 1));
    assert_eq!(waiting, 13, "100 m hold 13 cars of 7.5 m");
    step(&mut ls, SWITCH, 0);
    let mut passed_at = Vec::new();
    for second in 1..60 {
        let left = step(&mut ls, KEEP, 0);
        passed_at.extend(std::iter::repeat_n(second, waiting - left));
        waiting = left;
    }
    // From the fourth to the twelfth car: 8 headways, measured in whole seconds.
    let seconds = passed_at[11] - passed_at[3];
    assert!((f64::from(seconds) - 8.0 * 2.28).abs() <= 1.0, "{passed_at:?}");
}

#[test]
fn a_background_runs_its_lights_and_leaves_the_others_to_the_actions() {
    let domain = traffic();
    let alone = |agents: &[usize], name: &str, action| {
        let agents: Vec<AgentId> = agents.iter().copied().map(AgentId).collect();
        shown(&mut *domain.with_background(name, &agents).unwrap(), action)
    };
    let never = |shown: &[Light]| shown.iter().all(|&light| light == Light::VerticalGreen);
    let always =
        |shown: &[Light]| runs(shown).iter().all(|&(light, steps)| steps == if light.is_green() { 1 } else { 3 });
    let mixed = alone(&[1, 2], "never", SWITCH);
    assert_eq!([0, 1, 2, 3].map(|agent| never(&mixed[agent])), [false, true, true, false]);
    assert!(always(&mixed[0]) && always(&mixed[3]));
    let mixed = alone(&[1, 2], "always", KEEP);
    assert_eq!([0, 1, 2, 3].map(|agent| never(&mixed[agent])), [true, false, false, true]);

    // The net's own program: 10 s of green.
    let mixed = alone(&[1, 2], "program", SWITCH);
    for agent in [1, 2] {
        let runs = runs(&mixed[agent]);
        assert!(runs.len() > 10 && runs.iter().all(|&(light, steps)| steps == if light.is_green() { 10 } else { 3 }));
    }
    assert!(always(&mixed[0]) && always(&mixed[3]));

    // SUMO's actuated program too: its shortest greens are 8 s.
    let mixed = alone(&[1, 2], "actuated", SWITCH);
    for agent in [1, 2] {
        let runs = runs(&mixed[agent]);
        assert!(runs.len() > 10 && runs.iter().all(|&(light, steps)| steps >= if light.is_green() { 8 } else { 3 }));
    }
    assert!(always(&mixed[0]) && always(&mixed[3]));
}

/// A rule for one intersection, as a user would write it: green for the road to the east and the west while a car stands
/// on the approach from the east, else for the other road.
fn let_the_east_go(at: &Intersection<'_>) -> usize {
    let wanted = usize::from(at.queue(Side::East.index()) > 0);
    if at.shown_steps() >= 3 { wanted } else { at.target() }
}

/// A rule for all intersections, with a memory, as a user would write it.
struct OneAfterTheOther {
    step: usize,
}

impl LightController for OneAfterTheOther {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        for intersection in intersections.iter() {
            let agent = intersection.agent().0;
            if self.step % 40 == 10 * agent {
                targets[agent] = intersection.next(targets[agent]);
            }
        }
        self.step += 1;
    }
}

#[test]
fn a_user_can_hand_over_a_controller_of_his_own() {
    let domain = traffic();
    let mut gs = domain.global(domain.everywhere(HandCoded::rule(Each(let_the_east_go)))).unwrap();
    for shown in shown(&mut gs, KEEP) {
        let runs = runs(&shown);
        assert!(runs.len() > 10 && runs.iter().all(|&(_, steps)| steps >= 3), "{runs:?}");
    }
    gs.hand_over(domain.everywhere(HandCoded::rule(OneAfterTheOther { step: 0 })));
    for (agent, shown) in shown(&mut gs, KEEP).into_iter().enumerate() {
        let begins = |yellow| shown.iter().position(|&light| light == yellow);
        assert_eq!(begins(Light::VerticalYellow), Some(10 * agent));
        assert_eq!(begins(Light::HorizontalYellow), Some(10 * agent + 40));
    }
}
