//! The traffic domain on real SUMO.
//!
//! libsumo has one simulation per process: a test that needs it waits for its turn. Others run beside it.

mod controllers;
mod derive;
mod events;
mod examples;
mod free_car;
mod hostile_networks;
mod metrics;
mod networks;
mod reference_figures;
mod replay;
mod scenarios;
mod simulators;

/// Returns the program `sumo` of the SUMO that this program simulates with.
fn plain_sumo() -> std::path::PathBuf {
    libsumo::program("sumo").expect("SUMO has its program beside its library, or on the PATH")
}

/// Returns whether this is the SUMO of the numbers in this repository.
fn is_reference() -> bool {
    libsumo::load().unwrap().version.is_reference()
}
