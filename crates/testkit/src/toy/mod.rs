//! The smallest possible domains, with answers in closed form, for tests and as examples.
//!
//! - `coins`: two coupled coins, one kind of agents.
//! - `coins_and_dice`: two kinds of agents, one with action masks.

mod coins;
mod coins_and_dice;
mod game;

pub use coins::{Coins, NOISE};
pub use coins_and_dice::CoinsAndDice;
