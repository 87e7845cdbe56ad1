//! The command line as users see it: what it prints, writes and refuses, and what README and docs/ say about it.
//!
//! All tests with one subject share a program, because linking takes longer than most of them. Nothing here loads SUMO into
//! this process.

mod bench;
mod benchmark;
mod builds;
mod city;
mod command_line;
mod configuration_page;
mod crates;
mod docs;
mod documented_commands;
mod experiment;
mod export;
mod first_contact;
mod hostile_reports;
mod inspect;
mod limits;
mod live;
mod live_attacks;
mod report;
mod robustness;

#[path = "../common/place.rs"]
mod place;
