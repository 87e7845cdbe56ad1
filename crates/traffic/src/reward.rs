//! What an agent is paid for a step. Pure.

use std::collections::HashMap;

use super::agents::region_plan::RegionPlan;
use super::cars_at::CarsAt;
use super::observe;
use crate::config::{Reward, RewardTerm};
use crate::sim::others::OthersNow;
use libsumo::CarId;

/// Number of cars that count 1 in the terms `queue`, `lost-time`, `pressure`, `stops` and `passed`.
const CARS: f64 = 10.0;
/// Number of persons that count 1.
pub(crate) const PERSONS: f64 = 10.0;
/// Seconds of waiting that count 1 in the terms `wait` and `diff-waiting-time`.
const WAITING_S: f64 = 100.0;
/// Most that the term `wait` counts, so that one jam does not outweigh all else.
const MOST_WAIT: f64 = 10.0;

/// Grams of CO2 that count 1.
const CO2_G: f64 = 100.0;

/// How long the cars on the approaches of one light have stood there, and what else is noted second by second.
#[derive(Clone, Debug, Default)]
pub(crate) struct Waiting {
    /// Seconds that each car has stood, and whether it stands now.
    seconds: HashMap<CarId, (u32, bool)>,
    /// Sum over the cars, and the sum at the last decision.
    sum: u64,
    sum_before: u64,
    /// Cars that came to a stand, cars that left, and CO2 that was emitted, since the decision.
    stops: u32,
    passed: u32,
    co2_g: f64,
}

impl Waiting {
    pub(crate) fn note(&mut self, cars: CarsAt<'_>) {
        let mut seconds = HashMap::with_capacity(cars.cars());
        self.sum = 0;
        for lane in cars.iter() {
            for (car, stands) in lane.standing() {
                // A car that is first seen standing, such as one that enters, has not come to a stand here.
                let (before, stood) = self.seconds.get(&car).copied().unwrap_or((0, stands));
                let waited = before + u32::from(stands);
                self.sum += u64::from(waited);
                self.stops += u32::from(stands && !stood);
                seconds.insert(car, (waited, stands));
            }
        }
        let gone = self.seconds.keys().filter(|car| !seconds.contains_key(car)).count();
        self.passed += u32::try_from(gone).expect("a light has fewer cars");
        self.seconds = seconds;
    }

    pub(crate) fn of(&self, car: CarId) -> u32 {
        self.seconds.get(&car).map_or(0, |&(waited, _)| waited)
    }

    /// Notes the CO2 of a second, in mg.
    pub(crate) fn note_co2(&mut self, mg: f64) {
        self.co2_g += mg / 1e3;
    }

    pub(crate) fn decide(&mut self) {
        self.sum_before = self.sum;
        (self.stops, self.passed, self.co2_g) = (0, 0, 0.0);
    }
}

pub(crate) fn needs_waiting(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| {
        matches!(term, RewardTerm::Wait | RewardTerm::DiffWaitingTime | RewardTerm::Stops | RewardTerm::Passed)
    })
}

pub(crate) fn needs_co2(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| term == RewardTerm::Co2)
}

pub(crate) fn needs_others(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| term == RewardTerm::BusDelay)
}

pub(crate) fn needs_people(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| term == RewardTerm::PersonWait)
}

pub(crate) fn needs_exits(reward: &Reward) -> bool {
    reward.terms().any(|(term, _)| matches!(term, RewardTerm::ExitSpeed | RewardTerm::Pressure | RewardTerm::RootQueue))
}

/// Returns the reward of a step: the weighted sum of its terms after the step. `exits`: the cars on the exits; `others`: buses, if a
/// term needs them; `people`: persons who stand at each crossing.
pub(crate) fn reward(
    reward: &Reward,
    region: &RegionPlan,
    cars: CarsAt<'_>,
    exits: CarsAt<'_>,
    waiting: &Waiting,
    others: Option<&OthersNow>,
    people: &[u32],
) -> f32 {
    let standing = |cars: CarsAt<'_>| cars.iter().map(|lane| lane.halting()).sum::<usize>() as f64;
    let term = |term| match term {
        RewardTerm::MeanSpeed => f64::from(observe::mean_speed(region, cars)),
        RewardTerm::ExitSpeed => observe::exit_speed(region, exits),
        RewardTerm::Queue => -standing(cars) / CARS,
        RewardTerm::RootQueue => -(standing(cars) + standing(exits)).sqrt(),
        RewardTerm::LostTime => -observe::cars_lost(region, cars) / CARS,
        RewardTerm::Pressure => (exits.cars() as f64 - cars.cars() as f64) / CARS,
        RewardTerm::Wait => -(waiting.sum as f64 / WAITING_S).min(MOST_WAIT),
        RewardTerm::BusDelay => -others.map_or(0.0, |others| others.lost),
        RewardTerm::PersonWait => -f64::from(people.iter().sum::<u32>()) / PERSONS,
        RewardTerm::Stops => -f64::from(waiting.stops) / CARS,
        RewardTerm::Passed => f64::from(waiting.passed) / CARS,
        RewardTerm::Co2 => -waiting.co2_g / CO2_G,
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
    fn stops_passed_cars_and_co2_are_those_since_the_decision() {
        let mut waiting = Waiting::default();
        // Car 1 enters standing, car 2 comes to a stand; then car 1 moves and stands again, and car 2 leaves.
        for seconds in [&[(1, 0.0), (2, 9.0)][..], &[(1, 0.0), (2, 0.0)], &[(1, 3.0), (2, 0.0)], &[(1, 0.0)]] {
            waiting.note(CarsAt::all(&west(seconds)));
            waiting.note_co2(12_500.0);
        }
        let cars = west(&[]);
        let of = |term, waiting: &Waiting| {
            let cars = CarsAt::all(&cars);
            reward(&Reward::from(term), &middle().region, cars, cars, waiting, None, &[])
        };
        let counted =
            |waiting: &Waiting| [RewardTerm::Stops, RewardTerm::Passed, RewardTerm::Co2].map(|term| of(term, waiting));
        assert_eq!(counted(&waiting), [-0.2, 0.1, -0.5]);
        waiting.decide();
        assert_eq!(counted(&waiting), [0.0; 3]);
    }

    #[test]
    fn the_root_of_a_queue_counts_a_car_less_in_a_jam_and_as_much_behind_the_light() {
        let paid = |before: u64, behind: u64| {
            let standing = |count: u64| west(&(0..count).map(|id| (id, 0.0)).chain([(99, 5.0)]).collect::<Vec<_>>());
            let [before, behind] = [before, behind].map(standing);
            let term = Reward::from(RewardTerm::RootQueue);
            reward(&term, &middle().region, CarsAt::all(&before), CarsAt::all(&behind), &Waiting::default(), None, &[])
        };
        assert_eq!([paid(0, 0), paid(1, 0), paid(4, 0), paid(3, 1), paid(0, 4)], [0.0, -1.0, -2.0, -2.0, -2.0]);
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
            &[],
        );
        assert_eq!(f64::from(wait), -MOST_WAIT);
    }
}
