//! Replays and pictures: what plain SUMO plays from a written episode, compared with the episode.
//!
//! - `fcd`: what SUMO plays, and what was recorded, in the same form; `scenarios`: replays of scenarios.
//! - `stopped_films`: films that are stopped while they are made.

mod fcd;
mod scenarios;
mod stopped_films;

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command as Program;
use std::sync::{Mutex, PoisonError};

use assert_cmd::Command;
use dials_core::base::{Rows, Seed};
use dials_core::domain::{Beginning, Domain, LocalSimulator};
use dials_learn::evaluation::{episode_seed, play};
use dials_learn::policy::{JointPolicyController, Selection};
use dials_session::config::{RunConfig, load};
use dials_session::domains::DomainConfig;
use dials_session::records::networks::JointLayout;
use dials_traffic::Traffic;
use dials_traffic::agents::phases::Light;
use dials_traffic::config::TrafficTable;
use dials_traffic::controllers::{NAMES, PLAN};
use dials_traffic::sim::recording::{Recording, Tape};
use dials_traffic::sim::replay;
use quick_xml::Reader;
use quick_xml::events::Event;
use rand::Rng;

use self::fcd::{assert_same, attribute, sumo_plays};

const SEED: u64 = 11;

fn nets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets")
}

/// Writes a config of 512 timesteps on the 2x2 grid with episodes of 150 steps. `more` goes into its traffic table.
fn write_config(dir: &Path, more: &str) -> PathBuf {
    let path = dir.join("small.toml");
    let nets = nets().display().to_string();
    let text = format!(
        "total_steps = 512\n[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 150\n{more}\n\
         [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n\
         [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 600\nbatch = 32\nepochs = 2\n\
         [evaluation]\nevery_steps = 256\nepisodes = 1\n"
    );
    fs::write(&path, text).unwrap();
    path
}

fn dials_traffic<'a>(args: impl IntoIterator<Item = &'a str>) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(args);
    command
}

fn text(path: &Path) -> &str {
    path.to_str().expect("the paths of the tests are UTF-8")
}

fn train(dir: &Path, more: &[&str]) -> PathBuf {
    let (config, run) = (write_config(dir, ""), dir.join("run"));
    let args = ["train", text(&config), "--out", text(&run), "--workers", "0"];
    dials_traffic(args.into_iter().chain(more.iter().copied())).assert().success();
    run
}

fn open(config: &RunConfig) -> Traffic {
    let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = &config.domain else { panic!("a config of traffic") };
    Traffic::open(table).unwrap()
}

/// Plays the first episode of [`SEED`] in this process, to compare it with the program under test.
fn record(
    config: &RunConfig,
    cast: impl FnOnce(&Traffic) -> Option<JointPolicyController>,
    baseline: &str,
) -> Recording {
    let tape = Tape::default();
    let traffic = open(config).record_on(&tape);
    let episode = episode_seed(Seed::new(SEED), 0);
    match cast(&traffic) {
        Some(mut policies) => play(&mut *traffic.global_simulator().unwrap(), &mut policies, episode).unwrap(),
        None => {
            let mut baseline = traffic.baseline(baseline).unwrap();
            play(&mut *baseline.simulator, &mut *baseline.controller, episode).unwrap()
        }
    };
    tape.take().unwrap()
}

#[test]
fn sumo_plays_the_replay_of_trained_policies_as_the_episode_was() {
    let dir = tempfile::tempdir().unwrap();
    let run = train(dir.path(), &[]);
    let folder = dir.path().join("replay");
    let args = ["replay", text(&run), "--out", text(&folder), "--episode-seed", "11"];
    dials_traffic(args).assert().success();
    // The folder needs nothing outside of itself.
    let elsewhere = dir.path().join("elsewhere");
    fs::rename(&folder, &elsewhere).unwrap();

    let config = load(&run.join("config.toml"), &[]).unwrap();
    let recording = record(
        &config,
        |traffic| {
            let layout = JointLayout::of_policies(traffic.kinds(), &config.learning.policy);
            let policies = layout.read(&run.join("policies.safetensors")).unwrap();
            Some(JointPolicyController::new(traffic.kinds(), &config.learning, &policies, Selection::Sampled))
        },
        "",
    );
    assert_eq!(recording.steps.len(), 150);
    // 8 flows of 0.1 per second for 150 s are 120 cars, and each is on the road for at least 20 s.
    assert!(assert_same(&elsewhere, &recording) > 1500);
}

