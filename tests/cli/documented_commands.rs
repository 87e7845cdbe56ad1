//! Every command of README and docs/ runs to its end, in the order in which a newcomer reads, in one folder.
//!
//! The folder is a fresh clone without its sources. Commands are typed as they are written, but for the rows of
//! [`SHORTER`]. Configs and experiments have short settings, so names of runs stay as they are. [`NOT_TYPED`] lists
//! what cannot run here, with the reason.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use toml::{Table, Value};

/// Parts of commands that are typed in another way: what is written, what is typed, and why.
const SHORTER: &[(&str, &str, &str)] = &[
    ("./setup.sh && cargo run --release -- ", "dials-traffic ", "all is installed and built already"),
    (
        "train configs/any_light.toml",
        "train configs/town.toml --steps 256 --out runs/any_light-gs-seed1 --set traffic.observation=lanes \
         --set policy.share=kind --set policy.separate_critic=false --set policy.hidden=[8,8]",
        "its islands are not made here",
    ),
    (
        "town.sumocfg --steps 21600 ",
        "town.sumocfg --steps 240 --set evaluation.episodes=1 --set evaluation.final_episodes=1 ",
        "time",
    ),
    ("any-light,max-pressure,program\n", "any-light,max-pressure,program --episodes 1\n", "time"),
    (
        "any.safetensors --on sumo_nets/town/town.sumocfg",
        "any.safetensors --on sumo_nets/town/town.sumocfg --episodes 1",
        "time",
    ),
    (" --gui", "", "there is no screen"),
    ("sumo-gui -c", "sumo --no-step-log --end 20 -c", "there is no screen"),
    ("mpirun -n 3 dials-traffic", "dials-traffic", "tests/training/mpi.rs trains over ranks"),
    ("baseline CONFIG ", "baseline configs/traffic_4.toml ", "the reader puts a config there"),
    ("gap-out,RUN\n", "gap-out,runs/traffic_4-dials-seed1\n", "the reader puts a run there"),
    ("NAME", "small_simulators_traffic", "the reader puts an experiment there"),
    (
        "town.sumocfg --steps 7200",
        "town.sumocfg --steps 240 --set ppo.memory=120 --set evaluation.episodes=1 --set evaluation.final_episodes=2",
        "time",
    ),
    ("traffic_100.toml --steps 20000", "busy_road.toml --steps 256", "time"),
    (
        "bench configs/traffic_100.toml --workers 2 --seconds 60",
        "bench configs/traffic_4.toml --workers 2 --seconds 1",
        "time",
    ),
    ("--seed 1 --steps 20000", "--seed 1 --steps 240", "time"),
    ("--episodes 10 --seed 0", "--episodes 1 --seed 0", "time"),
    ("--steps 4000000", "--steps 384", "time"),
    ("--rows 32 --cols 32", "--rows 2 --cols 2", "time"),
    ("big/grid_32x32", "big/grid_2x2", "it follows from the row above"),
    ("--steps 1024", "--steps 256", "time"),
    ("--steps 10000", "--steps 256", "time"),
    ("--episodes 30", "--episodes 1", "time"),
    ("--episodes 5", "--episodes 1", "time"),
    ("--tune", "--tune --tune-episodes 1", "time"),
    ("--video actuated.gif", "--seconds 60,64 --video actuated.gif", "time: a film has a picture for every second"),
    ("--seconds 600,900", "--seconds 600,604", "time: a film has a picture for every second"),
    ("--seconds 60,150", "--seconds 60,64", "time: a film has a picture for every second"),
    (".mp4", ".gif", "ffmpeg is not needed for the tests"),
];

