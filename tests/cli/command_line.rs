//! The command line as users see it: what it prints, writes and refuses.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use assert_cmd::Command;
use serde_json::Value;

fn dials_traffic(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(args);
    command
}

fn nets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets")
}

/// Writes a config of 512 timesteps on the 2x2 grid that begins with the lines of `more`.
fn write_config(dir: &Path, more: &str) -> String {
    let path = dir.join("small.toml");
    let nets = nets().display().to_string();
    let text = format!(
        "{more}\n[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 40\n\
         [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n\
         [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 160\nbatch = 32\nepochs = 2\n\
         [evaluation]\nevery_steps = 256\nseed = 7\nepisodes = 1\nfinal_episodes = 2\n"
    );
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

const SHORT: &str = "total_steps = 512";

fn train(config: &str, out: &Path, more: &[&str]) -> assert_cmd::assert::Assert {
    let mut args = vec!["train", config, "--out", out.to_str().unwrap()];
    args.extend(more);
    dials_traffic(&args).assert()
}

fn six_decimals(number: &Value) -> String {
    format!("{:.6}", number.as_f64().unwrap())
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Asserts exit code 2 and one error that contains all of `parts`.
fn assert_refused(command: &mut Command, parts: &[&str]) {
    let output = command.assert().code(2).get_output().clone();
    let said = text(&output.stderr);
    let errors = said.lines().filter(|line| line.starts_with("error: ")).count();
    assert!(said.starts_with("error: ") && errors == 1, "{said}");
    for part in parts {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    assert!(output.stdout.is_empty());
}

#[test]
fn a_controller_to_imitate_that_does_not_exist_is_refused_before_anything_begins() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    for (name, told) in [
        ("gapout", "unknown (did you mean `gap-out`?); one of random"),
        ("gap-out:green=5", "has no parameter `green`"),
    ] {
        let setting = format!("policy.imitate={name}");
        let short = ["--set", "imitation.critic_steps=128"];
        let args = [&["train", &config, "--out", out.to_str().unwrap(), "--set", &setting][..], &short].concat();
        assert_refused(&mut dials_traffic(&args), &["policy.imitate: not a controller of this domain", told]);
        assert!(!out.exists());
    }
}

#[test]
fn a_run_leaves_a_directory_that_can_be_evaluated_anywhere() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    let assert = train(&config, &out, &["--seed", "5"]).success();
    let said = text(&assert.get_output().stdout);
    let evaluate = format!("evaluate {}\n", out.display());
    assert!(said.contains(&evaluate), "the exact command is told: {said}");
    for file in [
        "config.toml",
        "run.json",
        "returns.csv",
        "episodes.csv",
        "training.csv",
        "aip_loss.csv",
        "timing.csv",
        "policies.safetensors",
        "aips.safetensors",
    ] {
        assert!(out.join(file).is_file(), "{file}");
    }
    let run: Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["seed"], 5);
    assert_eq!(run["command"][1], "train");
    assert!(run["versions"]["sumo"].as_str().unwrap().starts_with("SUMO 1."));
    assert!(!run["versions"]["sumo_builder"].as_str().unwrap().is_empty());

    // A run directory has its own networks, so it can be moved anywhere.
    let elsewhere = dir.path().join("elsewhere");
    fs::rename(&out, &elsewhere).unwrap();
    fs::remove_file(&config).unwrap();
    let json = dials_traffic(&["evaluate", elsewhere.to_str().unwrap(), "--json"]).assert().success();
    let found: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    assert_eq!((&found["episodes"], &found["agents"], &found["seed"]), (&2.into(), &4.into(), &7.into()));
    assert!(found["std_error"].is_f64() && found["sumo_version"].is_string());

    // The last evaluation of the run played the same episodes with the same policies.
    let returns = fs::read_to_string(elsewhere.join("returns.csv")).unwrap();
    let last = returns.lines().rfind(|line| line.split(',').nth(1) == Some("all")).unwrap();
    let mean: f64 = last.split(',').nth(2).unwrap().parse().unwrap();
    assert!((found["mean_return"].as_f64().unwrap() - mean).abs() < 1e-4, "{found} {last}");
    let of_episodes: Vec<String> = found["episode_returns"].as_array().unwrap().iter().map(six_decimals).collect();
    let episodes = fs::read_to_string(elsewhere.join("episodes.csv")).unwrap();
    let last: Vec<&str> = episodes.lines().rev().take(2).map(|line| line.rsplit(',').next().unwrap()).collect();
    assert_eq!(of_episodes, [last[1], last[0]], "{episodes}");
}

#[cfg(not(feature = "torch"))]
#[test]
fn without_libtorch_export_says_how_to_build_with_it() {
    let told = ["built without it", "./setup.sh torch && cargo install --path . --features ", "policies.safetensors"];
    assert_refused(&mut dials_traffic(&["export", "no/run", "--out", "x"]), &told);
}

#[cfg(not(feature = "mpi"))]
#[test]
fn several_ranks_are_refused_by_a_build_without_mpi() {
    let mut rank = dials_traffic(&["train", "no/config.toml"]);
    assert_refused(
        rank.env("OMPI_COMM_WORLD_SIZE", "3"),
        &["3 ranks were started", "built without MPI", "./setup.sh mpi && cargo install --path . --features "],
    );
}

#[test]
fn ranks_have_flags_of_their_own_and_an_experiment_is_for_one_process() {
    let mut rank = dials_traffic(&["train", "no/config.toml", "--workers", "2"]);
    assert_refused(rank.env("PMI_SIZE", "3"), &["3 ranks were started; use --workers-per-rank"]);
    assert_refused(
        &mut dials_traffic(&["train", "no/config.toml", "--workers-per-rank", "2"]),
        &["--workers-per-rank: ", "this process is alone; use --workers"],
    );
    let mut experiment = dials_traffic(&["experiment", "no/file.toml"]);
    assert_refused(experiment.env("OMPI_COMM_WORLD_SIZE", "3"), &["experiment: ", "cannot be shared by 3 ranks"]);
}

