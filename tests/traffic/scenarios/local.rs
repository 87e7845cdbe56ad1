//! The local simulators of a scenario: each row is bit-identical to itself, whatever is simulated beside it and before.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{Action, Beginning, Domain, LocalSimulator};
use dials_testkit::conformance;
use dials_traffic::Traffic;
use dials_traffic::config::ScenarioConfig;
use rand::Rng;

use super::play::shipped;
use super::room::{CARS, NET, Room, SUMOCFG, table};

const COPIES: usize = 2;
const STEPS: usize = 40;

/// Returns the first ten minutes of a shipped scenario. Episodes of its local simulators are half as long.
fn ten_minutes(name: &str) -> Traffic {
    Traffic::open_scenario(&ten_minutes_of(name)).unwrap()
}

fn ten_minutes_of(name: &str) -> ScenarioConfig {
    let whole = ScenarioConfig::new(shipped(name));
    ScenarioConfig { begin_s: Some(0), end_s: Some(600), local_horizon: 60, ..whole }
}

fn load(traffic: &Traffic, regions: &[usize]) -> Box<dyn LocalSimulator> {
    let regions: Vec<AgentId> = regions.iter().map(|&agent| AgentId(agent)).collect();
    traffic.local_simulator(&regions, COPIES, Seed::new(5)).unwrap()
}

/// Everything that a row shows in a step, as bits.
type Shown = Vec<u32>;

/// Plays an episode of every row. In each row, one source in eight happens, and half of the decisions ask for a random
/// green. They follow from the agent and the episode. Returns what each row shows, step after step.
fn play(ls: &mut dyn LocalSimulator, regions: &[usize], episode: u64, steps: usize) -> Vec<Vec<Shown>> {
    let begin: Vec<Beginning> = (0..ls.rows()).map(|row| Beginning { row, episode }).collect();
    ls.reset(&begin).unwrap();
    let (actions, sources) = (ls.spec().n_actions, ls.spec().sources.count());
    let agents = regions.iter().flat_map(|&agent| [agent; COPIES]);
    let of_row = |agent| Seed::new(9).for_agent(AgentId(agent)).for_episode(episode as usize).dice();
    let mut dice: Vec<_> = agents.map(of_row).collect();
    let mut shown = vec![Vec::new(); ls.rows()];
    let mut chosen = vec![0; ls.rows()];
    for _ in 0..steps {
        let mut happens = Rows::new(0, sources);
        for (row, dice) in dice.iter_mut().enumerate() {
            if dice.random_bool(0.5) {
                chosen[row] = dice.random_range(0..actions) as Action;
            }
            happens.push(&(0..sources).map(|_| u8::from(dice.random_bool(0.125))).collect::<Vec<_>>());
        }
        let transition = ls.step(&chosen, &happens).unwrap();
        for (row, shown) in shown.iter_mut().enumerate() {
            let percept = &transition.percept;
            let numbers = percept.obs.row(row).iter().chain(percept.d_set.row(row)).chain([&transition.rewards[row]]);
            shown.push(numbers.map(|number| number.to_bits()).collect());
        }
    }
    shown
}

#[test]
fn a_row_is_bit_identical_alone_in_company_and_after_other_episodes_where_cars_dawdle() {
    let traffic = ten_minutes("town");
    let regions = [2, 7, 11, 4, 13];
    let mut ls = load(&traffic, &regions);
    let together = play(&mut *ls, &regions, 0, STEPS);
    let counted = ls.counters();
    assert!(counted[0].1 > 1000 && counted[1].1 > 10, "many cars come, and some have to wait: {counted:?}");
    assert!(together[0] != together[1], "two copies draw numbers of their own");
    let other = play(&mut *ls, &regions, 1, STEPS / 2);
    assert!(other[0] != together[0][..STEPS / 2], "another episode is another one");
    assert!(play(&mut *ls, &regions, 0, STEPS) == together, "after other episodes");
    drop(ls);
    for (place, region) in regions.iter().enumerate() {
        let alone = play(&mut *load(&traffic, &[*region]), &[*region], 0, STEPS);
        assert!(alone == together[place * COPIES..][..COPIES], "region {region}: alone and in company");
    }
    let others = [13, 0, 2];
    let elsewhere = play(&mut *load(&traffic, &others), &others, 0, STEPS);
    assert!(elsewhere[..COPIES] == together[4 * COPIES..], "at another place of the forest");
    assert!(elsewhere[2 * COPIES..] == together[..COPIES], "behind another region");
}

