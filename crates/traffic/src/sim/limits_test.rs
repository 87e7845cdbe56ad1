//! Limits of lights in SUMO itself: what it shows at a junction with people on foot, second by second.

use std::fs;
use std::path::Path;

use rand::Rng;
use tempfile::TempDir;

use super::control::SignalControl;
use crate::Traffic;
use crate::agents::derive::overrides::Overrides;
use crate::agents::derive::{Rules, derive};
use crate::config::{Actions, ScenarioConfig};
use crate::controllers::recipe;
use crate::light_limits_test::{CROSSING, crossing_roads};
use crate::watchdog::Watchdog;
use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Action, GlobalSimulator};

const LIMITS: &str = "[light.A0]\nmax_green_s = 40\nmax_red_s = 90\n";

/// Writes the scenario of the junction: cars from all sides, and people on two crossings.
fn scenario(dir: &Path) -> ScenarioConfig {
    let write = |name: &str, text: &str| fs::write(dir.join(name), text).unwrap();
    write("j.net.xml", CROSSING);
    let flow = |from: &str, to: &str, rate: f64| {
        format!("<flow id='{from}{to}' from='{from}0A0' to='A0{to}0' begin='0' end='2000' probability='{rate}'/>")
    };
    let cars = [("left", "right", 0.15), ("right", "left", 0.1), ("top", "bottom", 0.1), ("top", "right", 0.05)];
    let cars: String = cars.iter().map(|&(from, to, rate)| flow(from, to, rate)).collect();
    let people =
        "<personFlow id='p' begin='0' end='2000' period='20'><personTrip from='left0A0' to='A0top0'/></personFlow>
        <personFlow id='q' begin='0' end='2000' period='25'><personTrip from='bottom0A0' to='A0right0'/></personFlow>";
    write("j.rou.xml", &format!("<routes>{cars}{people}</routes>"));
    let files = "<net-file value='j.net.xml'/><route-files value='j.rou.xml'/><begin value='0'/><end value='2000'/>";
    write("j.sumocfg", &format!("<configuration>{files}</configuration>"));
    write("agents.toml", LIMITS);
    let agents = Some(dir.join("agents.toml"));
    ScenarioConfig { agents, decision_s: 1, ..ScenarioConfig::of_file(&dir.join("j.sumocfg")).unwrap() }
}

/// Plays under a control, with random actions that are allowed, and watches what SUMO shows. Returns the watchdog.
fn watched(config: &ScenarioConfig, control: impl Fn(&Traffic) -> SignalControl, seconds: usize) -> Watchdog {
    let traffic = Traffic::open_scenario(config).unwrap();
    let roads = crossing_roads();
    let rules = Rules::of(config);
    let derived = derive(&roads, &rules, &Overrides::parse(LIMITS).unwrap()).unwrap();
    let mut watchdog = Watchdog::new(&roads, &derived.agents[0]);
    let mut gs = traffic.global(control(&traffic)).unwrap();
    let mut dice = Seed::new(3).dice();
    let mut masks: Vec<bool> = gs.reset(Seed::new(5).for_episode(0)).unwrap().masks.row(0).to_vec();
    for second in 0..seconds {
        let allowed: Vec<usize> = (0..masks.len()).filter(|&action| masks[action]).collect();
        let action = allowed[dice.random_range(0..allowed.len())] as Action;
        masks = gs.step(&[action]).unwrap().percept.masks.row(0).to_vec();
        let state = gs.states().unwrap().remove(0);
        watchdog.see(&state).unwrap_or_else(|why| panic!("second {second}: {why}"));
    }
    watchdog
}

#[test]
fn sumo_shows_what_the_limits_say_under_agents_and_rules() {
    let dir = TempDir::new().unwrap();
    let config = scenario(dir.path());
    for actions in [Actions::Greens, Actions::FixedOrder, Actions::RingBarrier] {
        let config = ScenarioConfig { actions, ..config.clone() };
        let seen = watched(&config, |_| SignalControl::Agents, 1500);
        assert!(seen.changes > 60, "{actions:?}: {} changes", seen.changes);
    }
    for name in
        ["random", "max-pressure", "gap-out", "longest-queue", "fixed-time", "webster:episodes=1", "never", "always"]
    {
        let rule = |traffic: &Traffic| {
            let by = recipe(name, traffic.plans()).unwrap()(traffic).unwrap();
            SignalControl::HandCoded { by, agents: vec![AgentId(0)] }
        };
        let seen = watched(&config, rule, 600);
        // Even a rule that never changes anything must.
        assert!(seen.changes >= 10, "{name}: {} changes", seen.changes);
    }
}
