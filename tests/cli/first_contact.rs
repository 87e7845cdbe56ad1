//! What a newcomer asks first: what is this config, what is missing here, what does the shell know?

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn program(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(args);
    command
}

fn said(output: &Output) -> [String; 2] {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8(bytes.clone()).unwrap())
}

/// Makes a folder like a new clone: without the runs and results that its user may have made in this one.
fn clone() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["configs", "experiments", "sumo_nets"] {
        symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    folder
}

/// Returns what a command prints on standard output, in a new clone.
fn answer(args: &[&str]) -> String {
    let clone = clone();
    let [out, _] = said(program(args).current_dir(clone.path()).assert().success().get_output());
    out
}

#[test]
fn a_config_is_described_with_all_that_its_agents_see_do_and_are_paid_for() {
    let text = answer(&["describe", "configs/traffic_4.toml", "--workers", "2"]);
    for line in [
        "configs/traffic_4.toml: 4 agents, episodes of 300 steps",
        "agents: r0c0, r0c1, r1c0, r1c1",
        "reward of a step: mean speed of the cars on the approaches, as a share of the",
        "  limit",
        "40 observation columns:",
        "2 actions:",
        "4 influence sources:",
        "  4000000 steps per agent, 31250 updates of the policies",
        "  40 evaluations of 20 episodes on the way, one of 100 episodes at the end",
        "  4 trainings of the predictors, each on 17 episodes of the global simulator",
        "    (1.4 hours of demand), 15 epochs",
    ] {
        assert!(text.lines().any(|told| told == line), "`{line}` is not in:\n{text}");
    }
    assert!(!text.contains("`plan` makes fixed times"), "a grid of the paper is in no street: {text}");
    let town = answer(&["describe", "sumo_nets/town/town.sumocfg"]);
    assert!(town.contains("  `plan` makes fixed times of them, which plain SUMO plays\n"), "{town}");
    assert!(
        text.contains(" with 2 workers\nrough: from runs on two cores of another machine; to measure it here:\n  ")
    );

    let on_gs = answer(&["describe", "configs/traffic_4.toml", "--simulator", "gs", "--set", "total_steps=1e6"]);
    assert!(on_gs.contains("  1000000 steps per agent") && !on_gs.contains("influence source"), "{on_gs}");
}

/// Runs a command of this program as it is found on the PATH, and checks that its lines fit a terminal.
fn assert_fits_a_terminal(args: &[&str]) {
    let folder = Path::new(env!("CARGO_BIN_EXE_dials-traffic")).parent().unwrap();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap());
    let clone = clone();
    let output = program(args).current_dir(clone.path()).env("PATH", path).assert().success().get_output().clone();
    let [out, err] = said(&output);
    for line in out.lines().chain(err.lines()) {
        assert!(line.chars().count() <= 80, "{args:?}: {line}");
    }
}

#[test]
fn what_describes_configs_and_experiments_fits_a_terminal() {
    for config in ["configs/traffic_4.toml", "configs/smoke_warehouse.toml", "sumo_nets/town/town.sumocfg"] {
        for simulator in ["dials", "untrained-dials"] {
            assert_fits_a_terminal(&["describe", config, "--simulator", simulator]);
        }
    }
    // Their names have up to 43 characters.
    for experiment in ["experiments/sizes_traffic.toml", "experiments/scenarios.toml"] {
        assert_fits_a_terminal(&["experiment", experiment, "--dry-run"]);
    }
}

#[test]
fn every_agent_of_a_scenario_is_in_the_json_without_padding() {
    let text = answer(&["describe", "sumo_nets/town/town.sumocfg"]);
    assert!(text.contains(": 20 agents, episodes of 720 steps of 5 s (3600 s)"), "{text}");
    let json: Value = serde_json::from_str(&answer(&["describe", "sumo_nets/town/town.sumocfg", "--json"])).unwrap();
    let agents = json["agents"].as_array().unwrap();
    assert_eq!((agents.len(), agents[0]["name"].as_str()), (20, Some("b2")));
    let widths: Vec<usize> =
        agents.iter().map(|agent| agent["task"]["observation"].as_array().unwrap().len()).collect();
    let widest = json["kinds"][0]["observation_columns"].as_u64().unwrap() as usize;
    assert_eq!(widths.iter().max(), Some(&widest));
    assert!(widths.iter().any(|&width| width < widest), "{widths:?}");
    assert_eq!(json["run"]["steps_per_agent"], 216_000);
    assert!(json["cost"]["seconds"].as_f64().unwrap() > 0.0);
}