#[cfg(feature = "torch")]
#[test]
fn policies_are_exported_and_an_existing_file_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &out, &[]).success();
    let (run, file) = (out.to_str().unwrap(), dir.path().join("policies.pt"));
    let args = ["export", run, "--out", file.to_str().unwrap()];
    let said = text(&dials_traffic(&args).assert().success().get_output().stdout);
    assert!(said.contains("torch.jit.load") && said.contains("obs: float32 [4, batch, 40]"), "{said}");
    let first = fs::read(&file).unwrap();
    assert!(first.starts_with(b"PK"), "an archive, as TorchScript files are");

    fs::write(&file, "precious").unwrap();
    let neighbour = dir.path().join("policies.part");
    fs::write(&neighbour, "precious, too").unwrap();
    assert_refused(&mut dials_traffic(&args), &["policies.pt: exists already", "--force"]);
    assert_eq!(fs::read(&file).unwrap(), b"precious");
    dials_traffic(&args).arg("--force").assert().success();
    assert_eq!(fs::read(&neighbour).unwrap(), b"precious, too");
    assert_eq!(fs::read(dir.path().join("policies.pt.old-1")).unwrap(), b"precious");
    assert_eq!(fs::metadata(&file).unwrap().len(), first.len() as u64);
    let args = |out: &'static str| ["export", run, "--out", out];
    assert_refused(&mut dials_traffic(&args("/nowhere/p.pt")), &["/nowhere/p.pt: there is no directory /nowhere"]);
    assert_refused(&mut dials_traffic(&args("/tmp")), &["/tmp: is a directory"]);
    assert_refused(&mut dials_traffic(&["export", "no/run", "--out", "x"]), &["no/run: no such run directory"]);
}

#[test]
fn the_same_seed_gives_the_same_returns_byte_for_byte() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    for simulator in ["dials", "gs", "untrained-dials", "marginal-dials"] {
        let run = |name: &str, seed: &str| {
            let out = dir.path().join(format!("{simulator}-{name}"));
            train(&config, &out, &["--seed", seed, "--simulator", simulator]).success();
            ["returns.csv", "training.csv", "policies.safetensors"].map(|file| fs::read(out.join(file)).unwrap())
        };
        let first = run("first", "1");
        assert!(first == run("again", "1"), "{simulator}");
        assert!(first != run("other", "2"), "{simulator}");
    }
}

#[test]
fn an_existing_run_is_refused_or_moved_aside_but_never_lost() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    fs::create_dir(&out).unwrap();
    fs::write(out.join("precious"), "x").unwrap();
    let args = ["train", &config, "--out", out.to_str().unwrap()];
    assert_refused(&mut dials_traffic(&args), &["run: exists already", "--force"]);
    train(&config, &out, &["--force"]).success();
    assert!(out.join("returns.csv").is_file());
    assert!(dir.path().join("run.old-1/precious").is_file());
}

#[test]
fn without_a_place_runs_are_numbered_and_force_moves_the_last_one_aside() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), "total_steps = 128");
    let train = |more: &[&str]| {
        let mut command = dials_traffic(&["train", &config, "--workers", "0"]);
        command.args(more).current_dir(dir.path()).assert().success();
        let runs = fs::read_dir(dir.path().join("runs")).unwrap();
        let mut runs: Vec<String> = runs.map(|run| run.unwrap().file_name().into_string().unwrap()).collect();
        runs.sort();
        runs
    };
    assert_eq!(train(&[]), ["small-dials-seed1"]);
    assert_eq!(train(&[]), ["small-dials-seed1", "small-dials-seed1-2"]);
    assert_eq!(train(&["--force"]), ["small-dials-seed1", "small-dials-seed1-2", "small-dials-seed1.old-1"]);
}

#[test]
fn a_run_can_be_repeated_from_its_own_config_in_its_own_place() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &out, &[]).success();
    let returns = fs::read(out.join("returns.csv")).unwrap();
    train(out.join("config.toml").to_str().unwrap(), &out, &["--force"]).success();
    assert_eq!(fs::read(out.join("returns.csv")).unwrap(), returns);
    assert_eq!(fs::read(dir.path().join("run.old-1/returns.csv")).unwrap(), returns);
    for network in ["global", "local"] {
        assert!(out.join(format!("networks/{network}.net.xml")).is_file(), "{network}");
    }
}

#[test]
fn the_commands_that_a_run_prints_work_as_printed() {
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("it's a room");
    fs::create_dir(&room).unwrap();
    let (config, out) = (write_config(&room, SHORT), room.join("run"));
    // The program is not on this PATH.
    let output = dials_traffic(&["train", &config, "--out", out.to_str().unwrap(), "--workers", "0"])
        .env("PATH", "/usr/bin:/bin")
        .assert()
        .success();
    let said = text(&output.get_output().stdout);
    let commands: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("  ")).collect();
    assert_eq!(commands.len(), 2, "{said}");
    for command in commands {
        let output =
            std::process::Command::new("sh").args(["-c", command]).env("PATH", "/usr/bin:/bin").output().unwrap();
        assert!(output.status.success(), "{command}: {}", text(&output.stderr));
        assert!(text(&output.stdout).starts_with("return "), "{command}");
    }

    let bin = dir.path().join("bin");
    fs::create_dir(&bin).unwrap();
    symlink(assert_cmd::cargo::cargo_bin!("dials-traffic"), bin.join("dials-traffic")).unwrap();
    let output = dials_traffic(&["train", &config, "--out", dir.path().join("b").to_str().unwrap(), "--workers", "0"])
        .env("PATH", &bin)
        .assert()
        .success();
    assert!(
        text(&output.get_output().stdout).contains("\n  dials-traffic evaluate "),
        "by its name where that is found"
    );
}

#[test]
fn a_run_keeps_the_name_and_the_words_of_its_command_line() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), "total_steps = 128"), dir.path().join("run"));
    let link = dir.path().join("dials");
    symlink(assert_cmd::cargo::cargo_bin!("dials-traffic"), &link).unwrap();
    let mut command = std::process::Command::new(&link);
    let words = ["train", &config, "--workers", "0", "--out", out.to_str().unwrap()];
    assert!(command.args(words).output().unwrap().status.success());
    let run: Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    let typed: Vec<&str> = run["command"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
    assert_eq!(typed[0], link.to_str().unwrap());
    assert_eq!(typed[1..], words);
}

#[test]
fn the_largest_seed_trains_and_evaluates() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), "total_steps = 128"), dir.path().join("run"));
    let seed = u64::MAX.to_string();
    train(&config, &out, &["--seed", &seed, "--workers", "1"]).success();
    let run: Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["seed"], u64::MAX);
    let found = dials_traffic(&["evaluate", out.to_str().unwrap(), "--seed", &seed, "--json"]).assert().success();
    let found: Value = serde_json::from_slice(&found.get_output().stdout).unwrap();
    assert_eq!(found["seed"], u64::MAX);
}

