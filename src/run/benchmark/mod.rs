//! `benchmark resco`: trains and measures on the maps of the user's copy of RESCO, and writes the board.
//!
//! It makes configs of the maps' own files, lets the machinery of `experiment` do the work, and reads what that wrote. The
//! files in its folder are its only memory, so it may be killed at any time and called again.
//!
//! - `copies`: what of RESCO is there. `prepare`: scenarios and configs by the rules of a protocol.
//! - `work`: the tasks, and in which order. `gather`: what they measured.

mod copies;
mod gather;
mod prepare;
mod work;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, ensure};

use super::experiment::{Batch, FILES_PER_PROCESS, Tasks, check_builds, check_nobody_trains, held, write_plan};
use super::train::cores as machine_cores;
use crate::cli;
use copies::Found;
use dials_core::base::{counted, for_terminal};
use dials_core::outside::{Directory, quoted};
use dials_report::resco::results::About;
use dials_report::resco::{MARKDOWN, PAGE, files, summary};
use dials_session::error::{Error, Result};
use dials_session::machine::allow_open_files;
use dials_session::outputs::check_not_a_run;
use dials_session::terminal::{answer, note, program, warn};
use prepare::{Prepared, Protocol};
use work::Plan;

/// Folder of the runs, within that of the benchmark.
const RUNS: &str = "runs";
/// Word of `--methods` for no training at all.
const NO_METHOD: &str = "none";

pub(super) fn resco(args: &cli::RescoArgs) -> Result<()> {
    let begun = Instant::now();
    let protocol = Protocol::of(args.protocol);
    let default = || Path::new("resco").join(format!("{}-{}", protocol.name, args.episodes));
    let out = args.out.clone().unwrap_or_else(default);
    check_out(&out).map_err(Error::Usage)?;
    let cores = args.cores.unwrap_or_else(machine_cores);
    allow_open_files(cores, FILES_PER_PROCESS, "--cores").map_err(Error::Usage)?;
    let Found { copies, absent } = copies::find(&args.dir, &args.maps).map_err(Error::Usage)?;
    std::fs::create_dir_all(&out)
        .with_context(|| format!("{}: cannot be made", out.display()))
        .map_err(Error::Usage)?;
    let methods: Vec<&str> = args.methods.iter().map(String::as_str).filter(|&method| method != NO_METHOD).collect();
    let wanted = Wanted {
        protocol: &protocol,
        methods: &methods,
        seeds: &args.seeds.0,
        episodes: args.episodes,
        measured_episodes: args.measured_episodes,
    };
    let (mut prepared, mut refused) = (Vec::new(), Vec::new());
    for copy in &copies {
        // A map that cannot be read is no reason to leave out the others.
        match Prepared::make(copy, &wanted, &out) {
            Ok(ready) => prepared.push(ready),
            Err(error) => refused.push((copy.map.name, error)),
        }
    }
    for (map, error) in &refused {
        warn(for_terminal(&format!("warning: {map}: left out: {error:#}")));
    }
    if prepared.is_empty() {
        let (map, error) = refused.swap_remove(0);
        return Err(Error::Usage(error.context(format!("{map}: no map can be used"))));
    }
    let runs = out.join(RUNS);
    let plan = Plan::of(&prepared, &wanted, &runs, cores, args.accept_other_build).map_err(Error::Usage)?;
    if args.dry_run {
        return answer(Tasks::of(plan.tasks, cores).table()).map_err(Error::Run);
    }
    let folder = held(&runs).map_err(Error::Usage)?;
    for ready in &prepared {
        let Some(experiment) = &ready.experiment else { continue };
        check_nobody_trains(experiment, &runs).map_err(Error::Usage)?;
        if !args.accept_other_build {
            check_builds(experiment, &runs).map_err(Error::Usage)?;
        }
        write_plan(experiment, &ready.experiment_file, &folder).map_err(Error::Usage)?;
    }
    let again = command(args, &out);
    let until = args.budget_minutes.map(|minutes| begun + Duration::from_secs(60 * minutes));
    let (done_earlier, outcome) = (plan.done, Batch::begin(plan.tasks, folder, cores, until, &again));
    let outcome = outcome.and_then(Batch::carry_out).map_err(Error::Run)?;
    let about = About {
        protocol: protocol.name.to_owned(),
        rules: protocol.rules.clone(),
        episodes: args.episodes,
        measured_episodes: args.measured_episodes.into(),
        seeds: args.seeds.0.clone(),
        command: again.clone(),
        sumo: dials_traffic::sumo().map_err(|error| Error::Run(error.into()))?.name.clone(),
        absent: absent.into_iter().chain(refused.iter().map(|(map, _)| *map)).map(str::to_owned).collect(),
    };
    let maps: Vec<_> = prepared.iter().map(|ready| gather::results(ready, &wanted, &runs)).collect();
    let written = files(&about, &maps).and_then(|files| {
        let directory = Directory::open(&out)?;
        files.iter().try_for_each(|(name, text)| directory.write(name, text.as_bytes()))
    });
    written.map_err(Error::Run)?;
    let (tasks, left) = (outcome.tasks, outcome.left);
    answer(summary(&maps)).map_err(Error::Run)?;
    let pages = [PAGE, MARKDOWN].map(|name| quoted(&out.join(name)));
    note(format_args!("open {} or read {}", pages[0], pages[1]));
    outcome.judged(&runs.join(dials_session::experiment::LOGS), &again)?;
    let left = match left {
        0 => String::new(),
        left => format!("; {} left: {again}", counted(left, "task")),
    };
    note(format_args!("{tasks} done now, {done_earlier} done earlier{left}"));
    if refused.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = refused.iter().map(|(map, _)| *map).collect();
    Err(Error::Run(anyhow!(
        "{} could not be used: {}; the reasons stand above",
        counted(names.len(), "map"),
        names.join(", ")
    )))
}

/// What the user asked for.
struct Wanted<'a> {
    protocol: &'a Protocol,
    methods: &'a [&'a str],
    seeds: &'a [u64],
    episodes: u64,
    measured_episodes: u32,
}

/// Checks the folder of the benchmark. Runs in it are named on the command line of `baseline --compare`, whose list has commas.
fn check_out(out: &Path) -> anyhow::Result<()> {
    check_not_a_run("--out", out)?;
    let text =
        out.to_str().with_context(|| format!("{}: is not UTF-8; name another folder with --out", out.display()))?;
    ensure!(
        !text.contains([',', ':']),
        "{text}: must have no comma and no colon in it; name another folder with --out"
    );
    Ok(())
}

/// Returns the command that makes the same board again.
fn command(args: &cli::RescoArgs, out: &Path) -> String {
    let seeds: Vec<String> = args.seeds.0.iter().map(u64::to_string).collect();
    let mut words = vec![program(), "benchmark resco".to_owned(), quoted(&args.dir)];
    words.push(format!("--protocol {}", Protocol::of(args.protocol).name));
    if !args.maps.is_empty() {
        words.push(format!("--maps {}", args.maps.join(",")));
    }
    words.push(format!("--seeds {} --methods {}", seeds.join(","), args.methods.join(",")));
    words.push(format!("--episodes {} --measured-episodes {}", args.episodes, args.measured_episodes));
    words.push(format!("--out {}", quoted(out)));
    words.join(" ")
}

/// Returns a path that means the same from every folder.
fn absolute(path: &Path) -> anyhow::Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{}: cannot be found", path.display()))
}