#[test]
fn the_words_of_every_reward_are_those_of_the_docs() {
    let page = fs::read_to_string(root().join("docs/environments.md")).unwrap();
    let town = "sumo_nets/town/town.sumocfg";
    for name in ["mean-speed", "exit-speed", "queue", "pressure", "wait", "diff-waiting-time"] {
        let setting = format!("traffic.reward={name}");
        let text = answer(&["describe", town, "--set", &setting]);
        // A long line is broken, and goes on further to the right.
        let text = text.replace("\n  ", " ");
        let words = text.lines().find_map(|line| line.strip_prefix("reward of a step: ")).unwrap().to_owned();
        assert!(page.contains(&format!("| `{name}` | {words} |")), "{name}: {words}");
    }
}

#[test]
fn the_doctor_trains_and_says_what_is_missing_and_how_to_get_it() {
    let [out, _] = said(program(&["doctor"]).assert().success().get_output());
    for line in ["ok       a short training without SUMO", "ok       a short training on SUMO"] {
        assert!(out.lines().any(|told| told == line), "{out}");
    }
    assert!(out.contains("\ntraining works here"), "{out}");
    let libtorch = match cfg!(feature = "torch") {
        true => "ok       libtorch 1.13",
        false => {
            "missing  libtorch: needed for `export`\n         cure: ./setup.sh torch && cargo install --path . --features torch"
        }
    };
    assert!(out.contains(libtorch), "{out}");
    assert!(out.contains("SUMO's data"), "{out}");

    // Programs are for some commands. Training needs SUMO's library alone.
    let room = tempfile::tempdir().unwrap();
    let library = room.path().join("libsumocpp.so");
    symlink(&libsumo::load().unwrap().file, &library).unwrap();
    let mut without_programs = program(&["doctor"]);
    without_programs.env("PATH", "").env("DIALS_SUMO_LIBRARY", library);
    let [out, _] = said(without_programs.assert().success().get_output());
    for part in [
        "missing  sumo-gui was not found: needed for `replay --gui` and films\n         cure: pip install eclipse-sumo",
        "missing  netconvert was not found: ",
        "ok       a short training on SUMO",
    ] {
        assert!(out.contains(part), "`{part}` is not in:\n{out}");
    }

    let nowhere = program(&["doctor"]).env("TMPDIR", "/no/such/folder").assert().code(1).get_output().clone();
    assert!(said(&nowhere)[0].contains("/no/such/folder"), "{:?}", said(&nowhere));
}

#[test]
fn only_what_simulates_needs_sumo_and_a_missing_sumo_is_one_error_with_its_cure() {
    let room = clone();
    fs::write(room.path().join("libsumocpp.so"), "no library").unwrap();
    let without_sumo = |args: &[&str]| {
        let mut command = program(args);
        command.env("LD_LIBRARY_PATH", room.path()).current_dir(room.path());
        command
    };
    for args in [&["--version"][..], &["--help"], &["schema"], &["completions", "bash"], &["report", "--help"]] {
        without_sumo(args).assert().success();
    }
    let [_, err] = said(without_sumo(&["trian"]).assert().code(2).get_output());
    assert!(err.contains("unrecognized subcommand 'trian'"), "{err}");
    let run = |name: &str| room.path().join(name).to_str().unwrap().to_owned();
    without_sumo(&["train", "configs/smoke_warehouse.toml", "--steps", "4096", "--out", &run("robots")])
        .assert()
        .success();
    let [out, _] = said(without_sumo(&["info"]).assert().success().get_output());
    assert!(out.contains("no SUMO: SUMO's library cannot be loaded: libsumocpp.so (the system): "), "{out}");
    let train = ["train", "configs/smoke_traffic.toml", "--out", &run("lights")];
    let [_, err] = said(without_sumo(&train).assert().code(2).get_output());
    assert_one_error(
        &err,
        &["SUMO's library cannot be loaded: libsumocpp.so (the system): ", "install SUMO (pip install"],
    );
    let [out, _] = said(without_sumo(&["doctor"]).assert().code(1).get_output());
    assert!(out.contains("error    SUMO's library cannot be loaded: "), "{out}");
}

#[test]
fn each_fault_of_the_library_that_is_named_is_one_error_of_its_own() {
    let room = clone();
    let text = room.path().join("text.so");
    fs::write(&text, "no library").unwrap();
    let damaged = room.path().join("damaged.so");
    let other = loaded_c_library();
    fs::write(&damaged, &fs::read(&other).unwrap()[..100_000]).unwrap();
    let run = room.path().join("run");
    let train = ["train", "configs/smoke_traffic.toml", "--out", run.to_str().unwrap()];
    for (library, fault) in [
        (room.path(), "is a folder; let DIALS_SUMO_LIBRARY name the file libsumocpp.so in it"),
        (&room.path().join("none.so"), "no such file; let DIALS_SUMO_LIBRARY name a file"),
        (&text, "file too short; install SUMO again"),
        (&damaged, "is damaged: its end is missing; install SUMO again"),
        (&other, "is no libsumo: it has none of SUMO's functions"),
    ] {
        let mut command = program(&train);
        let output =
            command.env("DIALS_SUMO_LIBRARY", library).current_dir(room.path()).assert().code(2).get_output().clone();
        let place = format!("SUMO's library cannot be loaded: {} (DIALS_SUMO_LIBRARY): ", library.display());
        assert_one_error(&said(&output)[1], &[&place, fault]);
    }
    assert!(!run.exists());
}