/// Returns a pipe whose reader has closed it.
fn closed_pipe() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[test]
fn readers_that_go_away_are_no_reason_to_fail() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let out = dir.path().join("run");
    let program = || std::process::Command::new(assert_cmd::cargo::cargo_bin!("dials-traffic"));
    let train = ["train", &config, "--out", out.to_str().unwrap()];
    let status = program().args(train).stdout(closed_pipe()).stderr(closed_pipe()).status().unwrap();
    assert_eq!(status.code(), Some(0), "training goes on to its end");
    assert!(fs::read_to_string(out.join("returns.csv")).unwrap().contains("\n512,all,"));
    let baseline = ["baseline", &config, "--controller", "never", "--episodes", "1"];
    let nets = dir.path().join("nets");
    for args in [&["info"][..], &baseline, &["nets", "local", "--out", nets.to_str().unwrap()], &["--help"]] {
        let output = program().args(args).stdout(closed_pipe()).stderr(Stdio::piped()).output().unwrap();
        assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""), "{args:?}");
    }
    // An error has its exit code even if nobody can read its text.
    let status = program().args(["evaluate", "no/such"]).stderr(closed_pipe()).status().unwrap();
    assert_eq!(status.code(), Some(2));
}

#[test]
fn training_stops_early_where_asked_and_says_so_in_its_config() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &out, &["--steps", "100", "--set", "ppo.clip=0.2"]).success();
    let returns = fs::read_to_string(out.join("returns.csv")).unwrap();
    assert!(returns.contains("\n128,all,") && !returns.contains("\n256,all,"), "{returns}");
    let kept = fs::read_to_string(out.join("config.toml")).unwrap();
    assert!(kept.contains("stop_at_steps = 100") && kept.contains("clip = 0.2"), "{kept}");
}

