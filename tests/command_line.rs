//! The command line as a user meets it: what it prints, writes and refuses.

use std::fs;
use std::path::{Path, PathBuf};

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

/// A config of 512 timesteps on the 2x2 grid, with lines of `more` at its top.
fn write_config(dir: &Path, more: &str) -> String {
    let path = dir.join("small.toml");
    let nets = nets().display().to_string();
    let text = format!(
        "{more}\n[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 40\n\
         [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n\
         [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 160\nbatch = 32\nepochs = 2\n\
         [evaluation]\nevery_steps = 256\nepisodes = 2\n"
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

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Asserts exit code 2 and one error that says all of `parts`.
fn assert_refused(command: &mut Command, parts: &[&str]) {
    let output = command.assert().code(2).get_output().clone();
    let said = text(&output.stderr);
    assert!(said.starts_with("error: ") && said.matches("error:").count() == 1, "{said}");
    for part in parts {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    assert!(output.stdout.is_empty());
}

#[test]
fn a_run_leaves_a_directory_that_can_be_evaluated_anywhere() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    let assert = train(&config, &out, &["--seed", "5"]).success();
    let said = text(&assert.get_output().stdout);
    let evaluate = format!("dials-traffic evaluate {} --episodes 2 --seed 5", out.display());
    assert!(said.contains(&evaluate), "the exact command is told: {said}");
    for file in [
        "config.toml",
        "run.json",
        "returns.csv",
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
    assert!(run["versions"]["sumo"].as_str().unwrap().contains("1.15"));

    // It has its own networks, so it can go anywhere.
    let elsewhere = dir.path().join("elsewhere");
    fs::rename(&out, &elsewhere).unwrap();
    fs::remove_file(&config).unwrap();
    let json = dials_traffic(&["evaluate", elsewhere.to_str().unwrap(), "--seed", "5", "--json"]).assert().success();
    let found: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    assert_eq!((&found["episodes"], &found["agents"], &found["seed"]), (&2.into(), &4.into(), &5.into()));
    assert!(found["std_error"].is_f64() && found["sumo_version"].is_string());

    // The last evaluation of the run played the same episodes with the same policies.
    let returns = fs::read_to_string(elsewhere.join("returns.csv")).unwrap();
    let last = returns.lines().rfind(|line| line.split(',').nth(1) == Some("all")).unwrap();
    let mean: f64 = last.split(',').nth(2).unwrap().parse().unwrap();
    assert!((found["mean_return"].as_f64().unwrap() - mean).abs() < 1e-4, "{found} {last}");
}

#[test]
fn the_same_seed_gives_the_same_returns_byte_for_byte() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    for simulator in ["dials", "gs", "untrained-dials"] {
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
    refused(&mistyped, &[], &["invalid type: string \"many\"", "line 1"]);
    let good = write_config(dir.path(), SHORT);
    refused(&good, &["--set", "ppo.clip=-1"], &["ppo.clip = -1: must be a positive number"]);
    refused(&good, &["--set", "ppo.nonsense=1"], &["unknown field `nonsense`"]);
    refused(&good, &["--steps", "0"], &["stop_at_steps = 0: must be at least 1"]);
    refused(
        &good,
        &["--set", "traffic.network=/nowhere/grid_3x2"],
        &["/nowhere/grid_3x2.net.xml", "dials-traffic nets grid --rows 3 --cols 2"],
    );
}

#[test]
fn a_malformed_network_is_refused_with_its_name_and_place() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), SHORT);
    for file in fs::read_dir(nets()).unwrap().map(|entry| entry.unwrap().path()) {
        fs::copy(&file, dir.path().join(file.file_name().unwrap())).unwrap();
    }
    let net = dir.path().join("grid_2x2.net.xml");
    fs::write(&net, "<net>\n  <junction id=\n</net>").unwrap();
    let network = format!("traffic.network={}", dir.path().join("grid_2x2").display());
    let out = dir.path().join("run");
    let args = ["train", &config, "--out", out.to_str().unwrap(), "--set", &network];
    assert_refused(&mut dials_traffic(&args), &["grid_2x2.net.xml"]);
    assert!(!out.exists());
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
fn evaluate_refuses_what_is_no_run_or_of_another_shape() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path(), SHORT), dir.path().join("run"));
    let out_name = out.to_str().unwrap();
    assert_refused(&mut dials_traffic(&["evaluate", out_name]), &["run: not a run directory", "dials-traffic train"]);
    train(&config, &out, &[]).success();
    let kept = fs::read_to_string(out.join("config.toml")).unwrap();
    let other = kept.replacen("16", "24", 1);
    assert_ne!(kept, other);
    fs::write(out.join("config.toml"), other).unwrap();
    assert_refused(
        &mut dials_traffic(&["evaluate", out_name]),
        &["policies.safetensors: `layers.0.weight` is F32 [4, 40, 16]", "asks for F32 [4, 40, 24]"],
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
        &["controller `fastest`: unknown; one of random, never, always, switch-every-K, actuated, gap-out"],
    );
}

#[test]
fn nets_are_written_where_asked_and_a_missing_netconvert_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("nets");
    let args = ["nets", "grid", "--rows", "1", "--cols", "2", "--out", out.to_str().unwrap()];
    let said = text(&dials_traffic(&args).assert().success().get_output().stdout);
    assert!(said.contains("sumo-gui -c") && out.join("grid_1x2.sumocfg").is_file(), "{said}");

    let elsewhere = dir.path().join("elsewhere");
    let args = ["nets", "local", "--out", elsewhere.to_str().unwrap()];
    assert_refused(dials_traffic(&args).env("PATH", ""), &["netconvert is not on the PATH", "setup.sh"]);
    assert!(!elsewhere.exists() || fs::read_dir(&elsewhere).unwrap().next().is_none());
    assert_refused(
        &mut dials_traffic(&["nets", "grid", "--rows", "0", "--cols", "2", "--out", "x"]),
        &["a grid of 0x2"],
    );
}

#[test]
fn info_tells_versions_and_places() {
    let said = text(&dials_traffic(&["info"]).assert().success().get_output().stdout);
    for part in ["dials-traffic 0.", "SUMO 1.15", "libsumocpp", "libtorch 1.13", "libtorch_cpu", "netconvert at /"] {
        assert!(said.contains(part), "`{part}`: {said}");
    }
}

#[test]
fn asking_for_nothing_or_nonsense_exits_with_2() {
    dials_traffic(&[]).assert().code(2);
    dials_traffic(&["trian"]).assert().code(2);
    dials_traffic(&["--help"]).assert().success();
}
