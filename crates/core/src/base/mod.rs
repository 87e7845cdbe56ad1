//! What every room uses. Nothing here knows about simulators, networks or learning, and nothing here does input or
//! output.
//!
//! - `seed`, `purpose`: random streams by name, and the list of their purposes.
//! - [`Rows`], `ragged`, `compact`: tables of one width, of rows of different widths, and of bits.
//! - `units`: ids of agents and other units.
//! - `stopwatch`: time by activity and phase; `work`: where a long computation reports its times and its progress.
//! - `counted`: numbers of things, in the singular or the plural. `decimals`: how many digits a figure needs. `wrapped`:
//!   text in lines of a limited width. `repeated`: what stands twice in a list. `keys`: the keys of a table.
//! - [`statistics`]: means, intervals and differences.

mod compact;
mod counted;
mod decimals;
mod keys;
mod purpose;
mod ragged;
mod repeated;
mod seed;
pub mod statistics;
mod stopwatch;
mod units;
mod work;
mod wrapped;

pub use compact::CompactRows;
pub use counted::counted;
pub use decimals::decimals;
pub use keys::keys_of;
pub use purpose::RandomPurpose;
pub use ragged::Ragged;
pub use repeated::repeated;
pub use seed::{Dice, Seed, is_stuck, scramble};
pub use stacknets::Rows;
pub use stopwatch::{Activity, Phase, Stopwatch, Timesheet};
pub use units::AgentId;
pub use work::Work;
pub use wrapped::{TERMINAL_COLUMNS, for_terminal, wrapped};