#[test]
fn a_run_is_prolonged_to_what_a_longer_one_would_be_and_keeps_its_workers() {
    let dir = tempfile::tempdir().unwrap();
    let (config, whole, part) = (write_config(dir.path(), SHORT), dir.path().join("whole"), dir.path().join("part"));
    train(&config, &whole, &["--workers", "0"]).success();
    let begun = train(&config, &part, &["--workers", "0", "--steps", "256"]).success();
    let said = text(&begun.get_output().stderr);
    assert!(said.contains("4 agents, simulator dials, this process\n  up to step 256 per agent, into "), "{said}");
    let run = part.to_str().unwrap();
    let resume = |steps: &str| dials_traffic(&["train", "--resume", run, "--steps", steps]);
    let kept = fs::read(part.join("config.toml")).unwrap();
    assert_refused(&mut resume("513"), &["--steps 513: this run can go to step 512 only", "total_steps = 512"]);
    assert_refused(&mut resume("128"), &["stop_at_steps = 128", "256"]);
    assert_eq!(fs::read(part.join("config.toml")).unwrap(), kept, "a refused end leaves the config as it was");
    let said = text(&resume("512").assert().success().get_output().stderr);
    assert!(said.contains("resuming ") && said.contains("simulator dials, this process\n"), "{said}");
    assert!(said.contains("up to step 512"), "{said}");
    for file in ["policies.safetensors", "returns.csv", "training.csv"] {
        assert_eq!(fs::read(part.join(file)).unwrap(), fs::read(whole.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn bad_configs_are_refused_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run");
    let refused = |config: &str, more: &[&str], parts: &[&str]| {
        let mut args = vec!["train", config, "--out", out.to_str().unwrap()];
        args.extend(more);
        assert_refused(&mut dials_traffic(&args), parts);
        assert!(!out.exists(), "{parts:?}");
    };
    refused("no/such.toml", &[], &["no/such.toml: cannot be read", "caused by: No such file"]);
    let unknown = write_config(dir.path(), "simulatr = 'gs'");
    refused(&unknown, &[], &["small.toml: ", "unknown field `simulatr`", "line 1"]);
    let mistyped = write_config(dir.path(), "total_steps = 'many'");
    refused(&mistyped, &[], &["\"many\" is given", "line 1"]);
    let good = write_config(dir.path(), SHORT);
    refused(&good, &["--set", "ppo.clip=-1"], &["ppo.clip = -1: must be a positive number"]);
    refused(&good, &["--set", "ppo.nonsense=1"], &["unknown field `nonsense`"]);
    refused(&good, &["--steps", "0"], &["stop_at_steps = 0: must be at least 1"]);
    refused(
        &good,
        &["--steps", "513"],
        &["stop_at_steps = 513: is larger than total_steps = 512", "raise total_steps"],
    );
    refused(&good, &["--set", "aip.epochs=0"], &["aip.epochs = 0: must be at least 1", "predictor = \"untrained\""]);
    refused(
        &good,
        &["--set", "aip.retrain=drift"],
        &["aip.retrain = \"drift\": needs the loss", "set evaluation.aip_loss_episodes"],
    );
    refused(
        &good,
        &["--set", "aip.retrain=sometimes"],
        &["aip.retrain: `sometimes` is no allowed value; allowed: ", "`drift`"],
    );
    refused(&good, &["--set", "evaluation.every_steps=64"], &["must be at least ppo.memory = 128"]);
    refused(&good, &["--set", "total_steps=9000000000000000000"], &["must be at most 1000000000000000"]);
    refused(
        &good,
        &["--set", "traffic.network=/nowhere/grid_3x2"],
        &["/nowhere/grid_3x2.net.xml", "dials-traffic nets grid --rows 3 --cols 2"],
    );
}

/// Makes a copy of the networks in which one file is changed.
fn spoiled_nets(dir: &Path, file: &str, spoil: impl Fn(String) -> String) -> PathBuf {
    let copy = dir.join("spoiled");
    fs::create_dir_all(&copy).unwrap();
    let files = fs::read_dir(nets()).unwrap().map(|entry| entry.unwrap().path());
    for file in files.filter(|path| path.is_file()) {
        fs::copy(&file, copy.join(file.file_name().unwrap())).unwrap();
    }
    let text = spoil(fs::read_to_string(copy.join(file)).unwrap());
    fs::write(copy.join(file), text).unwrap();
    copy
}

#[test]
fn wrong_networks_are_refused_with_their_name_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let out = dir.path().join("run");
    let renamed = |from: &'static str, to: &'static str| move |text: String| text.replace(from, to);
    let (malformed, cut) = (|_| "<net>\n  <junction id=\n</net>".to_owned(), |text: String| text[..200].to_owned());
    type Spoil = Box<dyn Fn(String) -> String>;
    let spoils: [(&str, Spoil, &str); 10] = [
        ("grid_2x2.net.xml", Box::new(malformed), "is not XML"),
        ("grid_2x2.net.xml", Box::new(renamed("id=\"w0_r0c0_0\"", "id=\"other_0\"")), "remake it with"),
        ("grid_2x2.rou.xml", Box::new(cut), "nets grid --rows 2 --cols 2 --out"),
        (
            "grid_2x2.rou.xml",
            Box::new(renamed("edges=\"w0_r0c0 ", "edges=\"nowhere ")),
            "nets grid --rows 2 --cols 2 --out",
        ),
        ("grid_2x2.actuated.add.xml", Box::new(renamed("\"r0c0\"", "\"x\"")), "remake it with"),
        ("local.net.xml", Box::new(malformed), "is not XML"),
        (
            "local.net.xml",
            Box::new(|_| fs::read_to_string(nets().join("grid_2x2.net.xml")).unwrap()),
            "is a grid of 2x2",
        ),
        ("local.rou.xml", Box::new(cut), "is not XML"),
        ("local.rou.xml", Box::new(renamed("w0_to_e0", "x")), "nets local --out"),
        ("local.rou.xml", Box::new(renamed("\"car\"", "\"bus\"")), "nets local --out"),
    ];
    for (file, spoil, told) in spoils {
        let nets = spoiled_nets(dir.path(), file, spoil);
        let network = format!("traffic.network={}", nets.join("grid_2x2").display());
        let local = format!("traffic.local_network={}", nets.join("local").display());
        let args = ["train", &config, "--out", out.to_str().unwrap(), "--set", &network, "--set", &local];
        let name = file.split('.').next().unwrap();
        assert_refused(&mut dials_traffic(&args), &[name, told]);
        assert!(!out.exists(), "{file}");
    }
    let nets = spoiled_nets(dir.path(), "grid_2x2.rou.xml", cut);
    let spoiled = dir.path().join("spoiled.toml");
    let text = fs::read_to_string(&config).unwrap().replace(&nets_text(), nets.to_str().unwrap());
    fs::write(&spoiled, text).unwrap();
    let args = ["baseline", spoiled.to_str().unwrap(), "--controller", "never"];
    assert_refused(
        &mut dials_traffic(&args),
        &["grid_2x2.net.xml: this network cannot be simulated", "remake it with"],
    );
}

/// Replaces every occurrence of a text in a file.
fn edit(path: &Path, from: &str, to: &str) {
    let before = fs::read_to_string(path).unwrap();
    assert!(before.contains(from), "{from} is not in {}", path.display());
    fs::write(path, before.replace(from, to)).unwrap();
}

#[test]
fn a_net_with_shorter_lanes_is_refused_by_whatever_would_simulate_it_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let (config, run) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &run, &[]).success();
    let told = "grid_2x2.net.xml: lane \"e0_r0c1_0\": length=\"60.00\", and this program simulates length=\"100.00\"";
    let way_out = "remake it with: dials-traffic nets grid --rows 2 --cols 2 --out";

    let nets =
        spoiled_nets(dir.path(), "grid_2x2.net.xml", |text| text.replace("length=\"100.00\"", "length=\"60.00\""));
    // The lengths of edges are compared before those of their lanes.
    edit(&nets.join("grid_2x2.net.xml"), "priority=\"-1\" length=\"60.00\"", "priority=\"-1\" length=\"100.00\"");
    edit(Path::new(&config), &nets_text(), nets.to_str().unwrap());
    let before = names_in(dir.path());
    let out = dir.path().join("out");
    let places = ["--csv", out.to_str().unwrap()];
    assert_refused(&mut dials_traffic(&["train", &config, "--out", out.to_str().unwrap()]), &[told, way_out]);
    let baseline = ["baseline", &config, "--controller", "never"];
    assert_refused(&mut dials_traffic(&[&baseline[..], &places].concat()), &[told, way_out]);

    // A run keeps a copy of its networks under fixed names.
    edit(
        &run.join("networks/global.net.xml"),
        "\"e0_r0c1_0\" index=\"0\" speed=\"10.00\"",
        "\"e0_r0c1_0\" index=\"0\" speed=\"15.00\"",
    );
    let told =
        ["networks/global.net.xml: lane \"e0_r0c1_0\": speed=\"15.00\"", "nets grid --rows 2 --cols 2 --out DIR"];
    let run = run.to_str().unwrap();
    assert_refused(&mut dials_traffic(&[&["evaluate", run][..], &places].concat()), &told);
    assert_refused(&mut dials_traffic(&["train", "--resume", run]), &told);
    assert_refused(&mut dials_traffic(&["replay", run, "--out", out.to_str().unwrap()]), &told);
    assert_eq!(names_in(dir.path()), before);
}

fn names_in(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

#[test]
fn weights_that_are_no_finite_numbers_are_refused_wherever_they_would_be_played_or_exported() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &out, &[]).success();
    for (file, bad) in [("policies.safetensors", f32::NAN), ("aips.safetensors", f32::INFINITY)] {
        // The last number of a file is the last of a tensor, so it belongs to the last agent.
        let mut bytes = fs::read(out.join(file)).unwrap();
        let end = bytes.len();
        bytes[end - 4..].copy_from_slice(&bad.to_le_bytes());
        fs::write(out.join(file), bytes).unwrap();
    }
    let (run, new) = (out.to_str().unwrap(), dir.path().join("new"));
    let new_path = new.to_str().unwrap();
    let of_policies =
        ["policies.safetensors: `layers.", "of agent 3 holds NaN, which is not a finite number", "train again"];
    for args in [
        &["evaluate", run, "--csv", new_path][..],
        #[cfg(feature = "torch")]
        &["export", run, "--out", new_path],
        &["replay", run, "--out", new_path],
    ] {
        assert_refused(&mut dials_traffic(args), &of_policies);
        assert!(!new.exists(), "{args:?}");
    }
    let compare = ["baseline", &config, "--compare", &format!("never,{run}"), "--episodes", "1"];
    assert_refused(&mut dials_traffic(&compare), &of_policies);

    // Only `replay --local` plays AIPs (approximate influence predictors).
    let retrained = dir.path().join("retrained");
    train(&config, &retrained, &[]).success();
    fs::copy(out.join("aips.safetensors"), retrained.join("aips.safetensors")).unwrap();
    let local = ["replay", retrained.to_str().unwrap(), "--local", "0", "--out", new_path];
    assert_refused(&mut dials_traffic(&local), &["aips.safetensors: `", "of agent 3 holds inf", "train again"]);
    assert!(!new.exists());
}

