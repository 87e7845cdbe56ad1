//! Opens sumo-gui for a person.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use dials_core::outside::quoted;
use dials_session::terminal::on_the_path;

/// Name of the program.
pub(super) const SUMO_GUI: &str = "sumo-gui";

/// Checks that sumo-gui can be opened. The error says what to do.
pub(crate) fn check_screen() -> Result<()> {
    ensure!(on_the_path(SUMO_GUI).is_some(), "--gui: sumo-gui is not on the PATH: install Debian's package sumo");
    let display = std::env::var_os("DISPLAY").filter(|display| !display.is_empty());
    ensure!(
        display.is_some(),
        "--gui: there is no screen here (DISPLAY is not set); make a film with --video, or leave --gui \
         out and open the folder with sumo-gui elsewhere"
    );
    Ok(())
}

/// Opens sumo-gui and waits until it is closed.
pub(crate) fn watch(config: &Path) -> Result<()> {
    let status = Command::new(SUMO_GUI)
        .arg("-c")
        .arg(config)
        .arg("--start")
        .status()
        .context("sumo-gui could not be started")?;
    ensure!(
        status.success(),
        "sumo-gui ended with {status}; the folder is complete, try to open it with: sumo-gui -c {}",
        quoted(config)
    );
    Ok(())
}