#[test]
fn sumo_plays_the_replay_of_its_own_actuated_lights_as_the_episode_was() {
    let dir = tempfile::tempdir().unwrap();
    let (config, folder) = (write_config(dir.path(), ""), dir.path().join("replay"));
    let args = ["replay", text(&config), "--controller", "actuated", "--out", text(&folder), "--episode-seed", "11"];
    dials_traffic(args).assert().success();
    let recording = record(&load(&config, &[]).unwrap(), |_| None, "actuated");
    assert!(assert_same(&folder, &recording) > 1500);
    let shown: BTreeSet<&str> = recording.steps.iter().map(|step| step.signals[0].as_str()).collect();
    assert_eq!(shown.into_iter().collect::<Vec<_>>(), ["GrGr", "rGrG", "ryry", "yryr"], "its program ran");
}

#[test]
fn sumo_plays_the_replay_of_a_local_simulator_as_the_episode_was() {
    for entry in ["max", "reference"] {
        let dir = tempfile::tempdir().unwrap();
        let config = load(&write_config(dir.path(), &format!("entry = '{entry}'")), &[]).unwrap();
        let tape = Tape::default();
        let traffic = open(&config).record_on(&tape);
        // Two copies, the first of which is recorded, and more cars than there is room for.
        let mut ls = traffic.local(2).unwrap();
        let mut dice = Seed::new(5).dice();
        for episode in 0..2 {
            ls.reset(&Beginning::first([0, 1])).unwrap();
            for _ in 0..[200, 20][episode] {
                let sources = Rows::from_vec((0..8).map(|_| u8::from(dice.random_bool(0.3))).collect(), 4);
                ls.step(&[u8::from(dice.random_bool(0.1)), u8::from(dice.random_bool(0.1))], &sources).unwrap();
            }
        }
        let dropped = ls.counters().into_iter().find(|(name, _)| name == "dropped_arrivals").unwrap().1;
        assert!(dropped > 0, "{entry}");
        drop(ls);
        let recording = tape.take().unwrap();
        assert_eq!(recording.steps.len(), 200, "the first episode is what is on the tape");
        replay::write(&recording, dir.path()).unwrap();
        replay::check(&recording, dir.path()).unwrap();
        assert!(assert_same(dir.path(), &recording) > 3000, "{entry}");
    }
}

