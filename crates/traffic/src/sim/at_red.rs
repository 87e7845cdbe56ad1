//! How long cars stand before a red light.

use crate::agents::phase_plan::Shown;
use crate::agents::plan::AgentPlan;
use crate::cars_at::CarsAt;

/// The longest time that somebody has stood before the red light of an agent, in an episode.
#[derive(Clone, Debug, Default)]
pub(super) struct AtRed {
    /// Seconds for which somebody has stood on the lane of each approach without green.
    standing_s: Vec<u32>,
    longest_s: u32,
}

impl AtRed {
    pub(super) fn longest_s(&self) -> u32 {
        self.longest_s
    }

    /// Notes a second. Lanes further up, and those that no green lets go, have no red light of their own. Between two greens no lane
    /// has green.
    pub(super) fn note(&mut self, agent: &AgentPlan, shown: Shown, cars: CarsAt<'_>) {
        self.standing_s.resize(agent.region.approaches.len(), 0);
        for (approach, (lane, standing_s)) in agent.region.approaches.iter().zip(&mut self.standing_s).enumerate() {
            let is_red = || shown.green().is_none_or(|green| !agent.serves(green, approach));
            let has_green = || (0..agent.greens()).any(|green| agent.serves(green, approach));
            // Most lanes have nobody who stands, so the greens are asked last.
            let waits = lane.ahead_m == 0.0 && cars.lane(approach).halting() > 0 && is_red() && has_green();
            *standing_s = if waits { *standing_s + 1 } else { 0 };
            self.longest_s = self.longest_s.max(*standing_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cars_at::no_cars;
    use crate::controllers::examples::crossing;
    use libsumo::{CarId, CarTable};

    #[test]
    fn the_longest_wait_counts_only_seconds_of_red_with_somebody_there() {
        let agent = crossing();
        let lanes = agent.region.approaches.len();
        let [west, south, far] = ["west_0", "south_0", "far_east_0"]
            .map(|lane| agent.region.approaches.iter().position(|approach| approach.lane == lane).unwrap());
        let opens = |lane: usize| (0..agent.greens()).find(|&green| agent.serves(green, lane)).unwrap();
        let [to_west, to_south] = [opens(west), opens(south)];
        assert!(!agent.serves(to_south, west));
        let standing = |lane: usize, speed_mps: f64| {
            let car = |number| if number == lane { vec![(CarId(1), 30.0, speed_mps)] } else { Vec::new() };
            CarTable::of((0..lanes).map(car))
        };
        let mut at_red = AtRed::default();
        let mut note = |seconds: u32, shown: Shown, cars: &CarTable| {
            (0..seconds).for_each(|_| at_red.note(&agent, shown, CarsAt::all(cars)));
            at_red.longest_s()
        };
        let (red, between) = (Shown::Green(to_south), Shown::Between { from: to_south, to: to_west });
        assert_eq!(note(5, Shown::Green(to_west), &standing(west, 0.0)), 0, "a queue that may go");
        assert_eq!(note(5, red, &standing(west, 3.0)), 0, "it drives");
        assert_eq!(note(5, red, &standing(far, 0.0)), 0, "it stands further up");
        assert_eq!(note(4, red, &standing(west, 0.0)), 4);
        assert_eq!(note(3, between, &standing(west, 0.0)), 7);
        assert_eq!(note(1, red, &no_cars(lanes)), 7);
        assert_eq!(note(6, red, &standing(west, 0.0)), 7, "it began again");
        assert_eq!(note(2, red, &standing(west, 0.0)), 8);
    }
}
