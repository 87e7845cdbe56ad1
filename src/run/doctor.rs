//! `doctor`: what is installed here, what is missing, and the command that cures it.

use std::fmt;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, anyhow, ensure};

use super::info::{about_place, about_sumo};
use super::sumo_data::{self, Data};
use super::train::cores;
use crate::libtorch;
use crate::program::{PROGRAM, command_for_feature};
use dials_core::base::counted;
use dials_core::outside::{quoted, temporary_dir};
use dials_session::build;
use dials_session::error::{Error, Result};
use dials_session::fleet::children::FILES_PER_WORKER;
use dials_session::machine::{allow_open_files, free_disk_mib, free_memory_mib};
use dials_session::parent::END_WITH;
use dials_session::terminal::{answer, on_the_path};
use dials_session::trial::{End, watch};
use dials_traffic::{SumoError, sumo_program};
use stacknets::VectorWidth;

/// Memory that a worker and this program need at least, in MiB.
const MEMORY_MIB: u64 = 300;
/// Room on a disk below which even a short run may not fit, in MiB.
const DISK_MIB: u64 = 50;
/// Room on a disk below which long runs may not fit, in MiB.
const ROOMY_DISK_MIB: u64 = 1024;

const SUMO: &str = "sumo";
const INSTALL_SUMO: &str = "pip install eclipse-sumo, or apt-get install sumo";

/// Programs that some commands start: name, Debian's package, and what needs it.
const PROGRAMS: [(&str, &str, &str); 7] = [
    ("netconvert", SUMO, "`nets grid` and `nets local`"),
    ("sumo", SUMO, "playing the folders of `replay`"),
    ("sumo-gui", SUMO, "`replay --gui` and films"),
    ("Xvfb", "xvfb", "films"),
    ("setpriv", "util-linux", "films"),
    ("ffmpeg", "ffmpeg", "films as .mp4"),
    ("mpirun", "openmpi-bin", "training over several machines"),
];

/// Longest time of a short training. It takes about a second.
const PATIENCE: Duration = Duration::from_secs(120);

/// The smallest shipped networks. Training on them does not need netconvert.
const NETWORKS: [(&str, &str); 8] = [
    ("grid_2x2.net.xml", include_str!("../../sumo_nets/grid_2x2.net.xml")),
    ("grid_2x2.rou.xml", include_str!("../../sumo_nets/grid_2x2.rou.xml")),
    ("grid_2x2.actuated.add.xml", include_str!("../../sumo_nets/grid_2x2.actuated.add.xml")),
    ("grid_2x2.sumocfg", include_str!("../../sumo_nets/grid_2x2.sumocfg")),
    ("local.net.xml", include_str!("../../sumo_nets/local.net.xml")),
    ("local.rou.xml", include_str!("../../sumo_nets/local.rou.xml")),
    ("local.actuated.add.xml", include_str!("../../sumo_nets/local.actuated.add.xml")),
    ("local.sumocfg", include_str!("../../sumo_nets/local.sumocfg")),
];

/// Settings that make a training short, besides the table of its domain.
const SHORT: &str = "\
total_steps = 128

[local_simulators]
copies = 8

[policy]
hidden = [8]

[aip]
hidden = [8]
dataset_steps = 80
held_out = 0.5
batch = 1
epochs = 1

[evaluation]
episodes = 1
final_episodes = 1
";

pub(super) fn doctor() -> Result<()> {
    let mut findings = parts();
    findings.extend(trials());
    let lines: Vec<String> = findings.iter().map(Finding::to_string).collect();
    answer(lines.join("\n")).map_err(Error::Run)?;
    let count = |is: fn(&Finding) -> bool| findings.iter().filter(|finding| is(finding)).count();
    let errors = count(|finding| matches!(finding, Finding::Error(..)));
    if errors > 0 {
        return Err(Error::Run(anyhow!("training cannot work here: {}; see `cure:` above", counted(errors, "error"))));
    }
    let missing = match count(|finding| matches!(finding, Finding::Missing(..))) {
        0 => String::new(),
        1 => "; one part is missing, which some commands need".to_owned(),
        missing => format!("; {missing} parts are missing, which some commands need"),
    };
    answer(format_args!("\ntraining works here{missing}")).map_err(Error::Run)
}

