//! Route files of which each episode plays one.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Beginning, Domain, GlobalSimulator};
use dials_learn::evaluation::{episode_seed, play};
use dials_traffic::Traffic;
use dials_traffic::config::ScenarioConfig;
use dials_traffic::scenario::SumoScenario;
use dials_traffic::sim::recording::Tape;
use dials_traffic::sim::replay;

use super::play::{dials_traffic, json};
use super::room::{BUSES, NET, Room, names, table};
use crate::plain_sumo;

const ROUTES: &str = "[traffic]\nscenario = 'x.sumocfg'\nroutes = ['day_*.rou.xml']\n";

/// Returns a file with this many cars, which depart from second 100 on. They are of a type of their own.
fn day(number: usize, cars: usize) -> String {
    let trips = (0..cars).map(|car| {
        let (from, to) = [("w0_r0c0", "r0c1_e0"), ("w1_r1c0", "r1c1_e1")][car % 2];
        format!("<trip id='{car}' type='kind_{number}' depart='{}' from='{from}' to='{to}'/>", 100 + 2 * car)
    });
    format!("<routes><vType id='kind_{number}' length='{number}'/>{}</routes>", trips.collect::<String>())
}

/// Makes a scenario with a config `c.toml`, whose three files have 10, 20 and 30 cars.
fn room() -> Room {
    let room = Room::new();
    (1..=3).for_each(|number| fs::write(room.path(&file(number)), day(number, 10 * number)).unwrap());
    fs::write(room.path("c.toml"), ROUTES).unwrap();
    room
}

fn file(number: usize) -> String {
    format!("day_{number}.rou.xml")
}

fn config(room: &Room, settings: &[&str]) -> ScenarioConfig {
    let settings: Vec<String> = settings.iter().map(|&setting| setting.to_owned()).collect();
    table(dials_session::config::load(&room.path("c.toml"), &settings).unwrap())
}

fn read(room: &Room) -> SumoScenario {
    SumoScenario::read(&config(room, &[])).unwrap()
}

/// Returns why the scenario is refused, with `DIR/` for the folder.
fn error(room: &Room) -> String {
    let loaded = dials_session::config::load(&room.path("c.toml"), &[]);
    let error = loaded.and_then(|config| SumoScenario::read(&table(config))).expect_err("it is refused");
    format!("{error:#}").replace(&format!("{}/", room.dir.path().display()), "DIR/")
}

fn number_of(path: &Path) -> usize {
    path.file_name().unwrap().to_str().unwrap()["day_".len()..][..1].parse().unwrap()
}

fn departed(gs: &mut dyn GlobalSimulator, traffic: &Traffic, episode: Seed) -> usize {
    gs.reset(episode).unwrap();
    (0..traffic.kinds().horizon()).for_each(|_| drop(gs.step(&vec![0; traffic.agents()]).unwrap().rewards.clone()));
    let measures = gs.measures().unwrap();
    measures.system.iter().find(|(name, _)| name == "departed").unwrap().1 as usize
}

#[test]
fn each_episode_plays_the_file_that_its_seed_draws_whoever_runs_the_lights() {
    let room = room();
    let traffic = Traffic::open_scenario(&config(&room, &[])).unwrap();
    let episodes: Vec<Seed> = (0..9).map(|episode| episode_seed(Seed::new(1), episode)).collect();
    let drawn: Vec<usize> = episodes.iter().map(|&seed| number_of(&traffic.route_file_of(seed).unwrap())).collect();
    assert_eq!(drawn.iter().copied().collect::<BTreeSet<_>>(), BTreeSet::from([1, 2, 3]), "{drawn:?}");
    let expected: Vec<usize> = drawn.iter().map(|number| 10 * number).collect();
    let mut gs = traffic.global_simulator().unwrap();
    let by_agents: Vec<usize> = episodes.iter().map(|&seed| departed(&mut *gs, &traffic, seed)).collect();
    drop(gs);
    assert_eq!(by_agents, expected);
    // In another order, under another controller, and measured in full.
    let mut baseline = traffic.baseline("actuated").unwrap();
    baseline.simulator.measure_in_full().unwrap();
    for (&seed, &cars) in episodes.iter().zip(&expected).rev().take(4) {
        assert_eq!(departed(&mut *baseline.simulator, &traffic, seed), cars);
    }
}

