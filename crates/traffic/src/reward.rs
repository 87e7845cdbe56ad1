//! What an agent is paid for a step. Pure.

use std::collections::HashMap;

use super::agents::region_plan::RegionPlan;
use super::cars_at::CarsAt;
use super::observe;
use crate::config::{Reward, RewardTerm};
use crate::sim::others::OthersNow;
use libsumo::CarId;

/// Number of cars that count 1 in the terms `queue`, `lost-time` and `pressure`.
const CARS: f64 = 10.0;
/// Number of persons that count 1.
pub(crate) const PERSONS: f64 = 10.0;
/// Seconds of waiting that count 1 in the terms `wait` and `diff-waiting-time`.
const WAITING_S: f64 = 100.0;
/// Most that the term `wait` counts, so that one jam does not outweigh all else.
const MOST_WAIT: f64 = 10.0;

/// How long the cars on the approaches of one light have stood there.
#[derive(Clone, Debug, Default)]
pub(crate) struct Waiting {
    seconds: HashMap<CarId, u32>,
    /// Sum over the cars, and the sum at the last decision.
    sum: u64,
    sum_before: u64,
}

impl Waiting {
    pub(crate) fn note(&mut self, cars: CarsAt<'_>) {
        let mut seconds = HashMap::with_capacity(cars.cars());
        self.sum = 0;
        for lane in cars.iter() {
            for (car, stands) in lane.standing() {
                let waited = self.seconds.get(&car).copied().unwrap_or(0) + u32::from(stands);
                self.sum += u64::from(waited);
                seconds.insert(car, waited);
            }
        }
        self.seconds = seconds;
    }

    pub(crate) fn of(&self, car: CarId) -> u32 {
        self.seconds.get(&car).copied().unwrap_or(0)
    }

    pub(crate) fn decide(&mut self) {
        self.sum_before = self.sum;
    }
}

pub(crate) fn needs_waiting(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| matches!(term, RewardTerm::Wait | RewardTerm::DiffWaitingTime))
}

pub(crate) fn needs_others(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| matches!(term, RewardTerm::BusDelay | RewardTerm::PersonWait))
}

pub(crate) fn needs_exits(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| matches!(term, RewardTerm::ExitSpeed | RewardTerm::Pressure))
}

/// Returns the reward of a step: the weighted sum of its terms after the step. `exits`: the cars on the exits; `others`: buses and
/// persons, if a term needs them.
pub(crate) fn reward(
    reward: &Reward,
    region: &RegionPlan,
    cars: CarsAt<'_>,
    exits: CarsAt<'_>,
    waiting: &Waiting,
    others: Option<&OthersNow>,
) -> f32 {
    let term = |term| match term {
        RewardTerm::MeanSpeed => f64::from(observe::mean_speed(region, cars)),
        RewardTerm::ExitSpeed => observe::exit_speed(region, exits),
        RewardTerm::Queue => -(cars.iter().map(|lane| lane.halting()).sum::<usize>() as f64) / CARS,
        RewardTerm::LostTime => -observe::cars_lost(region, cars) / CARS,
        RewardTerm::Pressure => (exits.cars() as f64 - cars.cars() as f64) / CARS,
        RewardTerm::Wait => -(waiting.sum as f64 / WAITING_S).min(MOST_WAIT),
        RewardTerm::BusDelay => -others.map_or(0.0, |others| others.lost),
        RewardTerm::PersonWait => -others.map_or(0.0, |others| f64::from(others.waiting.iter().sum::<u32>()) / PERSONS),
        RewardTerm::DiffWaitingTime => (waiting.sum_before as f64 - waiting.sum as f64) / WAITING_S,
    };
    reward.terms().map(|(name, weight)| weight * term(name)).sum::<f64>() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::middle;
    use libsumo::CarTable;

    fn west(cars: &[(u64, f64)]) -> CarTable {
        let cars = cars.iter().map(|&(id, speed)| (CarId(id), 50.0, speed)).collect();
        CarTable::of([cars, Vec::new(), Vec::new(), Vec::new()])
    }

    #[test]
    fn a_car_that_left_no_longer_waits_and_a_jam_has_a_bound() {
        let mut waiting = Waiting::default();
        (0..50).for_each(|_| waiting.note(CarsAt::all(&west(&[(1, 0.0), (2, 0.0)]))));
        waiting.decide();
        waiting.note(CarsAt::all(&west(&[(2, 3.0)])));
        assert_eq!((waiting.sum_before, waiting.sum), (100, 50));
        (0..5000).for_each(|_| waiting.note(CarsAt::all(&west(&[(2, 0.0)]))));
        let cars = west(&[(2, 0.0)]);
        let wait = reward(
            &Reward::from(RewardTerm::Wait),
            &middle().region,
            CarsAt::all(&cars),
            CarsAt::all(&cars),
            &waiting,
            None,
        );
        assert_eq!(f64::from(wait), -MOST_WAIT);
    }
}
