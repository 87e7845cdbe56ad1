//! Replays and pictures of scenarios: several lanes, turns, types, cars that draw numbers at random.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{Action, Beginning, Domain};
use dials_learn::evaluation::{episode_seed, play};
use dials_session::config::load;
use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::config::{ScenarioConfig, TrafficTable};
use dials_traffic::sim::recording::{Recording, Tape};
use dials_traffic::sim::replay;
use rand::Rng;

use super::fcd::{assert_same, sumo_plays};
use super::{dials_traffic, text};

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("sumo_nets/{name}/{name}.sumocfg"))
}

/// Writes a scenario on the grid with turns: trips that SUMO routes, three types, and flows of every sort. It begins at
/// second 100.
fn write_mixed(dir: &Path) -> PathBuf {
    let net = shipped("grid_4x4_turns").with_file_name("grid_4x4_turns.net.xml");
    let routes = r#"<routes>
    <vType id="car" sigma="0.7" speedDev="0.1"/>
    <vType id="bus" vClass="bus" length="12" sigma="0.5" lcStrategic="2"/>
    <vTypeDistribution id="mixed"><vType id="fast" sigma="0.3" speedFactor="1.2" probability="0.5"/>
        <vType id="lorry" vClass="truck" length="9" accel="1.1" probability="0.5"/></vTypeDistribution>
    <trip id="early" type="car" depart="90" from="w0_x0y0" to="x3y3_n3"/>
    <flow id="likely" type="mixed" begin="100" end="390" probability="0.4" from="w1_x0y1" to="x2y3_n2"/>
    <flow id="spread" type="bus" number="40" from="w2_x0y2" to="x3y0_e0" departLane="best" departSpeed="max"/>
    <trip id="t" type="car" depart="110" from="w0_x0y0" to="x3y3_n3"/>
    <flow id="often" type="mixed" begin="120" period="exp(0.3)" from="w3_x0y3" to="x3y1_e1" departLane="random"/>
    <vehicle id="v" depart="130"><route edges="w0_x0y0 x0y0_x1y0 x1y0_x2y0"/></vehicle>
</routes>"#;
    fs::write(dir.join("mixed.rou.xml"), routes).unwrap();
    let sumocfg = format!(
        "<configuration><net-file value='{}'/><route-files value='mixed.rou.xml'/><begin value='100'/><end value='400'/>\
         </configuration>",
        net.display()
    );
    fs::write(dir.join("mixed.sumocfg"), sumocfg).unwrap();
    dir.join("mixed.sumocfg")
}

fn open(config: &ScenarioConfig, tape: &Tape) -> Traffic {
    Traffic::open_scenario(config).unwrap().record_on(tape)
}

/// Records an episode in which all agents act at random.
fn at_random(config: &ScenarioConfig, seed: u64) -> Recording {
    let tape = Tape::default();
    let traffic = open(config, &tape);
    let mut gs = traffic.global_simulator().unwrap();
    gs.reset(Seed::new(seed)).unwrap();
    let mut dice = Seed::new(seed).dice();
    for _ in 0..traffic.kinds().horizon() {
        let actions: Vec<Action> =
            traffic.plans().iter().map(|plan| dice.random_range(0..plan.phases.actions()) as Action).collect();
        gs.step(&actions).unwrap();
    }
    drop(gs);
    tape.take().unwrap()
}

fn types(recording: &Recording) -> BTreeSet<&str> {
    recording.entries.iter().map(|entry| entry.car.vehicle_type.as_str()).collect()
}

