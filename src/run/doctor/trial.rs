//! A short training of each domain, in a process of its own as a user would start it.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result, ensure};

use super::Finding;
use dials_core::outside::temporary_dir;
use dials_session::parent::END_WITH;
use dials_session::trial::{End, watch};
use dials_traffic::paper_grid::grid::Grid;
use dials_traffic::paper_grid::make::{write_grid, write_local};

/// Longest time of a training. It takes about a second.
const PATIENCE: Duration = Duration::from_secs(120);

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

pub(super) fn find() -> Vec<Finding> {
    let warehouse = "[warehouse]\nagents_per_side = 2\nhorizon = 40\n";
    let traffic = "[traffic]\nnetwork = 'grid_2x2'\nlocal_network = 'local'\nhorizon = 40\n";
    vec![
        judged("without SUMO", train(warehouse, |_| Ok(()))),
        judged("on SUMO", train(traffic, |dir| write_local(dir).and(write_grid(Grid::new(2, 2)?, 0.1, dir)).map(drop))),
    ]
}

fn judged(how: &str, trained: Result<()>) -> Finding {
    match trained {
        Ok(()) => Finding::good(format!("a short training {how}")),
        Err(error) => Finding::error(
            format!("a short training {how}: {error:#}"),
            "mend what is missing above; else run ./setup.sh, and build again with: cargo install --path .",
        ),
    }
}

/// Trains on a domain, with one worker. `prepare` writes the files that its table names into the directory.
fn train(domain: &str, prepare: impl Fn(&Path) -> Result<()>) -> Result<()> {
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