#[test]
fn a_note_says_that_the_other_files_are_not_played_and_what_is_odd_in_many_files_is_said_once() {
    let room = room();
    for number in 1..=3 {
        let early = format!("<trip id='early' depart='{number}' from='w0_r0c0' to='r0c1_e0'/>");
        let text = day(number, 10).replacen("<trip", &format!("{early}<trip"), 1);
        fs::write(room.path(&file(number)), text).unwrap();
    }
    let scenario = read(&room);
    let notes = &scenario.notes().left_out;
    assert_eq!(notes.iter().filter(|note| note.contains("each episode plays one of 3 files")).count(), 1, "{notes:?}");
    let odd: Vec<&String> = notes.iter().filter(|note| note.contains("depart before 100 s")).collect();
    assert!(odd.len() == 1 && odd[0].contains("day_1") && odd[0].ends_with("(and 2 like it)"), "{notes:?}");
    assert!(!notes.iter().any(|note| note.contains(BUSES)), "{notes:?}");
}

#[test]
fn a_copy_holds_all_files_and_draws_the_same_ones() {
    let room = room();
    fs::write(room.path("overrides.toml"), "# nothing yet\n").unwrap();
    let original = ScenarioConfig { agents: Some(room.path("overrides.toml")), ..config(&room, &[]) };
    let scenario = SumoScenario::read(&original).unwrap();
    let kept = scenario.keep_in(&room.path("run")).unwrap();
    assert_eq!(kept, ["scenario.sumocfg", "agents.toml", "scenario.1.*.rou.xml.gz"].map(PathBuf::from));
    let gz = |number: usize| format!("scenario.1.0000{number}.rou.xml.gz");
    let expected =
        ["agents.toml", &gz(0), &gz(1), &gz(2), "scenario.1.add.xml", "scenario.net.xml", "scenario.sumocfg"];
    assert_eq!(names(&room.path("run")), expected);
    let [sumocfg, agents, routes] = [0, 1, 2].map(|place| room.path("run").join(&kept[place]));
    let copied = ScenarioConfig { scenario: sumocfg, agents: Some(agents), routes: vec![routes], ..original.clone() };
    let copy = SumoScenario::read(&copied).unwrap();
    assert_eq!(copy.checksum(), scenario.checksum());
    copy.keep_in(&room.path("again")).unwrap();
    for name in expected {
        let [first, second] = ["run", "again"].map(|dir| fs::read(room.path(dir).join(name)).unwrap());
        assert!(first == second, "{name} of a copy of a copy differs");
    }
    let [traffic, again] = [&original, &copied].map(|config| Traffic::open_scenario(config).unwrap());
    for episode in 0..20 {
        let seed = Seed::new(2).for_episode(episode);
        let drawn = number_of(&traffic.route_file_of(seed).unwrap());
        assert!(again.route_file_of(seed).unwrap().ends_with(gz(drawn - 1)), "{drawn}");
    }
}

#[test]
fn the_checksum_changes_with_each_file() {
    let checksum = read(&room()).checksum();
    assert_eq!(checksum, read(&room()).checksum());
    for number in 1..=3 {
        let other = room();
        other.change(&file(number), "depart='104'", "depart='105'");
        assert_ne!(read(&other).checksum(), checksum, "{number}");
    }
    let fewer = room();
    fs::remove_file(fewer.path(&file(3))).unwrap();
    assert_ne!(read(&fewer).checksum(), checksum);
    // What is not played does not count.
    let others = room();
    others.change(BUSES, "120", "130");
    assert_eq!(read(&others).checksum(), checksum);
}