fn nets_text() -> String {
    nets().display().to_string()
}

#[test]
fn paths_that_sumo_would_misread_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let comma = dir.path().join("a,b");
    fs::create_dir(&comma).unwrap();
    let files = fs::read_dir(nets()).unwrap().map(|entry| entry.unwrap().path());
    for file in files.filter(|path| path.is_file()) {
        fs::copy(&file, comma.join(file.file_name().unwrap())).unwrap();
    }
    let out = dir.path().join("run");
    let train = ["train", &config, "--out", out.to_str().unwrap()];
    let network = format!("traffic.network={}", comma.join("grid_2x2").display());
    let told = ["a,b", "contains a comma, at which SUMO would split it"];
    assert_refused(dials_traffic(&train).args(["--set", &network]), &told);
    assert_refused(&mut dials_traffic(&["train", &config, "--out", comma.join("run").to_str().unwrap()]), &told);
    assert_refused(&mut dials_traffic(&["nets", "local", "--out", comma.to_str().unwrap()]), &told);
    let strange = dir.path().join(OsStr::from_bytes(b"\xff"));
    assert_refused(dials_traffic(&["train", &config, "--out"]).arg(&strange), &["is not UTF-8"]);
    assert!(!out.exists() && !comma.join("run").exists() && !strange.exists());
}

#[test]
fn an_unwritable_place_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    let out = file.join("run");
    assert_refused(
        &mut dials_traffic(&["train", &config, "--out", out.to_str().unwrap()]),
        &["file/run: cannot be made", "caused by: Not a directory"],
    );
    assert_refused(&mut dials_traffic(&["nets", "local", "--out", out.to_str().unwrap()]), &["file/run"]);
}

#[test]
fn a_run_that_has_ended_is_left_alone_by_a_resume_unless_its_last_evaluation_is_to_be_another_one() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    train(&config, &out, &["--set", "evaluation.final_episodes=2"]).success();
    let files = ["returns.csv", "episodes.csv", "timing.csv", "config.toml", "run.json"];
    let bytes = || files.map(|file| fs::read(out.join(file)).unwrap());
    let resume =
        || text(&dials_traffic(&["train", "--resume", out.to_str().unwrap()]).assert().success().get_output().stderr);
    let before = bytes();
    let said = resume();
    assert!(said.contains("note: this run has ended, at step ") && before == bytes(), "{said}");
    let kept = fs::read_to_string(out.join("config.toml")).unwrap();
    assert_eq!(kept.matches("final_episodes = 2").count(), 1, "{kept}");
    fs::write(out.join("config.toml"), kept.replace("final_episodes = 2", "final_episodes = 3")).unwrap();
    let said = resume();
    assert!(!said.contains("this run has ended") && bytes()[1] != before[1], "{said}");
}

#[test]
fn networks_that_are_lost_or_damaged_come_back_with_a_resume() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    let out_name = out.to_str().unwrap();
    train(&config, &out, &[]).success();
    let files = ["policies.safetensors", "aips.safetensors"].map(|file| out.join(file));
    let whole = files.clone().map(|file| fs::read(file).unwrap());
    let resume = || text(&dials_traffic(&["train", "--resume", out_name]).assert().success().get_output().stderr);
    let damages: [fn(&Path); 3] = [
        |file| fs::remove_file(file).unwrap(),
        |file| fs::write(file, &fs::read(file).unwrap()[..100]).unwrap(),
        |file| fs::write(file, b"").unwrap(),
    ];
    for damage in damages {
        damage(&files[0]);
        assert_refused(&mut dials_traffic(&["evaluate", out_name]), &["policies.safetensors", "train --resume"]);
        damage(&files[1]);
        let said = resume();
        for name in ["policies.safetensors", "aips.safetensors"] {
            assert!(said.contains(&format!("{name}: was lost or damaged; made again from the checkpoint")), "{said}");
        }
        assert!(said.contains("this run has ended"), "{said}");
        assert!(files.clone().map(|file| fs::read(file).unwrap()) == whole, "not the same bytes");
        assert!(!resume().contains("made again"));
    }
    // A loss of power may leave anything after what a checkpoint counts on.
    let losses = out.join("aip_loss.csv");
    let before = fs::read(&losses).unwrap();
    fs::write(&losses, [&before[..], b"\0\0\n"].concat()).unwrap();
    damages[0](&files[1]);
    assert!(resume().contains("aips.safetensors: was lost or damaged"));
    assert!(fs::read(&losses).unwrap() == before && fs::read(&files[1]).unwrap() == whole[1]);
}

#[test]
fn evaluate_refuses_what_is_no_run_or_of_another_shape() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    let out_name = out.to_str().unwrap();
    assert_refused(&mut dials_traffic(&["evaluate", out_name]), &["run: no such run directory", "dials-traffic train"]);
    train(&config, &out, &[]).success();
    let holds = "not a run directory; it holds 1 run: name one, such as ";
    assert_refused(&mut dials_traffic(&["evaluate", dir.path().to_str().unwrap()]), &[holds, out_name]);
    let kept = fs::read_to_string(out.join("config.toml")).unwrap();
    let other = kept.replacen("16", "24", 1);
    assert_ne!(kept, other);
    fs::write(out.join("config.toml"), other).unwrap();
    assert_refused(
        &mut dials_traffic(&["evaluate", out_name]),
        &["policies.safetensors: `layers.0.weight` is F32 [4, 40, 16]", "it must be F32 [4, 40, 24]"],
    );
    fs::write(out.join("config.toml"), kept).unwrap();
    fs::write(out.join("policies.safetensors"), "torn").unwrap();
    assert_refused(&mut dials_traffic(&["evaluate", out_name]), &["not a safetensors file, or cut short"]);
}