/// What was found, and what to do about it: a command if there is one.
enum Finding {
    Good(String),
    /// More about the line before.
    Note(String),
    /// Some commands do not work, but training does.
    Missing(String, String),
    Error(String, String),
}

/// A line, and one below it with the cure.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (state, what, cure) = match self {
            Finding::Good(what) => return write!(f, "{:9}{what}", "ok"),
            Finding::Note(what) => return write!(f, "{:9}{what}", ""),
            Finding::Missing(what, cure) => ("missing", what, cure),
            Finding::Error(what, cure) => ("error", what, cure),
        };
        write!(f, "{state:9}{what}\n{:9}cure: {cure}", "")
    }
}

fn parts() -> Vec<Finding> {
    let mut findings = vec![build_here()];
    findings.extend(sumo());
    findings.extend([libtorch(), mpi()]);
    findings.extend(PROGRAMS.map(program));
    findings.push(match sumo_data::data() {
        Data::Found(what) => Finding::Good(what),
        Data::Missing(what, cure) => Finding::Missing(what, cure),
    });
    findings.push(Finding::Good(counted(cores(), "core")));
    findings.push(memory());
    findings.push(disk("for runs", Path::new(".")));
    findings.push(disk("for temporary files", &std::env::temp_dir()));
    findings.push(open_files());
    findings
}

fn build_here() -> Finding {
    match build::without_sumo(PROGRAM, VectorWidth::Widest) {
        Ok(here) => Finding::Good(format!(
            "dials-traffic {} (commit {}), {} with {}",
            here.dials_traffic, here.git_commit, here.cpu, here.vector_instructions
        )),
        Err(error) => Finding::Error(
            format!("{error:#}"),
            "run ./setup.sh, and build again with: cargo install --path .".to_owned(),
        ),
    }
}

/// The SUMO that is taken, and every place that was looked at.
fn sumo() -> Vec<Finding> {
    let found = match dials_traffic::sumo() {
        Ok(sumo) => Finding::Good(about_sumo(sumo)),
        Err(SumoError::Library { text, way_out }) => {
            Finding::Error(format!("SUMO's library cannot be loaded: {text}"), way_out)
        }
        Err(error) => Finding::Error(error.to_string(), INSTALL_SUMO.to_owned()),
    };
    let places = dials_traffic::sumo_places();
    let looked = places.iter().map(|place| Finding::Note(about_place(place)));
    [found].into_iter().chain(looked).collect()
}

fn libtorch() -> Finding {
    let cure = command_for_feature("torch");
    match (cfg!(feature = "torch"), libtorch::maps()) {
        (true, Ok(_)) => Finding::Good(format!("libtorch {} for `export`", env!("DIALS_LIBTORCH_VERSION"))),
        (true, Err(error)) => Finding::Missing(format!("libtorch: needed for `export`: {error:#}"), cure),
        (false, _) => Finding::Missing("libtorch: needed for `export`".to_owned(), cure),
    }
}

fn mpi() -> Finding {
    match cfg!(feature = "mpi") {
        true => Finding::Good("MPI is built in".to_owned()),
        false => {
            Finding::Missing("MPI: needed for training over several machines".to_owned(), command_for_feature("mpi"))
        }
    }
}

fn program((name, package, needed): (&str, &str, &str)) -> Finding {
    let found = if package == SUMO { sumo_program(name) } else { on_the_path(name) };
    match found {
        Some(path) if package == SUMO && !starts(&path) => Finding::Missing(
            format!("{name} at {} does not start: needed for {needed}", path.display()),
            format!("run it, and install the libraries that it asks for: {} --version", quoted(&path)),
        ),
        Some(path) => Finding::Good(format!("{name} at {}", path.display())),
        None => Finding::Missing(
            format!("{name} was not found: needed for {needed}"),
            match package {
                SUMO => INSTALL_SUMO.to_owned(),
                _ => format!("apt-get install {package}"),
            },
        ),
    }
}

