//! The simulators of traffic on SUMO.
//!
//! - [`global`]: the global simulator (GS), a whole grid with inflow at its boundary; [`control`]: who runs its lights;
//!   `decisions`: what they decide; `shown_lights`: what the lights show.
//! - [`local`]: the local simulators (LS), a forest of single intersections.
//! - [`local_scenario`]: the LS of a scenario, different nets side by side, which `local_forest` loads. `entrance`: cars
//!   that come in; `ways`: their routes; `doors`: where they wait, and exits that are blocked.
//! - `border`: arrivals and blocked exits of a scenario's regions; [`visits`]: all visits of cars to them;
//!   [`visit_tables`]: cars drawn from visits. `visits_as_bytes`: visits for other processes.
//! - `handles`: the intersections of a loaded net; `options`: SUMO's options.
//! - [`tally`]: what every episode counts; `metrics`, `trips`: what only evaluations measure.
//! - `picture`: pictures of the GS. [`recording`]: an episode recorded, on [`recorded_roads`]; `recorded_local`: those of
//!   one light. [`replay`]: a recording as files that SUMO plays;
//!   [`trace`]: a recording for pictures.

mod border;
pub mod control;
mod decisions;
pub(super) mod doors;
pub(super) mod entrance;
pub mod global;
mod handles;
pub mod local;
pub(super) mod local_forest;
pub(crate) mod local_scenario;
pub(super) mod metrics;
pub(super) mod options;
mod picture;
pub(super) mod recorded_local;
pub mod recorded_roads;
pub mod recording;
pub mod replay;
mod shown_lights;
pub(crate) mod tally;
pub mod trace;
mod trips;
pub(crate) mod visit_tables;
pub(crate) mod visits;
pub(super) mod visits_as_bytes;
mod ways;