#[test]
fn the_first_place_that_has_sumo_is_taken_and_all_are_named() {
    let room = clone();
    let info = |variables: &[(&str, &str)]| {
        let mut command = program(&["info"]);
        // Of the machine: it may have a SUMO there.
        for name in ["DIALS_SUMO_LIBRARY", "SUMO_HOME", "VIRTUAL_ENV", "CONDA_PREFIX"] {
            command.env_remove(name);
        }
        variables.iter().for_each(|(name, folder)| _ = command.env(name, room.path().join(folder)));
        said(command.assert().success().get_output())[0].clone()
    };
    let usual = info(&[]);
    let library = usual.lines().find_map(|line| line.strip_prefix("SUMO ")?.split(" at ").nth(1)?.split(": ").next());
    for (environment, file) in [
        ("home", "lib64/libsumocpp.so"),
        ("virtual", "lib/python3.9/site-packages/sumo/lib64/libsumocpp.so"),
        ("conda", "lib/libsumocpp.so"),
    ] {
        let file = room.path().join(environment).join(file);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        symlink(library.unwrap(), file).unwrap();
    }
    let all = [("CONDA_PREFIX", "conda"), ("VIRTUAL_ENV", "virtual"), ("SUMO_HOME", "home")];
    for count in 1..=all.len() {
        let text = info(&all[..count]);
        let there: Vec<&str> = text.lines().filter(|line| line.ends_with("): there")).collect();
        let sources: Vec<&str> = there.iter().map(|line| line.split(" (").nth(1).unwrap()).collect();
        let expected: Vec<String> = all[..count].iter().rev().map(|(name, _)| format!("{name}): there")).collect();
        assert_eq!(sources, expected, "{text}");
        assert!(text.contains("SUMO 1.") && text.contains("looked at: libsumocpp.so (the system): "), "{text}");
    }
    let named = info(&[("DIALS_SUMO_LIBRARY", "conda/lib/libsumocpp.so"), ("SUMO_HOME", "home")]);
    assert_eq!(named.matches("looked at: ").count(), 1, "{named}");
}

/// Returns the file of the C library that this process uses.
fn loaded_c_library() -> PathBuf {
    let maps = fs::read_to_string("/proc/self/maps").unwrap();
    let path = maps.lines().find_map(|line| line.split_whitespace().nth(5).filter(|path| path.ends_with("/libc.so.6")));
    path.unwrap().into()
}

fn assert_one_error(err: &str, parts: &[&str]) {
    assert!(err.starts_with("error: ") && err.lines().filter(|line| line.starts_with("error")).count() == 1, "{err}");
    for part in parts {
        assert!(err.contains(part), "`{part}` is not in: {err}");
    }
}

/// Returns the subcommands that `--help` lists.
fn subcommands() -> Vec<String> {
    let help = answer(&["--help"]);
    let (_, list) = help.split_once("Commands:\n").unwrap();
    let lines = list.lines().take_while(|line| !line.is_empty());
    // Continued lines are further to the right.
    let names = lines.filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')));
    let names = names.filter_map(|line| line.split(' ').next().map(str::to_owned));
    names.filter(|name| name != "help").collect()
}

#[test]
fn shells_get_completions_with_every_subcommand() {
    for shell in ["bash", "zsh", "fish"] {
        let script = answer(&["completions", shell]);
        for name in subcommands() {
            assert!(script.contains(&name), "{shell}: {name}");
        }
    }
    let checked = Command::new("bash").args(["-n", "/dev/stdin"]).write_stdin(answer(&["completions", "bash"])).ok();
    checked.unwrap();
    program(&["completions", "cobol"]).assert().code(2);
}

#[test]
fn every_subcommand_has_a_manual_page() {
    let room = tempfile::tempdir().unwrap();
    let dir = room.path().join("man");
    program(&["man", "--out", dir.to_str().unwrap()]).assert().success();
    for name in subcommands() {
        let page = fs::read_to_string(dir.join(format!("dials-traffic-{name}.1"))).unwrap();
        assert!(page.contains(".SH NAME") && page.contains(".SH DESCRIPTION"), "{name}: {page}");
    }
    let again = program(&["man", "--out", dir.to_str().unwrap()]).assert().code(2).get_output().clone();
    assert!(said(&again)[1].contains("exists already"));
}

