//! What every crate uses. Nothing here knows about simulators, networks or learning, and nothing does input or output.
//!
//! - `seed`, `purpose`: random streams by name, and the list of their purposes.
//! - [`Rows`], `ragged`, `compact`: tables of one width, of rows of different widths, and of bits.
//! - `stopwatch`: time by activity and phase.
//! - `text`: figures and lines for people. `keys`: the keys of a table.
//! - [`statistics`]: means, intervals and differences.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Makes an enum of plain variants, each with a text, from one list: `ALL` has all of them, and `name` returns the text.
macro_rules! named {
    ($(#[$about:meta])* pub enum $type:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)* }) => {
        $(#[$about])*
        pub enum $type {
            $($(#[$doc])* $variant,)*
        }

        impl $type {
            pub const ALL: [$type; [$($text),*].len()] = [$($type::$variant),*];

            pub fn name(self) -> &'static str {
                match self {
                    $($type::$variant => $text,)*
                }
            }
        }
    };
}

mod compact;
mod keys;
mod purpose;
mod ragged;
mod seed;
pub mod statistics;
mod stopwatch;
mod text;

pub use compact::CompactRows;
pub use keys::keys_of;
pub use purpose::RandomPurpose;
pub use ragged::Ragged;
pub use seed::{Dice, Seed, is_stuck, scramble};
pub use stacknets::Rows;
pub use stopwatch::{Activity, Phase, Stopwatch, Timesheet, Work};
pub use text::{TERMINAL_COLUMNS, counted, decimals, for_terminal, repeated, wrapped};

/// Agent of the whole system, numbered from 0 in the domain's order (traffic: row-major from the south-west corner).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct AgentId(pub usize);

impl AgentId {
    /// Returns the agents `0..count`.
    pub fn all(count: usize) -> Vec<AgentId> {
        (0..count).map(AgentId).collect()
    }
}

impl fmt::Display for AgentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