#[test]
fn plain_sumo_plays_random_greens_on_a_scenario_as_the_episode_was() {
    for (name, decision_s) in [("town", 5), ("grid_4x4_turns", 7)] {
        let dir = tempfile::tempdir().unwrap();
        let config =
            ScenarioConfig { begin_s: Some(0), end_s: Some(400), decision_s, ..ScenarioConfig::new(shipped(name)) };
        let recording = at_random(&config, 3);
        assert_eq!(recording.steps.len(), 400 / decision_s as usize * decision_s as usize);
        assert!(types(&recording).len() >= 2, "{name}: {:?}", types(&recording));
        replay::write(&recording, dir.path()).unwrap();
        replay::check(&recording, dir.path()).unwrap();
        assert!(assert_same(dir.path(), &recording) > 10_000, "{name}");
        // Another seed is another episode: the cars do draw numbers.
        let sumocfg = fs::read_to_string(dir.path().join("replay.sumocfg")).unwrap();
        let seed = format!("<seed value=\"{}\"/>", recording.seed);
        assert!(sumocfg.contains(&seed), "{sumocfg}");
        fs::write(dir.path().join("replay.sumocfg"), sumocfg.replace(&seed, "<seed value=\"1\"/>")).unwrap();
        let error = replay::check(&recording, dir.path()).unwrap_err().to_string();
        assert!(error.contains("of the replay differently from the recording, so it is not kept"), "{error}");
    }
}

/// Records an episode of the local simulator of an agent, in which it acts at random and one source in eight happens.
fn locally_at_random(config: &ScenarioConfig, agent: usize, seed: u64) -> Recording {
    let tape = Tape::default();
    let traffic = open(config, &tape);
    let mut ls = traffic.local_simulator(&[AgentId(agent)], 2, Seed::new(seed)).unwrap();
    ls.reset(&Beginning::first(0..2)).unwrap();
    let (actions, sources) = (traffic.plans()[agent].phases.actions(), ls.spec().sources.count());
    let mut dice = Seed::new(seed).dice();
    for _ in 0..config.local_horizon {
        let actions = [(); 2].map(|()| dice.random_range(0..actions) as Action);
        let happens = (0..2 * sources).map(|_| u8::from(dice.random_bool(0.125))).collect();
        ls.step(&actions, &Rows::from_vec(happens, sources)).unwrap();
    }
    drop(ls);
    tape.take().unwrap()
}

#[test]
fn plain_sumo_plays_a_local_simulator_as_the_episode_was_though_cars_dawdle() {
    for (name, agent, light) in [("town", 7, None), ("grid_4x4_turns", 5, Some("x1y1"))] {
        let dir = tempfile::tempdir().unwrap();
        let whole = ScenarioConfig::new(shipped(name));
        let config = ScenarioConfig { begin_s: Some(0), end_s: Some(900), local_horizon: 60, ..whole };
        let recording = locally_at_random(&config, agent, 3);
        assert_eq!(recording.steps.len(), 300);
        assert!(recording.entries.len() > 100, "{name}: {} cars", recording.entries.len());
        assert!(light.is_none_or(|light| recording.roads.lights[0] == light), "{:?}", recording.roads.lights);
        replay::write(&recording, dir.path()).unwrap();
        replay::check(&recording, dir.path()).unwrap();
        assert!(assert_same(dir.path(), &recording) > 3000, "{name}");
        // Another seed is another episode: the cars do draw numbers.
        let path = dir.path().join("replay.sumocfg");
        let sumocfg = fs::read_to_string(&path).unwrap();
        let seed = format!("<seed value=\"{}\"/>", recording.seed);
        assert!(sumocfg.contains(&seed), "{sumocfg}");
        fs::write(&path, sumocfg.replace(&seed, "<seed value=\"1\"/>")).unwrap();
        let error = replay::check(&recording, dir.path()).unwrap_err().to_string();
        assert!(error.contains("of the replay differently from the recording, so it is not kept"), "{error}");
    }
}