#[test]
fn baselines_print_a_table_or_json_and_refuse_unknown_names() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let args = ["baseline", &config, "--controller", "gap-out", "--episodes", "2", "--seed", "1"];
    let table = text(&dials_traffic(&args).assert().success().get_output().stdout);
    assert!(table.starts_with("return ") && table.contains("p_switch_given_green"), "{table}");
    let json = dials_traffic(&[&args[..], &["--json"]].concat()).assert().success();
    let found: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    for key in ["mean_return", "std_error", "episodes", "agents", "seed", "sumo_version", "collisions", "teleports"] {
        assert!(!found[key].is_null(), "{key}: {found}");
    }
    assert_eq!(found["per_agent"].as_array().unwrap().len(), 4);
    assert_refused(
        &mut dials_traffic(&["baseline", &config, "--controller", "fastest"]),
        &["controller `fastest`: unknown; one of random, never, always, switch-every-K, program, actuated, gap-out"],
    );
}

/// Reads a CSV file. Returns a map from column to value for each line.
fn read_csv(path: &Path) -> Vec<HashMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(|line| line.unwrap()).collect()
}

#[test]
fn controllers_and_runs_are_compared_on_the_same_traffic() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), "total_steps = 128"), dir.path().join("run"));
    train(&config, &out, &["--workers", "0"]).success();
    let (run, csv) = (out.to_str().unwrap(), dir.path().join("csv"));
    let list = format!("never,gap-out,{run}");
    let args = ["baseline", &config, "--compare", &list, "--episodes", "3", "--seed", "4"];
    let table = text(&dials_traffic(&args).assert().success().get_output().stdout);
    assert!(table.starts_with("mean +- half of its 95 % interval over 3 episodes"), "{table}");
    for part in [
        "return",
        "delay_s",
        "queue_length",
        "\nnever ",
        "\ngap-out ",
        run,
        "difference from never (paired by episode)",
    ] {
        assert!(table.contains(part), "`{part}`: {table}");
    }
    assert!(table.lines().all(|line| line.chars().count() <= 80 || line.contains(run)), "{table}");

    let json = dials_traffic(&args).args(["--json", "--csv", csv.to_str().unwrap()]).assert().success();
    let found: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    let controllers = found["controllers"].as_array().unwrap();
    assert_eq!(
        (controllers.len(), &controllers[1]["controller"], &controllers[2]["run"]),
        (3, &"gap-out".into(), &run.into())
    );
    let difference = &found["differences"][0];
    assert_eq!((&difference["of"], &difference["less"]), (&"gap-out".into(), &"never".into()));
    let mean = |of: &Value, key: &str| of[key].as_f64().unwrap();
    assert_eq!(controllers[1]["return"], controllers[1]["mean_return"]);
    let expected = mean(&controllers[1], "return") - mean(&controllers[0], "return");
    assert!((mean(&difference["return"], "mean") - expected).abs() < 1e-9);

    let lines = read_csv(&csv.join("episodes.csv"));
    assert_eq!(lines.len(), 3 * 3);
    let number = |line: &HashMap<String, String>, key: &str| line[key].parse::<f64>().unwrap();
    for (index, line) in lines.iter().enumerate() {
        assert_eq!(line["episode"], (index % 3).to_string());
        // The number of arriving cars is the same for all players.
        let wanted = |line| number(line, "departed") + number(line, "backlog");
        assert_eq!(wanted(line), wanted(&lines[index % 3]));
    }
    let of_gap_out = lines[3..6].iter().map(|line| number(line, "delay_s")).sum::<f64>() / 3.0;
    assert!((of_gap_out - mean(&controllers[1], "delay_s")).abs() < 1e-9);
    let agents = read_csv(&csv.join("agents.csv"));
    assert_eq!(agents.len(), 3 * 3 * 4);
    let returns = agents[..4].iter().map(|line| number(line, "return")).sum::<f64>() / 4.0;
    assert!((returns - number(&lines[0], "return")).abs() < 1e-9);

    // Each player has the same figures alone as in the comparison.
    let alone = dials_traffic(&["evaluate", run, "--episodes", "3", "--seed", "4", "--json"]).assert().success();
    let alone: Value = serde_json::from_slice(&alone.get_output().stdout).unwrap();
    for key in ["mean_return", "delay_s", "half_width_95", "per_agent"] {
        assert_eq!(alone[key], controllers[2][key], "{key}");
    }
    assert_refused(dials_traffic(&args).args(["--csv", csv.to_str().unwrap()]), &["episodes.csv: exists already"]);

    // The title and the label say whether policies are sampled or greedy.
    assert!(table.contains("the same traffic for all,\nsampled policies\n"), "{table}");
    let csv = dir.path().join("greedy");
    let greedy = dials_traffic(&args).args(["--greedy", "--csv", csv.to_str().unwrap()]).assert().success();
    let table = text(&greedy.get_output().stdout);
    let label = format!("{run} (greedy)");
    assert!(table.contains("the same traffic for all,\ngreedy policies\n") && table.contains(&label), "{table}");
    let lines = read_csv(&csv.join("episodes.csv"));
    assert_eq!(lines[6]["controller"], label);
    let args = ["evaluate", run, "--episodes", "3", "--seed", "4", "--json", "--greedy"];
    let alone: Value = serde_json::from_slice(&dials_traffic(&args).assert().success().get_output().stdout).unwrap();
    let returns = lines[6..].iter().map(|line| number(line, "return")).sum::<f64>() / 3.0;
    assert!((returns - mean(&alone, "return")).abs() < 1e-9);
    dials_traffic(&["baseline", &config, "--controller", "never", "--greedy"]).assert().code(2);
}

#[test]
fn a_controller_is_itself_where_a_directory_has_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    fs::create_dir(dir.path().join("never")).unwrap();
    let compare = |list: &str| {
        let mut command = dials_traffic(&["baseline", &config, "--episodes", "2", "--compare", list]);
        command.current_dir(dir.path());
        command
    };
    let table = text(&compare("never,fixed-time,fixed-time:green=10").assert().success().get_output().stdout);
    assert!(table.contains("\ndifference from never (paired by episode)\n"), "{table}");
    assert_refused(&mut compare("gap-out,./never"), &["./never: not a run directory"]);
    // 10 is the default of `green`.
    let table = text(&compare("fixed-time,fixed-time:green=10").assert().success().get_output().stdout);
    let told = "difference from fixed-time (paired by episode)\nno figure differs in any episode\n";
    assert!(table.contains(told), "{table}");
}

