//! What hand-coded controllers see of the intersections. It is more than an agent observes: also queues and the cars
//! that have left. Learning uses none of it.

use std::ops::Range;

use crate::agents::phase_plan::Shown;
use crate::agents::plan::AgentPlan;
use dials_core::base::AgentId;
use libsumo::{CarTable, LaneCars};

/// All intersections, as they are after the last step.
pub struct Intersections<'a> {
    pub(crate) plans: &'a [AgentPlan],
    /// What every light showed in the last step, and for how many steps.
    pub(crate) shown: &'a [Shown],
    pub(crate) shown_steps: &'a [u32],
    /// Cars on the approaches and on the exits of all agents, agent by agent.
    pub(crate) approaches: &'a CarTable,
    pub(crate) exits: &'a CarTable,
}

impl<'a> Intersections<'a> {
    /// Returns the intersections, one per agent, in the order of the agents.
    pub fn iter(&self) -> impl Iterator<Item = Intersection<'a>> {
        let (mut approaches, mut exits) = (0, 0);
        let &Intersections { plans, shown, shown_steps, approaches: cars, exits: gone } = self;
        plans.iter().enumerate().map(move |(row, plan)| Intersection {
            plan,
            agent: AgentId(row),
            shown: shown[row],
            shown_steps: shown_steps[row],
            approaches: lanes(cars, take(&mut approaches, plan.region.approaches.len())),
            exits: lanes(gone, take(&mut exits, plan.region.exits.len())),
        })
    }
}

/// Returns the next `count` numbers from `from` on, and moves `from` behind them.
fn take(from: &mut usize, count: usize) -> Range<usize> {
    let taken = *from..*from + count;
    *from = taken.end;
    taken
}

fn lanes(cars: &CarTable, range: Range<usize>) -> Vec<LaneCars<'_>> {
    range.map(|lane| cars.lane(lane)).collect()
}

/// One intersection.
pub struct Intersection<'a> {
    pub(super) plan: &'a AgentPlan,
    pub(super) agent: AgentId,
    pub(super) shown: Shown,
    pub(super) shown_steps: u32,
    /// Cars on each approach and on each exit, in the order of the plan.
    pub(super) approaches: Vec<LaneCars<'a>>,
    pub(super) exits: Vec<LaneCars<'a>>,
}

impl<'a> Intersection<'a> {
    pub fn agent(&self) -> AgentId {
        self.agent
    }

    /// Returns the lanes, the links and the greens.
    pub fn plan(&self) -> &'a AgentPlan {
        self.plan
    }

    /// Returns what the light showed in the last step; at the beginning of an episode, what it will show.
    pub(crate) fn shown(&self) -> Shown {
        self.shown
    }

    /// Returns the number of steps for which the light has shown that.
    pub fn shown_steps(&self) -> u32 {
        self.shown_steps
    }

    /// Returns the green that is shown; `None` between greens.
    pub fn green(&self) -> Option<usize> {
        self.shown.green()
    }

    /// Returns the green that is shown or comes next. A rule that returns it keeps the light.
    pub fn target(&self) -> usize {
        self.shown.target()
    }

    /// Returns the green that follows this one in the order of the light's program.
    pub fn next(&self, green: usize) -> usize {
        self.plan.phases.next(green)
    }

    /// Returns the greens but this one, from the next one on in the order of the light's program.
    pub fn others(&self, green: usize) -> impl Iterator<Item = usize> {
        let greens = self.plan.greens();
        (1..greens).map(move |steps| (green + steps) % greens)
    }

    /// Returns the cars on an approach.
    pub fn cars(&self, approach: usize) -> LaneCars<'a> {
        self.approaches[approach]
    }

    /// Returns the cars on an exit.
    pub(crate) fn exit_cars(&self, exit: usize) -> LaneCars<'a> {
        self.exits[exit]
    }

    /// Returns the number of standing cars on an approach.
    pub fn queue(&self, approach: usize) -> usize {
        self.cars(approach).halting()
    }

    /// Returns the speeds of the cars on an approach that are less than `metres` before the stop line.
    pub(crate) fn speeds_within(&self, approach: usize, metres: f64) -> impl Iterator<Item = f64> {
        let lane = &self.plan.region.approaches[approach];
        let (length_m, ahead_m) = (lane.length_m, lane.ahead_m);
        let cars = self.cars(approach).iter();
        cars.filter(move |car| length_m - car.position_m + ahead_m < metres).map(|car| car.speed_mps)
    }

    /// Returns whether a car on an approach is less than `metres` before the stop line.
    pub(crate) fn has_car_within(&self, approach: usize, metres: f64) -> bool {
        self.speeds_within(approach, metres).next().is_some()
    }

    /// Returns whether a green is in use: a car is less than `metres` before a stop line that it opens. On a lane that
    /// it opens in part, only a car that moves counts: one that stands waits for another green.
    pub(crate) fn uses(&self, green: usize, metres: f64) -> bool {
        self.plan.served(green).any(|approach| {
            let whole = self.plan.share(green, approach) == 1.0;
            self.speeds_within(approach, metres).any(|speed_mps| whole || speed_mps >= MOVING_MPS)
        })
    }

    /// Returns whether a car may want green `wanted`: it is less than `metres` before a stop line, and `wanted` opens a
    /// link of its lane that green `shown` does not.
    pub(crate) fn wants(&self, wanted: usize, shown: usize, metres: f64) -> bool {
        let opened = |&link: &usize| self.plan.opens(wanted, link) && !self.plan.opens(shown, link);
        self.plan
            .region
            .approaches
            .iter()
            .enumerate()
            .any(|(approach, lane)| lane.links.iter().any(opened) && self.has_car_within(approach, metres))
    }
}

/// Speed from which a car moves.
const MOVING_MPS: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{At, crossing};

    #[test]
    fn distances_to_the_stop_line_include_what_lies_ahead_of_a_lane() {
        let plan = crossing();
        // Lane 4 ends 10 m before the stop line.
        let at = At::new(&plan, Shown::Green(0)).cars(4, &[(20.0, 5.0)]).build();
        assert!(!at.has_car_within(4, 30.0) && at.has_car_within(4, 30.1));
    }
}