#[test]
fn trips_types_and_flows_of_every_sort_are_replayed_whenever_the_episode_ends() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = write_mixed(dir.path());
    // 42 decisions of 7 s end 6 s before the scenario does, and a flow is spread over the whole of it.
    let config = ScenarioConfig { decision_s: 7, ..ScenarioConfig::of_file(&scenario).unwrap() };
    let recording = at_random(&config, 4);
    assert_eq!((recording.roads.begin_s(), recording.steps.len()), (100, 294));
    assert_eq!(types(&recording).into_iter().collect::<Vec<_>>(), ["DEFAULT_VEHTYPE", "bus", "car", "fast", "lorry"]);
    let folder = dir.path().join("replay");
    replay::write(&recording, &folder).unwrap();
    replay::check(&recording, &folder).unwrap();
    assert!(assert_same(&folder, &recording) > 3000);

    // A replay is a scenario, too. Its lights have programs of the names that replays give.
    let again = ScenarioConfig { decision_s: 1, ..ScenarioConfig::of_file(&folder.join("replay.sumocfg")).unwrap() };
    let second = at_random(&again, 5);
    let other = dir.path().join("again");
    replay::write(&second, &other).unwrap();
    let signals = fs::read_to_string(other.join("replay.signals.add.xml")).unwrap();
    assert!(signals.contains("programID=\"recorded_2\" offset=\"100\""), "{signals}");
    replay::check(&second, &other).unwrap();
    assert!(assert_same(&other, &second) > 3000);
}

#[test]
fn a_program_that_sumo_takes_in_a_net_only_is_replayed_from_the_net() {
    let dir = tempfile::tempdir().unwrap();
    let net = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/grid_2x2.net.xml");
    // Cars from north and east have green at the same time, and each must let the other one pass.
    let mut text = fs::read_to_string(net).unwrap();
    for (from, to) in [
        (r#"<request index="0" response="0000" foes="1010""#, r#"<request index="0" response="0010" foes="1010""#),
        (r#"<phase duration="10" state="GrGr"/>"#, r#"<phase duration="10" state="ggGr"/>"#),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    fs::write(dir.path().join("own.net.xml"), text).unwrap();
    let routes =
        r#"<routes><flow id="f" begin="0" end="100" period="9"><route edges="w0_r0c0 r0c0_r0c1"/></flow></routes>"#;
    fs::write(dir.path().join("own.rou.xml"), routes).unwrap();
    let sumocfg = "<configuration><net-file value='own.net.xml'/><route-files value='own.rou.xml'/><begin value='0'/>\
                   <end value='100'/></configuration>";
    fs::write(dir.path().join("own.sumocfg"), sumocfg).unwrap();
    let recording = at_random(&ScenarioConfig::of_file(&dir.path().join("own.sumocfg")).unwrap(), 3);
    let folder = dir.path().join("replay");
    replay::write(&recording, &folder).unwrap();
    replay::check(&recording, &folder).unwrap();
    let [net, signals] =
        ["replay.net.xml", "replay.signals.add.xml"].map(|name| fs::read_to_string(folder.join(name)).unwrap());
    assert_eq!(net.matches("programID=\"recorded\"").count(), 1);
    assert_eq!(signals.matches("<tlLogic ").count(), 3);
}

#[test]
fn lights_that_do_not_learn_run_their_own_program_in_a_replay() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("agents.toml"), "learn = [\"x1y1\", \"x2y2\"]\n").unwrap();
    let config = ScenarioConfig {
        agents: Some(dir.path().join("agents.toml")),
        end_s: Some(200),
        ..ScenarioConfig::of_file(&shipped("grid_4x4_turns")).unwrap()
    };
    let recording = at_random(&config, 6);
    assert_eq!(recording.roads.lights.len(), 16);
    let folder = dir.path().join("replay");
    replay::write(&recording, &folder).unwrap();
    replay::check(&recording, &folder).unwrap();
    assert!(assert_same(&folder, &recording) > 1000);
    let signals = fs::read_to_string(folder.join("replay.signals.add.xml")).unwrap();
    assert_eq!(signals.matches("<tlLogic ").count(), 2);
}

#[test]
fn the_command_replays_controllers_and_runs_on_a_scenario_from_any_folder() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = write_mixed(dir.path());
    let table = ScenarioConfig::of_file(&scenario).unwrap();
    for controller in ["max-pressure", "program", "actuated"] {
        let folder = dir.path().join(controller);
        let args =
            ["replay", text(&scenario), "--controller", controller, "--out", text(&folder), "--episode-seed", "11"];
        dials_traffic(args).assert().success();
        let elsewhere = dir.path().join(format!("{controller}-moved"));
        fs::rename(&folder, &elsewhere).unwrap();
        let tape = Tape::default();
        let mut baseline = open(&table, &tape).baseline(controller).unwrap();
        play(&mut *baseline.simulator, &mut *baseline.controller, episode_seed(Seed::new(11), 0)).unwrap();
        drop(baseline);
        assert!(assert_same(&elsewhere, &tape.take().unwrap()) > 3000, "{controller}");
    }
    // A run directory holds its scenario, so the folder of the user may go.
    let run = dir.path().join("run");
    let settings = ["total_steps=60", "ppo.rollout_steps=60", "ppo.memory=60", "ppo.minibatch=20", "policy.hidden=[8]"];
    let args = ["train", text(&scenario), "--simulator", "gs", "--workers", "0", "--out", text(&run)];
    let settings = settings.into_iter().chain(["evaluation.episodes=1", "evaluation.final_episodes=1"]);
    dials_traffic(args.into_iter().chain(settings.flat_map(|setting| ["--set", setting]))).assert().success();
    fs::remove_file(&scenario).unwrap();
    let folder = dir.path().join("trained");
    dials_traffic(["replay", text(&run), "--out", text(&folder)]).assert().success();
    let played = sumo_plays(&folder);
    assert_eq!(played.len(), 300);
    let Some(DomainConfig::Traffic(TrafficTable::Scenario(table))) =
        load(&run.join("config.toml"), &[]).unwrap().domain
    else {
        panic!()
    };
    assert!(table.scenario.starts_with(&run));
    assert!(played.iter().map(BTreeSet::len).sum::<usize>() > 3000);
    let out = dir.path().join("local");
    let local = ["replay", text(&run), "--local", "0", "--out", text(&out)];
    let output = dials_traffic(local).assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("was trained on the GS and has no AIPs, so its local simulators cannot be played"), "{said}");
}