#[test]
fn each_file_is_checked_before_the_first_episode() {
    for (from, to, told) in [
        ("<routes>", "<routes", "DIR/day_2.rou.xml: "),
        ("depart='100'", "depart='nan'", "DIR/day_2.rou.xml: "),
        (
            "<vType id='kind_2' length='2'/>",
            "<vType id='kind_1' length='2'/><vType id='kind_2' length='2'/>",
            "DIR/day_2.rou.xml: its vehicle type `kind_1` is another one than in DIR/day_1.rou.xml; rename one of the two",
        ),
    ] {
        let room = room();
        room.change(&file(2), from, to);
        assert!(error(&room).starts_with(told), "{to}: {}", error(&room));
    }
    let nobody = room();
    fs::write(nobody.path(&file(3)), day(3, 9).replace("depart='1", "depart='9")).unwrap();
    assert!(error(&nobody).starts_with("DIR/day_3.rou.xml: DIR/x.sumocfg: no vehicle departs from 100 to 400 s"));
    let net = room();
    fs::copy(net.path(NET), net.path("day_4.rou.xml")).unwrap();
    assert!(error(&net).starts_with("DIR/day_4.rou.xml: is a net, and traffic.routes names route files"));
    fs::remove_file(net.path("day_4.rou.xml")).unwrap();
    fs::write(net.path("c.toml"), ROUTES.replace("day_", "night_")).unwrap();
    assert_eq!(error(&net), "traffic.routes: DIR/night_*.rou.xml: there is no such file; correct the path");
    // Only SUMO knows which edges there are.
    let edge = room();
    edge.change(&file(2), "to='r0c1_e0'", "to='nowhere'");
    let refused = format!("{:#}", Traffic::open_scenario(&config(&edge, &[])).unwrap().try_out().unwrap_err());
    assert!(
        refused.contains("nowhere") && refused.contains(&format!("-r {}", edge.path(&file(2)).display())),
        "{refused}"
    );
}

#[test]
fn a_file_that_changes_later_is_refused_by_its_name() {
    let room = room();
    let traffic = Traffic::open_scenario(&config(&room, &[])).unwrap();
    let mut gs = traffic.global_simulator().unwrap();
    (1..=3).for_each(|number| room.change(&file(number), "depart='104'", "depart='105'"));
    let seeds = (0..9).map(|episode| Seed::new(1).for_episode(episode));
    let refused = seeds.filter_map(|seed| gs.reset(seed).err().map(|error| error.to_string()));
    let refused: Vec<String> = refused.collect();
    assert!(!refused.is_empty() && refused.iter().all(|error| error.contains(".rou.xml: has changed")), "{refused:?}");
}

#[test]
fn local_simulators_know_the_cars_of_several_files() {
    let room = room();
    let traffic = Traffic::open_scenario(&config(&room, &[])).unwrap();
    let visits = traffic.visits().unwrap();
    let drivers: BTreeSet<String> = visits
        .visits()
        .of_agents
        .iter()
        .flatten()
        .map(|visit| format!("{:?}", visits.visits().driver(visit)))
        .filter_map(|driver| Some(driver.split("kind_").nth(1)?[..1].to_owned()))
        .collect();
    assert_eq!(drivers.into_iter().collect::<String>(), "123");
    let mut ls = traffic.local_simulator(&[AgentId(0)], 2, Seed::new(5)).unwrap();
    let begin: Vec<Beginning> = (0..2).map(|row| Beginning { row, episode: 0 }).collect();
    ls.reset(&begin).unwrap();
}

#[test]
fn a_replay_has_the_file_that_was_played() {
    let room = room();
    let traffic = Traffic::open_scenario(&config(&room, &[])).unwrap();
    for number in 1..=3 {
        let is_drawn = |seed: &Seed| number_of(&traffic.route_file_of(*seed).unwrap()) == number;
        let seed = (0..).map(|run| episode_seed(Seed::new(run), 0)).find(is_drawn).unwrap();
        let tape = Tape::default();
        let recorded = traffic.clone().record_on(&tape);
        let mut baseline = recorded.baseline("max-pressure").unwrap();
        play(&mut *baseline.simulator, &mut *baseline.controller, seed).unwrap();
        drop(baseline);
        let recording = tape.take().unwrap();
        let folder = room.path(&format!("replay_{number}"));
        fs::create_dir(&folder).unwrap();
        replay::write(&recording, &folder).unwrap();
        replay::check(&recording, &folder).unwrap();
        let [kept, played] =
            [folder.join("replay.1.rou.xml"), room.path(&file(number))].map(|path| fs::read(path).unwrap());
        assert!(kept == played, "{number}");
    }
}