#[test]
fn editors_get_a_schema() {
    let schema: Value = serde_json::from_str(&answer(&["schema"])).unwrap();
    assert_eq!(schema["properties"]["ppo"]["properties"]["clip"]["type"], "number");
}

/// Trains a few steps of the warehouse into `run` of a directory, and returns what is said on standard error.
fn train(room: &Path, more: &[&str]) -> String {
    let config = root().join("configs/smoke_warehouse.toml");
    let mut command = program(&["train", config.to_str().unwrap(), "--out", "run", "--steps", "128", "--workers", "1"]);
    for setting in ["aip.epochs=1", "evaluation.episodes=1", "evaluation.final_episodes=1"] {
        command.args(["--set", setting]);
    }
    let [_, err] = said(command.args(more).current_dir(room).assert().success().get_output());
    err
}

#[test]
fn a_quiet_run_says_nothing_and_a_verbose_one_says_what_it_does() {
    let rooms = [(); 2].map(|()| tempfile::tempdir().unwrap());
    assert_eq!(train(rooms[0].path(), &["--quiet"]), "");
    let told = train(rooms[1].path(), &["-v"]);
    for doing in ["\n  evaluating\n", "\n  collecting datasets\n", "\n  training AIPs\n", "\n  training policies\n"] {
        assert!(told.contains(doing), "`{doing}` is not in: {told}");
    }
    program(&["--quiet", "--verbose", "info"]).assert().code(2);
    // Errors are always told.
    let refused = program(&["evaluate", "no/run", "--quiet"]).assert().code(2).get_output().clone();
    assert!(said(&refused)[1].starts_with("error: no/run: no such run directory"));
}

#[test]
fn a_run_with_another_reward_is_evaluated_resumed_compared_and_reported() {
    let room = tempfile::tempdir().unwrap();
    let config = root().join("configs/smoke_traffic.toml");
    let config = config.to_str().unwrap();
    let settings = ["aip.epochs=1", "aip.dataset_steps=600", "evaluation.episodes=1", "evaluation.final_episodes=1"];
    let with = |args: &[&str]| said(program(args).current_dir(room.path()).assert().success().get_output());
    for (run, reward) in [("one", "traffic.reward=queue"), ("two", "traffic.reward={queue=0.5,wait=0.5}")] {
        let mut args = vec!["train", config, "--out", run, "--steps", "128", "--workers", "1"];
        for setting in settings.iter().chain([&reward]) {
            args.extend(["--set", setting]);
        }
        with(&args);
        with(&["evaluate", run, "--episodes", "1"]);
        with(&["train", "--resume", run, "--steps", "256"]);
        let [_, told] = with(&["baseline", config, "--episodes", "1", "--compare", &format!("random,./{run}")]);
        assert!(told.contains("learned by other rules than those of this command"), "{told}");
    }
    // Their returns are by different rewards, so their difference would mean nothing.
    let output = program(&["compare", "one", "two"]).current_dir(room.path()).assert().code(2).get_output().clone();
    let [_, told] = said(&output);
    for words in [
        "the returns of A and B are by different rules",
        "\n  reward in A: minus the standing cars on the approaches, in tens\n  reward in B: 0.5 x (minus",
        "\n  dials-traffic baseline one/config.toml --compare one,two\n",
    ] {
        assert!(told.contains(words), "`{words}` is not in: {told}");
    }
    let [_, told] = with(&["report", "one", "two", "--out", "report"]);
    assert!(!told.contains("left out"), "{told}");
}

#[test]
fn a_run_that_was_trained_under_other_rules_is_not_scored_without_a_word() {
    let room = tempfile::tempdir().unwrap();
    train(room.path(), &[]);
    let path: PathBuf = room.path().join("run/run.json");
    let text = fs::read_to_string(&path).unwrap();
    let mut run: Value = serde_json::from_str(&text).unwrap();
    let rules = run["scenario"]["rules"].clone();
    assert_eq!((&rules["environment"], &rules["observation"]), (&1.into(), &"cell and items".into()));
    let config = root().join("configs/smoke_warehouse.toml");
    let compare = || {
        let args = ["baseline", config.to_str().unwrap(), "--episodes", "1", "--compare", "random,./run"];
        said(program(&args).current_dir(room.path()).assert().get_output())
    };
    assert_eq!(compare()[1], "");

    run["scenario"]["rules"]["reward"] = "items".into();
    fs::write(&path, run.to_string()).unwrap();
    let told = compare()[1].clone();
    assert!(told.starts_with("warning: ./run: learned by other rules than those of this command"), "{told}");
    assert!(told.contains("\n  reward in its training: items\n  reward in this command: age of the item"), "{told}");

    run["scenario"]["rules"]["observation"] = "smells".into();
    fs::write(&path, run.to_string()).unwrap();
    let told = compare()[1].clone();
    assert!(told.starts_with("error: ./run: its policies know other observations (smells)"), "{told}");
}
