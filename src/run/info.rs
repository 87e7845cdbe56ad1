//! `info`: prints versions and where each part was found.

use std::path::PathBuf;

use crate::libtorch;
use crate::program::PROGRAM;
use dials_session::build;
use dials_session::error::{Error, Result};
use dials_session::records::run_json::Versions;
use dials_session::terminal::answer;
use dials_traffic::{Sumo, SumoPlace, sumo_program};
use stacknets::VectorWidth;

pub(super) fn info() -> Result<()> {
    let build = build::without_sumo(PROGRAM, VectorWidth::Widest).map_err(Error::Run)?;
    let mut lines = vec![
        format!("dials-traffic {} (commit {})", build.dials_traffic, build.git_commit),
        dials_traffic::sumo().map_or_else(|error| format!("no SUMO: {error}"), about_sumo),
    ];
    lines.extend(dials_traffic::sumo_places().iter().map(|place| format!("  {}", about_place(place))));
    lines.extend([
        about_libtorch(&build),
        format!("{} at {}", build.libm, place(loaded_library("libm.so"))),
        format!("{}, with {}", build.cpu, build.vector_instructions),
    ]);
    let programs = ["netconvert", "sumo", "sumo-gui"];
    lines.extend(programs.map(|program| format!("{program} at {}", place(sumo_program(program)))));
    answer(lines.join("\n")).map_err(Error::Run)
}

/// Returns version, file and builder of the SUMO that is taken, and what its numbers stand for.
pub(super) fn about_sumo(sumo: &Sumo) -> String {
    let strings = if sumo.has_strings_of_cpp11() { "of C++11" } else { "from before C++11" };
    let numbers = match sumo.version.is_tried() {
        _ if sumo.version.is_reference() => "the version of the published numbers",
        true => "its numbers may differ a little from the published ones, which are of 1.15",
        false => "newer than what was tried; its numbers may differ from the published ones, which are of 1.15",
    };
    format!("{} ({}, strings {strings}) at {}: {numbers}", sumo.name, sumo.builder(), sumo.file.display())
}

/// Returns a place where SUMO is looked for, and whether it is there.
pub(super) fn about_place(place: &SumoPlace) -> String {
    let there = match place.is_there {
        Some(true) => "there",
        Some(false) => "not there",
        None => "asked if nothing above is there",
    };
    format!("looked at: {} ({}): {there}", place.library.display(), place.source)
}

fn about_libtorch(build: &Versions) -> String {
    if libtorch::check().is_err() {
        return "no libtorch: built without the feature `torch`".to_owned();
    }
    let maps = match libtorch::maps() {
        Ok(maps) => maps,
        Err(error) => return format!("no libtorch: {error:#}"),
    };
    let [torch, blas] = ["libtorch_cpu.so", "blas"].map(|name| place(file_in(&maps, name)));
    format!("libtorch {} at {torch}\nBLAS at {blas}", build.libtorch)
}

fn place(found: Option<PathBuf>) -> String {
    found.map_or("(not found)".to_owned(), |path| path.display().to_string())
}

/// Finds the file of a shared library that this process has loaded. `name`: part of its file name.
fn loaded_library(name: &str) -> Option<PathBuf> {
    file_in(&std::fs::read_to_string("/proc/self/maps").ok()?, name)
}

/// `maps`: what /proc says of the memory of a process.
fn file_in(maps: &str, name: &str) -> Option<PathBuf> {
    let is_it = |path: &PathBuf| path.file_name().is_some_and(|file| file.to_string_lossy().contains(name));
    maps.lines().filter_map(|line| line.split_whitespace().nth(5)).map(PathBuf::from).find(is_it)
}