#[test]
fn the_command_of_a_plan_plays_the_file_of_the_first_episode() {
    let room = room();
    let command = ["plan", "c.toml", "--controller", "webster", "--episodes", "3", "--out", "plan", "--json"];
    let assert = dials_traffic().current_dir(room.dir.path()).args(command).assert().success();
    let found = json(&assert.get_output().stdout);
    let traffic = Traffic::open_scenario(&config(&room, &[])).unwrap();
    for episode in 0..3 {
        let routes = found["episodes_of_plan"][episode]["routes"].as_str().unwrap();
        let drawn = traffic.route_file_of(episode_seed(Seed::new(found["seed"].as_u64().unwrap()), episode)).unwrap();
        assert_eq!(number_of(Path::new(routes)), number_of(&drawn));
    }
    let check = found["check_command"].as_str().unwrap().strip_prefix("sumo ").unwrap().to_owned();
    let typed = format!("'{}' {check} --no-step-log --no-warnings", plain_sumo().display());
    assert!(
        std::process::Command::new("sh").args(["-c", &typed]).current_dir(room.dir.path()).status().unwrap().success()
    );
    let trips = fs::read_to_string(room.path("trips.xml")).unwrap();
    let number = |line: &str, name: &str| -> f64 {
        line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
    };
    let lost = trips.lines().filter(|line| line.contains("<tripinfo "));
    let lost: Vec<f64> = lost.map(|line| number(line, "timeLoss") + number(line, "departDelay")).collect();
    let first = number_of(Path::new(found["episodes_of_plan"][0]["routes"].as_str().unwrap()));
    assert_eq!(lost.len(), 10 * first);
    let printed = found["episodes_of_plan"][0]["delay_s"].as_f64().unwrap();
    let plain = lost.iter().sum::<f64>() / lost.len() as f64;
    assert!((plain - printed).abs() < 1e-9, "{printed} s, but {plain} s by plain SUMO");
}

#[test]
fn closed_edges_and_calm_cars_go_with_files_that_are_drawn() {
    let room = room();
    let closed = SumoScenario::read(&config(&room, &["traffic.closed=['w1_r1c0']"])).unwrap();
    // Every other car begins on that edge: 5 of 10, 10 of 20, 15 of 30.
    let note = "closed w1_r1c0: of 60 vehicles in the files 0 get another route; 30 cannot get to their destination";
    assert!(closed.notes().left_out.iter().any(|left| left.contains(note)), "{:?}", closed.notes().left_out);
    let traffic = Traffic::open_scenario(&config(&room, &["traffic.closed=['w1_r1c0']"])).unwrap();
    let seed = Seed::new(1).for_episode(0);
    let drawn = number_of(&traffic.route_file_of(seed).unwrap());
    assert_eq!(departed(&mut *traffic.global_simulator().unwrap(), &traffic, seed), 5 * drawn);

    let scenario = read(&room);
    assert!(scenario.dawdles());
    let calm = scenario.dawdling(0.0).unwrap();
    assert!(!calm.dawdles() && calm.notes() == read(&room).notes());
    let traffic = Traffic::open_dawdling(&config(&room, &[]), 0.0).unwrap();
    assert_eq!(departed(&mut *traffic.global_simulator().unwrap(), &traffic, seed), 10 * drawn);
}

#[test]
fn without_the_key_nothing_is_drawn() {
    let room = room();
    let plain = Traffic::open_scenario(&table(room.config(&[]).unwrap())).unwrap();
    assert_eq!(plain.route_file_of(Seed::new(1)), None);
    assert!(!dials_session::config::to_toml(&room.config(&[]).unwrap()).unwrap().contains("routes"));
}
