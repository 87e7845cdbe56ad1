//! `completions` and `man`: what shells and `man` know of the command line. `schema`: what editors know of a config.

use std::fs;
use std::path::Path;

use anyhow::Context;
use clap::CommandFactory;
use clap_complete::Shell;

use crate::cli::Cli;
use dials_core::outside::quoted;
use dials_session::config::schema;
use dials_session::error::{Error, Result};
use dials_session::outputs::check_free;
use dials_session::places::{self, Existing};
use dials_session::terminal::{answer, json, note};

pub(super) fn completions(shell: Shell) -> Result<()> {
    let mut command = Cli::command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    let script = String::from_utf8(script).expect("clap writes UTF-8");
    answer(script.trim_end()).map_err(Error::Run)
}

/// Writes a page for the program and one for each subcommand into a directory.
pub(super) fn man(dir: &Path, force: bool) -> Result<()> {
    let existing = Existing::of_named(force);
    check_free(dir, "--out", existing).map_err(Error::Usage)?;
    let mut pages = 0;
    let written = places::make(dir, existing, |staged| {
        clap_mangen::generate_to(Cli::command(), staged.path()).context("the pages could not be made")?;
        pages = fs::read_dir(staged.path())?.count();
        Ok(())
    });
    written.map_err(Error::Usage)?;
    let first = quoted(&dir.join("dials-traffic.1"));
    note(format_args!("wrote {pages} pages into {}; read the first with: man -l {first}", dir.display()));
    Ok(())
}

pub(super) fn print_schema() -> Result<()> {
    answer(json(serde_json::to_string_pretty(&schema()).expect("JSON has any text"))).map_err(Error::Run)
}
