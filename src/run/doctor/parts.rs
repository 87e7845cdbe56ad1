//! Libraries, programs and limits.

use std::path::Path;

use super::Finding;
use crate::features::command_for_feature;
use crate::program::PROGRAM;
use crate::run::info::{loaded_library, place};
use crate::run::train::cores;
use dials_core::base::counted;
use dials_session::build;
use dials_session::fleet::children::FILES_PER_WORKER;
use dials_session::machine::{allow_open_files, free_disk_mib, free_memory_mib};
use dials_session::terminal::on_the_path;
use stacknets::VectorWidth;

/// Version of SUMO that was tried.
const TRIED_SUMO: &str = "SUMO 1.15.";
/// Memory that a worker and this program need at least, in MiB.
const MEMORY_MIB: u64 = 300;
/// Room on a disk below which even a short run may not fit, in MiB.
const DISK_MIB: u64 = 50;
/// Room on a disk below which long runs may not fit, in MiB.
const ROOMY_DISK_MIB: u64 = 1024;

/// Programs that some commands start: name, Debian's package, and what needs it.
const PROGRAMS: [(&str, &str, &str); 7] = [
    ("netconvert", "sumo", "`nets grid` and the test of training on SUMO below"),
    ("sumo", "sumo", "playing the folders of `replay`"),
    ("sumo-gui", "sumo", "`replay --gui` and films"),
    ("Xvfb", "xvfb", "films"),
    ("setpriv", "util-linux", "films"),
    ("ffmpeg", "ffmpeg", "films as .mp4"),
    ("mpirun", "openmpi-bin", "training over several machines"),
];

pub(super) fn find() -> Vec<Finding> {
    let mut findings = vec![build_here(), sumo(), libtorch(), mpi()];
    findings.extend(PROGRAMS.map(program));
    findings.push(Finding::good(counted(cores(), "core")));
    findings.push(memory());
    findings.push(disk("for runs", Path::new(".")));
    findings.push(disk("for temporary files", &std::env::temp_dir()));
    findings.push(open_files());
    findings
}

fn build_here() -> Finding {
    match build::here(PROGRAM, VectorWidth::Widest) {
        Ok(here) => Finding::good(format!(
            "dials-traffic {} (commit {}), {} with {}",
            here.dials_traffic, here.git_commit, here.cpu, here.vector_instructions
        )),
        Err(error) => {
            Finding::error(format!("{error:#}"), "run ./setup.sh, and build again with: cargo install --path .")
        }
    }
}

fn sumo() -> Finding {
    let version = dials_traffic::sumo_version();
    // The library is there since the line above.
    let at = place(loaded_library("libsumocpp.so"));
    match version {
        Ok(version) if version.starts_with(TRIED_SUMO) => Finding::good(format!("{version} as a library, at {at}")),
        Ok(version) => Finding::missing(
            format!("{version} as a library, at {at}: only {TRIED_SUMO}0 was tried, and others may give other numbers"),
            "install SUMO 1.15 (Debian 12 has it), and build again",
        ),
        Err(error) => Finding::error(format!("{error:#}"), "run ./setup.sh, and build again"),
    }
}

fn libtorch() -> Finding {
    match cfg!(feature = "torch") {
        true => Finding::good(format!("libtorch {} for `export`", env!("DIALS_LIBTORCH_VERSION"))),
        false => Finding::missing("libtorch: needed for `export`", command_for_feature("torch")),
    }
}

fn mpi() -> Finding {
    match cfg!(feature = "mpi") {
        true => Finding::good("MPI is built in"),
        false => Finding::missing("MPI: needed for training over several machines", command_for_feature("mpi")),
    }
}

fn program((name, package, needed): (&str, &str, &str)) -> Finding {
    match on_the_path(name) {
        Some(path) => Finding::good(format!("{name} at {}", path.display())),
        None => Finding::missing(
            format!("{name} is not on the PATH: needed for {needed}"),
            format!("apt-get install {package}"),
        ),
    }
}

fn memory() -> Finding {
    match free_memory_mib() {
        None => Finding::missing("free memory: the system does not say", "mount /proc"),
        Some(free) if free < MEMORY_MIB => {
            Finding::error(format!("{free} MiB of memory are free: a run needs {MEMORY_MIB}"), "end other programs")
        }
        Some(free) => Finding::good(format!("{free} MiB of memory are free")),
    }
}

fn disk(what: &str, dir: &Path) -> Finding {
    let place = dir.display();
    match free_disk_mib(dir) {
        Err(error) => Finding::error(format!("disk {what}: {error:#}"), "name another place with --out or TMPDIR"),
        Ok(free) if free < DISK_MIB => {
            Finding::error(format!("{free} MiB are free {what} in {place}"), "free space, or go to another folder")
        }
        Ok(free) if free < ROOMY_DISK_MIB => {
            Finding::missing(format!("{free} MiB are free {what} in {place}: long runs may need more"), "free space")
        }
        Ok(free) => Finding::good(format!("{free} MiB are free {what} in {place}")),
    }
}

fn open_files() -> Finding {
    match allow_open_files(cores(), FILES_PER_WORKER, "--workers") {
        Ok(()) => Finding::good("enough open files for a worker per core"),
        Err(error) => Finding::error(format!("{error:#}"), "raise the limit, or train with fewer --workers"),
    }
}