/// Beginnings of lines that are not typed, and why.
const NOT_TYPED: &[(&str, &str)] = &[
    ("./setup.sh", "installs Debian's packages"),
    ("cargo install", "builds a program, which is built already"),
    ("docs/book.sh", "needs mdbook; .ci/run makes the book"),
    ("xdg-open", "there is no screen"),
    ("cargo build", "builds the program, which is built already"),
    ("cargo test", "these tests"),
    ("FUZZ_TIMES=", "tests that last as long as one asks"),
    ("CHAOS_KILLS=", "tests that last as long as one asks"),
    ("SOAK_SECONDS=", "tests that last as long as one asks"),
    ("cargo run --release --example", "tests/traffic/examples.rs runs the examples"),
    ("mpirun -n 9 target/", "tests/training/mpi.rs trains over ranks"),
    ("mpirun --hostfile", "needs several machines"),
    ("mpirun -n 3 --oversubscribe", "tests/training/mpi.rs trains over ranks"),
    ("dials-traffic benchmark resco", "needs a copy of RESCO; tests/cli/benchmark.rs makes a map"),
    ("#!/bin/bash", "a script for Slurm"),
    ("#SBATCH", "a script for Slurm"),
    ("export OMP_NUM_THREADS", "a script for Slurm"),
    ("if [ -d runs/cluster ]", "a script for Slurm"),
    ("srun ", "a script for Slurm"),
    ("dials-traffic watch runs", "serves until Ctrl-C; tests/cli/live.rs watches a run"),
    ("python3 -m venv", "installs packages from the network"),
    ("dials-env/bin/", ".ci/run trains with the installed package"),
    ("python-env/bin/", "python/tests hold what the Python package does"),
    ("target/sumo_rl/bin/", "a benchmark"),
    ("python3 sumo_nets/make.py", "tests/traffic/networks holds that it gives the same files"),
];

/// Settings of every config, so that a run has two updates and one training of its predictors.
const SHORT_SETTINGS: &[(&str, &str, i64)] = &[
    ("", "stop_at_steps", 256),
    ("aip", "dataset_steps", 500),
    ("aip", "epochs", 1),
    ("aip", "batch", 4),
    ("imitation", "dataset_steps", 300),
    ("imitation", "epochs", 1),
    ("evaluation", "episodes", 1),
    ("evaluation", "final_episodes", 1),
    ("evaluation", "aip_loss_episodes", 1),
];

/// A block that takes longer hangs.
const LONGEST_S: &str = "1200";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Returns the pages in the order in which a newcomer reads them: the README, the pages of the index, the others.
fn pages() -> Vec<String> {
    let index = read("docs/README.md");
    let links = index.split("](").skip(1).map(|rest| rest.split(')').next().unwrap());
    let mut pages = vec!["README.md".to_owned()];
    for link in links.filter(|link| link.ends_with(".md")) {
        let page = link.strip_prefix("../").map_or(format!("docs/{link}"), str::to_owned);
        if !pages.contains(&page) {
            pages.push(page);
        }
    }
    pages.extend(["sumo_nets/README.md", "docs/README.md"].map(str::to_owned));
    pages
}

/// Returns the blocks of shell commands of a page, with continued lines joined.
fn blocks(page: &str) -> Vec<String> {
    let rest = page.split("```sh\n").skip(1);
    rest.map(|rest| rest.split("```").next().unwrap().replace("\\\n", "")).collect()
}

/// Copies a folder, but for the runs and the cache that its user has made there.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let name = entry.file_name();
        match entry.file_type().unwrap().is_dir() {
            true if name == "runs" => (),
            true => copy(&entry.path(), &to.join(name)),
            false => drop(fs::copy(entry.path(), to.join(name)).unwrap()),
        }
    }
}

/// Calls `change` with the content of every TOML file in a folder, and writes it back.
fn rewrite(folder: &Path, change: &dyn Fn(&mut Table)) {
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            rewrite(&path, change);
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            let mut table: Table = fs::read_to_string(&path).unwrap().parse().unwrap();
            change(&mut table);
            fs::write(&path, toml::to_string(&table).unwrap()).unwrap();
        }
    }
}

/// Steps of an episode on a grid. Films of the docs show the 60th to the 64th.
const HORIZON: i64 = 80;

fn shorten_config(config: &mut Table) {
    if let Some(grid) = config.get_mut("traffic").and_then(Value::as_table_mut).filter(|t| t.contains_key("network")) {
        grid.insert("horizon".to_owned(), HORIZON.into());
    }
    for &(table, key, value) in SHORT_SETTINGS {
        let table = match table {
            "" => &mut *config,
            name => config.entry(name).or_insert_with(|| Table::new().into()).as_table_mut().unwrap(),
        };
        table.insert(key.to_owned(), value.into());
    }
}

/// Scenarios end after twenty minutes instead of an hour.
fn shorten_scenario(path: &Path) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains("<end value=\"3600\"/>"), "{}", path.display());
    fs::write(path, text.replace("<end value=\"3600\"/>", "<end value=\"1200\"/>")).unwrap();
}

