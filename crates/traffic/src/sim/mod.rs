//! The simulators of traffic on SUMO.
//!
//! - [`global`]: the GS; `eyes`: what it reads; [`control`]: who runs its lights. `border`: arrivals and blocked exits of a
//!   scenario's regions; [`visits`]: all visits of cars to them.
//! - [`local`]: the LS. `local_forest`: the nets side by side that it loads; `entries`: where cars wait to come in, and
//!   exits that are blocked; `arriving`: which cars come; [`visit_tables`]: visits to draw them from; `local_routes`:
//!   their routes.
//! - `lights`: the lights of a loaded net; `options`: SUMO's options.
//! - `readings`: what the detectors of lights have seen. `watched`: all that is on the roads, for functions of the user.
//! - [`tally`]: what every episode counts; `at_red`: how long cars stand at red. `metrics`: what only evaluations measure, from
//!   SUMO's `trips`; `light_delays`: where cars lose time.
//! - `route_file`: what an episode plays, where each plays one of several route files.
//! - `picture`: pictures of the GS. [`recording`]: an episode recorded, on [`recorded_roads`]. [`replay`]: a recording as
//!   files that SUMO plays; [`trace`]: a recording for pictures.

pub(super) mod arriving;
mod at_red;
mod border;
pub mod control;
pub(crate) mod crossings;
pub(super) mod entries;
mod eyes;
pub mod global;
mod light_delays;
pub(crate) mod lights;
pub mod local;
pub(super) mod local_forest;
mod local_routes;
pub(super) mod metrics;
pub(super) mod options;
pub(super) mod others;
mod picture;
pub(crate) mod readings;
pub mod recorded_roads;
pub mod recording;
pub mod replay;
mod route_file;
pub(crate) mod tally;
pub mod trace;
mod trips;
pub(crate) mod visit_tables;
pub(crate) mod visits;
pub(crate) mod watched;

#[cfg(test)]
mod limits_test;