#[test]
fn pictures_of_a_scenario_show_its_roads_and_the_route_that_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = write_mixed(dir.path());
    let draw = |folder: &Path, more: &[&str]| {
        let args =
            ["baseline", text(&scenario), "--controller", "program", "--seed", "11", "--episodes", "1", "--plot"];
        dials_traffic(args.into_iter().chain([text(folder)]).chain(more.iter().copied())).assert()
    };
    let folder = dir.path().join("plots");
    draw(&folder, &["--route", "w0_x0y0,x0y0_x1y0,x1y0_x2y0"]).success();
    let picture = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let space_time = picture("space_time.svg");
    assert!(space_time.contains("Space and time: a route of 3 edges, from w0_x0y0 to x1y0_x2y0"), "{space_time}");
    let light = |name: &str| space_time.contains(&format!(">\n{name}\n"));
    assert!(light("x0y0") && light("x1y0") && !light("x2y0"));
    let returns = picture("returns.svg");
    assert!(returns.contains("Return per agent on scenario mixed") && returns.contains(">\n100 m\n"), "{returns}");
    let signals = picture("signals.svg");
    assert!(signals.contains("the 16 intersections of scenario mixed") && signals.contains(">\ngreen 3\n"));

    // The queues are those that plain SUMO has on the approaches.
    let replayed = dir.path().join("replay");
    let args = ["replay", text(&scenario), "--controller", "program", "--out", text(&replayed), "--episode-seed", "11"];
    dials_traffic(args).assert().success();
    let traffic = Traffic::open_scenario(&ScenarioConfig::of_file(&scenario).unwrap()).unwrap();
    let approaches = traffic.plans().iter().flat_map(|plan| &plan.region.approaches);
    // Approaches from the west lead to the light of the next column.
    let from_the_west = |lane: &str| {
        let ends = lane.rsplit_once('_').unwrap().0.split_once('_').unwrap();
        ends.0.starts_with('w') || ends.0 != ends.1 && ends.0[..2] < ends.1[..2] && ends.0[2..] == ends.1[2..]
    };
    let west: BTreeSet<&str> =
        approaches.map(|approach| approach.lane.as_str()).filter(|lane| from_the_west(lane)).collect();
    assert!(west.len() >= 2 * 16, "{west:?}");
    let stands = |place: &str| place.split(' ').nth(1).unwrap().parse::<f64>().unwrap() < 0.1;
    let played = sumo_plays(&replayed);
    let standing = played.iter().flatten().filter(|(_, lane, place)| west.contains(lane.as_str()) && stands(place));
    // 300 s and 16 lights.
    let words = format!("from the west: {:.2} cars on average", standing.count() as f64 / 4800.0);
    assert!(picture("queues.svg").contains(&words), "{words}");

    // A part of the episode has axes of its own, and only what happened then.
    let part = dir.path().join("part");
    draw(&part, &["--seconds", "200,230"]).success();
    let of_part = |name: &str| fs::read_to_string(part.join(name)).unwrap();
    for name in ["space_time.svg", "signals.svg", "queues.svg"] {
        let svg = of_part(name);
        assert!(svg.contains(">\n210\n") && !svg.contains(">\n190\n") && !svg.contains(">\n240\n"), "{name}");
    }
    let standing = played[200..230].iter().flatten();
    let standing = standing.filter(|(_, lane, place)| west.contains(lane.as_str()) && stands(place));
    let words = format!("from the west: {:.2} cars on average", standing.count() as f64 / 480.0);
    assert!(of_part("queues.svg").contains(&words), "{words}");
    assert_eq!(of_part("returns.svg"), fs::read_to_string(folder.join("returns.svg")).unwrap());

    // Without a route, the one on which lights meet the most cars is drawn.
    let unasked = dir.path().join("unasked");
    draw(&unasked, &[]).success();
    let space_time = fs::read_to_string(unasked.join("space_time.svg")).unwrap();
    let (_, title) = space_time.split_once("Space and time: a route of ").expect("a title");
    assert!(title.split(' ').next().unwrap().parse::<usize>().unwrap() >= 7, "{}", &title[..60]);

    let refused = |route: &str, told: &str| {
        let output = draw(&dir.path().join("none"), &["--route", route]).code(2).get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.starts_with("error: --route") && said.contains(told), "{said}");
    };
    refused("w0_x0y0,nowhere", "the net has no edge `nowhere`; sumo-gui shows the names of edges");
    refused("w0_x0y0,x1y0_x2y0", "edge `x1y0_x2y0` does not follow `w0_x0y0`; these do: x0y0_s0, x0y0_x0y1, x0y0_x1y0");
    refused("w0_x0y0,w0_x0y0", "names edge `w0_x0y0` twice; a picture can show each edge once");
    refused("x0y0_s0 w0_x0y0", "no edge follows `x0y0_s0`, so `w0_x0y0` cannot; end the route there");
    for (seconds, told) in [
        ("200,301", "--seconds 200,301: an episode has the seconds 0 to 300; end there"),
        ("30,30", "must begin before it ends, such as 600,1200"),
        ("30", "must be two seconds, such as 600,1200"),
    ] {
        let output = draw(&dir.path().join("none"), &["--seconds", seconds]).code(2).get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(told), "{said}");
    }
    refused(",", "names no edge; name edges that follow each other, separated by commas");
    let grid = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke_traffic.toml");
    let out = dir.path().join("grid");
    let args = ["baseline", text(&grid), "--controller", "never", "--plot", text(&out), "--route", "a"];
    let output = dials_traffic(args).assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("only a scenario has routes to choose from"), "{said}");
    assert!(!dir.path().join("none").exists() && !out.exists());
}
