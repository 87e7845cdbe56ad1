//! The traffic domain on real SUMO.
//!
//! libsumo has one simulation per process: a test that needs it waits for its turn. Others run beside it.

mod controllers;
mod derive;
mod examples;
mod free_car;
mod hostile_networks;
mod metrics;
mod networks;
mod reference_figures;
mod replay;
mod scenarios;
mod simulators;