#[test]
fn an_agent_is_replayed_in_its_local_simulator_with_the_cars_of_its_aip() {
    let dir = tempfile::tempdir().unwrap();
    let run = train(dir.path(), &[]);
    let replay = |out: &str, more: &[&str]| {
        let folder = dir.path().join(out);
        let args = ["replay", text(&run), "--out", text(&folder), "--local"];
        dials_traffic(args.into_iter().chain(more.iter().copied())).assert().success();
        sumo_plays(&folder)
    };
    let third = replay("third", &["3"]);
    assert_eq!(third.len(), 150);
    let cars: BTreeSet<&str> = third.iter().flatten().map(|(car, ..)| car.as_str()).collect();
    // AIPs (approximate influence predictors) with little training send a car with a probability of about a half: 4 x
    // 150 x 0.5 = 300. There is room for about a third of them.
    assert!(cars.len() > 30, "{}", cars.len());
    assert!(third.iter().flatten().all(|(_, lane, _)| lane.contains("r0c0")), "under the names of the local net");
    assert!(third == replay("again", &["3"]), "the same seed, the same episode");
    assert!(third != replay("other", &["3", "--episode-seed", "12"]));
    assert!(third != replay("first", &["1"]), "every agent has an AIP and a policy of its own");

    let out = dir.path().join("none");
    let error = |subject: &Path, more: &[&str]| {
        let args = ["replay", text(subject), "--out", text(&out)];
        let output = dials_traffic(args.into_iter().chain(more.iter().copied())).assert().code(2).get_output().clone();
        assert!(!out.exists());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(
        error(&run, &["--local", "4"]).contains("there is no agent `4`; the agents are 0 to 3, by name r0c0, r0c1")
    );
    let gs = tempfile::tempdir().unwrap();
    let gs = train(gs.path(), &["--simulator", "gs"]);
    assert!(error(&gs, &["--local", "0"]).contains("was trained on the GS and has no AIPs"));
}

#[test]
fn a_replay_is_the_first_episode_of_the_seed_it_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = write_config(dir.path(), "");
    let config = load(&path, &[]).unwrap();
    let episode = episode_seed(Seed::new(7), 0);
    let plan = dir.path().join("a_plan");
    let args = ["plan", text(&path), "--controller", "webster", "--episodes", "1", "--out", text(&plan)];
    dials_traffic(args).assert().success();
    for (number, name) in NAMES.iter().enumerate() {
        let name = if *name == PLAN { format!("{PLAN}:file={}", plan.display()) } else { name.replace('K', "10") };
        let folder = dir.path().join(format!("replay_{number}"));
        let args = ["replay", text(&path), "--controller", &name, "--out", text(&folder), "--episode-seed", "7"];
        dials_traffic(args).assert().success();
        let file = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
        let seed = format!("<seed value=\"{}\"/>", episode.for_sumo());
        assert!(file("replay.sumocfg").contains(&seed), "{name}: {}", file("replay.sumocfg"));

        // The same episode, without a recording.
        let traffic = open(&config);
        let mut gs = traffic.baseline(&name).unwrap().simulator;
        gs.reset(episode).unwrap();
        let mut shown = vec![Vec::new(); 4];
        for _ in 0..150 {
            let obs = &gs.step(&[0; 4]).unwrap().percept.obs;
            let letters = |obs: &[f32]| Light::ALL[obs[36..].iter().position(|&bit| bit == 1.0).unwrap()].letters();
            shown.iter_mut().zip(obs.iter()).for_each(|(shown, obs)| shown.push(letters(obs).to_owned()));
        }
        assert_eq!(signals(&file("replay.signals.add.xml")), shown, "{name}");
        let measures = gs.measures().unwrap().system;
        let departed = measures.iter().find(|(name, _)| name == "departed").unwrap().1;
        assert_eq!(file("replay.rou.xml").matches("<vehicle ").count() as f64, departed, "{name}");
    }
}

/// Returns what every light of a file of programs shows, second by second.
fn signals(xml: &str) -> Vec<Vec<String>> {
    let mut reader = Reader::from_str(xml);
    let mut lights: Vec<Vec<String>> = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Event::Start(tag) if tag.name().as_ref() == "tlLogic" => lights.push(Vec::new()),
            Event::Empty(tag) if tag.name().as_ref() == "phase" => {
                let seconds = attribute(&tag, "duration").parse().unwrap();
                lights.last_mut().unwrap().extend(std::iter::repeat_n(attribute(&tag, "state"), seconds));
            }
            Event::Eof => return lights,
            _ => {}
        }
    }
}

#[test]
fn a_folder_that_sumo_plays_otherwise_is_found_out() {
    let dir = tempfile::tempdir().unwrap();
    let config = load(&write_config(dir.path(), ""), &[]).unwrap();
    let mut recording = record(&config, |_| None, "gap-out");
    recording.entries[3].car.position_m += 1e-12;
    replay::write(&recording, dir.path()).unwrap();
    let error = replay::check(&recording, dir.path()).unwrap_err().to_string();
    let step = recording.entries[3].step;
    assert!(error.starts_with(&format!("SUMO plays step {step} of the replay differently")), "{error}");
}

