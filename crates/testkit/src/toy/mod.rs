//! The smallest possible domains, with answers in closed form, for tests and as examples.
//!
//! - `coins`: two coupled coins, one kind of agents.
//! - `coins_and_dice`: two kinds of agents, one with action masks.

mod coins;
mod coins_and_dice;
mod game;

pub use coins::{Coins, NOISE};
pub use coins_and_dice::CoinsAndDice;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use dials_core::base::Seed;
    use dials_core::domain::Domain;
    use dials_learn::evaluation::play;

    #[test]
    fn toys_are_exact_and_the_best_controller_earns_everything_and_a_random_one_half() {
        for toy in [&Coins::new(1000) as &dyn Domain, &CoinsAndDice::new(1000)] {
            let measured = conformance::check(toy, Seed::new(1)).unwrap();
            assert_eq!((measured.recall, measured.precision, measured.reward_error), (1.0, 1.0, 0.0));
            let returns = |name: &str| {
                let mut baseline = toy.baseline(name).unwrap();
                play(&mut *baseline.simulator, &mut *baseline.controller, Seed::new(3)).unwrap().returns
            };
            assert!(returns(toy.baselines()[1]).iter().all(|&total| total == 1000.0));
            // 1000 fair coins: standard deviation sqrt(250) = 16.
            assert!(returns("random").iter().all(|total| (total - 500.0).abs() < 64.0), "{:?}", returns("random"));
        }
    }
}
