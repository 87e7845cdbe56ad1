//! `info`: versions, and where each part was found.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::terminal::{answer, on_the_path};
use crate::error::{Error, Result};
use crate::sumo::Simulation;

pub fn info() -> Result<()> {
    let versions = versions().map_err(Error::Run)?;
    let text = |key: &str| versions[key].as_str().unwrap_or("unknown").to_owned();
    let mut lines = vec![
        format!("dials-traffic {} (commit {})", text("dials_traffic"), text("git_commit")),
        format!("{} at {}", text("sumo"), place(loaded_library("libsumocpp.so"))),
        format!("libtorch {} at {}", text("libtorch"), place(loaded_library("libtorch_cpu.so"))),
        format!("BLAS at {}", place(loaded_library("blas"))),
    ];
    let programs = ["netconvert", "sumo", "sumo-gui"];
    lines.extend(programs.map(|program| format!("{program} at {}", place(on_the_path(program)))));
    answer(lines.join("\n")).map_err(Error::Run)
}

/// The versions that go into `run.json`.
pub fn versions() -> anyhow::Result<Value> {
    Ok(json!({
        "dials_traffic": env!("CARGO_PKG_VERSION"),
        // Of the checkout that the program was built from; changes that were not committed do not show.
        "git_commit": env!("DIALS_GIT_COMMIT"),
        "sumo": Simulation::version()?,
        "libtorch": env!("DIALS_LIBTORCH_VERSION"),
    }))
}

fn place(found: Option<PathBuf>) -> String {
    found.map_or("(not found)".to_owned(), |path| path.display().to_string())
}

/// The file of a shared library that this process has loaded, by a part of its name.
fn loaded_library(name: &str) -> Option<PathBuf> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    let files = maps.lines().filter_map(|line| line.split_whitespace().nth(5));
    files
        .map(Path::new)
        .find(|path| path.file_name().is_some_and(|file| file.to_string_lossy().contains(name)))
        .map(Path::to_owned)
}
