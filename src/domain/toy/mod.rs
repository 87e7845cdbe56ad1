//! The smallest domains there are, with closed-form answers, for tests and as examples.
//!
//! - [`coins`]: two coupled coins, one kind of agents.

mod coins;

pub use coins::{Coins, NOISE};
