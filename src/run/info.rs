//! `info`: prints versions and where each part was found.

use std::path::PathBuf;

use crate::libtorch;
use crate::program::PROGRAM;
use dials_session::build;
use dials_session::error::{Error, Result};
use dials_session::records::run_json::Versions;
use dials_session::terminal::{answer, on_the_path};
use stacknets::VectorWidth;

pub(super) fn info() -> Result<()> {
    let build = build::here(PROGRAM, VectorWidth::Widest).map_err(Error::Run)?;
    let mut lines = vec![
        format!("dials-traffic {} (commit {})", build.dials_traffic, build.git_commit),
        format!("{} at {}", build.sumo, place(loaded_library("libsumocpp.so"))),
        about_libtorch(&build)?,
        format!("{} at {}", build.libm, place(loaded_library("libm.so"))),
        format!("{}, with {}", build.cpu, build.vector_instructions),
    ];
    let programs = ["netconvert", "sumo", "sumo-gui"];
    lines.extend(programs.map(|program| format!("{program} at {}", place(on_the_path(program)))));
    answer(lines.join("\n")).map_err(Error::Run)
}

fn about_libtorch(build: &Versions) -> Result<String> {
    if libtorch::check().is_err() {
        return Ok("no libtorch: built without the feature `torch`".to_owned());
    }
    let maps = libtorch::maps().map_err(Error::Run)?;
    let [torch, blas] = ["libtorch_cpu.so", "blas"].map(|name| place(file_in(&maps, name)));
    Ok(format!("libtorch {} at {torch}\nBLAS at {blas}", build.libtorch))
}

pub(super) fn place(found: Option<PathBuf>) -> String {
    found.map_or("(not found)".to_owned(), |path| path.display().to_string())
}

/// Finds the file of a shared library that this process has loaded. `name`: part of its file name.
pub(super) fn loaded_library(name: &str) -> Option<PathBuf> {
    file_in(&std::fs::read_to_string("/proc/self/maps").ok()?, name)
}

/// `maps`: what /proc says of the memory of a process.
fn file_in(maps: &str, name: &str) -> Option<PathBuf> {
    let is_it = |path: &PathBuf| path.file_name().is_some_and(|file| file.to_string_lossy().contains(name));
    maps.lines().filter_map(|line| line.split_whitespace().nth(5)).map(PathBuf::from).find(is_it)
}
