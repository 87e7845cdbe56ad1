//! Training: what is learned, by which fleet, through every accident, and what a run directory then holds.

mod boundaries;
mod chaos;
mod checkpoints;
mod damaged_networks;
mod durability;
mod fleet;
mod kinds;
mod learning;
mod mpi;
mod run_directory;
mod shortcuts;
mod warehouse;

#[path = "../common/place.rs"]
mod place;
