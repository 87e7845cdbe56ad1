//! Plans to put back: timings of all lights, as files that plain SUMO loads and as sheets that engineers read.
//!
//! - [`DayPlan`]: timings for one period of the day after the other. `make`: from the name of a controller; `periods`:
//!   when the demand changes; `coordinate`: offsets that suit the traffic; [`freeze`]: from what lights have shown.
//! - [`programs`]: the plan as an additional file. [`sheets`]: the plan as rows and bars. `plain`: how to play it.

mod coordinate;
mod day;
pub mod freeze;
mod make;
mod periods;
mod plain;
pub mod programs;
pub mod sheets;

pub use day::DayPlan;
pub use make::{timed, tune};
pub use plain::{PlainRun, plain_run};