#[test]
fn a_comparison_refuses_what_cannot_be_compared_before_anything_plays() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), "total_steps = 128");
    let compare = |list: &str| dials_traffic(&["baseline", &config, "--compare", list]);
    assert_refused(&mut compare("never,fastest"), &["controller `fastest`: unknown"]);
    assert_refused(&mut compare("never,no/such"), &["no/such: no such run directory"]);
    assert_refused(&mut compare("never,gap-out,never"), &["--compare: `never` is named twice"]);
    assert_refused(&mut compare("never,,gap-out"), &["--compare `never,,gap-out`: a name is empty"]);
    compare("never").args(["--controller", "never"]).assert().code(2);
    dials_traffic(&["baseline", &config]).assert().code(2);
    let warehouse = dir.path().join("warehouse.toml");
    fs::write(&warehouse, "total_steps = 128\nwarehouse = { agents_per_side = 2 }\n").unwrap();
    let run = dir.path().join("run");
    train(warehouse.to_str().unwrap(), &run, &["--workers", "0", "--simulator", "gs"]).success();
    let told = ["run: agent 0 has 37 inputs and 4 actions, but 40 and 2 in this config"];
    assert_refused(&mut compare(&format!("never,{}", run.display())), &told);
    let run = run.to_str().unwrap();
    let told = ["run: is a run directory, not a controller; use `evaluate`, `replay` or --compare"];
    assert_refused(&mut dials_traffic(&["baseline", &config, "--controller", run]), &told);
}

#[test]
fn places_to_write_to_are_checked_before_anything_plays() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let command = |words: &str| {
        let mut command = dials_traffic(&words.split(' ').collect::<Vec<_>>());
        command.arg(&config).current_dir(dir.path());
        command
    };
    let never = "baseline --controller never";
    let told = "must not write to the same place";
    assert_refused(&mut command(&format!("{never} --csv d --plot d")), &["d: --csv and --plot", told]);
    assert_refused(&mut command(&format!("{never} --csv d/csv --plot ./d")), &["./d: --csv and --plot", told]);
    let film = "replay --controller never --out x.gif --video x.gif";
    assert_refused(&mut command(film), &["x.gif: --out and --video", told]);

    // Nobody can make a file in /proc, not even root.
    let tune = "baseline --controller fixed-time --tune --tune-episodes 1";
    assert_refused(&mut command(&format!("{tune} --csv /proc")), &["/proc: cannot be written to"]);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing but the config");
    symlink("/proc", dir.path().join("tuned")).unwrap();
    assert_refused(&mut command(tune), &["tuned: cannot be written to"]);

    fs::create_dir(dir.path().join("pictures")).unwrap();
    fs::write(dir.path().join("pictures/episode.gif"), "precious").unwrap();
    let told = ["pictures: exists already; name another place with --render, or move it aside with --force"];
    assert_refused(&mut command(&format!("{never} --render pictures")), &told);
    assert_eq!(fs::read(dir.path().join("pictures/episode.gif")).unwrap(), b"precious");
}

#[test]
fn existing_outputs_are_refused_and_force_moves_them_aside() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let play = |more: &str| {
        let words = format!("baseline --controller never --episodes 1 {more}");
        let mut command = dials_traffic(&words.split(' ').collect::<Vec<_>>());
        command.arg(&config).current_dir(dir.path());
        command
    };
    let outputs = "--csv tables --plot plots";
    play(outputs).assert().success();
    assert_refused(&mut play("--csv tables"), &["tables/episodes.csv: exists already", "with --csv", "--force"]);
    assert_refused(&mut play("--plot plots"), &["plots: exists already", "with --plot", "--force"]);
    fs::write(dir.path().join("plots/queues.svg"), "precious").unwrap();
    fs::write(dir.path().join("tables/episodes.csv"), "precious").unwrap();
    play(&format!("{outputs} --force")).assert().success();
    for (new, old) in
        [("plots/queues.svg", "plots.old-1/queues.svg"), ("tables/episodes.csv", "tables/episodes.csv.old-1")]
    {
        assert_ne!(fs::read(dir.path().join(new)).unwrap(), b"precious");
        assert_eq!(fs::read(dir.path().join(old)).unwrap(), b"precious");
    }
    // A run is never in the way of a picture.
    train(&config, &dir.path().join("run"), &["--workers", "0"]).success();
    assert_refused(&mut play("--plot run --force"), &["run: is a run directory"]);
}

#[test]
fn fixed_time_is_tuned_once_and_the_file_says_on_what() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    let baseline = |more: &[&str]| {
        let mut command = dials_traffic(&["baseline", &config, "--episodes", "2"]);
        command.args(more).current_dir(dir.path());
        command
    };
    let tune = ["--controller", "fixed-time", "--tune", "--tune-episodes", "1"];
    let first = baseline(&tune).assert().success().get_output().clone();
    assert!(text(&first.stderr).contains(".toml: tuned on 1 episode, return "), "{}", text(&first.stderr));
    let files: Vec<PathBuf> =
        fs::read_dir(dir.path().join("tuned")).unwrap().map(|entry| entry.unwrap().path()).collect();
    let [file] = &files[..] else { panic!("{files:?}") };
    let kept = fs::read_to_string(file).unwrap();
    let parts =
        ["offsets = [", "network = \"grid_2x2\"", "network_crc32 = ", "horizon = 40", "episodes = 1", "seed = \"1\""];
    for part in parts.into_iter().chain(["search_version = ", "sumo_version = "]) {
        assert!(kept.contains(part), "`{part}`: {kept}");
    }
    let again = baseline(&tune).assert().success().get_output().clone();
    assert!(text(&again.stderr).contains("uses the timings of an earlier search"));
    assert_eq!(again.stdout, first.stdout);
    let by_hand = format!("fixed-time:file={}", file.display());
    assert_eq!(baseline(&["--controller", &by_hand]).assert().success().get_output().stdout, first.stdout);

    fs::write(file, kept.replace("horizon = 40", "horizon = 50")).unwrap();
    assert_refused(&mut baseline(&tune), &["was tuned for another setting; move it away"]);
    assert_refused(&mut baseline(&["--controller", "gap-out", "--tune"]), &["--tune: tunes fixed-time"]);
    let told = ["--tune: searches all timings of fixed-time, but `fixed-time:green=8` already sets some of them"];
    assert_refused(&mut baseline(&["--controller", "fixed-time:green=8", "--tune"]), &told);
    baseline(&["--controller", "fixed-time", "--tune-episodes", "1"]).assert().code(2);
    let warehouse = dir.path().join("warehouse.toml");
    fs::write(&warehouse, "total_steps = 128\nwarehouse = { agents_per_side = 2 }\n").unwrap();
    let args = ["baseline", warehouse.to_str().unwrap(), "--controller", "fixed-time", "--tune"];
    assert_refused(&mut dials_traffic(&args), &["controller `fixed-time`: unknown"]);
}

