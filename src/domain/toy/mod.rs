//! The smallest domains there are, with closed-form answers, for tests and as examples.
//!
//! - `coins`: two coupled coins, one kind of agents.
//! - `coins_and_dice`: two kinds of agents, of which one has action masks.

mod coins;
mod coins_and_dice;

pub use coins::{Coins, NOISE};
pub use coins_and_dice::CoinsAndDice;