/// Returns whether the system can load a program of SUMO, which needs libraries for its window.
fn starts(program: &Path) -> bool {
    let output = Command::new(program).arg("--version").stdin(Stdio::null()).output();
    output.is_ok_and(|output| output.status.success())
}

fn memory() -> Finding {
    match free_memory_mib() {
        None => Finding::Missing("free memory: the system does not say".to_owned(), "mount /proc".to_owned()),
        Some(free) if free < MEMORY_MIB => Finding::Error(
            format!("{free} MiB of memory are free: a run needs {MEMORY_MIB}"),
            "end other programs".to_owned(),
        ),
        Some(free) => Finding::Good(format!("{free} MiB of memory are free")),
    }
}

fn disk(what: &str, dir: &Path) -> Finding {
    let place = dir.display();
    match free_disk_mib(dir) {
        Err(error) => {
            Finding::Error(format!("disk {what}: {error:#}"), "name another place with --out or TMPDIR".to_owned())
        }
        Ok(free) if free < DISK_MIB => Finding::Error(
            format!("{free} MiB are free {what} in {place}"),
            "free space, or go to another folder".to_owned(),
        ),
        Ok(free) if free < ROOMY_DISK_MIB => Finding::Missing(
            format!("{free} MiB are free {what} in {place}: long runs may need more"),
            "free space".to_owned(),
        ),
        Ok(free) => Finding::Good(format!("{free} MiB are free {what} in {place}")),
    }
}

fn open_files() -> Finding {
    match allow_open_files(cores(), FILES_PER_WORKER, "--workers") {
        Ok(()) => Finding::Good("enough open files for a worker per core".to_owned()),
        Err(error) => Finding::Error(format!("{error:#}"), "raise the limit, or train with fewer --workers".to_owned()),
    }
}

/// Trains shortly on each domain, in a process of its own as a user would start it.
fn trials() -> Vec<Finding> {
    let warehouse = "[warehouse]\nagents_per_side = 2\nhorizon = 40\n";
    let traffic = "[traffic]\nnetwork = 'grid_2x2'\nlocal_network = 'local'\nhorizon = 40\n";
    vec![
        judged("without SUMO", train(warehouse, |_| Ok(()))),
        judged("on SUMO", train(traffic, |dir| write_networks(dir).context("the networks of the test"))),
    ]
}

fn write_networks(dir: &Path) -> std::io::Result<()> {
    NETWORKS.iter().try_for_each(|(name, text)| fs::write(dir.join(name), text))
}

fn judged(how: &str, trained: anyhow::Result<()>) -> Finding {
    match trained {
        Ok(()) => Finding::Good(format!("a short training {how}")),
        Err(error) => Finding::Error(
            format!("a short training {how}: {error:#}"),
            "mend what is missing above; else run ./setup.sh, and build again with: cargo install --path .".to_owned(),
        ),
    }
}

/// Trains on a domain, with one worker. `prepare` writes the files that its table names into the directory.
fn train(domain: &str, prepare: impl Fn(&Path) -> anyhow::Result<()>) -> anyhow::Result<()> {
    let dir = temporary_dir()?;
    prepare(dir.path())?;
    let config = dir.path().join("config.toml");
    fs::write(&config, format!("{SHORT}\n{domain}")).with_context(|| config.display().to_string())?;
    let mut command = Command::new("/proc/self/exe");
    command.args([END_WITH, &std::process::id().to_string(), "train"]).arg(&config);
    command.args(["--workers", "1", "--out"]).arg(dir.path().join("run"));
    let End { status, said } = watch(command, String::new(), PATIENCE)?;
    let status = status.with_context(|| format!("did not end within {} s", PATIENCE.as_secs()))?;
    ensure!(status.success(), "{status}: {}", said.trim());
    Ok(())
}