#[test]
fn some_agents_are_evaluated_in_front_of_a_hand_coded_background() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), "total_steps = 128"), dir.path().join("run"));
    train(&config, &out, &["--workers", "0"]).success();
    let evaluate = |more: &[&str]| {
        let mut command = dials_traffic(&["evaluate", out.to_str().unwrap(), "--episodes", "1"]);
        command.args(more);
        command
    };
    let json = evaluate(&["--background", "never", "--agents", "0,3", "--json"]).assert().success();
    let found: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    assert_eq!((&found["background"], &found["policies_of"]), (&"never".into(), &vec![0, 3].into()));
    let switches = |agent: usize| found["per_agent"][agent]["p_switch_given_green"].as_f64().unwrap() > 0.0;
    assert_eq!([0, 1, 2, 3].map(switches), [true, false, false, true]);

    assert_refused(
        &mut evaluate(&["--background", "never", "--agents", "0,4"]),
        &["--agents: there is no agent `4`; the agents are 0 to 3, by name r0c0, r0c1, r1c0, r1c1"],
    );
    assert_refused(
        &mut evaluate(&["--background", "never", "--agents", "r0c9"]),
        &["--agents: there is no agent `r0c9`; the agents are 0 to 3, by name r0c0"],
    );
    assert_refused(&mut evaluate(&["--background", "fastest", "--agents", "0"]), &["controller `fastest`: unknown"]);
    evaluate(&["--background", "never"]).assert().code(2);
    evaluate(&["--agents", "0"]).assert().code(2);
}

#[test]
fn nets_are_written_where_asked_and_a_missing_netconvert_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("nets");
    let args = ["nets", "grid", "--rows", "1", "--cols", "2", "--out", out.to_str().unwrap()];
    let said = text(&dials_traffic(&args).assert().success().get_output().stdout);
    assert!(said.contains("sumo-gui -c") && out.join("grid_1x2.sumocfg").is_file(), "{said}");

    // The same again changes nothing. A file that differs is refused, or moved aside, as everywhere.
    dials_traffic(&args).assert().success();
    fs::write(out.join("grid_1x2.rou.xml"), "mine").unwrap();
    assert_refused(&mut dials_traffic(&args), &["grid_1x2.rou.xml: exists already", "--force"]);
    dials_traffic(&args).arg("--force").assert().success();
    assert_eq!(fs::read_to_string(out.join("grid_1x2.rou.xml.old-1")).unwrap(), "mine");
    assert_eq!(fs::read_dir(&out).unwrap().count(), 5, "the files that were right already stay");

    let elsewhere = dir.path().join("elsewhere");
    let args = ["nets", "local", "--out", elsewhere.to_str().unwrap()];
    let library = dir.path().join("libsumocpp.so");
    std::os::unix::fs::symlink(&libsumo::load().unwrap().file, &library).unwrap();
    let mut without_programs = dials_traffic(&args);
    without_programs.env("PATH", "").env("DIALS_SUMO_LIBRARY", library);
    assert_refused(&mut without_programs, &["netconvert was not found", "apt install sumo"]);
    assert!(!elsewhere.exists() || fs::read_dir(&elsewhere).unwrap().next().is_none());
    assert_refused(
        &mut dials_traffic(&["nets", "grid", "--rows", "1000", "--cols", "1000", "--out", "x"]),
        &["a grid of 1000x1000: must have at most 10000 intersections"],
    );
}

#[test]
fn the_time_of_a_scenario_can_be_set_wherever_one_is_taken() {
    let town = "sumo_nets/town/town.sumocfg";
    let times = ["--begin", "600", "--end", "00:15:00"];
    let settings = ["--set", "traffic.begin_s=600", "--set", "traffic.end_s=900"];
    for command in [
        &["baseline", town, "--controller", "program", "--episodes", "1", "--json"][..],
        &["describe", town, "--json"],
        &["nets", "inspect", town, "--json"],
    ] {
        let [by_option, by_setting] = [times, settings]
            .map(|more| text(&dials_traffic(&[command, &more].concat()).assert().success().get_output().stdout));
        assert_eq!(by_option, by_setting, "{command:?}");
        let whole = text(&dials_traffic(command).assert().success().get_output().stdout);
        assert!(command[0] == "nets" || whole != by_option, "{command:?}");
    }
    assert_refused(&mut dials_traffic(&["nets", "inspect", town, "--end", "noon"]), &["--end", "07:00:00"]);
}

#[test]
fn info_tells_versions_and_places() {
    let said = text(&dials_traffic(&["info"]).assert().success().get_output().stdout);
    let torch = if cfg!(feature = "torch") { ["libtorch 1.13", "libtorch_cpu"] } else { ["no libtorch", "`torch`"] };
    let sumo = ["SUMO 1.", "libsumocpp", "looked at: libsumocpp.so (the system)", "netconvert at /"];
    for part in ["dials-traffic 0."].into_iter().chain(sumo).chain(torch) {
        assert!(said.contains(part), "`{part}`: {said}");
    }
}

#[test]
fn without_its_program_for_libtorch_info_and_doctor_say_so_and_go_on() {
    let room = tempfile::tempdir().unwrap();
    let alone = room.path().join("dials-traffic");
    let program = assert_cmd::cargo::cargo_bin!("dials-traffic");
    // A link costs nothing, but works on the same disk only.
    fs::hard_link(program, &alone).or_else(|_| fs::copy(program, &alone).map(drop)).unwrap();
    let info = text(&Command::new(&alone).arg("info").assert().success().get_output().stdout);
    assert!(info.contains("no libtorch: "), "{info}");
    let doctor = text(&Command::new(&alone).arg("doctor").assert().success().get_output().stdout);
    assert!(doctor.contains("missing  libtorch: needed for `export`"), "{doctor}");
}

#[test]
fn asking_for_nothing_or_nonsense_exits_with_2() {
    dials_traffic(&[]).assert().code(2);
    dials_traffic(&["trian"]).assert().code(2);
    dials_traffic(&["--help"]).assert().success();
}