#[test]
fn what_is_there_is_refused_or_moved_aside_but_never_lost() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), ""), dir.path().join("out"));
    fs::create_dir(&out).unwrap();
    fs::write(out.join("precious"), "x").unwrap();
    let args = ["replay", text(&config), "--controller", "never", "--out", text(&out)];
    let refused = |args: &[&str], parts: &[&str]| {
        let output = dials_traffic(args.iter().copied()).env_remove("DISPLAY").assert().code(2).get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.starts_with("error: ") && parts.iter().all(|part| said.contains(part)), "{said}");
    };
    refused(&args, &["out: exists already", "--force"]);
    dials_traffic(args.into_iter().chain(["--force"])).assert().success();
    assert!(out.join("replay.sumocfg").is_file() && dir.path().join("out.old-1/precious").is_file());

    let other = dir.path().join("other");
    let args = ["replay", text(&config), "--controller", "never", "--out", text(&other)];
    let with = |more: &[&'static str]| args.into_iter().chain(more.iter().copied()).collect::<Vec<&str>>();
    for (name, told) in [("a,b", "a comma"), ("${HOME}", "a variable"), ("a%41b", "one letter")] {
        let place = dir.path().join(name);
        refused(&["replay", text(&config), "--controller", "never", "--out", text(&place)], &[name, told, "rename it"]);
    }
    refused(&with(&["--gui"]), &["there is no screen here", "--video"]);
    refused(&with(&["--video", "film.avi"]), &["film.avi: must end in .gif or .mp4"]);
    refused(&["replay", text(&config), "--out", text(&other)], &["has no policies", "--controller"]);
    refused(&["replay", text(&config), "--controller", "no", "--out", text(&other)], &["controller `no`: unknown"]);
    let warehouse = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke_warehouse.toml");
    let robots = ["replay", text(&warehouse), "--controller", "random", "--out", text(&other)];
    refused(&robots, &["only episodes that SUMO simulates can be replayed"]);
    assert!(!other.exists());
    // With sumo-gui alone on the PATH, the error names each missing tool with its package.
    let bin = dir.path().join("bin");
    fs::create_dir(&bin).unwrap();
    std::os::unix::fs::symlink("/usr/bin/sumo-gui", bin.join("sumo-gui")).unwrap();
    let output = dials_traffic(with(&["--video", "film.gif"])).env("PATH", &bin).assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("Xvfb is not on the PATH: install Debian's package xvfb"), "{said}");
}

/// xvfb-run looks for a free screen and takes it a little later, so two at once may find the same one.
static SCREEN: Mutex<()> = Mutex::new(());

/// Returns whether sumo-gui can run on a virtual screen; prints a message if not.
fn has_xvfb() -> bool {
    let has =
        Program::new("xvfb-run").arg("--help").output().is_ok() && Program::new("xauth").arg("-V").output().is_ok();
    if !has {
        // Written straight to standard error, because the output of `println` and `eprintln` is not shown for tests
        // that pass.
        let message = b"skipped: xvfb-run or xauth is not installed (Debian's packages xvfb and xauth)\n";
        std::io::stderr().write_all(message).unwrap();
    }
    has
}

fn sumo_gui_plays(config: &Path, more: &[&str]) {
    let output = Program::new("xvfb-run")
        .args(["-a", "sumo-gui", "-c", text(config), "--start", "--quit-on-end"])
        .args(more)
        .env_remove("SUMO_HOME")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}: {}", config.display(), String::from_utf8_lossy(&output.stderr));
}

#[test]
fn sumo_gui_opens_every_saved_network_and_a_replay() {
    if !has_xvfb() {
        return;
    }
    let _screen = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let entries = |folder: &Path| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let files = entries(&nets()).into_iter().flat_map(|path| if path.is_dir() { entries(&path) } else { vec![path] });
    let configs: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|ending| ending == "sumocfg")).collect();
    assert_eq!(configs.len(), 5 + 1 + 4);
    configs.iter().for_each(|config| sumo_gui_plays(config, &["--end", "20"]));

    let dir = tempfile::tempdir().unwrap();
    let (config, folder) = (write_config(dir.path(), ""), dir.path().join("replay"));
    dials_traffic(["replay", text(&config), "--controller", "gap-out", "--out", text(&folder)]).assert().success();
    // With the delay of its view settings it would take 15 s.
    sumo_gui_plays(&folder.join("replay.sumocfg"), &["--delay", "0"]);
}

#[test]
fn a_film_has_a_picture_of_every_step() {
    if !has_xvfb() {
        return;
    }
    let _screen = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), "");
    let text_of = fs::read_to_string(&config).unwrap().replace("horizon = 150", "horizon = 12");
    fs::write(&config, text_of.replace("dataset_steps = 600", "dataset_steps = 240")).unwrap();
    let (folder, film) = (dir.path().join("replay"), dir.path().join("film.gif"));
    let args = ["replay", text(&config), "--controller", "always", "--out", text(&folder), "--video", text(&film)];
    dials_traffic(args).assert().success();
    let mut decoder = gif::DecodeOptions::new().read_info(fs::File::open(&film).unwrap()).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        frames.push((frame.palette.clone(), frame.buffer.to_vec()));
    }
    assert_eq!(frames.len(), 12);
    assert!(frames.windows(2).any(|two| two[0] != two[1]), "something moves");
}