#[test]
fn a_row_is_reset_to_the_bit_while_the_others_go_on() {
    let traffic = ten_minutes("grid_4x4_turns");
    let regions = [5, 6];
    let mut ls = load(&traffic, &regions);
    let fresh = play(&mut *ls, &regions, 3, STEPS);
    // Jams with red exits, then the same episode again.
    let (actions, all) =
        (vec![0; 4], Rows::from_vec(vec![1; 4 * ls.spec().sources.count()], ls.spec().sources.count()));
    for step in 0..STEPS {
        ls.step(&actions, &all).unwrap();
        if step % 7 == 0 {
            ls.reset(&[Beginning { row: step % 4, episode: step as u64 }]).unwrap();
        }
    }
    assert!(play(&mut *ls, &regions, 3, STEPS) == fresh);
}

#[test]
fn a_row_is_bit_identical_in_company_of_cars_that_have_no_way_on() {
    let room = Room::new();
    // On roads that are hardly longer than two cars, SUMO's decision who may enter depends on how it looks at the room.
    for border in ["s0", "w0"] {
        let net = fs::read_to_string(room.path(NET)).unwrap();
        let lane = format!(r#"<lane id="{border}_r0c0_0""#);
        let line = net.lines().find(|line| line.contains(&lane)).expect("a road of the net");
        room.change(NET, line, &line.replace(r#"length="100.00""#, r#"length="12.80""#));
    }
    // Nobody can turn at the lights.
    let demand = r#"<routes>
        <flow id="a" begin="100" end="400" period="4" departSpeed="max" from="s0_r0c0" to="r1c0_n0"/>
        <flow id="b" begin="100" end="400" period="4" departSpeed="max" from="w0_r0c0" to="r0c1_e0"/>
        <trip id="c" depart="390" from="e1_r1c1" to="r1c1_n1"/>
        <trip id="d" depart="395" from="e0_r0c1" to="r0c1_r1c1"/>
    </routes>"#;
    fs::write(room.path(CARS), demand).unwrap();
    room.change(SUMOCFG, "<processing>", r#"<processing><ignore-route-errors value="true"/>"#);
    let traffic = Traffic::open_scenario(&table(room.config(&["traffic.local_horizon=60"]).unwrap())).unwrap();
    let alone = play(&mut *load(&traffic, &[0]), &[0], 0, STEPS);
    let regions = [0, 1, 3];
    let mut ls = load(&traffic, &regions);
    for episode in [1, 0, 0] {
        let together = play(&mut *ls, &regions, episode, STEPS);
        assert!(episode == 1 || together[..COPIES] == alone, "episode {episode}");
    }
}

#[test]
fn a_worker_takes_the_recording_of_the_coordinator_and_plays_none_itself() {
    let [coordinator, worker] = [(); 2].map(|()| ten_minutes("town"));
    let prepared = coordinator.prepare(None).unwrap().expect("the local simulators of a scenario need a recording");
    // While a simulator is loaded, no episode can be recorded.
    let gs = worker.global_simulator().unwrap();
    worker.take_prepared(&prepared).unwrap();
    drop(gs);
    let [taken, recorded] = [&worker, &coordinator].map(|traffic| traffic.visits().unwrap());
    assert!(taken.visits() == recorded.visits());
    // A driver that visits several regions is sent once.
    let visits = || recorded.visits().of_agents.iter().flatten();
    let again = |driver: usize| visits().filter(|visit| visit.driver == driver).count();
    let often = visits().find(|visit| again(visit.driver) > 2).expect("cars pass several lights");
    let sent = postcard::to_stdvec(recorded.visits().driver(often)).unwrap();
    assert_eq!(prepared.windows(sent.len()).filter(|bytes| *bytes == sent).count(), 1);
    assert!(worker.take_prepared(&prepared[..prepared.len() / 2]).is_err(), "half of it");
    assert!(ten_minutes("grid_4x4_turns").take_prepared(&prepared).is_err(), "of another scenario");
    let farther = ScenarioConfig { approach_m: 70.0, ..ten_minutes_of("town") };
    let farther = Traffic::open_scenario(&farther).unwrap();
    assert!(farther.take_prepared(&prepared).is_err(), "of other regions");
    let again = farther.prepare(Some(&prepared)).unwrap().unwrap();
    assert!(again != prepared && farther.prepare(Some(&again)).unwrap().unwrap() == again);
}

#[test]
fn scenarios_have_the_properties_of_a_domain() {
    for name in ["town", "grid_4x4_turns"] {
        let likeness = conformance::check(&ten_minutes(name), Seed::new(3)).unwrap();
        // The windows of the local simulators begin at other seconds than the episode of the global one, and empty.
        assert!(likeness.recall > 0.1 && likeness.precision > 0.1, "{name}: {likeness:?}");
    }
}

#[test]
fn an_arrival_that_no_car_may_make_is_dropped_and_counted() {
    let room = Room::new();
    // Bicycles depart on a track of their own, and no bus drives on the bus lane.
    for (lane, class) in [("w0_r0c0_0", "bicycle"), ("r0c1_r1c1_0", "bus")] {
        let lane = format!(r#"<lane id="{lane}" index="0""#);
        room.change(NET, &lane, &format!(r#"{lane} allow="{class}""#));
    }
    let demand = r#"<routes>
        <vType id="bike" vClass="bicycle"/>
        <flow id="b" type="bike" begin="100" end="400" period="10"><route edges="w0_r0c0 r0c0_r0c1 r0c1_e0"/></flow>
        <flow id="c" type="car" begin="100" end="400" period="4"><route edges="e0_r0c1 r0c1_r0c0 r0c0_w0"/></flow>
    </routes>"#;
    fs::write(room.path(CARS), demand).unwrap();
    let traffic = Traffic::open_scenario(&table(room.config(&[]).unwrap())).unwrap();
    let names: Vec<String> = traffic.borders().iter().flat_map(|border| border.plan.source_names()).collect();
    let has = |name: &str| names.iter().any(|other| other == name);
    assert!(has("arrival departures on e0_r0c1[0]") && has("arrival r0c1_r1c1_0[0]"), "{names:?}");
    assert!(!has("arrival departures on w0_r0c0[0]"), "nobody is seen there");
    let all = AgentId::all(traffic.agents());
    let mut ls = traffic.local_simulator(&all, 1, Seed::new(5)).unwrap();
    ls.reset(&Beginning::first(0..all.len())).unwrap();
    let sources = ls.spec().sources.count();
    for _ in 0..10 {
        ls.step(&vec![0; all.len()], &Rows::from_vec(vec![1; all.len() * sources], sources)).unwrap();
    }
    let counted = ls.counters();
    let count = |name: &str| counted.iter().find(|(other, _)| *other == name).unwrap().1;
    // One in each of 50 seconds, on the bus lane alone.
    assert_eq!(count("dropped_arrivals"), 50, "{counted:?}");
    assert!(count("sampled_arrivals") > 100, "{counted:?}");
}

#[test]
fn a_car_that_waits_for_room_arrives_when_it_gets_in() {
    let traffic = ten_minutes("grid_4x4_turns");
    let border = &traffic.borders()[5];
    let columns = border.d_set.columns(&border.plan);
    let window = |column: &&String| column.starts_with("arrivals ") && column.ends_with(" in 60 s");
    let arrived: Vec<usize> = (0..columns.len()).filter(|&column| window(&&columns[column])).collect();
    let mut ls = traffic.local_simulator(&[AgentId(5)], 1, Seed::new(5)).unwrap();
    ls.reset(&Beginning::first(0..1)).unwrap();
    let sources = ls.spec().sources.count();
    let entries = border.plan.entries.len();
    assert_eq!(arrived.len(), entries);
    // A column counts up to 30 cars in the last minute, as a share of 30.
    let seen_after = |ls: &mut dyn LocalSimulator, seconds: usize, drawn: u8| {
        let sources: Vec<u8> = (0..sources).map(|at| drawn * u8::from(at < border.plan.all_blocked().start)).collect();
        for _ in 0..seconds / border.plan.decision_s {
            ls.step(&[0], &Rows::from_vec(sources.clone(), sources.len())).unwrap();
        }
        let d_set = ls.step(&[0], &Rows::from_vec(vec![0; sources.len()], sources.len())).unwrap().percept.d_set.row(0);
        arrived.iter().map(|&column| (f64::from(d_set[column]) * 30.0).round() as usize).sum::<usize>()
    };
    // A car a second at every entry is more than can get in. The light never changes.
    let at_first = seen_after(&mut *ls, 20, 1);
    assert!((1..15 * entries).contains(&at_first), "{at_first} of {} cars are in", 20 * entries);
    // Those that wait come later, although nobody is drawn any more.
    let later = seen_after(&mut *ls, 25, 0);
    assert!((at_first + 1..=20 * entries).contains(&later), "{later} after {at_first}");
}

/// A short training of the town.
struct Training {
    dir: tempfile::TempDir,
}

impl Training {
    fn new() -> Training {
        Training { dir: tempfile::tempdir().unwrap() }
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("run")
    }

    fn start(&self, workers: &str) -> Child {
        let settings = [
            "traffic.end_s=600",
            "traffic.local_horizon=30",
            "total_steps=240",
            "local_simulators.copies=2",
            "local_simulators.stagger=true",
            "ppo.rollout_steps=20",
            "ppo.memory=40",
            "ppo.minibatch=20",
            "ppo.epochs=1",
            "policy.hidden=[8]",
            "aip.hidden=[8]",
            "aip.dataset_steps=240",
            "aip.retrain_every_steps=160",
            "aip.epochs=2",
            "aip.batch=40",
            "evaluation.every_steps=80",
            "evaluation.episodes=1",
            "evaluation.final_episodes=1",
        ];
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/town.toml");
        let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.arg("train").arg(config).arg("--out").arg(self.out()).args(["--simulator", "dials"]);
        command.args(["--workers", workers]).args(settings.iter().flat_map(|setting| ["--set", setting]));
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn policies(&self) -> Vec<u8> {
        fs::read(self.out().join("policies.safetensors")).unwrap()
    }
}

fn assert_trained(process: Child) {
    let output = process.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_town_trains_to_the_same_policies_with_any_workers_and_after_a_kill() {
    let alone = Training::new();
    assert_trained(alone.start("1"));
    let killed = Training::new();
    let mut process = killed.start("2");
    let checkpoints = killed.out().join("checkpoints");
    let is_under_way = || fs::read_dir(&checkpoints).is_ok_and(|entries| entries.count() > 0);
    while !is_under_way() {
        assert!(process.try_wait().unwrap().is_none(), "{}", stderr(process));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    let mut resumed = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    resumed.args(["train", "--workers", "2", "--resume"]).arg(killed.out());
    assert_trained(resumed.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap());
    assert!(killed.policies() == alone.policies());
}

fn stderr(process: Child) -> String {
    String::from_utf8_lossy(&process.wait_with_output().unwrap().stderr).into_owned()
}