/// One seed, and the settings of [`SHORT_SETTINGS`] instead of its own.
fn shorten_experiment(experiment: &mut Table) {
    experiment.insert("seeds".to_owned(), vec![Value::from(1)].into());
    let short = |setting: &Value| {
        let key = setting.as_str().unwrap().split('=').next().unwrap();
        SHORT_SETTINGS.iter().all(|(table, name, _)| key.trim() != format!("{table}.{name}"))
    };
    if let Some(set) = experiment.get_mut("set") {
        set.as_array_mut().unwrap().retain(short);
    }
}

/// Makes the folder in which the commands are typed.
fn clone() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["configs", "experiments", "sumo_nets", "results"] {
        copy(&root().join(name), &folder.path().join(name));
    }
    rewrite(&folder.path().join("configs"), &shorten_config);
    rewrite(&folder.path().join("experiments"), &shorten_experiment);
    for name in ["town", "arterial"] {
        shorten_scenario(&folder.path().join(format!("sumo_nets/{name}/{name}.sumocfg")));
    }
    folder
}

/// Returns what of a block is typed, and notes which rows of the tables it used.
fn typed(block: &str, used: &mut [Vec<bool>; 2]) -> String {
    let mut lines = Vec::new();
    for line in block.lines() {
        let row = NOT_TYPED
            .iter()
            .position(|(begins, _)| line.starts_with(begins) && !line.contains("cargo run --release -- "));
        match row {
            Some(row) => used[0][row] = true,
            None => lines.push(line),
        }
    }
    let mut text = lines.join("\n") + "\n";
    for (row, (written, instead, _)) in SHORTER.iter().enumerate() {
        used[1][row] |= text.contains(written);
        text = text.replace(written, instead);
    }
    text
}

/// Returns whether films can be made here.
fn has_screen() -> bool {
    let path = std::env::var_os("PATH").unwrap();
    ["Xvfb", "xauth"].iter().all(|tool| std::env::split_paths(&path).any(|folder| folder.join(tool).is_file()))
}

#[test]
fn every_command_of_the_docs_runs_to_its_end_in_order() {
    let folder = clone();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_dials-traffic"));
    let mut path = program.parent().unwrap().as_os_str().to_owned();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap());
    let mut used = [vec![false; NOT_TYPED.len()], vec![false; SHORTER.len()]];
    let mut commands = 0;
    for page in pages() {
        for block in blocks(&read(&page)) {
            let mut text = typed(&block, &mut used);
            if !has_screen() && text.contains(" --video ") {
                let message =
                    b"skipped: films, because Xvfb or xauth is not installed (Debian's packages xvfb and xauth)\n";
                std::io::stderr().write_all(message).unwrap();
                text = text.lines().map(|line| line.split(" --video ").next().unwrap().to_owned() + "\n").collect();
            }
            if cfg!(not(feature = "torch")) && text.contains("dials-traffic export ") {
                std::io::stderr().write_all(b"skipped: export, because this build has no libtorch\n").unwrap();
                text = text
                    .lines()
                    .filter(|line| !line.contains("dials-traffic export "))
                    .map(|line| line.to_owned() + "\n")
                    .collect();
            }
            commands += text.lines().filter(|line| !line.trim().is_empty()).count();
            // A failing test shows how far it came.
            println!("{page}:\n{text}");
            let mut shell = Command::new("timeout");
            shell
                .args([LONGEST_S, "bash", "-e", "-c", &text])
                .current_dir(folder.path())
                .env("PATH", &path)
                .stdin(Stdio::null());
            let begun = Instant::now();
            let output = shell.output().unwrap();
            println!("took {:.1} s", begun.elapsed().as_secs_f64());
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{page}: {}\n{text}\n{said}", output.status);
        }
    }
    assert!(commands > 40, "only {commands} commands were found");
    for (row, (begins, _)) in NOT_TYPED.iter().enumerate() {
        assert!(used[0][row], "NOT_TYPED: no line begins with `{begins}` any more");
    }
    for (row, (written, ..)) in SHORTER.iter().enumerate() {
        assert!(used[1][row], "SHORTER: no command has `{written}` any more");
    }
    // A pattern such as 'runs/traffic_4-gs-seed*' must find one method: a number at the end of a name means the same
    // command again, and only the first run is made twice.
    let mut again: Vec<String> = fs::read_dir(folder.path().join("runs"))
        .unwrap()
        .map(|run| run.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.rsplit_once('-').is_some_and(|(_, number)| number.parse::<u32>().is_ok()))
        .collect();
    again.sort();
    assert_eq!(again, ["smoke_traffic-dials-seed1-2"]);
}