#[test]
fn a_scenario_has_a_film_too_whenever_it_begins() {
    if !has_xvfb() {
        return;
    }
    let _screen = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("short.toml");
    let scenario = nets().join("arterial/arterial.sumocfg");
    let table = format!("scenario = '{}'\nbegin_s = 300\nend_s = 315", scenario.display());
    fs::write(&config, format!("simulator = 'gs'\n[traffic]\n{table}\n")).unwrap();
    let (folder, film) = (dir.path().join("replay"), dir.path().join("film.gif"));
    let args = ["replay", text(&config), "--controller", "program", "--out", text(&folder), "--video", text(&film)];
    dials_traffic(args.into_iter().chain(["--seconds", "5,14"])).assert().success();
    let mut decoder = gif::DecodeOptions::new().read_info(fs::File::open(&film).unwrap()).unwrap();
    assert!(decoder.width() > decoder.height(), "the road leads from west to east");
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        frames.push((frame.palette.clone(), frame.buffer.to_vec()));
    }
    assert_eq!(frames.len(), 9);
    assert!(frames.windows(2).any(|two| two[0] != two[1]), "something moves");
    sumo_gui_plays(&folder.join("replay.sumocfg"), &["--delay", "0"]);
}

#[test]
fn pictures_name_what_they_show_and_their_queues_are_those_of_sumo() {
    let dir = tempfile::tempdir().unwrap();
    let (config, plots, folder) = (write_config(dir.path(), ""), dir.path().join("plots"), dir.path().join("replay"));
    let args =
        ["baseline", text(&config), "--controller", "never", "--seed", "11", "--episodes", "2", "--plot", text(&plots)];
    dials_traffic(args).assert().success();
    let picture = |name: &str| fs::read_to_string(plots.join(name)).unwrap();
    for name in ["space_time.svg", "queues.svg", "signals.svg", "returns.svg"] {
        let svg = picture(name);
        assert!(svg.contains("controller never on small.toml") && svg.contains("seed 11"), "{name}");
        assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"), "{name}");
    }
    assert!(picture("returns.svg").contains("mean over 2 episodes of seed 11"));

    // Vertical green all the time: queues from west and east, and none from south and north unless the way ahead is
    // full.
    let args = ["replay", text(&config), "--controller", "never", "--out", text(&folder), "--episode-seed", "11"];
    dials_traffic(args).assert().success();
    let into = |lane: &str, side: usize| {
        let lanes = [
            ["w0_r0c0_0", "r0c0_r0c1_0", "w1_r1c0_0", "r1c0_r1c1_0"],
            ["s0_r0c0_0", "s1_r0c1_0", "r0c0_r1c0_0", "r0c1_r1c1_0"],
        ];
        lanes[side].contains(&lane)
    };
    let mut standing = [0, 0];
    for (_, lane, place) in sumo_plays(&folder).iter().flatten() {
        let speed: f64 = place.split(' ').nth(1).unwrap().parse().unwrap();
        (0..2).filter(|&side| speed < 0.1 && into(lane, side)).for_each(|side| standing[side] += 1);
    }
    let queues = picture("queues.svg");
    for (side, name) in ["west", "south"].into_iter().enumerate() {
        // 150 steps and 4 intersections.
        let words = format!("from the {name}: {:.2} cars on average", f64::from(standing[side]) / 600.0);
        assert!(queues.contains(&words), "{words}");
    }
    assert!(standing[0] > 0);

    let again = dials_traffic(args_of(&config, &plots)).assert().code(2).get_output().clone();
    assert!(String::from_utf8(again.stderr).unwrap().contains("plots: exists already"));
}

fn args_of<'a>(config: &'a Path, plots: &'a Path) -> [&'a str; 6] {
    ["baseline", text(config), "--controller", "never", "--plot", text(plots)]
}
